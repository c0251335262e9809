"""A roll-out: the next jobs of all pickers, done in advance by a rule.

The policy `rolling` compares what comes of its choices.

It is a small event-driven model: robots follow the courses of their jobs, and wait in line for each
place on the roads, and for the bay.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from enum import Enum, auto
from functools import lru_cache
from heapq import heappop, heappush
from itertools import groupby
from typing import NamedTuple

from orchard.dispatch.ranking import MARGIN
from orchard.field.layout import KEPT_LAYOUTS, Layout
from orchard.field.scenario import TIME_STEP
from orchard.plans.jobs import TimedJob, Use, jobs_of

ORDERED = 12  # ticks from a decision until the carrier leaves, on average
MOVING_UP = 10  # ticks after which the carrier behind can leave
# m from a carrier that leaves the bay to the next one, which is behind its bin.
HEADWAY = 4.5
EARLY = round(MARGIN / TIME_STEP)
# In place of a line: a picker.
AWAY = -1


class What(Enum):
    """What a robot does on its way."""

    # It gives a place back.
    FREE = auto()
    # A carrier needs its picker to have come out of the row.
    MEET = auto()
    # It waits until it has a place.
    NEED = auto()
    # A carrier stops at the lane.
    STOP = auto()
    # It is out of its line: the next one can leave.
    OUT = auto()
    # It is back in its line.
    HOME = auto()


class CourseEvent(NamedTuple):
    """Something that a robot does."""

    # From the stop at the lane on.
    tick: int
    what: What
    place: str = ""


class JobCourse:
    """The courses of the robots of a job."""

    def __init__(self, job: TimedJob, headway: int) -> None:
        """`headway`: ticks from a carrier that leaves the bay to the next one there."""
        out, lane, crossing = (
            f"{job.picker} is out",
            f"{job.side}/D/{job.lane}",
            _events(job.crossings),
        )
        crossed = max(event.tick for event in crossing if event.what is What.NEED)
        stop = min(event.tick for event in _events(job.way) if event.place == lane)
        job_done = [
            CourseEvent(stop, What.MEET, out),
            CourseEvent(0, What.STOP),
            CourseEvent(job.to_bay, What.NEED, "bay"),
        ]
        job_done += [
            CourseEvent(job.to_bay + job.in_bay + headway, What.FREE, "bay"),
            CourseEvent(job.to_bay + job.to_head, What.HOME),
        ]
        self.job = job
        self.of_picker = _in_order([*crossing, CourseEvent(crossed + 1, What.FREE, out)])
        self.of_carrier = []  # from each line
        for approach, exits in job.exits:
            left = min((round(use.at / TIME_STEP) for use in exits), default=-approach)
            self.of_carrier.append(
                _in_order(
                    [*_events(exits), *_events(job.way), *job_done, CourseEvent(left, What.OUT)]
                )
            )


def _events(uses: Sequence[Use]) -> list[CourseEvent]:
    needs = []
    frees = []
    for use in uses:
        need = CourseEvent(round(use.at / TIME_STEP), What.NEED, use.place)
        needs.append(need)
        frees.append(CourseEvent(need.tick + use.ticks, What.FREE, use.place))
    return needs + frees


def _in_order(events: Sequence[CourseEvent]) -> list[CourseEvent]:
    return sorted(events, key=lambda event: (event.tick, event.what.value))


@lru_cache(maxsize=KEPT_LAYOUTS)
def courses_of(layout: Layout) -> dict[str, list[JobCourse]]:
    """Return the courses of each picker's jobs, with rows that are all picked at the mean speed."""
    lanes = []
    for lane in layout.lanes:
        lanes.append(replace(lane, picking_speed=layout.scenario.mean_picking_speed))
    jobs = jobs_of(replace(layout, lanes=tuple(lanes)))
    headway = round(HEADWAY / layout.machines["carrier"].speed / TIME_STEP)
    courses = {}
    for picker, of_picker in groupby(jobs, lambda job: job.picker):
        courses[picker] = [JobCourse(job, headway) for job in of_picker]
    return courses


class RobotUnderWay(NamedTuple):
    """A robot on its way."""

    course: list[CourseEvent]
    picker: str
    # Of the picker's bin, from 0.
    number: int
    # Of the queue; AWAY: it is the picker.
    line: int


class RollOut:
    """All robots from a tick on.

    The rule: a carrier at the head of its line leaves for the bin for which it is latest, of those
    for which it is time.
    """

    def __init__(
        self,
        courses: Mapping[str, list[JobCourse]],
        lines: Iterable[int],
        now: int,
        ends: Mapping[str, int],
    ) -> None:
        """`lines`: the line of each carrier. `ends`: how many bins of each picker are planned.

        Before the tick `now` no carrier leaves by the rule.
        """
        self.courses, self.now, self.ends = courses, now, ends
        self.robots = list[RobotUnderWay]()
        self.begun, self.done = (
            list[int](),
            list[int](),
        )  # of each robot: the tick that is 0 on its course, and the events that are over
        self.next = (
            list[tuple[int, int]]()
        )  # tick, and the robot that goes on then; or a line in which a carrier may leave, below 0
        self.taken = dict[
            str, list[int]
            # Place -> the robots that wait for it; without a key it is free.
        ]()
        self.wanted = dict[
            str, int
            # Picker that needs a carrier -> tick from which on it can stop there.
        ]()
        # Picker -> its bin with which it came out last.
        self.number = dict.fromkeys(courses, -1)
        self.home = Counter(lines)  # line -> the carriers in it
        self.is_open = dict.fromkeys(self.home, True)  # line -> whether the first of them can leave
        self.end = self.waited = (
            0  # tick at which the last carrier is home; ticks for which pickers wait
        )

    def fork(self) -> "RollOut":
        """Return a copy that goes on by itself."""
        twin = copy(self)
        for name in ("robots", "begun", "done", "next", "home", "is_open", "wanted", "number"):
            setattr(twin, name, copy(getattr(self, name)))
        twin.taken = {}
        for place, robots in self.taken.items():
            twin.taken[place] = list(robots)
        return twin

    def come_out(self, picker: str, number: int, stop: int) -> None:
        """Let a picker come out of its row with a bin, so that a carrier can stop there from a tick
        on.
        """
        self.wanted[picker], self.number[picker] = stop, number
        self.taken[f"{picker} is out"] = []
        self._begin(
            RobotUnderWay(self.courses[picker][number].of_picker, picker, number, AWAY), stop
        )

    def send(self, picker: str, line: int, tick: int) -> None:
        """Decide at a tick that the carrier at the head of a line leaves for a picker."""
        number = self.number[picker]
        course = self.courses[picker][number]
        self.waited -= self.wanted.pop(picker)
        self.home[line] -= 1
        self.is_open[line] = False
        self._begin(
            RobotUnderWay(course.of_carrier[line], picker, number, line),
            tick + ORDERED + course.job.exits[line][0],
        )

    def go_on(self, free: Collection[int]) -> None:
        """Let carriers leave from now on. `free`: the lines in which the first one can leave."""
        for line in self.home:
            self.is_open[line] |= line in free
            self._look(self.now, line)
        self.end = self.waited = 0

    @property
    def is_over(self) -> bool:
        """Whether all bins were fetched; if not, robots wait for each other."""
        return not self.wanted and all(
            self.number[picker] + 1 >= end for picker, end in self.ends.items()
        )

    def _begin(self, robot: RobotUnderWay, tick: int) -> None:
        heappush(self.next, (tick + robot.course[0].tick, len(self.robots)))
        self.robots.append(robot)
        self.begun.append(tick)
        self.done.append(0)

    def run(self, until: float) -> None:
        """Go on up to a tick."""
        while self.next and self.next[0][0] < until:
            tick, number = heappop(self.next)
            if number < 0:
                self._leave(tick, number + len(self.home))
            else:
                self._drive(number, tick, until)

    def _drive(self, number: int, tick: int, until: float) -> None:
        """Let a robot do what it can before others do something, or the roll-out ends."""
        robot, begun, taken = self.robots[number], self.begun[number], self.taken
        for at, what, place in robot.course[self.done[number] :]:
            if begun + at > tick:
                tick = begun + at
                if tick >= until or (self.next and tick >= self.next[0][0]):
                    return heappush(self.next, (tick, number))
            self.done[number] += 1
            if what is What.FREE:
                self._give_back(place, tick)
            elif what is What.NEED or what is What.MEET:
                if place in taken:
                    return taken[place].append(number)
                taken[place] = []
            elif what is What.STOP:
                self._stop(robot, tick)
            else:
                self._in_line(robot.line, what, tick)
        return None

    def _give_back(self, place: str, tick: int) -> None:
        """Give a place to the robot that has waited for longest."""
        if waiting := self.taken.get(place):
            number = waiting.pop(0)
            self.begun[number] = tick - self.robots[number].course[self.done[number] - 1].tick
            heappush(self.next, (tick, number))
        else:
            self.taken.pop(place, None)

    def _stop(self, robot: RobotUnderWay, tick: int) -> None:
        """Let the picker go on with the empty bin."""
        self.waited += tick
        picker, number = robot.picker, robot.number + 1
        if self.number[picker] < number < self.ends[picker]:
            job, after = self.courses[picker][robot.number].job, self.courses[picker][number].job
            self.come_out(picker, number, tick + job.going_on + after.ready)
            for line in self.home:
                self._look(max(tick, self._due(picker)), line)

    def _in_line(self, line: int, what: What, tick: int) -> None:
        if what is What.HOME:
            self.home[line] += 1
            self.end = max(self.end, tick)
        else:
            self.is_open[line] = True
            tick += MOVING_UP
        self._look(tick, line)

    def _look(self, tick: int, line: int) -> None:
        """Look at a tick whether a carrier may leave a line.

        The first line comes first, as in the dispatcher's decisions.
        """
        heappush(self.next, (tick, line - len(self.home)))

    def _due(self, picker: str) -> int:
        return self.wanted[picker] - self.courses[picker][self.number[picker]].job.approach - EARLY

    def _leave(self, tick: int, line: int) -> None:
        """Let the first carrier of a line leave, once it is time for a bin."""
        if tick < self.now or not self.wanted or not self.is_open[line] or not self.home[line]:
            return
        due, picker = min(zip(map(self._due, self.wanted), self.wanted, strict=True))
        if due > tick:
            self._look(due, line)
        else:
            self.send(picker, line, tick)
