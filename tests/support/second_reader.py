"""A second reader of the benchmark's instances: it imports nothing of the Orchard, and computes
from the JSON alone how long a schedule takes.

So tests show that a file says all that another program needs. The field `rules` of each file says
what its other fields mean; the names here are those of the fields. All times are ticks of 0.1 s.

Each robot has a list of events at ticks that count from its `zero`. A robot that waits for a place
or for a trailer, or is held up on its way, moves its `zero`, and so all its later events, by as
much.
"""

from collections import Counter, defaultdict
from heapq import heappop, heappush

TICK = 0.1  # s
# The kinds of events. Of events at one tick the smaller number is first: places become free before
# other robots claim them.
# RELEASE and CLAIM: of a place. ENTER: the robot has a place, and comes onto the road to the next
# one. WAIT: it is there, perhaps behind others. PASS: it has that place. STOP: the carrier stops at
# the picker's lane. HOME: it stands in the queue again. TRAILER: it is in the bay, and needs a
# trailer. LOADED: its bin is on. LEAVE: it leaves the queue. CHARGE: it is in its charging line.
# FULL: its battery is full. STAND: a robot fails, meets somebody or looks around.
RELEASE, WAIT, CLAIM, PASS, ENTER, STOP = range(6)
HOME, TRAILER, LOADED, LEAVE, CHARGE, FULL, STAND = range(6, 13)


class Reader:
    """The best known schedule of an instance, with one of its seeds. `run` does it."""

    def __init__(self, instance: dict, draw: int):
        self.instance = instance
        self.constants = instance["constants"]
        drawn = instance["draws"][draw]
        self.jobs = defaultdict(list)
        for job, ready in zip(instance["jobs"], drawn["ready"], strict=True):
            self.jobs[job["picker"]].append(job | {"mean_ready": job["ready"], "ready": ready})
        # (tick of its next event, number that orders equal ticks, robot).
        self.heap = []
        self.count = 0
        # Place that a robot has -> the robots that wait for it. A job's lane is a place too, named
        # "PICKER NUMBER": it is taken until the picker is out of the row.
        self.taken = {}
        for picker, jobs in self.jobs.items():
            self.taken |= {f"{picker} {number}": [] for number in range(len(jobs))}
        # (Place, next place) -> the robots on the road between them, in their order.
        self.roads = defaultdict(list)
        self.end = 0
        # Each trailer: [the tick at which it is back, its bins].
        self.trailers = [[0, 0] for _ in range(self.constants.get("trailers", 0))]
        self.loaded = 0
        # What holds robots up: kind -> robot -> [after so much, for so many ticks] of each time.
        self.drawn = {"meetings": drawn.get("meetings", {}), "failures": {}}
        for name, failures in drawn["failures"].items():
            self.drawn["failures"][name] = [[work / TICK, stay / TICK] for work, stay in failures]
        # (Kind, robot) -> how often that held it up, and how much there was since the last time.
        self.times = Counter()
        self.since = Counter()
        # Robot -> turn -> for how many ticks it looks around, without a bin and with one.
        self.looks = {}
        for name, looks in drawn.get("looks", {}).items():
            self.looks[name] = {turn: ticks for turn, *ticks in looks}
        self.turns = Counter()
        self.carriers = {}
        in_line = Counter()
        for carrier, line in instance["carriers"].items():
            self.carriers[carrier] = {"line": line, "charge": 1.0, "orders": []}
            self.carriers[carrier] |= {"is_out": False, "is_low": False}
            if "battery" in self.constants:
                to_head = in_line[line] * self.constants["place"]
                self.carriers[carrier]["charge"] -= to_head / self.constants["battery"]
            in_line[line] += 1
        # Chargers that are free; [carrier, since when it waits for one]; charging line -> the
        # carriers in it, in their order; carrier -> the ticks at which its battery was full.
        self.chargers = self.constants.get("chargers", 0)
        self.uncharged = []
        self.charging_lines = defaultdict(list)
        self.full = defaultdict(list)
        # A place, "trailer", "charger", "behind", "failures", "meetings" or "looks" -> for how many
        # ticks robots have waited for it, or were held up by it, in all.
        self.waited = Counter()
        # What happens at events of a kind, at which no robot waits.
        self.happens = {
            RELEASE: self.release,
            PASS: self.pass_on,
            STOP: self.go_on_picking,
            HOME: self.come_home,
            LOADED: self.unload,
            LEAVE: self.send,
            CHARGE: self.charge,
            FULL: self.be_full,
        }
        for picker, jobs in self.jobs.items():
            self.come_out(picker, 0, jobs[0]["ready"])
        # The carriers of a picker come for its jobs in their order.
        sent = Counter()
        for tick, _, carrier, picker in drawn["best"]["orders"]:
            leaves = tick + self.constants["ordered"]
            self.begin(leaves, [(0, LEAVE, (carrier, picker, sent[picker]))])
            sent[picker] += 1

    def begin(self, zero: int, events: list) -> None:
        """Let a robot do events at their ticks. `zero`: the tick that is 0 in them."""
        robot = {"zero": zero, "events": sorted(events, key=lambda event: event[:2]), "next": 0}
        self.count += 1
        heappush(self.heap, (zero + robot["events"][0][0], self.count, robot))

    def come_out(self, picker: str, number: int, tick: int) -> None:
        """Let a picker come out of the row of its job of this number, from a tick on."""
        job = self.jobs[picker][number]
        last = max(at for _, at, _ in job["crossings"])
        # The crossings before the last ones are earlier or later, as the row takes longer or not.
        crossings = []
        for place, at, ticks in job["crossings"]:
            share = job["ready"] / job["mean_ready"] if at < last else 1.0
            crossings.append([place, at * share, ticks])
        events = [*uses(crossings), (last + 1, RELEASE, f"{picker} {number}")]
        # Drives and turns count from when the picker went on, in a row that takes its mean time.
        drives = [[self.since_ready(job, at), *more] for at, *more in job.get("picker_drives", [])]
        turns = [[self.since_ready(job, at), *more] for at, *more in job.get("picker_turns", [])]
        self.begin(tick, self.held_up(picker, drives, turns, events))

    def since_ready(self, job: dict, at: int) -> float:
        """Return a tick that counts from when the picker went on, as one that counts from ready."""
        return at / job["mean_ready"] * job["ready"] - job["ready"]

    def send(self, order: tuple, tick: int) -> None:
        """Send a carrier to a picker's job at a tick, or when it is back. `order`: the carrier, the
        picker, and the number of the job.
        """
        carrier, picker, number = order
        state = self.carriers[carrier]
        if state["is_out"]:
            state["orders"].append(order)
            return
        job = self.jobs[picker][number]
        exit_ = job["exits"][state["line"]]
        if carrier in self.charging_lines[state["line"]]:
            self.charging_lines[state["line"]].remove(carrier)
        state["line"] = self.instance["carriers"][carrier]
        state["is_out"] = True
        to_bay = job["to_bay"]
        at_lane = min(at for place, at, _ in job["way"] if place == job["place"])
        events = [
            *uses(exit_["uses"]),
            *uses(job["way"]),
            *roads([*exit_["uses"], *job["way"], ["bay", to_bay, 0]]),
            # Before it claims the job's place on the road, at the same tick: hence the half.
            (at_lane, CLAIM - 0.5, f"{picker} {number}"),
            (0, STOP, (picker, number)),
            (to_bay, CLAIM, "bay"),
            (to_bay, TRAILER, ""),
            (to_bay + job["in_bay"], LOADED, (carrier, job, exit_, tick)),
            (to_bay + job["in_bay"] + self.constants["headway"], RELEASE, "bay"),
            (to_bay + job["to_rest"], HOME, carrier),
        ]
        events = self.held_up(carrier, exit_.get("drives", []), exit_.get("turns", []), events)
        self.begin(tick + exit_["approach"], events)

    def held_up(self, name: str, drives: list, turns: list, events: list) -> list:
        """Return the events of a robot, and those at which it stands on its drives and turns."""
        stands = []
        for at, ticks, metres, may_fail in drives:
            for share, stay in self.along("meetings", name, metres):
                stands.append((at + share * ticks, STAND, ("meetings", stay)))
            for share, stay in self.along("failures", name, ticks if may_fail else 0):
                fails = at + share * ticks
                stands.append((fails, STAND, ("failures", stay)))
                kept_since = fails - self.constants["keeps"]
                for number, (when, kind, what) in enumerate(events):
                    if kind == RELEASE and kept_since < when <= fails:
                        events[number] = (fails + 0.5, RELEASE, what)
        for at, _, is_towing in turns if self.looks else []:
            alone, towing = self.looks[name].get(self.turns[name], [self.constants["look"]] * 2)
            self.turns[name] += 1
            stands.append((at, STAND, ("looks", towing if is_towing else alone)))
        return events + stands

    def along(self, kind: str, name: str, length: float):
        """Yield where something of a kind holds a robot up, as a share of a length, and for how
        many ticks.
        """
        drawn = self.drawn[kind].get(name)
        here = 0
        while drawn and drawn[self.times[kind, name]][0] - self.since[kind, name] < length - here:
            after, stay = drawn[self.times[kind, name]]
            here += after - self.since[kind, name]
            self.since[kind, name] = 0
            self.times[kind, name] += 1
            yield here / length, stay
        self.since[kind, name] += length - here

    def run(self) -> int:
        """Do the schedule. Return the ticks that it takes."""
        while self.heap:
            tick, _, robot = heappop(self.heap)
            self.go_on(robot, tick)
        return self.end

    def go_on(self, robot: dict, tick: int) -> None:
        """Let a robot do its events up to a tick, or until it waits for others."""
        while robot["next"] < len(robot["events"]):
            at, kind, what = robot["events"][robot["next"]]
            if robot["zero"] + at > tick:
                self.count += 1
                heappush(self.heap, (robot["zero"] + at, self.count, robot))
                return
            robot["next"] += 1
            if kind in self.happens:
                self.happens[kind](what, tick)
            elif kind == ENTER:
                self.roads[what].append(robot)
            elif kind == WAIT:
                robot["is_behind"] = self.roads[what][0] is not robot
                if robot["is_behind"]:
                    return
            elif kind in (TRAILER, STAND):
                # What comes after it is as much later.
                why, stay = what or ("trailer", max(0, self.next_trailer(tick)[0] - tick))
                self.waited[why] += stay
                robot["zero"] += stay
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

    def unload(self, trip: tuple, tick: int) -> None:
        """Put a trip's bin on a trailer, which leaves when it is full, or with the last bin."""
        self.use_battery(trip, tick)
        self.loaded += 1
        if self.trailers:
            trailer = self.next_trailer(tick)
            trailer[1] += 1
            is_last = self.loaded == len(self.instance["jobs"])
            if is_last or trailer[1] == self.constants["trailer_bins"]:
                trailer[:] = [tick + self.constants["trailer_away"], 0]
                self.end = max(self.end, trailer[0])

    def use_battery(self, trip: tuple, tick: int) -> None:
        """Take from a battery what a trip needs, of which the bin is empty now. If the charge is at
        the reserve, the carrier goes to charge. `trip`: carrier, job, exit, and when it left.
        """
        carrier, job, exit_, left = trip
        if "battery" not in self.constants:
            return
        state = self.carriers[carrier]
        moves = [*exit_["drives"], *exit_["turns"]]
        moved = sum(ticks for at, ticks, *_ in moves if at < job["to_bay"])
        stood = tick - left - moved
        used = moved + self.constants["standing"] * stood
        state["charge"] -= used / self.constants["battery"]
        state["is_low"] = state["charge"] <= self.constants["reserve"]
        to_head = sum(ticks for at, ticks, *_ in moves if at >= job["to_bay"])
        state["charge"] -= to_head / self.constants["battery"]
        if state["is_low"]:
            state["line"] += len(job["exits"]) // 2
            to_charge = job["exits"][state["line"]]["to_charge"]
            self.begin(tick + to_charge - job["in_bay"], [(0, CHARGE, carrier)])

    def come_home(self, carrier: str, tick: int) -> None:
        """Let a carrier stand in the queue again. It can be sent again, if it need not charge."""
        self.end = max(self.end, tick)
        if not self.carriers[carrier]["is_low"]:
            self.be_free(carrier, tick)

    def charge(self, carrier: str, tick: int) -> None:
        """Let a carrier wait for a charger in its charging line."""
        self.charging_lines[self.carriers[carrier]["line"]].append(carrier)
        self.uncharged.append((carrier, tick))
        self.give_chargers(tick)

    def give_chargers(self, tick: int) -> None:
        """Give the chargers that are free to the carriers that are nearest to a head."""
        while self.chargers and self.uncharged:
            carrier, since = min(self.uncharged, key=self.carriers_ahead)
            self.uncharged.remove((carrier, since))
            self.chargers -= 1
            self.waited["charger"] += tick - since
            state = self.carriers[carrier]
            ticks = (1.0 - state["charge"]) * self.constants["charging"]
            state["charge"] = 1.0
            self.begin(tick + ticks, [(0, FULL, carrier)])

    def carriers_ahead(self, waiting: tuple) -> int:
        """Return how many carriers are before one in its charging line."""
        carrier, _ = waiting
        return self.charging_lines[self.carriers[carrier]["line"]].index(carrier)

    def be_full(self, carrier: str, tick: int) -> None:
        """Let a carrier with a full battery be sent again, and others have its charger."""
        self.full[carrier].append(tick)
        self.chargers += 1
        self.be_free(carrier, tick)
        self.give_chargers(tick)

    def be_free(self, carrier: str, tick: int) -> None:
        """Let a carrier be sent again, at once if it was sent too early."""
        state = self.carriers[carrier]
        state["is_out"] = False
        state["is_low"] = False
        if state["orders"]:
            self.send(state["orders"].pop(0), tick)

    def release(self, place: str, tick: int) -> None:
        """Free a place, or give it to the robot that has waited longest for it."""
        waiting = self.taken.get(place)
        if not waiting:
            self.taken.pop(place, None)
            return
        self.waited[place] += self.resume(waiting.pop(0), tick)

    def resume(self, robot: dict, tick: int) -> int:
        """Let a robot go on that has waited up to a tick. Return for how long it has."""
        # The event before its next one is that at which it has waited.
        came = robot["zero"] + robot["events"][robot["next"] - 1][0]
        robot["zero"] += tick - came
        self.count += 1
        heappush(self.heap, (tick, self.count, robot))
        return tick - came

    def pass_on(self, road: tuple, tick: int) -> None:
        """Let the first robot leave a road. The next one may have come up to it."""
        self.roads[road].pop(0)
        if self.roads[road] and self.roads[road][0].pop("is_behind", False):
            waits = self.resume(self.roads[road][0], tick)
            self.waited["behind"] += waits
            self.waited[road[1]] += waits

    def go_on_picking(self, stop: tuple, tick: int) -> None:
        """Begin a picker's next job when its carrier stops. `stop`: the picker, and this job."""
        picker, number = stop
        job = self.jobs[picker][number]
        if number + 1 < len(self.jobs[picker]):
            following = self.jobs[picker][number + 1]
            self.come_out(picker, number + 1, tick + job["going_on"] + following["ready"])


def roads(rows: list) -> list:
    """Return the events of a carrier on roads between places. `rows`: as those of `uses`."""
    events = []
    before = None
    for place, at, _ in sorted(rows, key=lambda row: row[1]):
        if before and at > before[1]:
            road = (before[0], place)
            events += [(before[1], ENTER, road), (at, WAIT, road), (at, PASS, road)]
        before = (place, at)
    return events


def uses(rows: list) -> list:
    """Return the events of places that a robot uses. `rows`: [place, tick, ticks] of each."""
    events = []
    for place, at, ticks in rows:
        events.append((at, CLAIM, place))
        events.append((at + ticks, RELEASE, place))
    return events
