"""A second reader of the benchmark's instances: it imports nothing of the Orchard, and computes
from the JSON alone how long a schedule takes.

So tests show that a file says all that another program needs. The field `rules` of each file says
what its other fields mean; the names here are those of the fields. All times are ticks of 0.1 s.

Each robot has a list of events at ticks that count from its `zero`. A robot that waits for a place
or for a trailer moves its `zero`, and so all its later events, by as much.

It is for orchards without people and animals, and for robots that neither fail nor charge.
"""

import json
from collections import Counter, defaultdict
from heapq import heappop, heappush
from pathlib import Path

TICK = 0.1  # s
# The kinds of events. Of events at one tick the smaller number is first: places become free before
# other robots claim them.
# RELEASE and CLAIM: of a place. STOP: the carrier stops at the picker's lane. HOME: the carrier
# stands in the queue again. TRAILER: it is in the bay, and needs a trailer. LOADED: its bin is on.
RELEASE, CLAIM, STOP, HOME, TRAILER, LOADED = range(6)


def seconds_of(file: Path, draw: int = 0) -> float:
    """Return how long the best schedule of a file takes with one of its seeds, s."""
    return Reader(json.loads(file.read_text()), draw).run() * TICK


class Reader:
    def __init__(self, instance: dict, draw: int):
        self.instance = instance
        drawn = instance["draws"][draw]
        self.jobs = defaultdict(list)
        for job, ready in zip(instance["jobs"], drawn["ready"], strict=True):
            self.jobs[job["picker"]].append(job | {"ready": ready})
        # (tick of its next event, number that orders equal ticks, robot).
        self.heap = []
        self.count = 0
        # Place that a robot has -> the robots that wait for it. A job's lane is a place too, named
        # "PICKER NUMBER": it is taken until the picker is out of the row.
        self.taken = {}
        self.end = 0
        # Each trailer: [the tick at which it is back, its bins].
        self.trailers = [[0, 0] for _ in range(instance["constants"].get("trailers", 0))]
        self.loaded = 0
        # Place, or "trailer" -> for how many ticks robots have waited for it in all.
        self.waited = Counter()
        for picker, jobs in self.jobs.items():
            self.come_out(picker, 0, jobs[0]["ready"])
        # The carriers of a picker come for its jobs in their order.
        sent = dict.fromkeys(self.jobs, 0)
        for tick, _, carrier, picker in drawn["best"]["orders"]:
            self.send(tick, carrier, picker, sent[picker])
            sent[picker] += 1

    def begin(self, zero: int, events: list) -> None:
        """Let a robot do events at their ticks. `zero`: the tick that is 0 in them."""
        robot = {"zero": zero, "events": sorted(events, key=lambda event: event[:2]), "next": 0}
        self.count += 1
        heappush(self.heap, (zero + robot["events"][0][0], self.count, robot))

    def come_out(self, picker: str, number: int, tick: int) -> None:
        """Let a picker come out of the row of its job of this number, from a tick on."""
        job = self.jobs[picker][number]
        self.taken[f"{picker} {number}"] = []
        last = max(at for _, at, _ in job["crossings"])
        events = [*uses(job["crossings"]), (last + 1, RELEASE, f"{picker} {number}")]
        self.begin(tick, events)

    def send(self, tick: int, carrier: str, picker: str, number: int) -> None:
        """Order a carrier to a picker's job of this number at a tick."""
        job = self.jobs[picker][number]
        exit_ = job["exits"][self.instance["carriers"][carrier]]
        to_bay = job["to_bay"]
        constants = self.instance["constants"]
        at_lane = min(at for place, at, _ in job["way"] if place == job["place"])
        # Before the picker has begun this job at all, its carrier waits too.
        self.taken.setdefault(f"{picker} {number}", [])
        events = [
            *uses(exit_["uses"]),
            *uses(job["way"]),
            # Before it claims the job's place on the road, at the same tick: hence the half.
            (at_lane, CLAIM - 0.5, f"{picker} {number}"),
            (0, STOP, (picker, number)),
            (to_bay, CLAIM, "bay"),
            (to_bay, TRAILER, ""),
            (to_bay + job["in_bay"], LOADED, ""),
            (to_bay + job["in_bay"] + constants["headway"], RELEASE, "bay"),
            (to_bay + job["to_rest"], HOME, ""),
        ]
        self.begin(tick + constants["ordered"] + exit_["approach"], events)

    def run(self) -> int:
        """Do the schedule. Return the ticks that it takes."""
        while self.heap:
            tick, _, robot = heappop(self.heap)
            self.go_on(robot, tick)
        return self.end

    def go_on(self, robot: dict, tick: int) -> None:
        """Let a robot do its events up to a tick, or until it waits for a place."""
        while robot["next"] < len(robot["events"]):
            at, kind, what = robot["events"][robot["next"]]
            if robot["zero"] + at > tick:
                self.count += 1
                heappush(self.heap, (robot["zero"] + at, self.count, robot))
                return
            robot["next"] += 1
            if kind == RELEASE:
                self.release(what, tick)
            elif kind == STOP:
                picker, number = what
                self.go_on_picking(picker, number, tick)
            elif kind == HOME:
                self.end = max(self.end, tick)
            elif kind == TRAILER:
                # What comes after it is as much later.
                waits = max(0, self.next_trailer(tick)[0] - tick)
                self.waited["trailer"] += waits
                robot["zero"] += waits
            elif kind == LOADED:
                self.load(tick)
            elif what in self.taken:
                self.taken[what].append(robot)
                return
            else:
                self.taken[what] = []

    def next_trailer(self, tick: int) -> list:
        """Return the trailer that takes the next bin.

        Of those that stand at the bay it is the one with most bins; else the one that is back
        first. In an orchard without trailers it is one that always stands.
        """
        there = [trailer for trailer in self.trailers if trailer[0] <= tick]
        if there:
            return max(there, key=lambda trailer: trailer[1])
        return min(self.trailers, default=[0, 0])

    def load(self, tick: int) -> None:
        """Put a bin on a trailer, which leaves when it is full, or with the last bin."""
        constants = self.instance["constants"]
        self.loaded += 1
        if self.trailers:
            trailer = self.next_trailer(tick)
            trailer[1] += 1
            is_last = self.loaded == len(self.instance["jobs"])
            if is_last or trailer[1] == constants["trailer_bins"]:
                trailer[:] = [tick + constants["trailer_away"], 0]
                self.end = max(self.end, trailer[0])

    def release(self, place: str, tick: int) -> None:
        """Free a place, or give it to the robot that has waited longest for it."""
        waiting = self.taken.get(place)
        if not waiting:
            self.taken.pop(place, None)
            return
        robot = waiting.pop(0)
        # The event before its next one is the claim at which it has waited.
        came = robot["zero"] + robot["events"][robot["next"] - 1][0]
        self.waited[place] += tick - came
        robot["zero"] += tick - came
        self.count += 1
        heappush(self.heap, (tick, self.count, robot))

    def go_on_picking(self, picker: str, number: int, tick: int) -> None:
        """Begin the next job of a picker whose carrier stops at a tick."""
        job = self.jobs[picker][number]
        if number + 1 < len(self.jobs[picker]):
            following = self.jobs[picker][number + 1]
            self.come_out_later(picker, number + 1, tick + job["going_on"] + following["ready"])

    def come_out_later(self, picker: str, number: int, tick: int) -> None:
        """Begin a job, for whose lane a carrier may wait already: `come_out` would forget it."""
        waiting = self.taken.get(f"{picker} {number}", [])
        self.come_out(picker, number, tick)
        self.taken[f"{picker} {number}"] = waiting


def uses(rows: list) -> list:
    """Return the events of places that a robot uses. `rows`: [place, tick, ticks] of each."""
    events = []
    for place, at, ticks in rows:
        events.append((at, CLAIM, place))
        events.append((at + ticks, RELEASE, place))
    return events
