"""A run as data: a run that goes on from a snapshot has the hash of a run without interruption. A bad snapshot is refused by name."""

import hashlib
from pathlib import Path

import pytest
from damaged_files import assert_usable_or_refused
from hypothesis import given, settings
from hypothesis import strategies as st
from local_runs import HARVEST_TICKS, harvest_hash, local_at

from orchard.contract.messages import pack, unpack
from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.sim.snapshot import HEAD, KEPT, VERSION, Snapshot, SnapshotError, as_file, newest, store


@settings(max_examples=5)
@given(st.lists(st.integers(0, HARVEST_TICKS), min_size=1, max_size=4))
def test_a_run_resumed_at_any_ticks_has_the_hash_of_one_never_interrupted(ticks):
    local = Local(Scenario(rows=3))
    for tick in sorted(ticks):
        while local.engine.tick < tick:
            local.tick()
        local = Local.resume(unpack(pack(local.snapshot()), Snapshot))
    while local.engine.tick < HARVEST_TICKS:
        local.tick()
    assert local.engine.hash == harvest_hash()


def test_two_forks_of_one_snapshot_go_their_own_ways():
    snapshot = local_at(100).snapshot()
    one, other = Local.resume(snapshot), Local.resume(snapshot)
    del other.agents["picker_01"]
    for _ in range(50):
        one.tick(), other.tick()
    assert one.engine.world.row_picked[0] > 14.9
    assert other.engine.world.row_picked[0] < 10.2


@pytest.fixture
def written(tmp_path):
    """A folder in which three snapshots were written, and two are kept."""
    local = local_at(10)
    for _ in range(3):
        store(*as_file(local.snapshot()), tmp_path)
        local.tick()
    return tmp_path


def files(folder: Path) -> list[Path]:
    return sorted(folder.iterdir())


def test_the_newest_two_are_kept_and_the_newest_is_read(written):
    assert len(files(written)) == KEPT
    refused: list[str] = []
    assert newest(written, refused).tick == 12
    assert refused == []


def test_snapshots_of_another_run_are_passed_over_and_named_even_if_they_are_most_and_newest(tmp_path):
    own, other = local_at(10).snapshot(), local_at(12).snapshot()
    own.run, other.run = "own", "other"
    store(*as_file(own), tmp_path, own.run)
    name, content = as_file(other)
    copies = [tmp_path / name.replace("12", tick) for tick in ("12", "13")]
    for copy in copies:
        copy.write_bytes(content)
    refused: list[str] = []
    assert newest(tmp_path, refused).run == "own"
    assert refused == [f"{copy}: of another run, other; expected own" for copy in reversed(copies)]


@pytest.mark.parametrize(
    ("damage", "why"),
    [
        (lambda data: data[: len(data) // 2], "truncated or changed"),
        (lambda data: data[:-1] + bytes([data[-1] ^ 1]), "truncated or changed"),
        (lambda data: data.replace(b"snapshot %d" % VERSION, b"snapshot 9", 1), "version 9"),
        (lambda data: b"", "not a snapshot"),
        (lambda data: b"PK" + data, "not a snapshot"),
    ],
)
def test_a_bad_snapshot_is_refused_by_name_and_the_one_before_it_is_used(written, damage, why):
    last = files(written)[-1]
    last.write_bytes(damage(last.read_bytes()))
    refused: list[str] = []
    assert newest(written, refused).tick == 11
    assert str(last) in refused[0]
    assert why in refused[0]


def test_a_folder_without_a_snapshot_is_named(tmp_path):
    with pytest.raises(SnapshotError, match="no usable snapshot"):
        newest(tmp_path / "nothing", [])


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> bytes:
    """The bytes of a good snapshot's file."""
    return store(*as_file(local_at(3).snapshot()), tmp_path_factory.mktemp("good")).read_bytes()


@settings(max_examples=200)
@given(junk=st.binary(max_size=200), at=st.integers(0, 10**6))
def test_whatever_bytes_are_in_a_file_it_is_a_snapshot_or_refused(tmp_path_factory, good, junk, at):
    at %= len(good)
    assert_usable_or_refused(tmp_path_factory.getbasetemp() / "junk.snapshot", good[:at] + junk + good[at + len(junk) :])


@settings(max_examples=300)
@given(junk=st.binary(max_size=20), at=st.integers(0, 10**6))
def test_a_false_payload_with_a_right_checksum_is_a_snapshot_or_refused(tmp_path_factory, good, junk, at):
    payload = good.split(b"\n", 2)[2]
    at %= len(payload)
    payload = payload[:at] + junk + payload[at + len(junk) :]
    head = HEAD % VERSION + hashlib.sha256(payload).hexdigest().encode() + b"\n"
    assert_usable_or_refused(tmp_path_factory.getbasetemp() / "false.snapshot", head + payload)
