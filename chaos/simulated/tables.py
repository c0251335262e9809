"""The tables of physics and hosts: they may not grow with ticks, with messages, or with sessions that have gone."""

from collections import deque
from collections.abc import Iterator
from typing import Any

from orchard.net.mailbox import STALE_TICKS
from orchard.net.refusals import Refusals

TABLES = dict, list, set, deque
OWNERS = "orchard.server", "orchard.net"  # packages whose objects are looked into, but for Refusals: its limit is fixed
CACHES = ("_heard",)  # that are emptied every RECHECK_SECONDS
FOR_EACH_AGENT, MORE = 3, 10  # entries; and what sessions and kept ticks need


def grown(owner: Any, agents: int, mode: str) -> Iterator[str]:
    """Yield a sentence for each table, among all that an object refers to, with more entries than so many agents need."""
    most = FOR_EACH_AGENT * agents + MORE + (STALE_TICKS if mode == "realtime" else 0)
    left, known = [owner], {id(owner)}
    while left:
        one = left.pop()
        for name, value in getattr(one, "__dict__", {}).items():
            if isinstance(value, TABLES):
                if len(value) > most and name not in CACHES:
                    yield f"grown: {type(one).__name__}.{name}: {len(value)} entries; at most {most}"
            elif type(value).__module__.startswith(OWNERS) and not isinstance(value, Refusals) and id(value) not in known:
                known.add(id(value))
                left.append(value)
