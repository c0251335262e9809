"""Which model does a harvest, and that both tell the same of it."""

from typing import Any

import pytest

pytest.importorskip("simpy", reason="the extra `study` is not installed")

from quiet import NOBODY, quiet_layouts

from orchard.discrete.generators import GeneratorHarvest
from orchard.discrete.harvest import DiscreteHarvest, is_known
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
    expected = GeneratorHarvest(layout).run()
    assert harvest.deliveries == expected.deliveries
    assert harvest.stood == expected.stood
    assert harvest.exchanges == expected.exchanges
    assert harvest.figures().carrier_utilisation == expected.carrier_utilisation()


UNKNOWN: dict[str, dict[str, Any]] = {
    "people": {"people": {"workers": 1, "visitors": 0}},
    "steps of the user's own": {"route": "examples.seams.signalled_route.SignalledRoute"},
}


@pytest.mark.parametrize("name", UNKNOWN)
def test_generators_do_what_the_event_model_does_not_know(name: str) -> None:
    layout = orchard(**UNKNOWN[name])
    assert not is_known(layout)
    assert isinstance(DiscreteHarvest(layout).model, GeneratorHarvest)


def test_the_event_model_does_harvests_on_free_roads() -> None:
    layout = orchard(dispatch="nearest")
    harvest = DiscreteHarvest(layout, free_roads=True).run()
    assert isinstance(harvest.model, EventHarvest)
    assert harvest.deliveries == GeneratorHarvest(layout, free_roads=True).run().deliveries


def test_long_runs_have_the_same_figures_by_both_models(monkeypatch: pytest.MonkeyPatch) -> None:
    layouts = [layout for layout in quiet_layouts(seed=3, count=12) if layout.bins <= 12]
    assert len(layouts) >= 4
    told = [long_run(layout) for layout in layouts]
    monkeypatch.setattr("orchard.discrete.harvest.is_known", lambda layout: False)
    for layout, figures in zip(layouts, told, strict=True):
        expected = long_run(layout)
        assert figures.bins_per_hour == pytest.approx(expected.bins_per_hour, rel=0.01)
        assert figures.carrier_utilisation == pytest.approx(expected.carrier_utilisation, abs=0.01)
