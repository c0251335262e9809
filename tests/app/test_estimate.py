"""The estimate beside the form: it follows what is entered, and gets surer harvest by harvest."""

import pytest

from orchard.app.estimate import MOST_HARVESTS, SURE, FastHarvest, FleetEstimate, harvest
from orchard.field.scenario import Scenario

# An orchard whose harvests differ only by what robots meet, and one whose picking times are random.
EVEN = Scenario(rows=3, carriers=1)
SPREAD = Scenario(
    rows=3, carriers=2, picking_speed=0.2, picking={"spread": {"distribution": "gamma"}}
)


def test_the_first_harvest_gives_a_first_answer():
    estimate = FleetEstimate(EVEN)
    assert estimate.words() == "With 1 carrier: the first harvest is computed."
    estimate.samples.append(harvest(EVEN, 0))
    assert "one harvest; more are computed" in estimate.words()
    assert not estimate.is_done
    assert harvest(EVEN, 0) == estimate.samples[0], "it is repeatable"


def test_harvests_that_are_nearly_the_same_need_few():
    """Three are too few, however alike; a fourth one suffices."""
    estimate = FleetEstimate(EVEN, [FastHarvest(bins_per_hour=9.0, seconds=100.0)] * 3)
    assert not estimate.is_done
    estimate.samples.append(FastHarvest(bins_per_hour=9.01, seconds=100.0))
    assert estimate.is_done
    assert 0.0 < estimate.unsure < SURE


def test_what_is_unsure_shrinks_with_each_harvest():
    estimate = FleetEstimate(SPREAD)
    # After each harvest, as a share of the mean.
    unsure = []
    for number in range(12):
        estimate.samples.append(harvest(SPREAD, number))
        unsure.append(estimate.unsure)
    assert unsure[0] == 1.0, "one harvest tells nothing of the spread"
    assert unsure[11] < unsure[3] < 1.0
    assert "12 harvests, 95% sure of the mean" in estimate.words()
    assert not estimate.is_done


def test_an_estimate_comes_to_an_end():
    """Harvests that stay unlike never make the mean sure enough, so their number has a limit."""
    unlike = []
    for number in range(MOST_HARVESTS):
        unlike.append(FastHarvest(bins_per_hour=9.0 + number % 2, seconds=100.0))
    estimate = FleetEstimate(SPREAD, unlike)
    assert estimate.is_done


@pytest.mark.parametrize(
    "changes", [{"sensors": {"gnss": {"white": 0.01}}}, {"agents": {"picker": "no.such.Picker"}}]
)
def test_what_the_fast_model_does_not_know_is_said(changes):
    scenario = Scenario(rows=3, **changes)
    estimate = FleetEstimate(scenario, [harvest(scenario, 0)])
    assert estimate.is_done
    assert "no estimate, because " in estimate.words()


def test_an_estimate_counts_bins_as_a_run_does():
    """The last bin of a row is part full: 3 rows of 70 m fill 4.2 bins of 50 m, in 6 bins."""
    parts = Scenario(rows=3, carriers=1, metres_per_bin=50.0)
    first = harvest(parts, 0)
    assert first.bins_per_hour == pytest.approx(3600.0 * 4.2 / first.seconds)
