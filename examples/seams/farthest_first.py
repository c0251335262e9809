"""A dispatch policy: the farthest bin first. A carrier that stops near holds up those behind it.

dispatch: examples.seams.farthest_first.FarthestFirst
"""

from orchard import Assignment


class FarthestFirst:
    Memory = dict

    def __init__(self, layout): ...

    def assign(self, now, bins, carriers, memory):
        memory["decisions"] = memory.get("decisions", 0) + 1
        far = sorted(bins, key=lambda report: (-report.metres, report.name))
        free = [carrier.name for carrier in carriers if carrier.is_next]
        # As many as there are of both.
        pairs = zip(far, free, strict=False)
        return [Assignment(report.name, carrier) for report, carrier in pairs]
