"""What waits between the logger and its recorder: pictures are left out, nothing that was said is."""

import numpy as np
from scripted_orchard import acted_layout

from orchard.contract.events import Event, Frame
from orchard.record.logger import FrameQueue, QueuedFrame, write

LAYOUT = acted_layout(rows=3, pickers=2)


class Notebook:
    """Writes down what a recorder is told."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.told: list[Event] = []
        self.gaps: list[tuple[int, int]] = []

    def tick(self, frame: Frame) -> None:
        self.frames.append(frame)
        self.told += frame.events

    def gap(self, since: int, until: int, why: str) -> None:
        self.gaps.append((since, until))

    def tell(self, event: Event) -> None:
        self.told.append(event)

    def close(self) -> None:
        pass


def picture(tick: int, **news: object) -> QueuedFrame:
    """A picture that tells little, and one event."""
    return QueuedFrame(Frame(tick, np.zeros((1, 3)), **news), [Event(tick - 1, "call", "bin_01", "", f"of tick {tick - 1}")])


def written(pages: FrameQueue, last: int | None = 0) -> Notebook:
    pages.close()
    notebook = Notebook()
    write(pages, notebook, last)
    return notebook


def test_a_recorder_that_takes_three_ticks_a_picture_leaves_out_pictures_but_nothing_that_was_said():
    pages, taken = FrameQueue(most=10), []
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
    assert sorted(event.tick for event in told) == list(range(1000))
    assert all(event.detail == f"of tick {event.tick}" for event in told)


def test_a_recorder_that_never_comes_back_costs_no_more_than_so_many_pictures():
    pages = FrameQueue(most=10)
    for tick in range(1, 5001):
        pages.put(QueuedFrame(Frame(tick, np.zeros((1, 3))), []))
    assert len(pages) == 10
    assert pages.left_out == 4990


def test_what_is_left_out_leaves_its_news_to_the_next():
    pages = FrameQueue(most=1)
    pages.put(picture(1, doing={"picker_01": "picking row 1", "bin_01": "empty"}, row_picked=np.array([1.0]), alive=np.array([True])))
    pages.put(picture(2, doing={"bin_01": "full"}, alive=np.array([False])))
    pages.put(picture(3))
    (frame,) = written(pages).frames
    assert (frame.tick, frame.left_out) == (3, 2)
    assert frame.doing == {"picker_01": "picking row 1", "bin_01": "full"}
    assert frame.row_picked == [1.0] and frame.alive == [False]


def test_ticks_that_never_came_are_a_gap():
    pages = FrameQueue()
    for tick in (31, 32, 40):
        pages.put(picture(tick))
    assert written(pages, last=20).gaps == [(20, 31), (32, 40)]
