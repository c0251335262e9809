"""A roll-out: the next jobs of all pickers, done in advance by a rule.

The policy `rolling` (rolling.py) makes one for each of its choices, and compares how long they
take.

It is a small event-driven model: robots follow the courses of their jobs, and wait in line for each
place on the roads, and for the bay. A job is an exchange of bins: its picker leaves a full bin, and
a carrier brings an empty one and takes the full one to the bay (`TimedJob` of
orchard/plans/jobs.py). Tick 0 of a job's course is the tick at which its carrier stops at the lane,
if nothing holds it up. Places are named by strings; besides those of the roads there are "bay", and
"PICKER is out", which a carrier can have once the picker has left its row.
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
from orchard.field.layout_key import Geometry
from orchard.field.queue import CLOSED_UP
from orchard.field.scenario import TIME_STEP
from orchard.plans.jobs import TimedJob, Use, jobs_of

# Ticks from a decision until the carrier leaves, on average: the letters in between.
ORDERED = 12
# Ticks after a carrier is out of its line until the one behind it can leave.
MOVING_UP = 10
# m from a carrier that leaves the bay to the next one, which is behind its bin, and drives on a few
# ticks later.
HEADWAY = CLOSED_UP + 0.4
# Ticks by which a carrier leaves earlier than it must, as with `predictive`.
EARLY = round(MARGIN / TIME_STEP)
# In place of a line of the queue: the robot is a picker.
AWAY = -1


class What(Enum):
    """What a robot does on its way."""

    # It gives a place back.
    RELEASE = auto()
    # A carrier needs its picker to have come out of the row.
    MEET = auto()
    # It claims a place, and waits until it has it.
    CLAIM = auto()
    # A carrier stops at the lane.
    STOP = auto()
    # It is out of its line: the next one can leave.
    OUT = auto()
    # It is back in its line.
    HOME = auto()


class CourseEvent(NamedTuple):
    """Something that a robot does."""

    # From the carrier's stop at the lane on; negative before it.
    tick: int
    what: What
    # For RELEASE, MEET and CLAIM; else ''.
    place: str = ""


class JobCourse:
    """The courses of the robots of a job: an exchange of bins.

    `of_picker`: that of the picker. `of_carrier`: that of the carrier from each line of the queue.
    """

    def __init__(self, job: TimedJob, headway: int, bays: int) -> None:
        """`headway`: ticks from a carrier that leaves the bay to the next one there. `bays`: how
        many carriers unload at a time. The roll-out has one bay for one carrier: with two bays a
        carrier has it for half of the time of unloading.
        """
        is_out = f"{job.picker} is out"
        lane = f"{job.side}/D/{job.lane}"
        crossing = _events(job.crossings)
        way = _events(job.way)
        # Ticks at which the picker has all that it needs to cross the roads, and at which the
        # carrier has the place of the lane.
        crossed = max(event.tick for event in crossing if event.what is What.CLAIM)
        stop = min(event.tick for event in way if event.place == lane)
        exchange = [
            CourseEvent(stop, What.MEET, is_out),
            CourseEvent(0, What.STOP),
            CourseEvent(job.to_bay, What.CLAIM, "bay"),
            CourseEvent(job.to_bay + job.in_bay // bays + headway, What.RELEASE, "bay"),
            CourseEvent(job.to_bay + job.to_head, What.HOME),
        ]
        self.job = job
        self.of_picker = _in_order([*crossing, CourseEvent(crossed + 1, What.RELEASE, is_out)])
        self.of_carrier = []
        for approach, exits in job.exits:
            # A carrier that needs no place on its way out has left its line at once.
            out_of_line = min((round(use.at / TIME_STEP) for use in exits), default=-approach)
            leaving = [*_events(exits), CourseEvent(out_of_line, What.OUT)]
            self.of_carrier.append(_in_order([*leaving, *way, *exchange]))


def _events(uses: Sequence[Use]) -> list[CourseEvent]:
    """Return the events of some uses of places: all claims, and then all releases."""
    claims = []
    releases = []
    for use in uses:
        tick = round(use.at / TIME_STEP)
        claims.append(CourseEvent(tick, What.CLAIM, use.place))
        releases.append(CourseEvent(tick + use.ticks, What.RELEASE, use.place))
    return claims + releases


def _in_order(events: Sequence[CourseEvent]) -> list[CourseEvent]:
    """Return events by their ticks, and at one tick by the order of `What`: releases come first."""
    return sorted(events, key=lambda event: (event.tick, event.what.value))


def courses_of(layout: Layout) -> dict[str, list[JobCourse]]:
    """Return the courses of each picker's jobs, with rows that are all picked at the mean speed.

    So they do not depend on the seed, and are kept for a geometry.
    """
    return _courses_of(Geometry.of(layout))


@lru_cache(maxsize=KEPT_LAYOUTS)
def _courses_of(geometry: Geometry) -> dict[str, list[JobCourse]]:
    layout = geometry.layout
    lanes = []
    for lane in layout.lanes:
        lanes.append(replace(lane, picking_speed=layout.scenario.mean_picking_speed))
    scenario = layout.scenario
    in_mean_times = scenario.model_copy(update={"picking": scenario.picking.in_mean_times})
    jobs = jobs_of(replace(layout, scenario=in_mean_times, lanes=tuple(lanes)))
    headway = round(HEADWAY / layout.machines["carrier"].speed / TIME_STEP)
    courses = {}
    for picker, of_picker in groupby(jobs, lambda job: job.picker):
        courses[picker] = [JobCourse(job, headway, layout.scenario.bays) for job in of_picker]
    return courses


class RobotUnderWay(NamedTuple):
    """A robot on its way."""

    course: list[CourseEvent]
    picker: str
    # The number of the picker's bin, from 0.
    number: int
    # Its line of the queue; AWAY: it is the picker.
    line: int


class RollOut:
    """All robots from a tick on.

    `come_out`, `send` and `go_on` set what is known; `run` then does the jobs. The rule: a carrier
    at the head of its line leaves for the bin for which it is latest, of those for which it is
    time.
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
        self.courses = courses
        self.now = now
        self.ends = ends
        self.robots = list[RobotUnderWay]()
        # Of each robot, the tick that is 0 on its course.
        self.begun = list[int]()
        # Of each robot, how many events of its course are over.
        self.done = list[int]()
        # A heap of what goes on next: the tick, and a number. From 0 on it is the index of a robot
        # in `robots`. Below 0 it is a line of the queue, less the number of lines: a carrier may
        # leave it then (`_look`). So at one tick lines come first, in their order.
        self.next = list[tuple[int, int]]()
        # Place -> the robots that wait for it. A place without a key is free.
        self.taken = dict[str, list[int]]()
        # Picker that needs a carrier -> tick from which on one can stop there.
        self.wanted = dict[str, int]()
        # Picker -> the number of its bin with which it came out last; -1: none yet.
        self.number = dict.fromkeys(courses, -1)
        # Line -> how many carriers are in it. Lines are numbered from 0.
        self.home = Counter(lines)
        # Line -> whether the first of them can leave.
        self.is_open = dict.fromkeys(self.home, True)
        # Tick at which the last carrier is home.
        self.end = 0
        # Ticks for which pickers wait, all together. For each wait its first tick is subtracted
        # (`send`), and its last one added (`_stop`).
        self.waited = 0

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
        self.wanted[picker] = stop
        self.number[picker] = number
        # A carrier that meets the picker waits until the picker is out.
        self.taken[f"{picker} is out"] = []
        course = self.courses[picker][number].of_picker
        self._begin(RobotUnderWay(course, picker, number, AWAY), stop)

    def send(self, picker: str, line: int, tick: int) -> None:
        """Decide at a tick that the carrier at the head of a line leaves for a picker."""
        number = self.number[picker]
        job_course = self.courses[picker][number]
        approach, _ = job_course.job.exits[line]
        # The picker waits from the tick at which a carrier can stop, up to that at which one does:
        # `_stop` adds that one.
        self.waited -= self.wanted.pop(picker)
        self.home[line] -= 1
        self.is_open[line] = False
        robot = RobotUnderWay(job_course.of_carrier[line], picker, number, line)
        self._begin(robot, tick + ORDERED + approach)

    def go_on(self, free: Collection[int]) -> None:
        """Let carriers leave from now on, and count the length and the waits from now on.

        `free`: the lines in which the first one can leave.
        """
        for line in self.home:
            self.is_open[line] |= line in free
            self._look(self.now, line)
        self.end = 0
        self.waited = 0

    @property
    def is_over(self) -> bool:
        """Whether all bins were fetched; if not, robots wait for each other."""
        if self.wanted:
            return False
        return all(self.number[picker] + 1 >= end for picker, end in self.ends.items())

    def _begin(self, robot: RobotUnderWay, tick: int) -> None:
        """Let a robot begin its course. `tick`: the one that is 0 on it."""
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
        robot = self.robots[number]
        begun = self.begun[number]
        for event in robot.course[self.done[number] :]:
            if begun + event.tick > tick:
                tick = begun + event.tick
                if tick >= until or self._others_are_first(tick):
                    heappush(self.next, (tick, number))
                    return
            self.done[number] += 1
            needs_place = event.what is What.CLAIM or event.what is What.MEET
            if not needs_place:
                self._do(robot, event, tick)
            elif not self._get(event.place, number):
                return

    def _others_are_first(self, tick: int) -> bool:
        """Whether another robot does something up to a tick."""
        return bool(self.next) and self.next[0][0] <= tick

    def _get(self, place: str, number: int) -> bool:
        """Give a place to a robot if it is free; else let the robot wait for it.

        Return whether it got the place.
        """
        waiting = self.taken.get(place)
        if waiting is None:
            self.taken[place] = []
            return True
        waiting.append(number)
        return False

    def _do(self, robot: RobotUnderWay, event: CourseEvent, tick: int) -> None:
        """Let a robot do at a tick what needs no place."""
        if event.what is What.RELEASE:
            self._give_back(event.place, tick)
        elif event.what is What.STOP:
            self._stop(robot, tick)
        else:
            self._in_line(robot.line, event.what, tick)

    def _give_back(self, place: str, tick: int) -> None:
        """Give a place to the robot that has waited for longest.

        The rest of its course is as much later as it has waited.
        """
        waiting = self.taken.get(place)
        if not waiting:
            self.taken.pop(place, None)
            return
        number = waiting.pop(0)
        # The event that was done last: the robot waited in it.
        claim = self.robots[number].course[self.done[number] - 1]
        self.begun[number] = tick - claim.tick
        heappush(self.next, (tick, number))

    def _stop(self, robot: RobotUnderWay, tick: int) -> None:
        """Let the picker of a carrier that stops go on with the empty bin."""
        self.waited += tick
        picker = robot.picker
        following = robot.number + 1
        # The next bin is planned, and the picker has not come out with it already.
        if self.number[picker] < following < self.ends[picker]:
            job = self.courses[picker][robot.number].job
            job_after = self.courses[picker][following].job
            self.come_out(picker, following, tick + job.going_on + job_after.ready)
            for line in self.home:
                self._look(max(tick, self._due(picker)), line)

    def _in_line(self, line: int, what: What, tick: int) -> None:
        """Let a carrier come home to its line, or leave the head of it to the next one."""
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
        """Return the tick at which it is time for a carrier to leave for a picker."""
        job = self.courses[picker][self.number[picker]].job
        return self.wanted[picker] - job.approach - EARLY

    def _leave(self, tick: int, line: int) -> None:
        """Let the first carrier of a line leave, once it is time for a bin."""
        can_leave = self.is_open[line] and self.home[line] > 0
        if tick < self.now or not self.wanted or not can_leave:
            return
        due, picker = min(zip(map(self._due, self.wanted), self.wanted, strict=True))
        if due > tick:
            self._look(due, line)
        else:
            self.send(picker, line, tick)
