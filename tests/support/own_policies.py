"""Dispatch policies of a user's own, in a file that every process of a test finds: one that sends carriers too early, and faulty ones."""

from orchard import Assignment, BinReport


class AtOnce:
    """An early policy that sends a carrier as soon as a bin reports: much too early."""

    Memory = dict
    early = True

    def __init__(self, layout):
        pass

    def assign(self, now, bins, carriers, memory):
        free = [carrier.name for carrier in carriers if carrier.is_next]
        return [Assignment(report.name, carrier) for report, carrier in zip(bins, free, strict=False)]


class Bad:
    Memory = dict

    def __init__(self, layout):
        pass


class Raising(Bad):
    def assign(self, now, bins, carriers, memory):
        raise LookupError("no such bin here")


class Inventing(Bad):
    def assign(self, now, bins, carriers, memory):
        bins.append(BinReport("bin_77", 1, "east", "picker_01", 0, 0.0))
        return [Assignment("bin_77", "carrier_01")]


class Overworking(Bad):
    def assign(self, now, bins, carriers, memory):
        return [Assignment(report.name, "carrier_01") for report in bins] * 2


class Leaving(Bad):
    def assign(self, now, bins, carriers, memory):
        raise SystemExit(0)


class Hoarding(Bad):
    def assign(self, now, bins, carriers, memory):
        memory["past"] = "x" * 20_000
        return []


class Silent(Bad):
    def assign(self, now, bins, carriers, memory):
        memory["bins"] = set(bins)


class Idle(Bad):
    def assign(self, now, bins, carriers, memory):
        return []


class FarthestOfMine(Bad):
    """Farthest first, as a reader of docs/extending.md would write it."""

    def assign(self, now, bins, carriers, memory):
        far = sorted((report for report in bins if report.seconds_to_full <= 0.0), key=lambda report: -report.lane)
        free = [carrier.name for carrier in carriers if carrier.is_next]
        return [Assignment(report.name, carrier) for report, carrier in zip(far, free, strict=False)]
