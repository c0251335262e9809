"""The jobs of a harvest: how long picker and carrier need for each bin, on free roads.

A job is one exchange of bins, in which a carrier brings an empty bin and takes the full one. The
event model, the bounds and the optimum plan with these times (orchard/plans/jobs.py).
"""

from typing import NamedTuple

import pytest
from made_surveys import UNEQUAL, orchard_of
from stage import empty_orchard

from orchard.field.layout import lay_out
from orchard.plans.jobs import TimedJob, Use, jobs_of

# Each carrier drives its bin 200 m to the load-out at 4 m/s, back again, and spends 20 s there:
# 120 s beside the way to the road that leads there.
HAULS = {"load_out": {"metres": 200.0, "speed": 4.0, "seconds": 20.0}}
BATTERIES = {
    "chargers": 1,
    "carrying": {"battery": {"hours": 0.2, "hours_to_charge": 0.1, "reserve": 0.5}},
}


def jobs(**changes: object) -> list[TimedJob]:
    """Return the jobs of a small orchard with these changes.

    A picker picks its row of 30 m at 0.4 m/s, so in 750 ticks.
    """
    values = {"rows": 3, "pickers": 2, "carriers": 3, "row_length": 30.0, "picking_speed": 0.4}
    return jobs_of(lay_out(empty_orchard(**values | changes)))


class Times(NamedTuple):
    """The times of a job, ticks. `orchard.plans.jobs.TimedJob` says what each of them is."""

    ready: int
    clearing: int
    approach: int
    going_on: int
    to_bay: int
    in_bay: int
    to_head: int
    to_rest: int


def times(job: TimedJob) -> Times:
    return Times(*(getattr(job, field) for field in Times._fields))


# What differs from the orchard of `jobs`, and the times of its first job. `ready` is the 750 ticks
# of picking and `clearing`. The others follow from the lengths of drives, at 1 m/s, from turns of 4
# s, and from the handling of bins; they were read off the plans once, and are kept here, so that a
# change of them is seen.
FIRST_JOBS = {
    "one way": ({"route": "one-way"}, Times(877, 127, 232, 8, 1315, 57, 311, 229)),
    "two ways": ({"route": "two-way", "carriers": 4}, Times(898, 148, 321, 8, 968, 57, 222, 99)),
    "hauls": ({"route": "one-way", **HAULS}, Times(877, 127, 232, 8, 1315, 57, 1371, 1371)),
    "batteries": ({"route": "two-way", **BATTERIES}, Times(898, 148, 251, 8, 968, 57, 262, 221)),
}


def test_a_second_job_counts_from_the_exchange_before():
    """The picker goes on with its empty bin from the exchange, not from its start.

    Its second bin fills inside a row. As for FIRST_JOBS, the times were read off the plans once.
    """
    second = jobs(route="two-way", carriers=4, metres_per_bin=12.5, rows=4)[1]
    assert times(second) == Times(906, 268, 611, 72, 531, 57, 222, 99)


def test_a_lane_is_cleared_as_soon_beside_a_short_row():
    """The drive from the row's end to the furthest end on that side is not counted.

    So all jobs of a side have one time, in ticks, although the rows end at different places. In the
    west it is 2 s longer, as are the drives there.
    """
    clearing = {"east": set(), "west": set()}
    for job in jobs_of(lay_out(orchard_of(UNEQUAL, pickers=2))):
        clearing[job.side].add(job.clearing)
    assert clearing == {"east": {127}, "west": {147}}


@pytest.mark.parametrize("name", FIRST_JOBS)
def test_a_job_takes_what_its_plans_take(name):
    """Sizes, speeds and steps of plans give the times of FIRST_JOBS. A change of those changes
    them.
    """
    changes, expected = FIRST_JOBS[name]
    assert times(jobs(**changes)[0]) == expected


def test_a_carrier_that_comes_last_rests_behind_the_others():
    """It rests sooner than it would reach the head of the line.

    Each carrier before it takes 4.1 m (`CLOSED_UP`) of the line, which are 41 ticks at 1 m/s.
    """
    fleets = [jobs(route="one-way", carriers=carriers)[0] for carriers in (1, 2, 3)]
    assert {job.to_head for job in fleets} == {311}
    assert [job.to_rest for job in fleets] == [311, 311 - 41, 311 - 2 * 41]


def test_a_picker_that_stays_in_its_row_lets_the_carrier_out():
    """It goes back into its row once the carrier has left the lane's place.

    Otherwise it goes on 8 ticks after the carrier's stop, when the bins are handed over.
    """
    in_one_row = jobs(route="two-way", metres_per_bin=12.5, rows=4)
    back = in_one_row[1]
    place = f"{back.side}/D/{back.lane}"
    of_carrier = first_use(back.way, place)
    leaves = 10.0 * of_carrier.at + of_carrier.ticks
    # The picker hears of it one answer, 2 ticks, earlier than others, and times are rounded.
    assert back.going_on == pytest.approx(leaves, abs=3)
    assert [job.going_on for job in in_one_row[:3]] == [8, back.going_on, 8]


def first_use(uses: list[Use], place: str) -> Use:
    """Return the first use of a place on a way."""
    return next(use for use in uses if use.place == place)


def test_a_carrier_stops_once_its_picker_has_left_the_place():
    """The picker's use of the lane's place ends at the moment at which the carrier's begins.

    `at` is in s, and `ticks` are of 0.1 s.
    """
    for job in jobs(route="one-way"):
        place = f"{job.side}/D/{job.lane}"
        of_picker = [use for use in job.crossings if use.place == place][-1]
        of_carrier = first_use(job.way, place)
        assert of_picker.at + 0.1 * of_picker.ticks == pytest.approx(of_carrier.at)


def test_each_line_of_the_queue_has_its_way_to_the_first_lane():
    """The nearest line gives the approach. What all lines share is in the way, and in no exit.

    The lines are 3 m apart, which are 30 ticks at 1 m/s. A carrier from a further line passes the
    place of one line more.
    """
    job = jobs(route="two-way", **BATTERIES)[0]
    assert [(ticks, len(uses)) for ticks, uses in job.exits] == [
        (281, 3),
        (251, 2),
        (311, 4),
        (341, 5),
    ]
    assert job.approach == min(ticks for ticks, _ in job.exits)
    for _, uses in job.exits:
        assert max(use.at for use in uses) < min(use.at for use in job.way)
