"""The logger: when it begins, and what it passes to the recorder, also to a slow one.

Physics sends pictures of the world, ten ticks in a bundle, to the logger. The logger makes frames
of them, and puts these into a queue. A recorder takes frames and writes them to the file. It may be
slow: then the queue leaves frames out, but not their events.
"""

import math
import os
import re
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
from command_line import orchard, running, summary_of
from fleet import Process, wait_for
from local_runs import local_hash
from patience import PATIENCE
from recorded_messages import KEYS, Net, Run, StandIn
from recordings import lines_of, rows_of, seen_at
from rerun.chunk import RrdReader
from slow_logger import MOST

from orchard.contract.events import SELDOM, Event, Frame, talk_of
from orchard.contract.messages import pack
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.net.bus import Alive, Sample, Signal
from orchard.net.host import GONE_SECONDS
from orchard.record import logger as recording
from orchard.record.logger import FrameQueue, Logger, write
from orchard.sim.frames import FrameBuilder
from orchard.view.files import parts_of
from orchard.view.reader import missing, read_part
from orchard.wire.codec import picture_of
from orchard.wire.messages import Bundle, read


def test_physics_sends_a_whole_picture_when_a_logger_comes(fleet):
    """A whole picture has all fields. It comes each 50 ticks, and when a logger's token appears.

    Any other one has only what has changed.
    """
    fleet.physics(Scenario(rows=3), "--speed", "2", "--duration", "60")
    client = fleet.client()
    pictures = client.hear(client.keys.of("picture"))
    fleet.share(2)
    earlier = wait_for(pictures, lambda picture: picture["tick"] % 50 == 5)
    assert earlier["alive"] is None
    token = client.declare(client.keys.of("alive", "logger", "me"))
    whole = wait_for(pictures, lambda picture: picture["alive"] is not None)
    assert whole["tick"] % 50 != 0
    assert None not in (whole["coupled"], whole["fill"], whole["row_ends"])
    assert {"picker_01", "carrier_01"} <= whole["doing"].keys()
    token.undeclare()


def test_a_logger_is_ready_before_it_shows_its_token(monkeypatch):
    """It listens, and its recording is open, because the first tick waits for the token."""
    done = []
    run = (SimpleNamespace(run="run1"), lay_out(Scenario(rows=3)))
    executor = SimpleNamespace(submit=lambda *_: done.append("write"))
    bus = SimpleNamespace(clock=lambda: 0.0, declare_alive=done.append, executor=executor)
    monkeypatch.setattr(recording, "fetch_layout", lambda *_: run)
    monkeypatch.setattr(recording, "open_recording", lambda *_: (done.append("open"), None))
    monkeypatch.setattr(Logger, "listen", lambda self: done.append("listen"))
    monkeypatch.setattr(Logger, "run", lambda self, writing: (0, None))
    assert recording.record(bus, KEYS, None, None, "me") == (0, None)
    assert done == ["listen", "open", KEYS.of("alive", "logger", "me"), "write"]


def test_a_logger_begins_with_a_whole_picture():
    """Two pictures come, of ticks 101 and 102. The first holds all changes, but the texts only of
    bodies that do something new: it is no whole one. So the logger begins with the second.
    """
    local = Local(Scenario(rows=3))
    local.tick()
    world = local.engine.world
    bus = StandIn(Net(), "logger")
    queue = FrameQueue()
    builder = FrameBuilder(local.engine)

    def shown(tick):
        world.tick = tick
        frame = builder.frame([])
        bus.inbox.put(
            Sample(
                KEYS.of("bundle"), pack(Bundle("run1", tick, [], [], [picture_of("run1", frame)]))
            )
        )
        return frame

    # After a frame that is sent to no subscriber, all fields that change seldom change.
    builder.frame([])
    for name in SELDOM:
        values = getattr(world, name)
        others = np.zeros_like(values) if values.any() else values + 1
        setattr(world, name, others)
    changed = shown(101)
    builder.forget()
    shown(102)
    bus.inbox.put(Signal(signal.SIGTERM))
    Logger(bus, KEYS, "run1", local.engine.layout, queue).run(
        SimpleNamespace(done=lambda: False, result=lambda: None)
    )
    assert all(getattr(changed, name) is not None for name in SELDOM)
    assert changed.doing == {}
    assert queue.take().tick == 102


def test_a_logger_records_however_slowly_it_opened(monkeypatch):
    """Messages that physics is alive wait in the inbox while the recording opens.

    They count when they are read, though they came long before.
    """
    now = [0.0]
    bus = StandIn(Net(), "logger")
    monkeypatch.setattr(bus, "clock", lambda: now[0])
    logger = Logger(bus, KEYS, "run1", Local(Scenario(rows=3)).engine.layout, FrameQueue())
    bus.inbox.put(Alive(KEYS.of("physics", "run1"), up=True))
    now[0] = 10 * GONE_SECONDS
    bus.inbox.put(Signal(signal.SIGTERM))
    code, _ = logger.run(SimpleNamespace(done=lambda: False, result=lambda: None))
    assert code == 0, "it has taken physics for gone, and recorded nothing"


def test_a_logger_that_gives_up_says_so(monkeypatch, caplog):
    """Physics never shows that it is alive, and each look takes a quarter of GONE_SECONDS."""
    now = [0.0]
    bus = StandIn(Net(), "logger")
    monkeypatch.setattr(bus, "clock", lambda: now[0])

    def pass_time(*_):
        now[0] += GONE_SECONDS / 4

    monkeypatch.setattr(bus.inbox, "take", pass_time)
    logger = Logger(bus, KEYS, "run1", Local(Scenario(rows=3)).engine.layout, FrameQueue())
    code, _ = logger.run(SimpleNamespace(done=lambda: False, result=lambda: None))
    assert code == 1
    assert caplog.messages == ["physics is gone; waited for 20 s: nothing is recorded"]


def test_changes_of_all_pictures_together_are_a_whole_one():
    """Robots are stopped, reset and in each other's way. Every 37th tick has no picture, and the
    next one must hold its news, too.
    """
    local = Local(Scenario(rows=10, pickers=10, seed=4))
    doing = dict[str, str]()
    builder = FrameBuilder(local.engine)
    for tick in range(1500):
        if tick % 150 == 40:
            local.engine.stop(["picker_01", "carrier_01"])
        if tick % 150 == 90:
            local.engine.reset()
        local.tick()
        if tick % 37:
            doing |= builder.frame([]).doing
            assert doing == FrameBuilder(local.engine).frame([]).doing


def test_bundles_hold_each_picture_with_what_was_said(monkeypatch):
    """A bundle holds pictures, and the events and letters of the step of each.

    In 725 ticks the first bins are full and call, so there are events and letters.
    """
    monkeypatch.setattr("orchard.server.publisher.BUNDLE_SECONDS", math.inf)
    ticks = 725
    run = Run(Scenario(rows=3), "run1", 725)
    run.to_the_end()
    sent = [(key.removeprefix("orchard/"), payload) for key, payload in run.net.sent]

    def sent_on(wanted: str) -> list[bytes]:
        return [payload for key, payload in sent if key == wanted]

    # The bundles have the messages that are sent on keys of their own, too.
    bundles = [read(payload, Bundle) for payload in sent_on("bundle")]
    events = [message for bundle in bundles for message in bundle.events]
    letters = [message for bundle in bundles for message in bundle.letters]
    pictures = [message for bundle in bundles for message in bundle.pictures]
    assert sent_on("events") == [pack(message) for message in events]
    assert sent_on("letters") == [pack(message) for message in letters]
    assert sent_on("picture") == [pack(message) for message in pictures]
    assert len(pictures) == ticks
    assert len(events) > 0
    assert len(letters) > 0
    assert all(len(bundle.pictures) <= 10 for bundle in bundles)
    assert [key for key, _ in sent if key in ("bundle", "end")][-2:] == ["bundle", "end"]

    # The logger gives each picture the events of its step.
    bus = StandIn(Net(), "logger")
    queue = FrameQueue()
    logger = Logger(bus, KEYS, "run1", run.engine.layout, queue)
    for bundle in bundles:
        logger._handle(Sample(KEYS.of("bundle"), pack(bundle)))
    queue.close()
    frames = [queue.take() for _ in range(ticks)]
    assert [frame.tick for frame in frames] == [*range(1, ticks + 1)]
    assert {event.tick - frame.tick for frame in frames for event in frame.events} == {-1}
    in_bundles = sum(len(message.events) for message in events)
    in_bundles += sum(len(talk_of(0, message.letters)) for message in letters)
    assert sum(len(frame.events) for frame in frames) == in_bundles


@pytest.mark.processes
def test_a_slow_recorder_holds_physics_up_no_more_than_none(fleet, tmp_path):
    file = tmp_path / "slow.rrd"
    ticks = 600
    fleet.physics(Scenario(rows=3), "--duration", str(ticks / 10))
    slow = Process("slow_logger", "--connect", fleet.endpoint, "--record", str(file))
    fleet._stack.callback(slow.kill)
    assert slow.line().startswith("recording")
    fleet.share(2)
    hash_ = fleet.end()
    assert hash_ == local_hash(Scenario(rows=3), ticks)
    code, _, complaints = slow.end()
    assert code == 0
    # More than MOST frames, which the queue holds, were written, and many were left out.
    left_out = read_part(file).left_out
    assert left_out > ticks / 3
    assert f"{left_out} frames" in complaints
    assert missing(file, ticks) == {
        "recording_parts": ["slow.rrd"],
        "recording_gaps": [],
        "messages_dropped": left_out,
    }
    assert ticks - left_out > MOST


# Of the run whose logger is killed and frozen.
TICKS = 2000


def wait_until(look, seconds: float = PATIENCE):
    """Look until there is something. Return it."""
    deadline = time.monotonic() + seconds
    while not (result := look()):
        assert time.monotonic() < deadline, "it never came"
        # To look through all processes takes 10 ms of a processor.
        time.sleep(0.05)
    return result


def loggers_of(run: subprocess.Popen) -> list[psutil.Process]:
    """Return the loggers that are there. A process may end while it is looked at."""
    loggers = []
    for child in psutil.Process(run.pid).children(recursive=True):
        with suppress(psutil.Error):
            if "orchard.processes.logger" in child.cmdline():
                loggers.append(child)
    return loggers


def next_logger(run: subprocess.Popen, old: psutil.Process) -> psutil.Process:
    """Wait for the logger that takes the place of an old one."""
    return wait_until(lambda: [logger for logger in loggers_of(run) if logger.pid != old.pid])[0]


def has_begun(file: Path) -> bool:
    """Whether a recording has more than the scenery and the first pictures, which are 700 kB."""
    return file.exists() and file.stat().st_size > 900_000


@pytest.fixture(scope="module")
def battered(tmp_path_factory):
    """Run with a logger that is killed, killed while it starts, and frozen.

    Return its recording, its summary, and what it printed.
    """
    folder = tmp_path_factory.mktemp("battered")
    file = folder / "run.rrd"
    pace = ["--hosts", 1, "--speed", 10, "--duration", TICKS / 10]
    with running("--rows", 3, *pace, "--record", file, "--summary", folder / "summary.json") as run:
        wait_until(lambda: has_begun(file))
        (first,) = loggers_of(run)
        # A logger of another class would interrupt the processes for which the run waits.
        assert os.sched_getscheduler(first.pid) == os.SCHED_BATCH
        first.kill()
        second = next_logger(run, first)
        second.kill()
        third = next_logger(run, second)
        wait_until(lambda: has_begun(file.with_suffix(".part2.rrd")))
        third.send_signal(signal.SIGSTOP)
        next_logger(run, third)
        printed, _ = run.communicate(timeout=PATIENCE)
        assert run.returncode == 0, printed
    return file, summary_of(folder / "summary.json"), printed


@pytest.fixture(scope="module")
def unharmed(tmp_path_factory):
    """Run the same in local mode. Return the rows of its recording, and its summary."""
    folder = tmp_path_factory.mktemp("unharmed")
    where = ("--record", folder / "run.rrd", "--summary", folder / "summary.json")
    orchard("--rows", 3, "--mode", "local", "--duration", TICKS / 10, *where)
    return rows_of(folder / "run.rrd"), summary_of(folder / "summary.json")


@pytest.fixture(scope="module")
def rows(battered):
    return rows_of(battered[0])


def test_a_run_with_a_battered_logger_has_the_same_hash(battered, unharmed):
    _, summary, printed = battered
    assert summary["hash"] == unharmed[1]["hash"]
    assert len(re.findall(r"logger ended with code -9; starting it again", printed)) == 3


def test_the_parts_are_one_recording(battered):
    file, summary, printed = battered
    parts = parts_of(file)
    assert [path.name for path in parts] == ["run.rrd", "run.part2.rrd", "run.part3.rrd"]
    assert summary["recording_parts"] == [path.name for path in parts]
    assert len({RrdReader(path).recordings()[0].recording_id for path in parts}) == 1
    assert all(len(RrdReader(path).blueprints()) == 1 for path in parts)
    assert printed.strip().splitlines()[-2].endswith(f"view {file}")


def test_gaps_are_named_in_the_summary_and_the_recording(battered, rows):
    _, summary, _ = battered
    # One of them is before the second part, and one before the third: the logger that was killed
    # while it started has left no part.
    gaps = summary["recording_gaps"]
    assert len(gaps) == 2
    lines = lines_of(rows)
    in_gaps = set()
    for begin, end in gaps:
        words = f"logger: nothing recorded from {begin:.1f} s to {end:.1f} s: the logger was away"
        assert (end, words) in lines
        in_gaps |= {tick / 10 for tick in range(round(begin * 10) + 1, round(end * 10))}

    recorded = {round(seconds, 1) for seconds, _ in rows["/tf", "Transform3D:translation"]}
    assert {tick / 10 for tick in range(1, TICKS + 1)} - recorded == in_gaps
    assert summary["messages_dropped"] == 0


def test_after_the_gaps_everything_is_as_if_there_had_been_none(battered, rows, unharmed):
    _, summary, _ = battered
    whole, _ = unharmed
    gaps = summary["recording_gaps"]

    # A row was picked within a gap, so the recording after it must show more than its last frame.
    changed = set()
    for (entity, _), history in whole.items():
        for begin, end in gaps:
            if any(begin < seconds < end for seconds, _ in history):
                changed.add(entity)
    assert any(entity.startswith("/world/rows") for entity in changed)

    for seconds in [end for _, end in gaps] + [TICKS / 10]:
        shown = seen_at(rows, seconds)
        expected = seen_at(whole, seconds)
        assert shown.keys() == expected.keys()
        for key, value in expected.items():
            assert shown[key] == value, key


def test_refusals_pauses_and_steps_are_events_at_their_ticks(fleet):
    """Refusals, pauses and steps come on keys of their own, ahead of the bundles.

    The test looks at what the logger passes to the writer.
    """
    fleet.physics(Scenario(rows=3), "--duration", "12", "--recorded", "--speed", "5")
    fleet.start("orchard.processes.logger", "--connect", fleet.endpoint)
    fleet.share(1)
    client = fleet.client()
    keys = client.keys
    pictures = client.hear(keys.of("picture"))
    wait_for(pictures, lambda picture: picture["tick"] >= 55)
    client.put(keys.of("velocity", "nobody_01"), tick=1, linear={"x": 0.1}, angular={"z": 0.0})
    paused = client.ask(keys.of("set_simulation_state"), client._of_run(state="paused"))[0]["tick"]
    stepped = client.ask(keys.of("step_simulation"), client._of_run(steps=3))[0]["tick"]
    client.ask(keys.of("set_simulation_state"), client._of_run(state="playing"))
    fleet.end()
    (queue,) = fleet.simulated_world.frames
    queue.close()
    notebook = Notebook()
    write(queue, notebook, 0)
    assert stepped == paused + 3
    states = [(event.tick, event.what) for event in notebook.events if event.who == "the run"]
    assert states == [
        (0, "playing"),
        (paused, "paused"),
        (paused, "playing"),
        (stepped, "paused"),
        (stepped, "playing"),
        (120, "quitting"),
    ]
    (refused,) = [event for event in notebook.events if event.what == "refused"]
    assert refused.detail == "orchard/nobody_01/velocity: no such robot, nobody_01"
    assert 55 <= refused.tick <= paused
    for frame in notebook.frames:
        assert all(event.tick == frame.tick - 1 for event in frame.events)


class Notebook:
    """A recorder that notes what it gets: frames, events and gaps."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.events: list[Event] = []
        self.gaps: list[tuple[int, int]] = []

    def tick(self, frame: Frame) -> None:
        self.frames.append(frame)
        self.events += frame.events

    def gap(self, since: int, until: int, why: str) -> None:
        self.gaps.append((since, until))

    def tell(self, event: Event) -> None:
        self.events.append(event)

    def close(self) -> None:
        pass


def picture(tick: int, **news: object) -> Frame:
    """Return a frame with an event of the step before it, and with this news."""
    return Frame(
        tick,
        np.zeros((1, 3)),
        events=[Event(tick - 1, "call", "bin_01", "", f"of tick {tick - 1}")],
        **news,
    )


def written(pages: FrameQueue, last: int | None = 0) -> Notebook:
    """Let a notebook take what is left in a queue, after the frame of tick `last`. Return it."""
    pages.close()
    notebook = Notebook()
    write(pages, notebook, last)
    return notebook


def test_a_slow_recorder_leaves_out_pictures_but_no_words():
    """The recorder takes three ticks for a picture."""
    pages = FrameQueue(most=10)
    taken = []
    for tick in range(1, 1001):
        pages.put(picture(tick))
        assert len(pages) <= 10
        if tick % 3 == 0:
            taken.append(pages.take())
    rest = written(pages, taken[-1].tick)
    frames = taken + rest.frames
    # A third of the frames is taken, and at most ten more are in the queue at the end.
    assert pages.left_out > 600
    assert pages.left_out == 1000 - len(frames)
    assert pages.left_out == sum(frame.left_out for frame in frames)
    assert rest.gaps == [], "the logger was there all the time"
    assert frames[-1].tick == 1000, "the newest is never left out"

    events = [event for frame in taken for event in frame.events] + rest.events
    assert sorted(event.tick for event in events) == list(range(1000))
    assert all(event.detail == f"of tick {event.tick}" for event in events)


def test_a_hanging_recorder_costs_only_so_many_pictures():
    pages = FrameQueue(most=10)
    for tick in range(1, 5001):
        pages.put(Frame(tick, np.zeros((1, 3))))
    assert len(pages) == 10
    assert pages.left_out == 4990


def test_what_is_left_out_leaves_its_news_to_the_next():
    pages = FrameQueue(most=1)
    doing = {"picker_01": "picking row 1", "bin_01": "empty"}
    picked = np.array([[1.0, 0.0, 0.0, 0.0]])
    pages.put(picture(1, doing=doing, row_ends=picked, alive=np.array([True])))
    pages.put(
        picture(2, charges={"carrier_01": 0.5}, doing={"bin_01": "full"}, alive=np.array([False]))
    )
    pages.put(picture(3))
    (frame,) = written(pages).frames
    assert frame.charges == {"carrier_01": 0.5}
    assert frame.tick == 3
    assert frame.left_out == 2
    assert frame.doing == {"picker_01": "picking row 1", "bin_01": "full"}
    assert frame.row_ends.tolist() == picked.tolist()
    assert frame.alive == [False]


def test_ticks_that_never_came_are_a_gap():
    pages = FrameQueue()
    for tick in (31, 32, 40):
        pages.put(picture(tick))
    assert written(pages, last=20).gaps == [(20, 31), (32, 40)]
