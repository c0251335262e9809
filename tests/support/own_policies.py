"""Dispatch policies as a user writes them: classes that a scenario names as `own_policies.AtOnce`.

Some work, well or badly, and some are faulty: tests look at what is said of each fault. They stand
in a module of their own because each process of a run imports them by this name.
docs/extending.md describes the arguments of `assign`.
"""

import os
from collections import Counter

from orchard import Assignment, BinReport


class Own:
    """What the policies of this file have in common. A policy needs no base class."""

    Memory = dict

    def __init__(self, layout):
        pass

    def assign(self, now, bins, carriers, memory):
        return []


class Lacking(Own):
    """Cannot be made: a package that it needs is missing."""

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
    """Sends a carrier only while no carrier has a job, and there are two carriers or more."""

    def assign(self, now, bins, carriers, memory):
        free = [carrier.name for carrier in carriers if carrier.is_next]
        is_quiet = all(not carrier.job for carrier in carriers) and len(carriers) > 1
        return [Assignment(bins[0].name, free[0])] if is_quiet and bins and free else []


class Raising(Own):
    """Raises an error at each decision."""

    def assign(self, now, bins, carriers, memory):
        raise LookupError("no such bin here")


class Inventing(Own):
    """Assigns a bin that does not exist, which it has added to the list that it was given."""

    def assign(self, now, bins, carriers, memory):
        bins.append(BinReport("bin_77", 1, "east", "picker_01", 0, 0.0))
        return [Assignment("bin_77", "carrier_01")]


class Overworking(Own):
    """Assigns each bin twice, and all bins to one carrier."""

    def assign(self, now, bins, carriers, memory):
        return [Assignment(report.name, "carrier_01") for report in bins] * 2


class Leaving(Own):
    """Ends its process, as `sys.exit` does."""

    def assign(self, now, bins, carriers, memory):
        raise SystemExit(0)


class Hoarding(Own):
    """Remembers 20,000 letters, more than `LARGEST_POLICY_MEMORY` allows."""

    def assign(self, now, bins, carriers, memory):
        memory["past"] = "x" * 20_000
        return []


class Silent(Own):
    """Returns None in place of a list, and remembers a set, which no message can carry."""

    def assign(self, now, bins, carriers, memory):
        memory["bins"] = set(bins)


class Idle(Own):
    """Never sends a carrier."""

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


class NoMaker(Own):
    """Its memory is a number in place of a class."""

    Memory = 7


class Unmade(Own):
    """Its memory cannot be made."""

    class Memory:
        """Raises when it is made."""

        def __init__(self):
            raise ValueError("no memory today")


class Unkept(Own):
    """Its memory is of a plain class, which no message can carry."""

    class Memory:
        """Of no type that msgpack knows."""


class Named(Own):
    """Names a policy in place of deciding."""

    assign = "nearest"


class NotEarly(Own):
    """Says no in a word that Python takes for yes."""

    early = "no"


class Yielding(Own):
    """Yields its orders in place of returning them."""

    def assign(self, now, bins, carriers, memory):
        yield from ()


class Awaited(Own):
    """Decides in a function that somebody would have to await."""

    async def assign(self, now, bins, carriers, memory):
        return []


class Tupling(Own):
    """Remembers a tuple, which would come back as a list."""

    def assign(self, now, bins, carriers, memory):
        memory["seen"] = (now,)
        return []


class Tallying(Own):
    """Remembers a Counter, which equals the dict as which it would come back."""

    def assign(self, now, bins, carriers, memory):
        memory["asked"] = Counter(bins=1)
        return []


class Remembering(Own):
    """Remembers a function."""

    def assign(self, now, bins, carriers, memory):
        memory["last"] = [len]
        return []


class Talking(AtOnce):
    """Prints a line in each decision."""

    def assign(self, now, bins, carriers, memory):
        print("I decide")
        return super().assign(now, bins, carriers, memory)


class Ending(AtOnce):
    """Ends its process at once."""

    def assign(self, now, bins, carriers, memory):
        os._exit(0)


class Crashing(AtOnce):
    """Lets its process crash."""

    def assign(self, now, bins, carriers, memory):
        os.abort()
