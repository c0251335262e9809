"""The tables of a run: each row is what the run was, and a run that is resumed leaves each row
once.
"""

import os
import re

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import typer
from command_line import ROOT, orchard, python
from hypothesis import given, settings
from hypothesis import strategies as st
from local_runs import HARVEST_TICKS, SMALL

from orchard.contract.agent import STATES
from orchard.contract.events import STOPPED
from orchard.contract.messages import Fetch, pack, type_of, unpack
from orchard.field.kinds import kind_of
from orchard.field.scenario import TIME_STEP, Scenario, with_changes
from orchard.local import Local
from orchard.report.metrics import HarvestFigures
from orchard.server.figures import RunFigures
from orchard.sim.kernels.move import quaternions
from orchard.sim.snapshot import Snapshot
from orchard.tables import folder as folders
from orchard.tables.columns import BODIES, CALLS, EVENTS, EXCHANGES, MESSAGES, SUMMARY
from orchard.tables.exchanges import calls, exchanges
from orchard.tables.folder import GrowingTable, as_table, check_folder, complete, last_tick
from orchard.tables.tables import Tables
from orchard.terminal.exits import exit_on_errors

ALL = {
    "bodies": BODIES,
    "events": EVENTS,
    "messages": MESSAGES,
    "calls": CALLS,
    "exchanges": EXCHANGES,
}
SHORT = ("--rows", 3, "--mode", "local", "--duration", 1, "--record", "none")
TICKS = 60
GNSS = {"sensors.gnss.white": 0.01, "sensors.gnss.bias": 0.02}
ODOMETRY = {"sensors.odometry.distance": 0.02, "sensors.odometry.heading": 0.01}
ERRING = with_changes(SMALL, **GNSS, **ODOMETRY)
MEASURED = ("measured_x", "measured_y")
RECKONED = ("odometry_x", "odometry_y", "odometry_yaw")


def tick(local: Local, tables: Tables) -> None:
    events = local.tick()
    tables.update(local.engine, events, local.post.written.get(local.engine.tick - 1, {}))


def run(local: Local, folder, ticks: int) -> Tables:
    tables = Tables(folder, local.engine)
    while local.engine.tick < ticks:
        tick(local, tables)
    return tables


def read(folder) -> dict:
    return {name: pq.read_table(folder / f"{name}.parquet") for name in ALL}


def rows_of(folder, name: str, body: str = "") -> list[dict]:
    rows = pq.read_table(folder / f"{name}.parquet").to_pylist()
    return [row for row in rows if not body or row["name"] == body]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The tables of a run of some exchanges, its agents' view of it, and its figures."""
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
        letters += [
            type_of(body)
            for one in written.values()
            for body in [*(r for _, r in one.requests), *(a.body for a in one.answers)]
        ]
        poses.append(local.engine.world.pose.copy())
        twists.append(local.engine.world.twist.copy())
    tables.close()
    return folder, local, figures, events, letters, np.array(poses), np.array(twists)


def test_each_body_has_a_row_a_tick_with_the_worlds_bits(whole):
    """Each body has a row for each tick with the same bits as in the world."""
    folder, local, _, _, _, poses, twists = whole
    table = pq.read_table(folder / "bodies.parquet")
    names = local.engine.layout.names
    assert table["tick"].to_pylist() == [t for t in range(1, HARVEST_TICKS + 1) for _ in names]
    assert table["name"].to_pylist() == [*names] * HARVEST_TICKS
    for columns, known in (
        (("x", "y", "yaw"), poses),
        (("linear_x", "linear_y", "angular_z"), twists),
    ):
        stored = np.stack([table[column].to_numpy() for column in columns], axis=1).reshape(
            known.shape
        )
        assert stored.tobytes() == known.tobytes()


def test_measured_poses_have_the_bits_that_agents_observe(tmp_path):
    """The measured poses have the same bits as those that agents observe."""
    local = Local(ERRING)
    measured = []
    reckoned = []
    tables = Tables(tmp_path, local.engine)
    for _ in range(TICKS):
        tick(local, tables)
        measured.append(local.seen.states[:, :2])  # at the begin of the step
        reckoned.append(local.engine.odometry().states[:, :4])  # at its end
    tables.close()
    measured.append(local.engine.observe().states[:, :2])
    robots = [
        i
        for i, name in enumerate(local.engine.layout.names)
        if kind_of(name) in ("picker", "carrier")
    ]
    stored = stored_poses(tmp_path, ("x", "y"), robots)
    assert (stored_poses(tmp_path, MEASURED, robots) != stored).any(axis=1).all()
    assert (
        stored_poses(tmp_path, MEASURED, robots).tobytes()
        == np.concatenate([states[robots] for states in measured[1:]]).tobytes()
    )
    stored = stored_poses(tmp_path, RECKONED, robots)
    known = np.concatenate([states[robots] for states in reckoned])
    assert np.hstack([stored[:, :2], quaternions(stored)]).tobytes() == known.tobytes()


def stored_poses(folder, columns: tuple[str, ...], bodies: list[int]) -> np.ndarray:
    """The columns of these bodies, tick after tick."""
    table = pq.read_table(folder / "bodies.parquet")
    stored = np.stack([table[name].to_numpy() for name in columns], axis=1)
    return stored.reshape(TICKS, -1, len(columns))[:, bodies].reshape(-1, len(columns))


@pytest.mark.parametrize(
    ("errors", "told"),
    [({}, ()), (GNSS, MEASURED), (ODOMETRY, RECKONED), (GNSS | ODOMETRY, MEASURED + RECKONED)],
)
def test_what_is_measured_exactly_is_null(tmp_path, errors, told):
    run(Local(with_changes(Scenario(rows=3), **errors)), tmp_path, 2).close()
    for row in rows_of(tmp_path, "bodies"):
        is_robot = kind_of(row["name"]) in ("picker", "carrier", "tractor")
        assert {name for name in MEASURED + RECKONED if row[name] is not None} == {
            *(told if is_robot else ())
        }


def test_a_body_that_is_not_blocked_drives_as_it_wanted(whole):
    table = pq.read_table(whole[0] / "bodies.parquet")
    wanted, done = (
        np.stack([table[f"{before}{name}"].to_numpy() for name in ("linear_x", "angular_z")])
        for before in ("cmd_", "")
    )
    moved = (done != 0.0).any(axis=0)
    assert moved.any() and (wanted != 0.0).any()
    assert (wanted[:, moved] == done[:, moved]).all()


def test_the_states_add_up_to_those_of_the_summary(whole):
    folder, local, *_ = whole
    table = pq.read_table(folder / "bodies.parquet", columns=["name", "state"])
    counts = table.group_by(["name", "state"]).aggregate([([], "count_all")]).to_pylist()
    counted = {(row["name"], row["state"]): row["count_all"] for row in counts}
    for name, ticks in local.engine.states.counts.ticks.items():
        assert [counted.get((name, state), 0) for state in STATES] == ticks


def test_the_events_and_the_messages_are_those_of_the_run(whole):
    folder, _, _, events, letters, *_ = whole
    told = [
        (row["tick"], row["what"], row["who"], row["whom"] or "", row["detail"] or "")
        for row in rows_of(folder, "events")
    ]
    assert told == [(e.tick, e.what, e.who, e.whom, e.detail) for e in events]
    messages = rows_of(folder, "messages")
    assert sorted(row["type"] for row in messages) == sorted(letters)
    assert [(row["tick"], row["sender"]) for row in messages] == sorted(
        (row["tick"], row["sender"]) for row in messages
    )
    fetch = next(row for row in messages if row["type"] == "fetch")
    assert msgspec.json.decode(fetch["content"], type=Fetch).lane in (1, 2, 3)


def test_an_exchange_lasts_for_the_wait_and_the_drive_before(whole):
    """An exchange lasts for the wait in the summary and the drive before it."""
    folder, _, figures, *_ = whole
    found = rows_of(folder, "exchanges")
    supplied = sorted(
        (row for row in found if row["supplied"] is not None), key=lambda row: row["supplied"]
    )
    for row, wait in zip(supplied, figures.waits, strict=True):
        ticks = row["supplied"] - row["full"]
        assert row["waited_seconds"] == pytest.approx(ticks * TIME_STEP)
        assert 0.0 <= wait < row["waited_seconds"]
    first = found[0]
    assert first["full"] < first["left"] < first["brought"] < first["supplied"] < first["fetched"]


def test_each_call_is_followed_from_message_to_carrier(whole):
    """Each call is followed from its first message to the carrier."""
    found = [row for row in rows_of(whole[0], "calls") if row["fetched"] is not None]
    assert found
    for row in found:
        assert row["called"] < row["sent"] < row["agreed"] < row["fetched"] and row["asked"] >= 1


def test_each_column_has_its_unit_in_the_file(whole):
    for name, schema in ALL.items():
        fields = pq.read_table(whole[0] / f"{name}.parquet").schema
        assert [field.metadata for field in fields] == [field.metadata for field in schema]
        assert all(field.metadata.keys() == {b"unit", b"description"} for field in fields)


def test_the_page_names_each_column():
    page = (ROOT / "docs" / "reference.md").read_text()
    for name, schema in ALL.items():
        told = {
            word
            for line in re.findall(rf"(?<=^\| column of `{name}`)(?:.*\n\|.*)+", page, re.M)
            for word in re.findall(r"`(\w+)`", line)
        }
        assert told >= {*schema.names}, name


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed")
    run(Local(ERRING), folder, TICKS).close()
    return read(folder)


@pytest.mark.parametrize("most", [50, folders.MOST_ROWS])
@pytest.mark.parametrize(
    ("kept", "dead", "is_closed"),
    [(20, 33, False), (0, 9, False), (20, 20, False), (31, 31, True), (20, 45, True)],
)
def test_a_run_that_is_resumed_leaves_each_row_once(
    tmp_path, undisturbed, monkeypatch, most, kept, dead, is_closed
):
    """The snapshot is of the tick `kept`; the rows reach until `dead`, at which the program is
    killed or the run stopped.
    """
    monkeypatch.setattr(folders, "MOST_ROWS", most)
    local = Local(ERRING)
    tables = run(local, tmp_path, kept)
    tables.flush()
    snapshot = unpack(pack(local.snapshot()), Snapshot)
    while local.engine.tick < dead:
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
    """A file that a kill has torn is no part of the table and goes."""
    local = Local(ERRING)
    tables = run(local, tmp_path, 40)
    torn = tmp_path / "bodies.parquet" / ".000001.parquet.123.new"
    torn.write_text("half of it")
    tables.flush()
    assert len(pq.read_table(tmp_path / "bodies.parquet")) == 40 * len(local.engine.layout.names)
    run(Local.resume(local.snapshot()), tmp_path, TICKS).close()
    assert read(tmp_path) == undisturbed and not torn.exists()


@settings(max_examples=25)  # each waits for the disk
@given(st.lists(st.integers(1, 4), max_size=12), st.integers(0, 12), st.integers(1, 9))
def test_what_is_removed_from_a_growing_table_comes_again(tmp_path_factory, steps, until, most):
    """What is removed from a growing table is what comes again.

    Steps of some ticks are written one after another; then all from a tick on are
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
    """A run that ends before its first tick leaves empty tables."""
    run(Local(SMALL), tmp_path, 0).close()
    assert [len(table) for table in read(tmp_path).values()] == [0] * len(ALL)
    assert complete(tmp_path, {"ticks": 0, "scenario": {}}) == []


def test_a_folder_with_tables_is_refused_and_kept(tmp_path):
    orchard(*SHORT, "--table", tmp_path / "tables")
    before = (tmp_path / "tables" / "bodies.parquet" / "000001.parquet").read_bytes()
    done = orchard(*SHORT, "--table", tmp_path / "tables", code=2)
    assert done.stdout == ""
    assert (
        done.stderr
        == f"{tmp_path}/tables: tables of a run are there, and are not replaced; --table DIR names"
        " another folder\n"
    )
    assert (tmp_path / "tables" / "bodies.parquet" / "000001.parquet").read_bytes() == before


@pytest.mark.parametrize("name", ["events", "messages", "calls", "exchanges", "summary"])
def test_a_file_with_the_name_of_a_table_is_refused_and_kept(name, tmp_path):
    own = tmp_path / f"{name}.parquet"
    own.write_text("a year's work")
    with pytest.raises(ValueError, match=rf"{name}.parquet: it has the name of a table"):
        check_folder(tmp_path, SMALL)
    with pytest.raises(ValueError, match="--table DIR names another folder"):
        check_folder(tmp_path, SMALL, 5)
    assert own.read_text() == "a year's work"


def test_files_of_a_user_beside_the_rows_of_a_table_stay(tmp_path):
    table = tmp_path / "bodies.parquet"
    local = Local(SMALL)
    run(local, tmp_path, 20).close()
    names = ("notes.new", ".notes.txt.12.new", "notes.parquet")
    for name in names:
        (table / name).write_text("a year's work")
    run(Local.resume(local.snapshot()), tmp_path, 30).close()
    assert [(table / name).read_text() for name in names] == ["a year's work"] * 3
    assert last_tick(tmp_path) == 30


def test_physics_started_by_hand_replaces_no_tables(tmp_path):
    """Physics that is started by hand does not replace tables either."""
    run(Local(SMALL), tmp_path, 5).close()
    done = python("-m", "orchard.processes.physics", "--table", tmp_path, code=2)
    assert "tables of a run are there, and are not replaced" in done.stderr
    assert last_tick(tmp_path) == 5


def test_a_file_in_place_of_the_folder_is_told(tmp_path):
    (tmp_path / "tables").write_text("")
    with pytest.raises(
        OSError,
        match=(
            "tables: tables cannot be written there: File exists; --table DIR names another folder"
        ),
    ):
        check_folder(tmp_path / "tables", SMALL)


@pytest.mark.parametrize("fault", [13, 30])
def test_a_folder_that_can_only_be_read_is_told_in_words(tmp_path, monkeypatch, capsys, fault):
    def refuse(path, *_, **__):
        raise OSError(fault, os.strerror(fault), str(path))

    monkeypatch.setattr(type(tmp_path), "touch", refuse)
    with pytest.raises(typer.Exit) as end, exit_on_errors(OSError):
        check_folder(tmp_path / "new", SMALL)
    assert end.value.exit_code == 2
    why = f"tables cannot be written there: {os.strerror(fault)}; --table DIR names another folder"
    assert capsys.readouterr().err == f"{tmp_path}/new: {why}\n"


def test_tables_that_do_not_fit_a_resumed_run_are_refused(tmp_path):
    """Tables of another run or with missing rows are refused when a run is resumed."""
    run(Local(SMALL), tmp_path, 5).close()
    check_folder(tmp_path, SMALL, 5)
    with pytest.raises(
        ValueError,
        match=(
            "the tables there end at tick 5, and the run goes on at tick 6: rows would be missing"
        ),
    ):
        check_folder(tmp_path, SMALL, 6)
    with pytest.raises(ValueError, match="the tables there are of another scenario"):
        check_folder(tmp_path, SMALL.model_copy(update={"seed": 7}), 5)
    complete(tmp_path, {"ticks": 5, "scenario": {}})
    check_folder(tmp_path, SMALL, 5)
    with pytest.raises(
        ValueError,
        match=(
            "are of a run that ended at tick 5, and this one goes on at tick 4: its rows would be"
            " lost"
        ),
    ):
        check_folder(tmp_path, SMALL, 4)
    (tmp_path / "bodies.parquet" / "000001.parquet").write_text("no table")
    with pytest.raises(ValueError, match="the tables there cannot be read"):
        check_folder(tmp_path, SMALL, 5)


def test_a_full_disk_is_logged_once_and_told_at_the_end(tmp_path, monkeypatch, caplog):
    """A disk that becomes full is logged once and told at the end."""
    local = Local(SMALL)
    tables = None
    tables = run(local, tmp_path, 5)
    tables.flush()

    def refuse(*_):
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(folders, "write_whole", refuse)
    tick(local, tables)
    tables.flush()
    tick(local, tables)
    tables.close()
    monkeypatch.undo()
    (told,) = [record.getMessage() for record in caplog.records]
    assert (
        told
        == f"the tables in {tmp_path} cannot be written: No space left on device; the run goes on"
        " without them"
    )
    assert complete(tmp_path, {"ticks": 7, "scenario": {}}) == [
        f"{tmp_path}: the tables end at tick 5, and the run at tick 7"
    ]
    assert last_tick(tmp_path) == 5


def test_a_summary_becomes_one_row():
    summary = {"hash": "ab", "ticks": 5, "lost_seconds": {"traffic": 1.5}, "violations": []}
    summary |= {"scenario": {"rows": 3}, "history": {"seconds": [1, 2]}}
    table = as_table(summary)
    (row,) = table.to_pylist()
    assert {name: value for name, value in row.items() if value is not None} == {
        "hash": "ab",
        "ticks": 5,
        "lost_seconds.traffic": 1.5,
        "violations": "[]",
        "scenario": '{"rows":3}',
        "history.seconds": [1.0, 2.0],
    }
    assert (
        table.schema.field("lost_seconds.traffic").metadata[b"unit"]
        == b"s, which add up to the harvest's length"
    )


def test_all_summaries_have_one_schema_whatever_happened():
    run = Local(Scenario(rows=3, tractor=False))
    figures = RunFigures(run.engine, lambda: 0.0)
    summaries = [figures.summary()]
    run.engine.stop(["picker_01"])
    for _ in range(20):
        figures.update(run.tick())
    summaries.append(figures.summary() | {"messages_refused": {"not a letter": 2}, "jam": ["x"]})
    summaries[1] |= {"ticks_late": 1, "answer_milliseconds": {"p50": 1, "p99": None}}
    summaries[1] |= {"forked_from": {"run": "harvest", "seconds": 2}, "lost_seconds": {}}
    summaries.append(dict(reversed(summaries[0].items())) | {"bins_per_hour": 1})
    tables = [as_table(summary) for summary in summaries]
    assert all(table.schema.equals(SUMMARY) for table in tables)
    together = pa.concat_tables(tables)
    assert together["stopped_seconds"].to_pylist()[:2] == ["{}", '{"bin_01":2.0,"picker_01":2.0}']
    assert together["bins_per_hour"].to_pylist()[2] == 1.0


def test_a_figure_without_a_column_is_told(tmp_path):
    with pytest.raises(ValueError, match="golden_kiwis: no such column"):
        as_table({"golden_kiwis": 1.0, "scenario": {}})


def message(tick, sender, recipient, type_, content="{}"):
    return {
        "tick": tick,
        "sender": sender,
        "recipient": recipient,
        "type": type_,
        "content": content,
    }


def test_a_carrier_that_does_not_come_is_followed_by_the_next():
    called = '{"type":"call","lane":2,"side":"west","since":3}'
    said = [
        message(3, "bin_01", "carrier_01", "call", called),
        message(23, "bin_01", "carrier_01", "call", called),
        message(25, "bin_01", "carrier_01", "come"),
        message(26, "carrier_01", "bin_01", "yes"),
        message(75, "bin_01", "carrier_02", "come"),
        message(76, "carrier_02", "bin_01", "yes"),
        message(86, "carrier_02", "bin_01", "yes"),
    ]
    coupled = {"tick": 90, "what": "coupled", "who": "carrier_02", "whom": "bin_01", "detail": None}
    (call,) = calls([coupled], said)
    assert tuple(call.values()) == ("bin_01", None, 2, "west", 3, 2, "carrier_02", 75, 76, 90)
    (open_,) = calls([], said[:3])
    assert tuple(open_.values()) == ("bin_01", None, 2, "west", 3, 2, "carrier_01", 25, None, None)


def test_a_picker_that_couples_its_full_bin_has_no_empty_one():
    """A picker that couples its full bin anew has no empty one yet."""

    def event(tick, what, who, whom, detail=None):
        return {"tick": tick, "what": what, "who": who, "whom": whom, "detail": detail}

    full = event(90, "bin full", "bin_01", "picker_01", "row 2, 70.00 m")
    anew = event(100, "coupled", "picker_01", "bin_01")
    empty = event(120, "coupled", "picker_01", "bin_02")
    (exchange,) = exchanges([full, anew, empty])
    assert (exchange["empty_bin"], exchange["supplied"]) == ("bin_02", 120)


def test_tables_from_the_middle_have_no_false_rows():
    """Tables that begin in the middle of an exchange have no false rows."""
    coupled = {"tick": 90, "what": "coupled", "who": "picker_02", "whom": "bin_01", "detail": None}
    assert exchanges([coupled, {**coupled, "what": "unloaded", "who": "bin_09"}]) == []


def test_a_stopped_robot_is_stopped_in_the_rows(tmp_path):
    """A stopped robot is stopped in the rows and says again what it said after the reset."""
    local = Local(SMALL)
    tables = run(local, tmp_path, 3)
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
    assert [row["doing"] == STOPPED for row in rows] == [t == 3 for t in range(9)]
