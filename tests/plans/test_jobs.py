"""The jobs of a harvest: how long picker and carrier need for each bin, on free roads."""

from typing import NamedTuple

import pytest
from made_surveys import UNEQUAL, orchard_of
from stage import empty_orchard

from orchard.field.layout import lay_out
from orchard.plans.jobs import TimedJob, jobs_of

HAULS = {"load_out": {"metres": 200.0, "speed": 4.0, "seconds": 20.0}}
BATTERIES = {
    "chargers": 1,
    "carrying": {"battery": {"hours": 0.2, "hours_to_charge": 0.1, "reserve": 0.5}},
}


def jobs(**changes: object) -> list[TimedJob]:
    """Return the jobs of a small orchard with these changes."""
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


# What differs from the orchard of `jobs`, and the times of its first job.
FIRST_JOBS = {
    "one way": ({"route": "one-way"}, Times(877, 127, 232, 8, 1315, 57, 311, 229)),
    "two ways": ({"route": "two-way", "carriers": 4}, Times(898, 148, 321, 8, 968, 57, 222, 99)),
    "hauls": ({"route": "one-way", **HAULS}, Times(877, 127, 232, 8, 1315, 57, 1371, 1371)),
    "batteries": ({"route": "two-way", **BATTERIES}, Times(898, 148, 251, 8, 968, 57, 262, 221)),
}


def test_a_second_job_counts_from_the_exchange_before():
    """The picker goes on with its empty bin from the exchange, not from its start."""
    second = jobs(route="two-way", carriers=4, metres_per_bin=12.5, rows=4)[1]
    assert times(second) == Times(906, 268, 611, 72, 531, 57, 222, 99)


def test_a_lane_is_cleared_as_soon_beside_a_short_row():
    """The drive from the row's end to the furthest end on that side is not counted."""
    clearing = {"east": set(), "west": set()}
    for job in jobs_of(lay_out(orchard_of(UNEQUAL, pickers=2))):
        clearing[job.side].add(job.clearing)
    assert clearing == {"east": {127}, "west": {147}}


@pytest.mark.parametrize("name", FIRST_JOBS)
def test_a_job_takes_what_its_plans_take(name):
    """Sizes, speeds and steps of plans give these times. A change of those changes these."""
    changes, expected = FIRST_JOBS[name]
    assert times(jobs(**changes)[0]) == expected


def test_a_carrier_that_comes_last_rests_behind_the_others():
    """It is home sooner than at the head of the line, by the length of the carriers before it."""
    fleets = [jobs(route="one-way", carriers=carriers)[0] for carriers in (1, 2, 3)]
    assert {job.to_head for job in fleets} == {311}
    assert [job.to_rest for job in fleets] == [311, 270, 229]


def test_a_picker_that_stays_in_its_row_lets_the_carrier_out():
    """It goes back into its row once the carrier has left the lane's place."""
    in_one_row = jobs(route="two-way", metres_per_bin=12.5, rows=4)
    back = in_one_row[1]
    place = f"{back.side}/D/{back.lane}"
    of_carrier = next(use for use in back.way if use.place == place)
    leaves = 10.0 * of_carrier.at + of_carrier.ticks
    assert back.going_on == pytest.approx(leaves, abs=3)
    assert [job.going_on for job in in_one_row[:3]] == [8, 72, 8]


def test_a_carrier_stops_once_its_picker_has_left_the_place():
    """The picker's use of the place ends at the carrier's stop, where the carrier's use begins."""
    for job in jobs(route="one-way"):
        place = f"{job.side}/D/{job.lane}"
        of_picker = [use for use in job.crossings if use.place == place][-1]
        of_carrier = next(use for use in job.way if use.place == place)
        assert of_picker.at + 0.1 * of_picker.ticks == pytest.approx(of_carrier.at)


def test_each_line_of_the_queue_has_its_way_to_the_first_lane():
    """The nearest line gives the approach. What all lines share is in the way, and in no exit."""
    job = jobs(route="two-way", **BATTERIES)[0]
    assert [(ticks, len(uses)) for ticks, uses in job.exits] == [
        (281, 3),
        (251, 2),
        (311, 4),
        (341, 5),
    ]
    assert job.approach == 251
    for _, uses in job.exits:
        assert max(use.at for use in uses) < min(use.at for use in job.way)
