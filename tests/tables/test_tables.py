"""The tables of a run: each row is what the run was, and a run that is resumed leaves each row
once.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from local_runs import HARVEST_TICKS, SMALL
from table_runs import ALL, read, rows_of, run, tick

from orchard.contract.agent import STATES
from orchard.contract.events import STOPPED, Event
from orchard.contract.messages import Fetch, pack, type_of, unpack
from orchard.field.kinds import kind_of
from orchard.field.scenario import TIME_STEP, Scenario, with_changes
from orchard.local import Local
from orchard.report.metrics import HarvestFigures
from orchard.sim.kernels.move import quaternions
from orchard.sim.snapshot import Snapshot
from orchard.tables import folder as folders
from orchard.tables.columns import EVENTS
from orchard.tables.folder import GrowingTable, complete
from orchard.tables.tables import Tables

TICKS = 60
# Errors of sensors: of receivers in m, of odometry as a share of the way and in rad a metre.
GNSS = {"sensors.gnss.white": 0.01, "sensors.gnss.bias": 0.02}
ODOMETRY = {"sensors.odometry.distance": 0.02, "sensors.odometry.heading": 0.01}
ERRING = with_changes(SMALL, **GNSS, **ODOMETRY)
MEASURED = ("measured_x", "measured_y")
RECKONED = ("odometry_x", "odometry_y", "odometry_yaw")


@dataclass(frozen=True)
class Harvested:
    """A run that has written tables, and what happened in it.

    `letters`: the type of each message between agents. `poses`, `twists`: (ticks, bodies, 3).
    """

    folder: Path
    local: Local
    figures: HarvestFigures
    events: list[Event]
    letters: list[str]
    poses: np.ndarray
    twists: np.ndarray


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Run through some exchanges. Return its tables, and what happened in it."""
    local = Local(Scenario(rows=3))
    folder = tmp_path_factory.mktemp("tables")
    tables = Tables(folder, local.engine)
    figures = HarvestFigures()
    events = []
    letters = []
    poses = []
    twists = []
    while local.engine.tick < HARVEST_TICKS:
        happened = local.tick()
        written = local.post.written.get(local.engine.tick - 1, {})
        tables.update(local.engine, happened, written)
        figures.update(local.engine.world, happened, local.engine.answers)
        events += happened
        letters += types_of(written)
        poses.append(local.engine.world.pose.copy())
        twists.append(local.engine.world.twist.copy())
    tables.close()
    return Harvested(folder, local, figures, events, letters, np.array(poses), np.array(twists))


def types_of(written) -> list[str]:
    """Return the type of each request and answer that agents have written."""
    types = []
    for letters in written.values():
        types += [type_of(request) for _, request in letters.requests]
        types += [type_of(answer.body) for answer in letters.answers]
    return types


def test_each_body_has_a_row_a_tick_with_the_worlds_bits(whole):
    table = pq.read_table(whole.folder / "bodies.parquet")
    names = whole.local.engine.layout.names
    assert table["tick"].to_pylist() == [t for t in range(1, HARVEST_TICKS + 1) for _ in names]
    assert table["name"].to_pylist() == [*names] * HARVEST_TICKS

    def stored(*columns: str) -> bytes:
        return np.stack([table[column].to_numpy() for column in columns], axis=1).tobytes()

    assert stored("x", "y", "yaw") == whole.poses.tobytes()
    assert stored("linear_x", "linear_y", "angular_z") == whole.twists.tobytes()


def test_measured_poses_have_the_bits_that_agents_observe(tmp_path):
    """Sensors err in this run, so each measured pose differs from the true one."""
    local = Local(ERRING)
    # x, y of each body. Agents observe the poses at the begin of a step; a row has those at its
    # end, which are the next step's.
    observed = []
    tables = Tables(tmp_path, local.engine)
    for _ in range(TICKS):
        tick(local, tables)
        observed.append(local.seen.states[:, :2])
    tables.close()
    observed.append(local.engine.observe().states[:, :2])
    robots = robots_of(local)
    measured = stored_poses(tmp_path, MEASURED, robots)
    assert (measured != stored_poses(tmp_path, ("x", "y"), robots)).any(axis=1).all()
    known = np.concatenate([states[robots] for states in observed[1:]])
    assert measured.tobytes() == known.tobytes()


def test_reckoned_poses_have_the_bits_of_the_odometry(tmp_path):
    local = Local(ERRING)
    # x, y and the quaternion's z, w of each body, at the end of a step.
    odometry = []
    tables = Tables(tmp_path, local.engine)
    for _ in range(TICKS):
        tick(local, tables)
        odometry.append(local.engine.odometry().states[:, :4])
    tables.close()
    robots = robots_of(local)
    reckoned = stored_poses(tmp_path, RECKONED, robots)
    known = np.concatenate([states[robots] for states in odometry])
    assert np.hstack([reckoned[:, :2], quaternions(reckoned)]).tobytes() == known.tobytes()


def robots_of(local) -> list[int]:
    """Return the numbers of the pickers and carriers."""
    names = local.engine.layout.names
    return [i for i, name in enumerate(names) if kind_of(name) in ("picker", "carrier")]


def stored_poses(folder, columns: tuple[str, ...], bodies: list[int]) -> np.ndarray:
    """Return the columns of these bodies, tick after tick."""
    table = pq.read_table(folder / "bodies.parquet")
    stored = np.stack([table[name].to_numpy() for name in columns], axis=1)
    return stored.reshape(TICKS, -1, len(columns))[:, bodies].reshape(-1, len(columns))


@pytest.mark.parametrize(
    ("errors", "columns"),
    [({}, ()), (GNSS, MEASURED), (ODOMETRY, RECKONED), (GNSS | ODOMETRY, MEASURED + RECKONED)],
)
def test_what_is_measured_exactly_is_null(tmp_path, errors, columns):
    """`columns`: those that robots have with these errors of sensors."""
    run(Local(with_changes(Scenario(rows=3), **errors)), tmp_path, 2).close()
    for row in rows_of(tmp_path, "bodies"):
        is_robot = kind_of(row["name"]) in ("picker", "carrier", "tractor")
        expected = columns if is_robot else ()
        filled = [name for name in MEASURED + RECKONED if row[name] is not None]
        assert set(filled) == set(expected)


def test_a_body_that_is_not_blocked_drives_as_it_wanted(whole):
    table = pq.read_table(whole.folder / "bodies.parquet")

    def velocities(prefix: str) -> np.ndarray:
        columns = (f"{prefix}linear_x", f"{prefix}angular_z")
        return np.stack([table[column].to_numpy() for column in columns])

    wanted = velocities("cmd_")
    done = velocities("")
    moved = (done != 0.0).any(axis=0)
    assert moved.any()
    assert (wanted != 0.0).any()
    assert (wanted[:, moved] == done[:, moved]).all()


def test_the_states_add_up_to_those_of_the_summary(whole):
    table = pq.read_table(whole.folder / "bodies.parquet", columns=["name", "state"])
    counts = table.group_by(["name", "state"]).aggregate([([], "count_all")]).to_pylist()
    counted = {(row["name"], row["state"]): row["count_all"] for row in counts}
    for name, ticks in whole.local.engine.states.counts.ticks.items():
        assert [counted.get((name, state), 0) for state in STATES] == ticks


def test_the_events_and_the_messages_are_those_of_the_run(whole):
    folder = whole.folder
    # A text that is empty is null in the table.
    for row, event in zip(rows_of(folder, "events"), whole.events, strict=True):
        assert row["tick"] == event.tick
        assert row["what"] == event.what
        assert row["who"] == event.who
        assert (row["whom"] or "") == event.whom
        assert (row["detail"] or "") == event.detail

    messages = rows_of(folder, "messages")
    assert sorted(row["type"] for row in messages) == sorted(whole.letters)
    order = [(row["tick"], row["sender"]) for row in messages]
    assert order == sorted(order)
    fetch = next(row for row in messages if row["type"] == "fetch")
    assert msgspec.json.decode(fetch["content"], type=Fetch).lane in (1, 2, 3)


def test_an_exchange_lasts_for_the_wait_and_the_drive_before(whole):
    """A row counts from the full bin on. The wait of the summary is shorter: it begins when the
    picker has come to its row's end and left the bin there.
    """
    rows = rows_of(whole.folder, "exchanges")
    supplied = [row for row in rows if row["supplied"] is not None]
    supplied.sort(key=lambda row: row["supplied"])
    for row, wait in zip(supplied, whole.figures.waits, strict=True):
        ticks = row["supplied"] - row["full"]
        assert row["waited_seconds"] == pytest.approx(ticks * TIME_STEP)
        assert 0.0 <= wait < row["waited_seconds"]
    first = rows[0]
    assert first["full"] < first["left"] < first["brought"] < first["supplied"] < first["fetched"]


def test_each_call_is_followed_from_message_to_carrier(whole):
    rows = [row for row in rows_of(whole.folder, "calls") if row["fetched"] is not None]
    assert rows
    for row in rows:
        assert row["called"] < row["sent"] < row["agreed"] < row["fetched"]
        assert row["asked"] >= 1


def test_each_column_has_its_unit_in_the_file(whole):
    for name, schema in ALL.items():
        fields = pq.read_table(whole.folder / f"{name}.parquet").schema
        assert [field.metadata for field in fields] == [field.metadata for field in schema]
        assert all(field.metadata.keys() == {b"unit", b"description"} for field in fields)


def test_the_page_names_each_column():
    page = (ROOT / "docs" / "reference.md").read_text()
    for name, schema in ALL.items():
        expected = {
            word
            for line in re.findall(rf"(?<=^\| column of `{name}`)(?:.*\n\|.*)+", page, re.M)
            for word in re.findall(r"`(\w+)`", line)
        }
        assert expected >= {*schema.names}, name


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Return the tables of a run that nothing interrupts."""
    folder = tmp_path_factory.mktemp("undisturbed")
    run(Local(ERRING), folder, TICKS).close()
    return read(folder)


@pytest.mark.parametrize("most", [50, folders.MOST_ROWS])
@pytest.mark.parametrize(
    ("snapshot_tick", "end_tick", "is_closed"),
    [
        pytest.param(20, 33, False, id="killed after the snapshot"),
        pytest.param(0, 9, False, id="killed before the first snapshot"),
        pytest.param(20, 20, False, id="killed at the snapshot"),
        pytest.param(31, 31, True, id="stopped at the snapshot"),
        pytest.param(20, 45, True, id="stopped after the snapshot"),
    ],
)
def test_a_run_that_is_resumed_leaves_each_row_once(
    tmp_path, undisturbed, monkeypatch, most, snapshot_tick, end_tick, is_closed
):
    """The run goes on from the snapshot, so the rows after it are written a second time.

    `most`: the rows that a file of a growing table has at most. `is_closed`: the run was stopped,
    and not killed, at `end_tick`.
    """
    monkeypatch.setattr(folders, "MOST_ROWS", most)
    local = Local(ERRING)
    tables = run(local, tmp_path, snapshot_tick)
    tables.flush()
    snapshot = unpack(pack(local.snapshot()), Snapshot)
    while local.engine.tick < end_tick:
        tick(local, tables)
        if local.engine.tick % 5 == 0:
            tables.flush()
    if is_closed:
        tables.close()
    run(Local.resume(snapshot), tmp_path, TICKS).close()
    assert read(tmp_path) == undisturbed
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        f"{name}.parquet" for name in ALL
    )


def test_a_file_torn_by_a_kill_goes(tmp_path, undisturbed):
    """A file is written under a hidden name, and renamed when it is whole."""
    local = Local(ERRING)
    tables = run(local, tmp_path, 40)
    torn = tmp_path / "bodies.parquet" / ".000001.parquet.123.new"
    torn.write_text("half of it")
    tables.flush()
    assert len(pq.read_table(tmp_path / "bodies.parquet")) == 40 * len(local.engine.layout.names)
    run(Local.resume(local.snapshot()), tmp_path, TICKS).close()
    assert read(tmp_path) == undisturbed
    assert not torn.exists()


# Few examples, because each waits for the disk.
@settings(max_examples=25)
@given(st.lists(st.integers(1, 4), max_size=12), st.integers(0, 12), st.integers(1, 9))
def test_what_is_removed_from_a_growing_table_comes_again(tmp_path_factory, steps, until, most):
    """`steps`: how many rows are written at once, one row a tick. `most`: rows of a file at most.

    A second table then begins at the tick `until`. It removes all rows from there on, and they are
    written again.
    """
    folder = tmp_path_factory.mktemp("growing") / "events.parquet"
    rows = [(t, "collision", f"dog_{t}", None, None) for t in range(sum(steps))]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(folders, "MOST_ROWS", most)
        for begin in (0, until):
            table = GrowingTable(folder, EVENTS, begin)
            left = [row for row in rows if row[0] >= begin]
            for step in steps:
                part = left[:step]
                left = left[step:]
                table.add(
                    EVENTS.empty_table().from_pylist(
                        [dict(zip(EVENTS.names, row, strict=True)) for row in part], EVENTS
                    )
                )
        table.finish()
    assert [row["tick"] for row in pq.read_table(folder).to_pylist()] == [row[0] for row in rows]


def test_a_run_that_ends_before_its_first_tick_has_empty_tables(tmp_path):
    run(Local(SMALL), tmp_path, 0).close()
    assert [len(table) for table in read(tmp_path).values()] == [0] * len(ALL)
    assert complete(tmp_path, {"ticks": 0, "scenario": {}}) == []


def test_a_stopped_robot_is_stopped_in_the_rows(tmp_path):
    """After the reset its rows are as before the stop."""
    stopped_at = 3
    local = Local(SMALL)
    tables = run(local, tmp_path, stopped_at)
    local.engine.stop(["picker_01"])
    tick(local, tables)
    local.engine.reset()
    for _ in range(5):
        tick(local, tables)
    tables.close()
    rows = rows_of(tmp_path, "bodies", "picker_01")
    states = [row["state"] for row in rows]
    assert [states.count(state) for state in STATES] == local.engine.states.counts.ticks[
        "picker_01"
    ]
    assert [row["doing"] == STOPPED for row in rows] == [t == stopped_at for t in range(9)]
