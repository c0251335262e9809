"""The event model as data beside the one of generators."""

from typing import Any

import pytest

from orchard.discrete.generators import GeneratorHarvest
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.results import Exchange
from orchard.field.layout import Layout


def differences(layout: Layout, free_roads: bool = False) -> list[str]:
    """Do a harvest in both models, and return in what they differ: each tick counts."""
    told = EventHarvest(layout, free_roads=free_roads).run()
    expected = GeneratorHarvest(layout, free_roads=free_roads).run()
    exchanges = {}
    for picker, those in expected.exchanges.items():
        exchanges[picker] = [pytest.approx(vars(exchange)) for exchange in those]
    pairs = {
        "deliveries": (told.deliveries, pytest.approx(expected.deliveries)),
        "exchanges": (_data(told.exchanges), exchanges),
        "stood": (told.stood, pytest.approx(expected.stood)),
        "flat": (told.flat, expected.flat),
        "length": (told.seconds, pytest.approx(expected.seconds)),
        "waiting": (
            told.picker_waiting_seconds(),
            pytest.approx(expected.picker_waiting_seconds()),
        ),
        "utilisation": (told.carrier_utilisation(), pytest.approx(expected.carrier_utilisation())),
    }
    return [name for name, (figure, other) in pairs.items() if figure != other]


def _data(exchanges: dict[str, list[Exchange]]) -> dict[str, list[dict[str, Any]]]:
    return {picker: [vars(one) for one in those] for picker, those in exchanges.items()}
