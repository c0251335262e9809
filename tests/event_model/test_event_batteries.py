"""Carriers with batteries, in both event models."""

from random import Random
from typing import Any

import pytest

pytest.importorskip("simpy", reason="the extra `study` is not installed")

from both_models import differences, mended
from quiet import NOBODY, random_layouts

from orchard.discrete.generators import GeneratorHarvest
from orchard.event_model.harvest import EventHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario

# As in quiet orchards: robots that act in one tick take turns by name here, and by chance in the
# model of generators. In five of the nine no delivery differs, and other figures do by a tick.
MOST_DELIVER_OTHERWISE = 5
MOST_DIFFER = 9


def with_batteries(chances: Random) -> dict[str, Any]:
    """Return values of a scenario in which carriers charge, some after each job."""
    battery = {
        "hours": chances.choice([0.2, 0.3, 0.5]),
        "hours_to_charge": chances.choice([0.02, 0.05, 0.1]),
        "standing": chances.choice([0.0, 0.1, 0.3]),
        "reserve": chances.choice([0.5, 0.7, 0.9]),
    }
    return {"carrying": {"battery": battery}, "chargers": chances.randint(1, 3)}


def test_batteries_have_the_same_ticks_in_both_models() -> None:
    layouts = random_layouts(seed=41, count=40, values_of=with_batteries)
    differ = [found for found in map(differences, layouts) if found]
    assert len(differ) <= MOST_DIFFER
    assert sum("deliveries" in found for found in differ) <= MOST_DELIVER_OTHERWISE


def test_a_flat_carrier_stands_for_ever() -> None:
    values = NOBODY | {"rows": 8, "pickers": 2, "carriers": 1, "dispatch": "nearest"}
    battery = {"hours": 0.05, "hours_to_charge": 0.1, "reserve": 0.0}
    layout = lay_out(Scenario(**values, carrying={"battery": battery}))
    harvest = EventHarvest(layout).run()
    assert not harvest.is_over
    with mended():
        told = GeneratorHarvest(layout).run()
    assert harvest.delivered == told.delivered < layout.bins


def test_an_exchange_takes_the_same_of_a_battery_in_both_models() -> None:
    values = NOBODY | {"rows": 8, "pickers": 2, "carriers": 2, "dispatch": "predictive"}
    battery = {"hours": 0.5, "hours_to_charge": 0.1, "reserve": 0.7}
    layout = lay_out(Scenario(**values, carrying={"battery": battery}))
    model = EventHarvest(layout).run().model
    took = sorted(
        (exchange.tick, exchange.carrier_ticks, exchange.battery_used)
        for exchange in model.exchanges[: model.desk[0].exchanges]
    )
    with mended():
        told = GeneratorHarvest(layout).run()
    expected = sorted(
        (exchange.tick, exchange.carrier_ticks, exchange.battery_used)
        for exchanges in told.exchanges.values()
        for exchange in exchanges
    )
    assert [exchange[0] for exchange in took] == [exchange[0] for exchange in expected]
    for exchange, other in zip(took, expected, strict=True):
        assert exchange[1:] == pytest.approx(other[1:])
