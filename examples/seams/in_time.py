"""An early policy: carriers leave before a bin is full, the farthest first, 3 s apart or more.

dispatch: examples.seams.in_time.InTime
"""

import msgspec

from orchard import Assignment

APART = 30  # ticks between two carriers, 3 s


class InTime:
    early = True  # bins report before they are full

    class Memory(msgspec.Struct):
        left: int = -1000  # tick at which the last carrier was sent

    def __init__(self, layout): ...

    def assign(self, now, bins, carriers, memory):
        due = [report for report in bins if report.seconds_to_full <= report.seconds_to_reach]
        free = [carrier.name for carrier in carriers if carrier.is_next]
        if not due or not free or now - memory.left < APART:
            return []
        memory.left = now
        farthest = max(due, key=lambda report: (report.metres, report.name))
        return [Assignment(farthest.name, free[0])]
