"""How good can a harvest be? A proven bound on its time: the jobs of its carriers, and the schedule
of them that ends first.

No duration and no place is written down here: the jobs are computed from the plans that robots
follow (`orchard.plans.jobs`), so that a changed plan changes the bound too.
"""


class NoBound(ValueError):
    """Raised for a harvest that has no proven bound; the text says why."""
