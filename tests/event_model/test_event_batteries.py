"""Carriers with batteries in the event model alone."""

from quiet import NOBODY

from orchard.event_model.harvest import EventHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import TIME_STEP, Scenario


def test_a_flat_carrier_stands_for_ever() -> None:
    """With a reserve of 0 the only carrier never goes to charge. Its battery lasts for 6 min."""
    values = NOBODY | {"rows": 8, "pickers": 2, "carriers": 1, "dispatch": "nearest"}
    battery = {"hours": 0.1, "hours_to_charge": 0.1, "reserve": 0.0}
    layout = lay_out(Scenario(**values, carrying={"battery": battery}))
    harvest = EventHarvest(layout).run()
    assert not harvest.is_over
    assert harvest.flat == ["carrier_01"]
    assert 0 < harvest.delivered < layout.bins


def test_an_exchange_uses_a_battery_for_the_time_that_it_takes() -> None:
    """It uses no more than a drive of that time, and no less than standing for that time.

    A drive of `hours` uses a whole battery; standing uses `standing` as much.
    """
    values = NOBODY | {"rows": 8, "pickers": 2, "carriers": 2, "dispatch": "predictive"}
    battery = {"hours": 0.5, "hours_to_charge": 0.1, "reserve": 0.7, "standing": 0.2}
    layout = lay_out(Scenario(**values, carrying={"battery": battery}))
    harvest = EventHarvest(layout).run()
    exchanges = [exchange for of_picker in harvest.exchanges.values() for exchange in of_picker]
    assert len(exchanges) == layout.bins
    for exchange in exchanges:
        assert exchange.carrier_ticks is not None
        share = exchange.carrier_ticks * TIME_STEP / 3600.0 / battery["hours"]
        assert battery["standing"] * share < exchange.battery_used < share


def test_no_battery_is_more_than_full() -> None:
    """Carriers stand in their charging lines, move up while they charge, and leave them full."""
    values = NOBODY | {
        **{"rows": 14, "pickers": 5, "carriers": 6, "row_length": 34.0, "picking_speed": 0.5},
        **{"dispatch": "nearest", "route": "one-way", "chargers": 3},
    }
    battery = {"hours": 0.2, "hours_to_charge": 0.1, "reserve": 0.9, "standing": 0.3}
    harvest = EventHarvest(lay_out(Scenario(**values, carrying={"battery": battery})))
    most = 0.0
    # Until all bins are delivered.
    for tick in range(0, 15_000, 20):
        harvest.advance(tick)
        most = max(most, harvest.model.robots.charge.max())
    assert harvest.is_over
    assert most == 1.0
