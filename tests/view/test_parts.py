"""The parts of a recording: where it goes on, and what is missing between them.

If the logger dies, the next one goes on in a further file, run.part2.rrd. `before` reads what a
recording has: the file in which to go on, its last tick (0: nothing), the colours of states.
"""

from dataclasses import replace

import numpy as np
from recordings import chunks, frames, lines_of, poses_at, recording_of, rows_of, seen_at, starts

from orchard.contract.events import Frame
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.view.palette import STATES
from orchard.view.reader import before, missing
from orchard.view.recorder import Recorder

LAYOUT = lay_out(Scenario(rows=3))


def course(ticks: range) -> list[Frame]:
    """Return the frames of these ticks. A frame is what a recording shows of a tick."""
    return [frame for frame in frames(LAYOUT, (ticks.stop - 1) / 10) if frame.tick in ticks]


def test_a_recording_goes_on_where_it_can_be_read_to(tmp_path):
    """A recording of ticks 0 to 52 is there; then a longer one whose last tenth is torn off; then
    files in which nothing can be read.
    """
    path = tmp_path / "run.rrd"
    assert before(path, "a")[:2] == (path, 0)
    recording_of(path, LAYOUT, course(range(53)), "a")
    assert before(path, "a")[:2] == (tmp_path / "run.part2.rrd", 52)
    whole = path.read_bytes()
    recorder = Recorder(LAYOUT, "a", path)
    for frame in course(range(301)):
        recorder.tick(frame)
    recorder.rec.flush()
    torn = path.read_bytes()
    recorder.close()
    path.write_bytes(torn[: len(torn) * 9 // 10])
    known = before(path, "a")
    assert known.file == tmp_path / "run.part2.rrd"
    assert 100 < known.last < 300, "the last tenth is torn off"
    assert known.colours["/world/pickers/picker_01"] == {"picking row 1": STATES["picking"]}
    path.write_bytes(whole[:100])
    assert before(path, "a")[:2] == (path, 0), "nothing in it can be read"
    path.write_bytes(b"")
    assert before(path, "a")[:2] == (path, 0)


def test_a_recording_of_another_run_is_not_gone_on_with(tmp_path):
    recording_of(tmp_path / "run.rrd", LAYOUT, course(range(20)), "a")
    assert before(tmp_path / "run.rrd", "b")[:2] == (tmp_path / "run.rrd", 0)


def test_what_is_missing_is_read_from_the_parts(tmp_path):
    """The first part ends at 5.2 s, and the second begins at 9.0 s and ends at 14.9 s, of 17 s. In
    it seven frames were left out.
    """
    path = tmp_path / "run.rrd"
    recording_of(path, LAYOUT, course(range(53)), "a")
    recorder = Recorder(LAYOUT, "a", before(path, "a").file)
    recorder.gap(52, 90, "the logger was away")
    for frame in course(range(90, 150)):
        recorder.tick(replace(frame, left_out=7) if frame.tick == 120 else frame)
    recorder.close()
    lacking = missing(path, 170)
    assert lacking["recording_parts"] == ["run.rrd", "run.part2.rrd"]
    assert lacking["recording_gaps"] == [[5.2, 9.0], [14.9, 17.0]], "the second: nothing came after"
    assert lacking["messages_dropped"] == 7
    texts = lines_of(rows_of(path))
    assert (9.0, "logger: nothing recorded from 5.2 s to 9.0 s: the logger was away") in texts
    assert any("left out 7 frames" in text for _, text in texts)


def test_every_tick_counts_when_pictures_are_left_out(tmp_path):
    """Rows are gathered, and written once a second. Of every seven ticks one has a picture here,
    and none of these falls on a whole second. Yet the file is written as the run goes on.
    """
    path = tmp_path / "run.rrd"
    recorder = Recorder(LAYOUT, "a", path)
    for frame in course(range(3, 600, 7)):
        if frame.tick % 10:
            recorder.tick(replace(frame, left_out=6))
    recorder.rec.flush()
    assert before(path, "a").last > 580
    recorder.close()


def test_a_further_part_shows_what_has_gone_in_the_gap(tmp_path):
    """The first part shows a weed, the bar between picker and bin, and the fruit of a row. In the
    gap the weed was flattened, the bin uncoupled, and the row picked: the second part clears them.
    """
    path = tmp_path / "run.rrd"
    poses = starts(LAYOUT)
    weed = LAYOUT.index["weed_01"]
    picker = LAYOUT.index["picker_01"]
    alive = np.ones(len(poses), bool)
    coupled = np.full(len(poses), -1)
    coupled[picker] = LAYOUT.index["bin_01"]
    begun = {"doing": {"picker_01": "picking row 1"}, "states": {"picker_01": "picking"}}
    early = Frame(
        1,
        poses,
        coupled=coupled.copy(),
        fill=np.zeros(len(poses)),
        alive=alive.copy(),
        row_ends=np.zeros((3, 4)),
        **begun,
    )
    alive[weed] = False
    coupled[picker] = -1
    late = Frame(
        60,
        poses,
        coupled=coupled,
        fill=np.zeros(len(poses)),
        alive=alive,
        row_ends=np.eye(3, 4) * [70.0, 0.0, 0.0, 0.0],
    )
    recording_of(path, LAYOUT, [early], "a")
    further = Recorder(LAYOUT, "a", before(path, "a").file)
    further.gap(1, 60, "the logger was away")
    further.tick(late)
    further.close()
    rows = rows_of(path)
    seen = seen_at(rows, 6.0)
    then = seen_at(rows, 1.0)
    r, g, b = STATES["picking"]
    assert then["/pins/picker_01", "Points3D:colors"] == [r << 24 | g << 16 | b << 8 | 255]
    assert ("/world/weeds/weed_01", "Asset3D:blob") in then.keys() - seen.keys()
    assert ("/world/pickers/picker_01/bar", "LineStrips3D:strips") in then.keys() - seen.keys()
    assert ("/canopy/fruit/row_01", "Points3D:positions") in then.keys() - seen.keys()


def test_a_recorder_behind_records_the_same_in_fewer_pieces(tmp_path):
    frames_ = course(range(701))
    apart = recording_of(tmp_path / "apart.rrd", LAYOUT, frames_)
    together = tmp_path / "together.rrd"
    torn = tmp_path / "torn.rrd"
    # It takes itself to be behind, because a frame always waits. So it gathers rows of 25 s.
    recorder = Recorder(LAYOUT, "a", together)
    recorder.waiting = lambda: 1
    for frame in frames_:
        recorder.tick(frame)
    recorder.rec.flush()
    torn.write_bytes(together.read_bytes())
    assert 450 < before(torn, "a").last < 700, "much waits, but not without end"
    recorder.close()
    pieces = [
        [chunk for chunk in chunks(path) if not chunk.is_static] for path in (apart, together)
    ]
    assert len(pieces[1]) < len(pieces[0]) / 4
    known = rows_of(apart)
    seen = rows_of(together)
    assert known.keys() == seen.keys()
    assert [key for key in known if key[0] != "/tf" and known[key] != seen[key]] == []
    assert all(
        poses_at(apart, seconds) == poses_at(together, seconds) for seconds in (0.0, 12.3, 70.0)
    )
