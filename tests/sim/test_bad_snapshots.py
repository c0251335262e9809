"""False or damaged snapshots: they are refused by name, or the run goes on from them."""

import hashlib
import itertools
import math
import random
import time
from contextlib import suppress

import msgpack
import numpy as np
import pytest
from damaged_files import assert_usable_or_refused
from local_runs import local_at
from recorded_messages import mutants

from orchard.contract.messages import pack
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.server.figures import RunFigures
from orchard.server.snapshots import examine, last
from orchard.sim.restore import world_from
from orchard.sim.snapshot import HEAD, LARGEST, VERSION, SnapshotError, read


@pytest.fixture(scope="module")
def snapshot():
    """A good snapshot, as plain data."""
    local = local_at(12)
    taken = local.snapshot()
    taken.figures |= RunFigures(local.engine, time.monotonic).as_data()
    return msgpack.unpackb(pack(taken), strict_map_key=False)


def filed(path, tree):
    """Write a snapshot's file with a right checksum, and return its path."""
    payload = tree if isinstance(tree, bytes) else msgpack.packb(tree)
    path.write_bytes(HEAD % VERSION + hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload)
    return path


def resumed(path, tree) -> Local:
    """Return the run that a snapshot gives. Raises SnapshotError."""
    found = read(filed(path, tree))
    examine(found)
    return Local.resume(found)


def array(tree, name, kind, place, value):
    values = np.frombuffer(tree["world"][name], kind).copy()
    values[place] = value
    return tree | {"world": tree["world"] | {name: values.tobytes()}}


def on_a_weed(tree):
    """Couple the first picker to a weed, and the weed to the picker."""
    index = lay_out(Scenario(rows=3)).index
    picker, fruit, weed = (index[name] for name in ("picker_01", "bin_01", "weed_01"))
    return array(array(array(tree, "coupled", "<i8", fruit, -1), "coupled", "<i8", picker, weed), "coupled", "<i8", weed, picker)


FALSE = {
    "coupled to 999": lambda t: array(t, "coupled", "<i8", 0, 999),
    "coupled to -7": lambda t: array(t, "coupled", "<i8", 0, -7),
    "coupled to itself": lambda t: array(t, "coupled", "<i8", 0, 0),
    "coupled one way": lambda t: array(t, "coupled", "<i8", 0, -1),
    "nowhere": lambda t: array(t, "pose", "<f8", 0, math.nan),
    "far away": lambda t: array(t, "pose", "<f8", 1, 1e9),
    "infinite turn": lambda t: array(t, "pose", "<f8", 2, math.inf),
    "fast": lambda t: array(t, "twist", "<f8", 0, 1e300),
    "overfull": lambda t: array(t, "fill", "<f8", 0, 1e6),
    "less than none": lambda t: array(t, "row_picked", "<f8", 0, -1.0),
    "two truths": lambda t: array(t, "alive", "u1", 0, 7),
    "from nowhere": lambda t: array(t, "row_from", "<i8", 0, 5),
    "unloaded backwards": lambda t: array(t, "bay_ticks", "<i8", 0, -5),
    "driven backwards": lambda t: array(t, "distance", "<f8", 0, -1.0),
    "collisions backwards": lambda t: array(t, "collisions", "<i8", 0, -1),
    "held back backwards": lambda t: array(t, "held", "<i8", 0, -1),
    "delivered backwards": lambda t: t | {"world": t["world"] | {"delivered": -1}},
    "half a delivery": lambda t: t | {"world": t["world"] | {"delivered": 0.5}},
    "coupled to a weed": on_a_weed,
    "short": lambda t: t | {"world": t["world"] | {"pose": b"\0" * 8}},
    "text": lambda t: t | {"world": t["world"] | {"pose": "x"}},
    "no pose": lambda t: t | {"world": {k: v for k, v in t["world"].items() if k != "pose"}},
    "before the beginning": lambda t: t | {"world": t["world"] | {"tick": -1}},
    "never": lambda t: t | {"world": t["world"] | {"tick": 2**63}},
    "half a tick": lambda t: t | {"world": t["world"] | {"tick": 1.5}},
    "no world": lambda t: t | {"world": {}},
    "no memories": lambda t: t | {"memories": dict.fromkeys(t["memories"], b"\xc1\xc1")},
    "nobody remembers": lambda t: t | {"memories": {"nobody": b"\x80"}},
    "nobody owned": lambda t: t | {"owned": ["nobody"]},
    "other agents' memories": lambda t: t | {"memories": {**t["memories"], "picker_01": b"\x81\xa4plan\xa1x"}},
    "short hash": lambda t: t | {"digest": b"x"},
    "odd run": lambda t: t | {"run": "a/*"},
    "other scenario": lambda t: t | {"scenario": {"rows": 20}},
    "no scenario": lambda t: t | {"scenario": {"rows": -1}},
    "other figures": lambda t: t | {"figures": {"states": {"since": "x", "ticks": {}}}},
    "no states": lambda t: t | {"figures": {"states": {}}},
    "no invariants": lambda t: t | {"figures": {"invariants": 3}},
    "wall of text": lambda t: t | {"figures": t["figures"] | {"wall_seconds": []}},
    "wall of refusals": lambda t: t | {"figures": t["figures"] | {"refused": {"counts": {"malformed": -1}}}},
    "harvest": lambda t: t | {"figures": t["figures"] | {"harvest": 1}},
    "deep": lambda t: b"\x91" * 100_000,
    "nothing": lambda t: b"",
    "large": lambda t: bytes(LARGEST),
}


@pytest.mark.parametrize("lie", FALSE)
def test_a_snapshot_that_lies_is_refused(tmp_path, snapshot, lie):
    with pytest.raises(SnapshotError) as refused:
        resumed(tmp_path / "lie.snapshot", FALSE[lie](snapshot))
    assert len(str(refused.value)) < 3000


@pytest.mark.parametrize(
    ("lie", "why"),
    [("far away", "pose's y: must be from"), ("wall of text", "figures in the snapshot are malformed"), ("no pose", "is missing"),
     ("no invariants", "inconsistent"), 
     ("wall of refusals", "refused messages in the snapshot are malformed"),
     ("nobody owned", "there is no such agent"), ("other scenario", "inconsistent")],
)  # fmt: skip
def test_physics_refuses_the_newest_snapshot_if_it_lies_with_a_right_checksum_and_takes_the_one_before(
    tmp_path, snapshot, lie, why, caplog
):
    filed(tmp_path / "tick-000000012.snapshot", snapshot)
    newer = filed(tmp_path / "tick-000000015.snapshot", FALSE[lie](snapshot))
    found = last(tmp_path)
    assert found is not None
    assert found.tick == 12
    (said,) = [record.getMessage() for record in caplog.records]
    assert said.startswith(f"not used: {newer}: ")
    assert why in said


@pytest.mark.parametrize("lie", ["nobody remembers", "nobody owned"])
def test_who_is_not_there_is_refused_before_any_agent_is_made(tmp_path, snapshot, lie):
    """Physics, which has no agents, refuses it."""
    with pytest.raises(SnapshotError, match="nobody: there is no such agent"):
        world_from(read(filed(tmp_path / "lie.snapshot", FALSE[lie](snapshot))))


def test_a_file_that_is_too_large_is_refused_for_that(tmp_path):
    """It is refused before its content is read."""
    path = tmp_path / "large.snapshot"
    with path.open("wb") as sparse:
        sparse.truncate(10**10)
    with pytest.raises(SnapshotError, match=f"larger than {LARGEST} bytes"):
        read(path)


def test_letters_to_nobody_go_nowhere(tmp_path, snapshot):
    written = {"nobody": {"requests": [["nowhere", {"type": "where"}]], "answers": [["nobody", 3, 0, {"type": "yes"}]]}}
    lost = snapshot | {"letters": [*snapshot["letters"], [11, written], [2**60, written], [-5, written]]}
    for tree in (snapshot, lost):
        local = resumed(tmp_path / "letters.snapshot", tree)
        local.tick()
        assert local.engine.tick == 13


def test_a_damaged_snapshot_goes_on_or_is_refused(tmp_path, snapshot):
    path, chance = tmp_path / "damaged.snapshot", random.Random(6)
    assert_usable_or_refused(path, b"")
    good = 0
    for payload in itertools.islice(mutants(msgpack.packb(snapshot), chance), 150):
        with suppress(SnapshotError):
            resumed(path, payload)
            good += 1
    assert good < 110
