"""How good can a harvest be? A proven bound on its time: the jobs of its carriers, and the schedule
of them that ends first.

A copy of a duration or a place may not live here: jobs are read from the plans that robots follow,
as in `orchard.event_model`.
"""


class NoBound(ValueError):
    """Raised for a harvest that has no proven bound; the text says why."""
