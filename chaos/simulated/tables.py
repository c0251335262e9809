"""The tables of physics and hosts: they may not grow with ticks, with messages, or with sessions
that have gone.
"""

from collections import deque
from collections.abc import Iterator
from functools import cache
from typing import Any

from orchard.net.mailbox import STALE_TICKS
from orchard.net.refusals import Refusals

TABLES = dict, list, set, deque
OWNERS = (
    "orchard.server",
    "orchard.net",
)  # packages whose objects are looked into, but for Refusals: its limit is fixed
CACHES = ("_heard",)  # that are emptied every RECHECK_SECONDS
FOR_EACH_AGENT = 3  # entries
# Entries that sessions and kept ticks need beside those of agents.
MORE = 10


def grown(owner: Any, agents: int, mode: str) -> Iterator[str]:
    """Yield a sentence for each table, among all that an object refers to, with more entries than
    so many agents need.
    """
    most = FOR_EACH_AGENT * agents + MORE + (STALE_TICKS if mode == "realtime" else 0)
    left = [owner]
    known = {id(owner)}
    while left:
        one = left.pop()
        for name, value in getattr(one, "__dict__", {}).items():
            type_: Any = type(value)
            is_table, is_owner = _kind_of(type_)
            if is_table and len(value) > most and name not in CACHES:
                yield f"grown: {type(one).__name__}.{name}: {len(value)} entries; at most {most}"
            elif is_owner and id(value) not in known:
                known.add(id(value))
                left.append(value)


@cache
def _kind_of(type_: Any) -> tuple[bool, bool]:
    """Whether it is a table, and whether its objects are looked into."""
    is_table = issubclass(type_, TABLES)
    return is_table, not is_table and type_.__module__.startswith(OWNERS) and not issubclass(
        type_, Refusals
    )
