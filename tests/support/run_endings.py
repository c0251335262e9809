"""Made summaries of runs, for tests of the words in which the end of a run is printed."""

from orchard.report.summary import Outcome


def harvested(**changes: object) -> Outcome:
    """Return the summary of a harvest of five rows that went well, with some figures changed.

    The figures are those of one run of the default orchard. Tests look for them in the words, or
    put other ones in their place.
    """
    figures = dict(
        hash="0" * 64,
        ticks=9698,
        sim_seconds=969.8,
        wall_seconds=13.6,
        finished=True,
        ended="harvested",
        rows=5,
        bins=5,
        rows_picked=5,
        row_length=70.0,
        metres_picked=350.0,
        bins_delivered=5,
        bins_per_hour=18.56,
        limit_bins_per_hour=24.94,
        bottleneck="carriers",
        lost_seconds={},
        violations=[],
        broken_agents=[],
        jam=[],
        times_real_time=71.3,
        schedule_sim_seconds=891.0,
        carrier_utilisation=0.8,
        state_seconds={},
    )
    return Outcome(**figures | changes)
