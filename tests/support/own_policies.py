"""Dispatch policies of a user's own, in a file that every process of a test finds: one that sends
carriers too early, and faulty ones.
"""

from orchard import Assignment, BinReport


class Own:
    Memory = dict

    def __init__(self, layout):
        pass


class Lacking(Own):
    def __init__(self, layout):
        import no_such_package  # noqa: F401


class AtOnce(Own):
    """An early policy that sends a carrier as soon as a bin reports: much too early."""

    early = True

    def assign(self, now, bins, carriers, memory):
        free = [carrier.name for carrier in carriers if carrier.is_next]
        return [
            Assignment(report.name, carrier) for report, carrier in zip(bins, free, strict=False)
        ]


class OneAtATime(Own):
    """Sends a carrier only while no other one is away, and one stands behind it."""

    def assign(self, now, bins, carriers, memory):
        free = [carrier.name for carrier in carriers if carrier.is_next]
        is_quiet = all(not carrier.job for carrier in carriers) and len(carriers) > 1
        return [Assignment(bins[0].name, free[0])] if is_quiet and bins and free else []


class Raising(Own):
    def assign(self, now, bins, carriers, memory):
        raise LookupError("no such bin here")


class Inventing(Own):
    def assign(self, now, bins, carriers, memory):
        bins.append(BinReport("bin_77", 1, "east", "picker_01", 0, 0.0))
        return [Assignment("bin_77", "carrier_01")]


class Overworking(Own):
    def assign(self, now, bins, carriers, memory):
        return [Assignment(report.name, "carrier_01") for report in bins] * 2


class Leaving(Own):
    def assign(self, now, bins, carriers, memory):
        raise SystemExit(0)


class Hoarding(Own):
    def assign(self, now, bins, carriers, memory):
        memory["past"] = "x" * 20_000
        return []


class Silent(Own):
    def assign(self, now, bins, carriers, memory):
        memory["bins"] = set(bins)


class Idle(Own):
    def assign(self, now, bins, carriers, memory):
        return []


class FarthestOfMine(Own):
    """Farthest first, as a reader of docs/extending.md would write it."""

    def assign(self, now, bins, carriers, memory):
        far = sorted(
            (report for report in bins if report.seconds_to_full <= 0.0),
            key=lambda report: -report.lane,
        )
        free = [carrier.name for carrier in carriers if carrier.is_next]
        return [
            Assignment(report.name, carrier) for report, carrier in zip(far, free, strict=False)
        ]
