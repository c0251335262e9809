"""The logger: killed it goes on in a further part of the recording, slow it leaves out pictures and holds nobody up."""

import re
import signal
import subprocess
import time
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
from fleet import Fleet, Process, until
from rerun.chunk import RrdReader
from scripted_orchard import acted_layout, frames
from slow_logger import MOST, SECONDS
from test_repeatable import run as hash_after
from test_run import orchard, running, summary_of

from orchard.config import Scenario
from orchard.frames import Event, Frame
from orchard.parts import parts_of
from orchard.view import Recorder
from orchard.view.parts import before, missing, read_part
from processes.pages import Page, Pages, write
from processes.watchdog import SECONDS as FROZEN_SECONDS
from processes.watchdog import Watchdog

LAYOUT = acted_layout(rows=3, pickers=2)


# -- what waits


class Notebook:
    """Writes down what a recorder is told."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.told: list[tuple[int, Event]] = []
        self.gaps: list[tuple[int, int]] = []

    def tick(self, frame: Frame) -> None:
        self.frames.append(frame)
        self.told += [(frame.tick - 1, event) for event in frame.events]

    def gap(self, since: int, until: int, why: str) -> None:
        self.gaps.append((since, until))

    def tell(self, tick: int, event: Event) -> None:
        self.told.append((tick, event))

    def close(self) -> None:
        pass


def picture(tick: int, **news: object) -> Page:
    """A picture that tells little, and one event."""
    return Page(Frame(tick, np.zeros((1, 3)), **news), [(tick - 1, Event("call", "bin_01", "", f"of tick {tick - 1}"))])


def written(pages: Pages, last: int | None = 0) -> Notebook:
    pages.close()
    notebook = Notebook()
    write(pages, notebook, last)
    return notebook


def test_a_recorder_that_takes_three_ticks_a_picture_leaves_out_pictures_but_nothing_that_was_said():
    pages, taken = Pages(most=10), []
    for tick in range(1, 1001):
        pages.put(picture(tick))
        assert len(pages) <= 10
        if tick % 3 == 0:
            taken.append(pages.take())
    rest = written(pages, taken[-1].frame.tick)
    frames_ = [page.frame for page in taken] + rest.frames
    assert pages.left_out == 1000 - len(frames_) > 600
    assert pages.left_out == sum(frame.left_out for frame in frames_)
    assert rest.gaps == [], "it was there all the time"
    assert frames_[-1].tick == 1000, "the newest is never left out"
    told = [note for page in taken for note in page.notes] + rest.told
    assert sorted(tick for tick, _ in told) == list(range(1000))
    assert all(event.text == f"of tick {tick}" for tick, event in told)


def test_a_recorder_that_never_comes_back_costs_no_more_than_so_many_pictures():
    pages = Pages(most=10)
    for tick in range(1, 5001):
        pages.put(Page(Frame(tick, np.zeros((1, 3))), []))
    assert len(pages) == 10
    assert pages.left_out == 4990


def test_what_is_left_out_leaves_its_news_to_the_next():
    pages = Pages(most=1)
    pages.put(picture(1, doing={"picker_01": "picking row 1", "bin_01": "empty"}, row_picked=np.array([1.0]), alive=np.array([True])))
    pages.put(picture(2, doing={"bin_01": "full"}, alive=np.array([False])))
    pages.put(picture(3))
    (frame,) = written(pages).frames
    assert (frame.tick, frame.left_out) == (3, 2)
    assert frame.doing == {"picker_01": "picking row 1", "bin_01": "full"}
    assert frame.row_picked == [1.0] and frame.alive == [False]


def test_ticks_that_never_came_are_a_gap():
    pages = Pages()
    for tick in (31, 32, 40):
        pages.put(picture(tick))
    assert written(pages, last=20).gaps == [(20, 31), (32, 40)]


# -- what is in the parts


def recorded(path: Path, run: str, ticks: range) -> None:
    recorder = Recorder(LAYOUT, run, path)
    for frame in list(frames(LAYOUT, ticks.stop / 10))[ticks.start : ticks.stop]:
        recorder.tick(frame)
    recorder.close()


def test_a_recording_goes_on_where_it_can_be_read_to(tmp_path):
    path = tmp_path / "run.rrd"
    assert before(path, "a")[:2] == (path, 0)
    recorded(path, "a", range(0, 53))
    assert before(path, "a")[:2] == (tmp_path / "run.part2.rrd", 52)
    whole = path.read_bytes()
    recorder = Recorder(LAYOUT, "a", path)
    for frame in frames(LAYOUT, 30.0):
        recorder.tick(frame)
    recorder.rec.flush()
    torn = path.read_bytes()
    recorder.close()
    path.write_bytes(torn[: len(torn) * 9 // 10])
    known = before(path, "a")
    assert known.file == tmp_path / "run.part2.rrd"
    assert 100 < known.last < 300, "the last tenth is torn off"
    assert known.said["/world/pickers/picker_01"] == ["picking row 1"]
    path.write_bytes(whole[:100])
    assert before(path, "a")[:2] == (path, 0), "nothing in it can be read"
    path.write_bytes(b"")
    assert before(path, "a")[:2] == (path, 0)


def test_a_recording_of_another_run_is_not_gone_on_with(tmp_path):
    recorded(tmp_path / "run.rrd", "a", range(0, 20))
    assert before(tmp_path / "run.rrd", "b")[:2] == (tmp_path / "run.rrd", 0)


def test_what_is_missing_is_read_from_the_parts(tmp_path):
    path = tmp_path / "run.rrd"
    recorded(path, "a", range(0, 53))
    recorder = Recorder(LAYOUT, "a", before(path, "a").file)
    recorder.gap(52, 90, "the logger was away")
    for frame in list(frames(LAYOUT, 15.0))[90:150]:
        recorder.tick(replace(frame, left_out=7) if frame.tick == 120 else frame)
    recorder.close()
    told = missing(path, 170)
    assert told["recording_parts"] == ["run.rrd", "run.part2.rrd"]
    assert told["recording_gaps"] == [[5.2, 9.0], [14.9, 17.0]], "the second: nothing came after"
    assert told["messages_dropped"] == 7
    texts = lines_of(path)
    assert (9.0, "logger: nothing recorded from 5.2 s to 9.0 s: the logger was away") in texts
    assert any("left out 7 pictures" in text for _, text in texts)


def test_every_tick_counts_when_pictures_are_left_out(tmp_path):
    """No picture falls on a whole second, and yet the file is written as it goes on."""
    path = tmp_path / "run.rrd"
    recorder = Recorder(LAYOUT, "a", path)
    for frame in list(frames(LAYOUT, 60.0))[3:600:7]:
        if frame.tick % 10:
            recorder.tick(replace(frame, left_out=6))
    recorder.rec.flush()
    assert before(path, "a").last > 580
    recorder.close()


def test_a_further_part_shows_what_has_gone_in_the_gap(tmp_path):
    """A weed, a bar, the fruit of a row: the part before says that they are there."""
    path, poses = tmp_path / "run.rrd", np.array([start.pose for start in LAYOUT.starts])
    weed, picker = LAYOUT.index["weed_01"], LAYOUT.index["picker_01"]
    alive, coupled = np.ones(len(poses), bool), np.full(len(poses), -1)
    coupled[picker] = LAYOUT.index["bin_01"]
    early = Frame(1, poses, coupled=coupled.copy(), fill=np.zeros(len(poses)), alive=alive.copy(), row_picked=np.zeros(3))
    alive[weed], coupled[picker] = False, -1
    late = Frame(60, poses, coupled=coupled, fill=np.zeros(len(poses)), alive=alive, row_picked=np.array([70.0, 0.0, 0.0]))
    recorder = Recorder(LAYOUT, "a", path)
    recorder.tick(early)
    recorder.close()
    further = Recorder(LAYOUT, "a", before(path, "a").file)
    further.gap(1, 60, "the logger was away")
    further.tick(late)
    further.close()
    seen, then = seen_at(path, 6.0), seen_at(path, 1.0)
    assert ("/world/weeds/weed_01", "Mesh3D:vertex_positions") in then.keys() - seen.keys()
    assert ("/world/pickers/picker_01/bar", "LineStrips3D:strips") in then.keys() - seen.keys()
    assert ("/canopy/fruit/row_01", "Points3D:positions") in then.keys() - seen.keys()


# -- a frozen one


class OneProcess:
    """A fleet of one."""

    def __init__(self) -> None:
        self.number, self.killed = 1, []

    def pid(self, name: str) -> int:
        return self.number

    def kill(self, name: str) -> None:
        self.killed.append(self.number)


def test_a_process_is_ended_when_its_token_is_gone_for_too_long_and_not_while_it_starts():
    fleet, now = OneProcess(), [0.0]
    watchdog = Watchdog(fleet, "logger", lambda: now[0])
    now[0] = 100.0
    watchdog.look()
    assert fleet.killed == [], "it has not been there yet"
    watchdog.hear(True)
    watchdog.hear(False)
    now[0] += FROZEN_SECONDS - 0.1
    watchdog.look()
    watchdog.hear(True)
    now[0] += FROZEN_SECONDS
    watchdog.look()
    assert fleet.killed == [], "it came back"
    watchdog.hear(False)
    now[0] += FROZEN_SECONDS
    watchdog.look()
    assert fleet.killed == [1]
    fleet.number = 2
    now[0] += 10 * FROZEN_SECONDS
    watchdog.look()
    assert fleet.killed == [1], "the next one starts"
    watchdog.end()
    assert fleet.killed == [1, 2], "who is away at the end is not waited for"


# -- real processes


@pytest.fixture
def fleet(tmp_path):
    with ExitStack() as stack:
        yield Fleet(tmp_path, stack)


def test_physics_sends_a_whole_picture_when_a_logger_comes(fleet):
    fleet.physics(Scenario(rows=3), "--speed", "2", "--duration", "60")
    someone = fleet.client()
    pictures = someone.hear(someone.keys.of("picture"))
    fleet.share(2)
    before_ = until(pictures, lambda told: told["tick"] % 50 == 5)
    assert before_["alive"] is None
    token = someone.session.liveliness().declare_token(someone.keys.of("alive", "logger", "me"))
    whole = until(pictures, lambda told: told["alive"] is not None)
    assert whole["tick"] % 50 != 0
    assert None not in (whole["coupled"], whole["fill"], whole["row_picked"])
    assert {"picker_01", "carrier_01"} <= whole["doing"].keys()
    token.undeclare()


def test_a_slow_recorder_holds_physics_up_no_more_than_none(fleet, tmp_path):
    file, ticks = tmp_path / "slow.rrd", 600
    fleet.physics(Scenario(rows=3), "--duration", str(ticks / 10))
    slow = Process("slow_logger", "--connect", fleet.endpoint, "--record", str(file))
    fleet._stack.callback(slow.kill)
    assert slow.line().startswith("recording")
    fleet.share(2)
    begun = time.monotonic()
    hash_ = fleet.end()
    assert time.monotonic() - begun < ticks * SECONDS / 3, "the recorder would take 120 s for all of them"
    assert hash_ == hash_after(Scenario(rows=3), ticks)
    code, _, complaints = slow.end()
    assert code == 0
    left_out = read_part(file).left_out
    assert left_out > ticks / 3
    assert f"{left_out} pictures" in complaints
    assert missing(file, ticks) == {"recording_parts": ["slow.rrd"], "recording_gaps": [], "messages_dropped": left_out}
    assert ticks - left_out > MOST


TICKS = 2000
SPEED = 10


def wait_for(what, seconds: float = 60.0):
    """What it gives, once it gives something."""
    deadline = time.monotonic() + seconds
    while not (found := what()):
        assert time.monotonic() < deadline, "it never came"
        time.sleep(0.01)
    return found


def loggers_of(run: subprocess.Popen) -> list[psutil.Process]:
    """Those that live."""
    found = []
    for child in psutil.Process(run.pid).children(recursive=True):
        with suppress(psutil.Error):  # one that has just ended
            found += [child] if "processes.logger" in child.cmdline() else []
    return found


def next_logger(run: subprocess.Popen, old: psutil.Process) -> psutil.Process:
    """The one that was started in the place of another."""
    return wait_for(lambda: [logger for logger in loggers_of(run) if logger.pid != old.pid])[0]


def has_begun(file: Path) -> bool:
    """Whether there is more in it than the scenery and the first pictures, which are 700 kB."""
    return file.exists() and file.stat().st_size > 900_000


@pytest.fixture(scope="module")
def battered(tmp_path_factory):
    """A run whose logger is killed, killed while it starts, and frozen; its recording, its summary, and what it printed."""
    folder = tmp_path_factory.mktemp("battered")
    file = folder / "run.rrd"
    options = ["--rows", 3, "--speed", SPEED, "--duration", TICKS / 10, "--record", file, "--summary", folder / "summary.json"]
    with running(*options) as run:
        wait_for(lambda: has_begun(file))
        (first,) = loggers_of(run)
        first.kill()
        second = next_logger(run, first)
        second.kill()
        third = next_logger(run, second)
        wait_for(lambda: has_begun(file.with_suffix(".part2.rrd")))
        third.send_signal(signal.SIGSTOP)
        next_logger(run, third)
        printed, _ = run.communicate(timeout=240)
        assert run.returncode == 0, printed
    return file, summary_of(folder / "summary.json"), printed


@pytest.fixture(scope="module")
def unharmed(tmp_path_factory):
    """The same run, whole."""
    file = tmp_path_factory.mktemp("unharmed") / "run.rrd"
    done = orchard("--rows", 3, "--mode", "local", "--duration", TICKS / 10, "--record", file)
    assert done.returncode == 0, done.stderr
    return file


def lines_of(file: Path) -> list[tuple[float, str]]:
    """The log of events of all parts: (s, simulated, line)."""
    return [(t, text[0]) for t, text in rows_of(file).get(("/events", "TextLog:text"), [])]


def rows_of(file: Path) -> dict[tuple[str, str], list[tuple[float, object]]]:
    """(entity, component) -> (s, simulated, value) in the order of time, of all parts together."""
    found: dict[tuple[str, str], list[tuple[float, object]]] = {}
    for path in parts_of(file):
        for chunk in RrdReader(path).stream():
            batch = chunk.to_record_batch()
            if not chunk.is_static and "sim_time" in batch.schema.names:
                times = [time_.value / 1e9 for time_ in batch["sim_time"]]
                for name in (name for name in batch.schema.names if ":" in name):
                    found.setdefault((chunk.entity_path, name), []).extend(
                        (t, value) for t, value in zip(times, batch[name].to_pylist(), strict=True) if value is not None
                    )
    return {key: sorted(rows, key=lambda row: row[0]) for key, rows in found.items()}


def seen_at(file: Path, seconds: float) -> dict[tuple[str, str], object]:
    """What a viewer shows of all that changes seldom."""
    newest = {}
    for (entity, component), rows in rows_of(file).items():
        if entity.startswith(("/world", "/canopy", "/pins")):
            past = [row for row in rows if row[0] <= seconds]
            newest.update({(entity, component): past[-1]} if past else {})
    cleared = {entity: t for (entity, component), (t, _) in newest.items() if component == "Clear:is_recursive"}
    return {key: value for key, (t, value) in newest.items() if t > cleared.get(key[0], -1.0) and value != []}


def test_a_run_whose_logger_is_battered_ends_well_with_the_same_hash(battered):
    _, summary, printed = battered
    assert summary["hash"] == hash_after(Scenario(rows=3), TICKS)
    assert len(re.findall(r"logger ended with code -9; starting it again", printed)) == 3


def test_its_parts_are_one_recording(battered):
    file, summary, printed = battered
    parts = parts_of(file)
    assert summary["recording_parts"] == [path.name for path in parts] == ["run.rrd", "run.part2.rrd", "run.part3.rrd"]
    assert len({RrdReader(path).recordings()[0].recording_id for path in parts}) == 1
    assert all(len(RrdReader(path).blueprints()) == 1 for path in parts)
    assert printed.strip().splitlines()[-1].endswith(f"view {file}")


def test_the_gaps_are_named_in_the_summary_and_in_the_recording_and_are_where_nothing_is(battered):
    file, summary, _ = battered
    gaps = summary["recording_gaps"]
    assert len(gaps) == 2
    told = lines_of(file)
    for since, until_ in gaps:
        assert (until_, f"logger: nothing recorded from {since:.1f} s to {until_:.1f} s: the logger was away") in told
    times = {round(t, 1) for t, _ in rows_of(file)["/tf", "Transform3D:translation"]}
    lost = {tick / 10 for tick in range(1, TICKS + 1)} - times
    assert lost == {tick / 10 for since, until_ in gaps for tick in range(round(since * 10) + 1, round(until_ * 10))}
    assert summary["messages_dropped"] == 0


def test_after_the_gaps_everything_is_as_if_there_had_been_none(battered, unharmed):
    file, summary, _ = battered
    whole = rows_of(unharmed)
    changed = [
        key for key, rows in whole.items() for since, until_ in summary["recording_gaps"] if any(since < t < until_ for t, _ in rows)
    ]
    assert any(entity.startswith("/world/rows") for entity, _ in changed), "a row was picked meanwhile"
    for seconds in [until_ for _, until_ in summary["recording_gaps"]] + [TICKS / 10]:
        seen, meant = seen_at(file, seconds), seen_at(unharmed, seconds)
        assert {key for key in seen.keys() | meant.keys() if seen.get(key) != meant.get(key)} == set()
