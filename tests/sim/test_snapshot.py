"""A run as data: one that goes on from a snapshot has the hash of one without interruption.

A snapshot holds a run at a tick: world, memories, letters and figures (orchard/sim/snapshot.py).
Its file, tick-NNNNNNNNN.snapshot, has a head with a version and a checksum. A keyframe is a copy
that stays, for forks. A bad snapshot is refused by name.
"""

import hashlib
import itertools
import math
import random
import time
from contextlib import suppress
from pathlib import Path

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from local_runs import HARVEST_TICKS, harvest_hash, local_at, played
from recorded_messages import mutants

from orchard.contract.messages import pack, unpack
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.futures.moments import WatchedRun, snapshot_at
from orchard.local import Local
from orchard.server.figures import RunFigures
from orchard.server.snapshots import examine, last
from orchard.sim.restore import world_from
from orchard.sim.snapshot import (
    HEAD,
    KEPT,
    KEYFRAME,
    LARGEST,
    VERSION,
    Snapshot,
    SnapshotError,
    as_file,
    newest,
    read,
    store,
)


def assert_usable_or_refused(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    with suppress(SnapshotError):
        world_from(read(path))


@settings(max_examples=4)
@given(st.lists(st.integers(0, HARVEST_TICKS), min_size=1, max_size=4))
def test_a_run_resumed_at_any_ticks_has_the_same_hash(ticks):
    local = Local(Scenario(rows=3))
    for tick in sorted(ticks):
        local = Local.resume(unpack(pack(played(local, tick).snapshot()), Snapshot))
    assert played(local, HARVEST_TICKS).engine.hash == harvest_hash()


def test_a_run_that_goes_on_has_the_figures_of_one_run():
    """Its summary, with its history, is that of a run without interruption."""
    run = WatchedRun(local_at(10).snapshot())
    run.go_on(450)
    resumed = WatchedRun(unpack(pack(run.snapshot()), Snapshot))
    run.go_on(900)
    resumed.go_on(900)
    summary = run.figures.summary()
    after = resumed.figures.summary()
    # A run that goes on asks all agents once more.
    assert after.pop("asked_share") > summary.pop("asked_share")
    assert len(summary["history"]["seconds"]) >= 4
    assert after == summary


def test_two_forks_of_one_snapshot_go_their_own_ways():
    """In one of them the picker has no agent, so it stands from 10 s on; the other goes on.

    A picker picks at 1 m/s: 10 m until then, and 15 m until 15 s.
    """
    snapshot = local_at(100).snapshot()
    going_on = Local.resume(snapshot)
    standing = Local.resume(snapshot)
    del standing.agents["picker_01"]
    played(going_on, 150)
    played(standing, 150)
    assert going_on.engine.world.row_picked[0] > 14.9
    assert standing.engine.world.row_picked[0] < 10.2


@pytest.fixture
def written(tmp_path):
    """Return a folder to which the snapshots of ticks 10, 11 and 12 have been written."""
    local = local_at(10)
    for _ in range(3):
        store(*as_file(local.snapshot()), tmp_path)
        local.tick()
    return tmp_path


def files(folder: Path) -> list[Path]:
    """Return the files of a folder, the oldest snapshot first."""
    return sorted(folder.iterdir())


def test_the_newest_two_are_kept_and_the_newest_is_read(written):
    assert len(files(written)) == KEPT
    refused: list[str] = []
    assert newest(written, refused).tick == 12
    assert refused == []


def test_the_first_snapshot_of_another_run_takes_over(written):
    other = local_at(12).snapshot()
    other.run = "other"
    store(*as_file(other), written, "other")
    assert newest(written, []).run == "other"
    assert len(list(written.glob("tick-*"))) == 1


def test_files_of_a_user_beside_snapshots_stay(written):
    names = ("tick-notes.txt", "tick-12.snapshot", "holiday.snapshot", "notes.new")
    for name in names:
        (written / name).write_text("a year's work")
    (written / ".tick-000000011.snapshot.4711.new").write_text("half a snapshot")
    other = local_at(13).snapshot()
    other.run = "other"
    path = store(*as_file(other), written, "other")
    assert {file.name for file in files(written)} == {*names, path.name, "run"}
    assert newest(written, []).tick == 13


def test_snapshots_of_another_run_are_passed_over_and_named(tmp_path):
    # Snapshots of the other run that somebody has copied here, with newer ticks.
    own = local_at(10).snapshot()
    other = local_at(12).snapshot()
    own.run = "own"
    other.run = "other"
    store(*as_file(own), tmp_path, own.run)
    name, content = as_file(other)
    copies = [tmp_path / name.replace("12", tick) for tick in ("12", "13")]
    for copy in copies:
        copy.write_bytes(content)
    refused: list[str] = []
    assert newest(tmp_path, refused).run == "own"
    assert refused == [f"{copy}: of another run, other; expected own" for copy in reversed(copies)]


# What damage makes of the bytes of a snapshot, and why it is then refused.
DAMAGES = [
    pytest.param(lambda data: data[: len(data) // 2], "truncated or changed", id="half"),
    pytest.param(
        lambda data: data[:-1] + bytes([data[-1] ^ 1]), "truncated or changed", id="one bit"
    ),
    pytest.param(
        lambda data: data.replace(b"snapshot 10", b"snapshot 9", 1),
        "version 9; this program reads version 10",
        id="an older version",
    ),
    pytest.param(lambda data: b"", "not a snapshot", id="empty"),
    pytest.param(lambda data: b"PK" + data, "not a snapshot", id="a zip file"),
]


@pytest.mark.parametrize(("damage", "why"), DAMAGES)
def test_a_bad_snapshot_is_refused_for_the_one_before(written, damage, why):
    damaged = files(written)[-1]
    damaged.write_bytes(damage(damaged.read_bytes()))
    refused: list[str] = []
    assert newest(written, refused).tick == 11
    assert str(damaged) in refused[0]
    assert why in refused[0]


@pytest.mark.parametrize("tick", [9, 11, 99])
def test_a_snapshot_under_the_name_of_another_tick_is_refused(tick, tmp_path):
    """A run or a fork would go on from another moment than the one that was asked for."""
    name, content = as_file(local_at(10).snapshot())
    renamed = tmp_path / name.replace("000000010", f"{tick:09d}")
    for path in (renamed, renamed.with_suffix(KEYFRAME)):
        path.write_bytes(content)
    for until in (None, 99):
        refused: list[str] = []
        with pytest.raises(SnapshotError, match="no usable snapshot"):
            newest(tmp_path, refused, until=until)
        assert refused[0] == f"{renamed}: of tick 10, which its name should say"
    with pytest.raises(SnapshotError, match=r"keyframe: of tick 10, which its name should say"):
        snapshot_at(tmp_path, tick, print)


def test_ticks_of_ten_digits_come_after_those_of_nine(tmp_path):
    """Their names do not: tick-1000000000 stands before tick-999999999 in the alphabet."""
    snapshot = local_at(10).snapshot()
    last_of_nine = 10**9 - 1
    for tick in (last_of_nine, 10**9, 10**9 + 1):
        snapshot.world["tick"] = tick
        name, content = as_file(snapshot)
        (tmp_path / name).write_bytes(content)
    assert newest(tmp_path, []).tick == 10**9 + 1
    for until in (last_of_nine, 10**9):
        assert newest(tmp_path, [], until=until).tick == until


def test_a_folder_without_a_snapshot_is_named(tmp_path):
    with pytest.raises(SnapshotError, match="no usable snapshot"):
        newest(tmp_path / "nothing", [])


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> bytes:
    """Return the bytes of a snapshot."""
    return store(*as_file(local_at(3).snapshot()), tmp_path_factory.mktemp("good")).read_bytes()


@given(junk=st.binary(max_size=200), at=st.integers(0, 10**6))
def test_any_bytes_are_a_snapshot_or_refused(tmp_path_factory, whole, junk, at):
    at %= len(whole)
    damaged = whole[:at] + junk + whole[at + len(junk) :]
    assert_usable_or_refused(tmp_path_factory.getbasetemp() / "junk.snapshot", damaged)


@given(junk=st.binary(max_size=20), at=st.integers(0, 10**6))
def test_a_false_payload_with_a_right_checksum_is_survived(tmp_path_factory, whole, junk, at):
    # After the two lines of the head.
    payload = whole.split(b"\n", 2)[2]
    at %= len(payload)
    payload = payload[:at] + junk + payload[at + len(junk) :]
    false = tmp_path_factory.getbasetemp() / "false.snapshot"
    assert_usable_or_refused(false, with_head(payload))


def with_head(payload: bytes) -> bytes:
    """Return the bytes of a snapshot with this payload: its head has a right checksum."""
    return HEAD % VERSION + hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload


@pytest.fixture(scope="module")
def snapshot():
    """Return a snapshot of tick 12 with figures, as maps and lists."""
    local = local_at(12)
    taken = local.snapshot()
    taken.figures |= RunFigures(local.engine, time.monotonic).as_data()
    return msgpack.unpackb(pack(taken), strict_map_key=False)


def write_snapshot(path, tree):
    """Write a snapshot of maps and lists, or of bytes, with a right checksum. Return its path."""
    payload = tree if isinstance(tree, bytes) else msgpack.packb(tree)
    path.write_bytes(with_head(payload))
    return path


def resumed(path, tree) -> Local:
    """Write a snapshot, and go on from it as physics does."""
    read_back = read(write_snapshot(path, tree))
    examine(read_back)
    return Local.resume(read_back)


def with_value(tree, name, kind, place, value):
    """Return a snapshot in which an array of the world has another value at a place.

    `kind`: the type of the array, such as "<f8".
    """
    values = np.frombuffer(tree["world"][name], kind).copy()
    values[place] = value
    return tree | {"world": tree["world"] | {name: values.tobytes()}}


def on_a_weed(tree):
    """Couple the first picker to a weed, and the weed to the picker."""
    index = lay_out(Scenario(rows=3)).index
    changed = with_value(tree, "coupled", "<i8", index["bin_01"], -1)
    changed = with_value(changed, "coupled", "<i8", index["picker_01"], index["weed_01"])
    return with_value(changed, "coupled", "<i8", index["weed_01"], index["picker_01"])


# What is inconsistent in a snapshot `t`, as maps and lists, and the snapshot in which it is so.
# Arrays of the world are bytes, of float 64 (<f8), int 64 (<i8) or bytes (u1).
INCONSISTENT = {
    "coupled to 999": lambda t: with_value(t, "coupled", "<i8", 0, 999),
    "coupled to -7": lambda t: with_value(t, "coupled", "<i8", 0, -7),
    "coupled to itself": lambda t: with_value(t, "coupled", "<i8", 0, 0),
    "coupled one way": lambda t: with_value(t, "coupled", "<i8", 0, -1),
    "nowhere": lambda t: with_value(t, "pose", "<f8", 0, math.nan),
    "far away": lambda t: with_value(t, "pose", "<f8", 1, 1e9),
    "infinite turn": lambda t: with_value(t, "pose", "<f8", 2, math.inf),
    "fast": lambda t: with_value(t, "twist", "<f8", 0, 1e300),
    "overfull": lambda t: with_value(t, "fill", "<f8", 0, 1e6),
    "less than none": lambda t: with_value(t, "row_ends", "<f8", 0, -1.0),
    "alive is 7": lambda t: with_value(t, "alive", "u1", 0, 7),
    "metres delivered backwards": lambda t: t | {"world": t["world"] | {"delivered_metres": -1.0}},
    "unloaded backwards": lambda t: with_value(t, "bay_ticks", "<i8", 0, -5),
    "driven backwards": lambda t: with_value(t, "distance", "<f8", 0, -1.0),
    "collisions backwards": lambda t: with_value(t, "collisions", "<i8", 0, -1),
    "refused backwards": lambda t: with_value(t, "refused", "<i8", 0, -1),
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
    "other agents' memories": lambda t: (
        t | {"memories": {**t["memories"], "picker_01": b"\x81\xa4plan\xa1x"}}
    ),
    "short hash": lambda t: t | {"digest": b"x"},
    "odd run": lambda t: t | {"run": "a/*"},
    "other scenario": lambda t: t | {"scenario": {"rows": 20}},
    "no scenario": lambda t: t | {"scenario": {"rows": -1}},
    "other figures": lambda t: t | {"figures": {"states": {"since": "x", "ticks": {}}}},
    "no states": lambda t: t | {"figures": {"states": {}}},
    "no invariants": lambda t: t | {"figures": {"invariants": 3}},
    "wall seconds are a list": lambda t: t | {"figures": t["figures"] | {"wall_seconds": []}},
    "refused less than never": lambda t: (
        t | {"figures": t["figures"] | {"refused": {"counts": {"malformed": -1}}}}
    ),
    "harvest": lambda t: t | {"figures": t["figures"] | {"harvest": 1}},
    "deep": lambda t: b"\x91" * 100_000,
    "nothing": lambda t: b"",
    "large": lambda t: bytes(LARGEST),
}


@pytest.mark.parametrize("change", INCONSISTENT.values(), ids=INCONSISTENT)
def test_an_inconsistent_snapshot_is_refused(tmp_path, snapshot, change):
    with pytest.raises(SnapshotError) as refused:
        resumed(tmp_path / "inconsistent.snapshot", change(snapshot))
    assert len(str(refused.value)) < 3000, "the message does not repeat the snapshot"


# An inconsistency, and words of the line in the log.
LOGGED = [
    ("far away", "pose's y: must be from"),
    ("wall seconds are a list", "figures in the snapshot are malformed"),
    ("no pose", "is missing"),
    ("no invariants", "inconsistent"),
    ("refused less than never", "refused messages in the snapshot are malformed"),
    ("nobody owned", "there is no such agent"),
    ("other scenario", "inconsistent"),
]


@pytest.mark.parametrize(("name", "why"), LOGGED)
def test_physics_takes_the_snapshot_before_an_inconsistent_one(
    tmp_path, snapshot, name, why, caplog
):
    """The checksum of the inconsistent snapshot is right, so only its content tells."""
    write_snapshot(tmp_path / "tick-000000012.snapshot", snapshot)
    inconsistent = INCONSISTENT[name](snapshot)
    newer = write_snapshot(tmp_path / "tick-000000015.snapshot", inconsistent)
    used = last(tmp_path)
    assert used is not None
    assert used.tick == 12
    (line,) = [record.getMessage() for record in caplog.records]
    assert line.startswith(f"not used: {newer}: ")
    assert why in line


@pytest.mark.parametrize("name", ["nobody remembers", "nobody owned"])
def test_an_unknown_agent_is_refused_before_any_agent_is_made(tmp_path, snapshot, name):
    path = write_snapshot(tmp_path / "unknown.snapshot", INCONSISTENT[name](snapshot))
    with pytest.raises(SnapshotError, match="nobody: there is no such agent"):
        world_from(read(path))


def test_a_file_that_is_too_large_is_refused_for_that(tmp_path):
    """It is refused before its content is read."""
    path = tmp_path / "large.snapshot"
    with path.open("wb") as sparse:
        sparse.truncate(10**10)
    with pytest.raises(SnapshotError, match=f"larger than {LARGEST} bytes"):
        read(path)


def test_messages_to_unknown_agents_do_nothing(tmp_path, snapshot):
    """They may also be of ticks that never come. The run goes on without them."""
    written = {
        "nobody": {
            "requests": [["nowhere", {"type": "where"}]],
            "answers": [["nobody", 3, 0, {"type": "yes"}]],
        }
    }
    lost = snapshot | {
        "letters": [*snapshot["letters"], [11, written], [2**60, written], [-5, written]]
    }
    for tree in (snapshot, lost):
        local = resumed(tmp_path / "letters.snapshot", tree)
        local.tick()
        assert local.engine.tick == 13


def test_a_damaged_snapshot_goes_on_or_is_refused(tmp_path, snapshot):
    path = tmp_path / "damaged.snapshot"
    chance = random.Random(6)
    assert_usable_or_refused(path, b"")
    used = 0
    for payload in itertools.islice(mutants(msgpack.packb(snapshot), chance), 150):
        with suppress(SnapshotError):
            resumed(path, payload)
            used += 1
    # Many mutants change only a value that may be anything. But more than a quarter of the 150 must
    # be refused: else damage would not be noticed at all.
    assert used < 110
