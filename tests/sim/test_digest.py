"""The run's hash: equal for equal runs, different for any other run."""

import copy

import numpy as np
import pytest

from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.sim.engine import next_digest
from orchard.sim.scan import Scanner
from orchard.sim.world import World

NONE_SEEN = np.zeros(0, dtype=np.float32)


def hash_of(world: World, ranges: np.ndarray, mail: dict[str, bytes]) -> str:
    return next_digest(bytes(32), world, ranges, mail).hex()


def _nudge(array: np.ndarray) -> None:
    flat = array.reshape(-1)
    flat[0] = ~flat[0] if array.dtype == bool else flat[0] + 1 if array.dtype.kind == "i" else np.nextafter(flat[0], np.inf)


@pytest.mark.parametrize("part", ["pose", "coupled", "fill", "row_picked", "alive"])
def test_the_last_bit_of_every_part_counts(part):
    world = World(lay_out(Scenario()))
    ranges, other = Scanner(world).scan(world).ranges, copy.deepcopy(world)
    _nudge(getattr(other, part))
    assert hash_of(other, ranges, {}) != hash_of(world, ranges, {})


def test_scans_deliveries_mail_and_all_ticks_before_count():
    world = World(lay_out(Scenario()))
    ranges = Scanner(world).scan(world).ranges
    hashes = [hash_of(world, ranges, mail) for mail in ({}, {"a": b"xy"}, {"a": b"x"}, {"b": b"xy"}, {"ax": b"y"}, {"a": b"x", "b": b"y"})]
    changed = ranges.copy()
    changed[-1] = 9.0
    hashes += [hash_of(world, changed, {}), next_digest(bytes(31) + b"x", world, ranges, {}).hex()]
    world.delivered = 1
    hashes.append(hash_of(world, ranges, {}))
    assert len(set(hashes)) == len(hashes)


def test_mail_counts_by_name_and_not_by_arrival():
    world = World(lay_out(Scenario()))
    assert hash_of(world, NONE_SEEN, {"a": b"1", "b": b"2"}) == hash_of(world, NONE_SEEN, {"b": b"2", "a": b"1"})
