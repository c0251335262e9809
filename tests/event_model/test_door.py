"""Which model does a harvest, and that both tell the same of it."""

from typing import Any

import pytest

pytest.importorskip("simpy", reason="the extra `study` is not installed")

from both_models import differences, mended
from own_policies import AtOnce
from quiet import NOBODY, quiet_layouts

from orchard.behaviour.dispatcher import PolicyFault
from orchard.discrete.generators import GeneratorHarvest
from orchard.discrete.harvest import DiscreteHarvest, Jam, is_known
from orchard.dispatch.policy import CarrierReport
from orchard.event_model.harvest import EventHarvest
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario
from orchard.report.long_run import long_run

SMALL = NOBODY | {"rows": 5, "pickers": 3, "carriers": 3, "row_length": 30.0}


def orchard(**values: Any) -> Layout:
    return lay_out(Scenario(**SMALL | values))


@pytest.mark.parametrize("dispatch", ["nearest", "predictive", "assignment"])
def test_the_event_model_does_a_quiet_harvest(dispatch: str) -> None:
    layout = orchard(dispatch=dispatch)
    harvest = DiscreteHarvest(layout).run()
    assert isinstance(harvest.model, EventHarvest)
    assert not differences(layout)


@pytest.mark.parametrize(
    "dispatch", ["own_policies.OneAtATime", "own_policies.FarthestOfMine", "rolling"]
)
def test_a_policy_in_python_decides_the_same_in_both_models(dispatch: str) -> None:
    layout = orchard(dispatch=dispatch, row_length=40.0, picking_speed=0.5)
    harvest = DiscreteHarvest(layout).run()
    assert isinstance(harvest.model, EventHarvest)
    assert not differences(layout)


def test_a_policy_in_python_is_told_the_same_at_each_question(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    reports: list[Any] = []
    assign = AtOnce.assign

    def noting(policy: AtOnce, now: int, bins: Any, carriers: Any, memory: Any) -> Any:
        reports.append((now, list(bins), [_rounded(carrier) for carrier in carriers]))
        return assign(policy, now, bins, carriers, memory)

    monkeypatch.setattr(AtOnce, "assign", noting)
    layout = orchard(dispatch="own_policies.AtOnce", route="two-way")
    DiscreteHarvest(layout).run()
    told = reports.copy()
    reports.clear()
    with mended():
        GeneratorHarvest(layout).run()
    assert told == reports


def _rounded(carrier: CarrierReport) -> tuple[str, str, bool, float]:
    return carrier.name, carrier.job, carrier.is_next, round(carrier.metres, 6)


@pytest.mark.parametrize("policy", ["Raising", "Inventing", "Overworking", "Hoarding", "Silent"])
def test_a_policy_that_breaks_is_told_in_the_same_words(policy: str) -> None:
    layout = orchard(dispatch=f"own_policies.{policy}")
    with pytest.raises(PolicyFault) as told:
        DiscreteHarvest(layout).run()
    with pytest.raises(PolicyFault) as expected:
        GeneratorHarvest(layout).run()
    assert str(told.value) == str(expected.value)


def test_a_policy_that_sends_nobody_is_a_jam() -> None:
    layout = orchard(dispatch="own_policies.Idle")
    with pytest.raises(Jam, match="only 0 bins were delivered: some robots wait for ever"):
        DiscreteHarvest(layout).run().figures()


def test_generators_do_a_route_with_steps_of_its_own() -> None:
    layout = orchard(route="examples.seams.signalled_route.SignalledRoute")
    assert not is_known(layout)
    assert isinstance(DiscreteHarvest(layout).model, GeneratorHarvest)


def test_long_runs_have_the_same_figures_by_both_models(monkeypatch: pytest.MonkeyPatch) -> None:
    layouts = [layout for layout in quiet_layouts(seed=3, count=12) if layout.bins <= 12]
    assert len(layouts) >= 4
    told = [long_run(layout) for layout in layouts]
    monkeypatch.setattr("orchard.discrete.harvest.is_known", lambda layout: False)
    for layout, figures in zip(layouts, told, strict=True):
        expected = long_run(layout)
        assert figures.bins_per_hour == pytest.approx(expected.bins_per_hour, rel=0.01)
        assert figures.carrier_utilisation == pytest.approx(expected.carrier_utilisation, abs=0.01)
