"""The tables of physics and hosts: dicts, lists, sets and deques that their objects hold.

They may not grow with ticks, with messages, or with sessions that have gone.
"""

from collections import deque
from collections.abc import Iterator
from functools import cache
from typing import Any

from orchard.net.mailbox import STALE_TICKS
from orchard.net.refusals import Refusals

TABLES = dict, list, set, deque
# Packages whose objects are looked into, but for `Refusals`, whose limit is fixed.
OWNERS = ("orchard.server", "orchard.net")
# Fields that are emptied every RECHECK_SECONDS of publisher.py.
CACHES = ("_heard",)
# Entries of a table that each agent may have.
FOR_EACH_AGENT = 3
# Entries that sessions and kept ticks need beside those of agents.
MORE = 10


def grown(owner: Any, agents: int, mode: str) -> Iterator[str]:
    """Yield a sentence for each table with more entries than so many agents need.

    `owner`: an object. All objects that it refers to, over any number of others, are looked into.
    """
    most = FOR_EACH_AGENT * agents + MORE
    if mode == "realtime":
        most += STALE_TICKS
    remaining = [owner]
    known = {id(owner)}
    while remaining:
        holder = remaining.pop()
        for name, value in getattr(holder, "__dict__", {}).items():
            type_: Any = type(value)
            is_table, is_owner = _kind_of(type_)
            if is_table and len(value) > most and name not in CACHES:
                table = f"{type(holder).__name__}.{name}"
                yield f"grown: {table}: {len(value)} entries; at most {most}"
            elif is_owner and id(value) not in known:
                known.add(id(value))
                remaining.append(value)


@cache
def _kind_of(type_: Any) -> tuple[bool, bool]:
    """Return whether a type is a table, and whether its objects are looked into."""
    is_table = issubclass(type_, TABLES)
    if is_table or issubclass(type_, Refusals):
        return is_table, False
    return False, type_.__module__.startswith(OWNERS)
