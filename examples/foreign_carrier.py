"""A carrier that is written from keyspace.md alone, as it could be in any language: zenoh, msgpack,
and nothing of this program.

    python foreign_carrier.py ENDPOINT NAME

Owns the agent of a carrier in lockstep until the run ends, by foreign_host.py. If a figure changes
in the documents, it must change here.
"""

import math
import struct
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from foreign_host import Host, opened

# -- bodies, field, motion

BYSTANDERS = {
    "worker": (0.55, 1.0, 1.0),
    "visitor": (0.55, 1.0, 1.0),
    "dog": (1.0, 0.8, 3.0),
    "cat": (1.0, 0.8, 3.0),
}  # m, m, m/s
LENGTH, WIDTH, TOWS, BIN = 1.8, 1.5, 1.9, 1.0
FRONT = [(-math.pi / 2 + i * math.pi / 179) for i in range(180)]
AROUND = [i * 2 * math.pi / 60 for i in range(60)]
STEP, EXACT = 0.1, 1e-9
EAST, NORTH, WEST, SOUTH = 0.0, math.pi / 2, math.pi, -math.pi / 2


def wrapped(angle):
    return math.remainder(angle, 2 * math.pi)


class Side:
    """One side of the lanes; figures are those of the east."""

    def __init__(self, name, field):
        self.name, self.field, self.sign = name, field, 1 if name == "east" else -1

    def x(self, east):
        return east if self.sign > 0 else -3.0 - east

    def y(self, lane, past):
        return self.field.lane(lane) - self.sign * past

    def heading(self, east):
        return east if self.sign > 0 else wrapped(east + math.pi)

    def lanes(self, first=None, last=None):
        """Those that a carrier passes, in its order."""
        lanes = list(range(1, self.field.rows + 1))[:: self.sign]
        return lanes[lanes.index(first) if first else 0 : lanes.index(last) + 1 if last else None]


class Field:
    D, F, COUPLES, FULL, PICKER = 38.75, 36.25, 34.15, 32.25, 41.0
    STOP, HOLD, CLEAR = 1.9, 3.75, 5.7
    TOP_ROAD, BAY_STOP, TURN_OFF, HEAD = 24.5, -30.0, -18.6, 35.4
    LINES = (24.5, 21.5, 18.5, 27.5, 30.5, 33.5, 36.5, 39.5, 42.5, 45.5)

    def __init__(self, scenario, name):
        self.rows, self.pitch = scenario["rows"], scenario["row_width"] + 0.5
        carriers = scenario["carriers"] or math.ceil(scenario["pickers"] * 7 / 10)
        last_trees = 13.5 - self.rows * self.pitch
        self.bottom_d, self.bottom_f = last_trees - 5.6, last_trees - 3.5
        self.line = self.LINES[(int(name.rsplit("_", 1)[1]) - 1) // 12]
        self.top = ["top"] if carriers > 12 else []
        self.top_clear = min(self.LINES[: (carriers - 1) // 12 + 1]) - 3.75
        self.east, self.west = Side("east", self), Side("west", self)

    def lane(self, number):
        return 13.5 - (number - 0.5) * self.pitch

    def side(self, name):
        return self.east if name == "east" else self.west

    def along(self, side, road, lanes):
        """The places on a road past lanes: where to wait for each, where to give it back."""
        places = [(f"{side.name}/{road}/{lane}", lane) for lane in lanes]
        return [(p, side.y(n, -self.HOLD)) for p, n in places], [
            (p, side.y(n, self.CLEAR)) for p, n in places
        ]

    def distance(self, x, y, lane, side):
        stop = side.y(lane, self.STOP)
        if side is self.east:
            return (self.D - x) + y - stop
        return (
            (self.D - x)
            + (y - self.bottom_d)
            + (self.D - self.west.x(self.D))
            + (stop - self.bottom_d)
        )

    def at_work(self, lane, side):
        """The boxes that are no obstacles: x, y, half length, half width."""
        y, half = self.lane(lane), BIN / 2 + 0.1
        return [
            (side.x(self.FULL), y, half, half),
            (side.x(self.D), y, half, half),
            (side.x(self.PICKER), y, 1.35, 0.85),
        ]


# -- the job of a carrier


class Carrier:
    """One carrier. `work` is a coroutine: each `yield` is the end of a tick."""

    def __init__(self, info, name):
        self.name, self.field = name, Field(info["scenario"], name)
        carrying = info["scenario"]["carrying"]
        self.cruise = carrying["speed"]
        self.most_rate = math.pi * (carrying["turning"] / 180.0)
        self.people = [other for other in info["agents"] if other.rsplit("_", 1)[0] in BYSTANDERS]
        self.job, self.jobs, self.steps, self.calls = None, 0, 0, {}
        self.reserved, self.agreed, self.claimed = [], [], -5
        self.sighted, self.moved, self.bumped = {}, False, -10
        self.doing, self.state = "waiting in the queue", "waiting"
        self.working = self.work()

    def decide(self, seen, heard, mine):
        self.observe(seen)
        self.hear(mine)
        self.hear_calls(heard)
        answers = [
            [sender, tick, number, self.reply_to(sender, body)]
            for sender, tick, number, body in heard
        ]
        next(self.working)
        self.claim()
        twist = self.safe()
        self.moved = twist != (0.0, 0.0)
        status = {
            "doing": self.doing,
            "state": self.state,
            "waits_for": self.waits_for,
            "steps_done": self.steps,
        }
        return (
            {"twist": [twist[0], 0.0, twist[1]], "deeds": self.deeds} | status,
            self.requests,
            answers,
        )

    def observe(self, seen):
        self.tick = seen["tick"]
        self.x, self.y, z, w, *self.twist = struct.unpack("<7d", seen["states"])
        self.yaw = wrapped(2 * math.atan2(z, w))
        self.scan = struct.unpack("<180f", seen["ranges"])
        self.hitch = seen["hitches"].get(self.name)
        self.speed, self.rate, self.left, self.blind, self.queueing = 0.0, 0.0, 0.0, [], False
        self.deeds, self.requests, self.wanted, self.waits_for = [], [], [], ""
        if self.moved and not any(self.twist):
            self.bumped = self.tick

    def hear(self, mine):
        self.answered = [request for request in mine if request["answer"]]
        for request in self.answered:
            if request["answer"]["type"] == "places":
                self.agreed = request["answer"]["held"]
                self.reserved += [
                    place
                    for place in self.agreed
                    if place in request["body"]["want"] and place not in self.reserved
                ]
        for request in mine:
            if request["body"]["type"] == "where":
                is_told = request["answer"] and request["answer"]["type"] == "position"
                self.sighted[request["to"]] = (
                    self.tick - 1,
                    *((request["answer"]["x"], request["answer"]["y"]) if is_told else ()),
                )

    # requests of others

    def reply_to(self, sender, body):
        if body["type"] == "carrierquery":
            metres = max(0.0, self.field.HEAD - self.x)
            return {
                "type": "carrierstatus",
                "job": self.job[0] if self.job else "",
                "is_next": self.is_next(),
                "metres": metres,
            }
        if body["type"] not in ("call", "come"):
            return no("a carrier knows nothing of that")
        if body["type"] == "come" and self.job and self.job[0] == sender:
            return {"type": "yes"}
        if not 1 <= body["lane"] <= self.field.rows:
            return no("there is no such lane")
        if self.job:
            return no(f"busy with {self.job[0]}")
        if body["type"] == "come":
            return self.accept(sender, body)
        if not self.is_next():
            return no("another one goes first")
        if not self.offer(sender):
            return no("an older call comes first")
        distance = self.field.distance(self.x, self.y, body["lane"], self.field.side(body["side"]))
        return {"type": "offer", "x": self.x, "y": self.y, "distance": distance}

    def hear_calls(self, heard):
        for sender, _, _, body in heard:
            if body["type"] == "call":
                since, _, offered = self.calls.get(sender, (None, 0, math.inf))
                self.calls[sender] = (
                    body["since"],
                    self.tick,
                    offered if since == body["since"] else math.inf,
                )
        self.calls = {name: call for name, call in self.calls.items() if self.tick - call[1] <= 25}

    def offer(self, sender):
        """Whether the call of a bin is the oldest; bins that let an offer pass come last."""
        if (
            min(
                self.calls,
                key=lambda name: (self.tick - self.calls[name][2] > 5, self.calls[name][0], name),
            )
            != sender
        ):
            return False
        since, heard, offered = self.calls[sender]
        self.calls[sender] = since, heard, min(offered, self.tick)
        return True

    def accept(self, sender, body):
        self.job = sender, body["lane"], self.field.side(body["side"]), body["picker"]
        self.is_left, self.looked = False, -20
        return {"type": "yes"}

    def is_next(self):
        short = self.field.HEAD - self.x
        return not self.job and (short < 0.1 or (short < 4.2 and self.twist[0] > 0.0))

    # steps

    def work(self):
        yield from self.face(EAST)
        while True:
            self.say("waiting in the queue", "waiting")
            while not self.job:
                left = self.field.HEAD - self.x
                self.speed, self.queueing = (
                    (min(self.cruise, left / STEP) if left > EXACT else 0.0),
                    True,
                )
                yield
            answer = yield from self.ask(self.job[0], {"type": "confirm"}, lambda answer: True)
            if answer["type"] == "yes":
                yield from self.fetch(*self.job)
                self.jobs += 1
            self.job = None

    def fetch(self, full, lane, side, picker):
        self.say(f"bringing an empty bin to {picker}", "driving")
        yield from self.bring(lane, side)
        empty = self.hitch["name"]
        while self.hitch:
            self.deed({"type": "uncouple"})
            yield
        yield from self.ask(
            picker, {"type": "here", "bin": empty}, lambda answer: answer["type"] == "yes"
        )
        yield from self.loop(lane, side)
        while not self.hitch or self.hitch["name"] != full:
            self.deed({"type": "couple", "bin": full})
            yield
        self.say(f"taking {full} to the bay", "hauling")
        yield from self.haul(lane, side)
        self.say(f"unloading {full}", "unloading")
        yield from self.ask(
            full,
            {"type": "state"},
            lambda answer: answer["type"] == "binstate" and not answer["full"],
        )
        self.say("returning to the queue", "driving")
        yield from self.go_home()

    def bring(self, lane, side):
        field, east, west = self.field, self.field.east, self.field.west
        yield from self.drive("x", field.D, [(place, field.HEAD) for place in field.top])
        yield from self.face(SOUTH)
        leave_top = [(place, field.top_clear) for place in field.top]
        needs, frees = field.along(side, "D", side.lanes(last=lane))
        if side is west:
            past, left = field.along(east, "D", east.lanes())
            corner = ("corner/south-east", field.bottom_f + field.HOLD)
            yield from self.drive("y", field.bottom_d, [*past, corner], left + leave_top)
            yield from self.face(WEST)
            self.free("corner/south-east")
            yield from self.drive("x", west.x(field.D), [("corner/south-west", -35.5)])
            yield from self.face(NORTH)
            self.free("corner/south-west")
            leave_top = []
        yield from self.drive("y", side.y(lane, field.STOP), needs, frees + leave_top)

    def loop(self, lane, side):
        blind = self.field.at_work(lane, side)
        yield from self.need(f"{side.name}/F/{lane}")
        yield from self.face(side.heading(WEST), blind)
        yield from self.drive(
            "x",
            side.x(self.field.COUPLES),
            frees=[(f"{side.name}/D/{lane}", side.x(36.8))],
            blind=blind,
        )
        yield from self.face(side.heading(NORTH), blind)
        yield from self.drive("y", self.field.lane(lane), blind=blind)
        yield from self.face(side.heading(EAST), blind)

    def haul(self, lane, side):
        field, west, blind, corner = self.field, self.field.west, self.field.at_work(lane, side), []
        yield from self.drive("x", side.x(field.F), blind=blind)
        yield from self.face(side.heading(SOUTH), blind)
        if side is not west:
            yield from self.drive(
                "y", field.bottom_f, *field.along(side, "F", side.lanes(first=lane))
            )
            yield from self.need("corner/south-east")
            yield from self.face(WEST)
            yield from self.drive("x", west.x(field.F), frees=[("corner/south-east", 34.7)])
            yield from self.need("corner/south-west", "turn/south-west")
            yield from self.face(NORTH)
            corner = [
                ("corner/south-west", field.bottom_f + 1.4),
                ("turn/south-west", field.bottom_f + 3.75),
            ]
        needs, frees = field.along(west, "F", west.lanes(first=lane if side is west else None))
        yield from self.drive("y", field.TOP_ROAD, needs, frees + corner)
        yield from self.face(EAST)
        yield from self.drive("x", field.BAY_STOP)

    def go_home(self):
        field = self.field
        yield from self.drive("x", field.TURN_OFF)
        if field.line != field.TOP_ROAD:
            yield from self.face(SOUTH if field.line < field.TOP_ROAD else NORTH)
            yield from self.drive("y", field.line)
            yield from self.face(EAST)

    def say(self, doing, state):
        self.doing, self.state, self.steps = doing, state, self.steps + 1

    def drive(self, axis, target, needs=(), frees=(), blind=()):
        """Straight on, to an x or y.

        Places: (name, the coordinate at which it is needed, or given back).
        """
        ahead = 1.0 if abs(wrapped(self.yaw - (EAST if axis == "x" else NORTH))) < 1.0 else -1.0
        while True:
            here = getattr(self, axis)
            self.free(*(place for place, at in frees if ahead * (here - at) > -EXACT))
            missing = [
                (p, at)
                for p, at in needs
                if p not in self.reserved
                and -EXACT <= ahead * (at - here) <= ahead * (target - here)
            ]
            limit = missing[0][1] if missing else target
            if (
                missing
                and ahead * (limit - here) < 3.0 * min(1.0, self.cruise)
                and self.may_ask_for(missing[0][0])
            ):
                self.want(missing[0][0])
            left = ahead * (limit - here)
            if left > EXACT:
                self.speed, self.blind = min(self.cruise, left / STEP), blind
            elif not missing:
                break
            yield
        self.steps += 1

    def may_ask_for(self, place):
        """Whether the picker can come out without this place: it has left its full bin.

        Until then the bin is asked.
        """
        full, lane, side, _ = self.job
        if place != f"{side.name}/D/{lane}" or self.is_left:
            return True
        told = [
            r["answer"] for r in self.answered if (r["to"], r["body"]["type"]) == (full, "state")
        ]
        self.is_left = any(
            answer["type"] == "binstate" and answer["full"] and not answer["coupled_to"]
            for answer in told
        )
        if not self.is_left and self.tick - self.looked >= 20:
            self.looked = self.tick
            self.requests.append([full, {"type": "state"}])
        self.waits_for = full
        return self.is_left

    def face(self, heading, blind=()):
        while abs(left := wrapped(heading - self.yaw)) > EXACT:
            self.rate, self.left, self.blind = (
                max(-self.most_rate, min(self.most_rate, left / STEP)),
                left,
                blind,
            )
            yield
        self.steps += 1

    def need(self, *places):
        while not {*places} <= {*self.reserved}:
            self.want(*places)
            yield

    def want(self, *places):
        self.wanted, self.waits_for = [*places], places[0]

    def free(self, *places):
        self.reserved = [place for place in self.reserved if place not in places]

    def deed(self, deed):
        """When both stand."""
        self.waits_for = deed.get("bin", "")
        if not any(self.twist) and not (self.hitch and any(self.hitch["state"][4:])):
            self.deeds = [deed]

    def ask(self, to, body, hoped):
        """Every 5 ticks, until the answer is as hoped."""
        asked = -5
        while True:
            for answer in [
                r["answer"]
                for r in self.answered
                if (r["to"], r["body"]["type"]) == (to, body["type"])
            ]:
                if hoped(answer):
                    self.steps += 1
                    return answer
            if self.tick - asked >= 5:
                asked = self.tick
                self.requests.append([to, body])
            self.waits_for = to
            yield

    def claim(self):
        since = self.tick - self.claimed
        if (self.wanted and since >= 5) or (
            sorted(self.agreed) != sorted(self.reserved) and since >= 2
        ):
            self.claimed = self.tick
            self.requests.append(
                [
                    "traffic",
                    {
                        "type": "claim",
                        "keep": list(self.reserved),
                        "want": self.wanted,
                        "beside": "",
                    },
                ]
            )

    # obstacles

    def safe(self):
        """The velocity of this tick: 0 where something is in the way."""
        if self.tick - self.bumped < 10:
            return 0.0, 0.0
        if self.speed > 0.0 and self.something_ahead():
            self.waits_for = "" if self.queueing else "an obstacle ahead"
            return 0.0, 0.0
        if self.rate and (self.somebody_near() or self.something_in_the_turn()):
            self.waits_for = "an obstacle in its turn"
            return 0.0, 0.0
        return self.speed, self.rate

    def something_ahead(self):
        points = self.points(self.scan, FRONT, 2.0, LENGTH / 2)
        return any(
            ahead < LENGTH / 2 + 0.8
            and abs(left) < WIDTH / 2 + 0.2
            and not self.is_blind(ahead, left)
            for ahead, left in points
        )

    def something_in_the_turn(self):
        boxes = [(0.0, LENGTH / 2, WIDTH / 2)] + ([(-TOWS, BIN / 2, BIN / 2)] if self.hitch else [])
        points = [point for point in self.points_around() if not self.is_blind(*point)]
        steps = int(abs(self.left) / (math.pi / 48)) + 1
        for angle in (self.left * i / steps for i in range(steps + 1) if points):
            s, c = math.sin(angle), math.cos(angle)
            turned = [(c * ahead + s * left, c * left - s * ahead) for ahead, left in points]
            if any(
                abs(a - x) < length + 0.05 and abs(left) < width + 0.05
                for a, left in turned
                for x, length, width in boxes
            ):
                return True
        return False

    def points(self, scan, angles, reach, ahead):
        """What returns nearer than `reach`: metres ahead of the centre, metres to the left."""
        return [
            (ahead + r * math.cos(a), r * math.sin(a))
            for r, a in zip(scan, angles, strict=True)
            if r < reach
        ]

    def points_around(self):
        """Of both lasers, without the carrier itself."""
        own = self.points(self.scan, FRONT, 3.5, LENGTH / 2)
        if not self.hitch:
            return own
        x, y, z, w, *_ = self.hitch["state"]
        dx, dy, turn = x - self.x, y - self.y, 2 * math.atan2(z, w) - self.yaw
        s, c = math.sin(self.yaw), math.cos(self.yaw)
        at, side = c * dx + s * dy, c * dy - s * dx
        s, c = math.sin(turn), math.cos(turn)
        seen = self.points(struct.unpack("<60f", self.hitch["ranges"]), AROUND, 3.5, 0.0)
        rear = [(at + c * a - s * b, side + s * a + c * b) for a, b in seen]
        return own + [
            (a, b) for a, b in rear if abs(a) > LENGTH / 2 + 0.1 or abs(b) > WIDTH / 2 + 0.1
        ]

    def is_blind(self, ahead, left):
        s, c = math.sin(self.yaw), math.cos(self.yaw)
        x, y = self.x + c * ahead - s * left, self.y + s * ahead + c * left
        return any(
            abs(x - bx) <= half_x and abs(y - by) <= half_y for bx, by, half_x, half_y in self.blind
        )

    def somebody_near(self):
        """Whether a person or an animal is, or may be, in the circle of the turn; those that soon
        may be are asked.
        """
        radius = (
            math.hypot(TOWS + BIN / 2, BIN / 2) if self.hitch else math.hypot(LENGTH, WIDTH) / 2
        )
        left = {name: self.seconds_to(name, radius) for name in self.people}
        self.requests += [
            [name, {"type": "where"}] for name, seconds in left.items() if seconds < 0.3
        ]
        return any(seconds < 0.1 for seconds in left.values())

    def seconds_to(self, name, radius):
        tick, *place = self.sighted.get(name, (-100,))
        length, width, speed = BYSTANDERS[name.rsplit("_", 1)[0]]
        if not place:
            return math.inf if self.tick - tick < 50 else -math.inf
        room = (
            math.hypot(place[0] - self.x, place[1] - self.y)
            - radius
            - math.hypot(length, width) / 2
            - 0.1
        )
        return room / speed - (self.tick - tick) * STEP


def no(reason):
    return {"type": "no", "reason": reason}


def main(endpoint, name):
    with opened(endpoint) as session:
        host = Host(session, name)
        carrier = Carrier(host.info, name)
        host.ticks(carrier.decide)
        print(carrier.jobs, "bins taken", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
