"""The steps of which the job of a carrier is made, written from docs/reference.md alone: drive,
turn, claim places, ask, couple. foreign_carrier.py puts them together.

A step is a coroutine: each `yield` in it is the end of a tick. What it has set by then, such as
`speed` or `wanted`, is sent.
"""

import math
import struct

from foreign_field import EAST, NORTH, wrapped
from foreign_obstacles import STEP, Obstacles

EXACT = 1e-9  # m and rad; what is nearer counts as there
PATIENCE = 5  # ticks after which a request is repeated
SETTLED = 2  # ticks after which a claim has its answer
RECOVERY = 10  # ticks for which the carrier stands after a collision
LOOK_AHEAD = 3.0  # s of driving, at 1 m/s at most, before a place at which the carrier asks for it


class Driver:
    """A robot that does steps."""

    def __init__(self, info, name):
        """`info`: as physics replies to the query `scenario`."""
        self.name = name
        carrying = info["scenario"]["carrying"]
        self.cruise = carrying["speed"]  # m/s
        self.most_rate = math.pi * (carrying["turning"] / 180.0)  # rad/s
        people = ("worker", "visitor", "dog", "cat")
        self.obstacles = Obstacles([other for other in info["agents"] if other.startswith(people)])
        # How many steps it has done.
        self.steps = 0
        # The places that it holds, and those that `traffic` said last that it holds.
        self.reserved = []
        self.agreed = []
        # The ticks of its newest claim and of its newest collision.
        self.claimed = -PATIENCE
        self.bumped = -RECOVERY
        # Whether it wanted to move in the tick before.
        self.moved = False
        self.doing = ""
        self.state = "waiting"

    def observe(self, seen):
        """Take what is seen at a tick. Nothing is wanted in it yet."""
        self.tick = seen["tick"]
        self.x, self.y, z, w, *self.twist = struct.unpack("<7d", seen["states"])
        self.yaw = wrapped(2 * math.atan2(z, w))
        self.hitch = seen["hitches"].get(self.name)
        scan = struct.unpack("<180f", seen["ranges"])
        self.obstacles.see(self.tick, (self.x, self.y, self.yaw), scan, self.hitch)
        # What the job sets in this tick: m/s, rad/s, the rest of a turn, boxes that are no
        # obstacles, whether what is ahead is the queue, deeds, requests, places, and words.
        self.speed = 0.0
        self.rate = 0.0
        self.left = 0.0
        self.blind = ()
        self.queueing = False
        self.deeds = []
        self.requests = []
        self.wanted = []
        self.waits_for = ""
        # Physics has refused the step if it wanted to move and has not moved.
        if self.moved and not any(self.twist):
            self.bumped = self.tick

    def hear(self, mine):
        """Take the answers to its requests."""
        self.answered = [request for request in mine if request["answer"]]
        for request in self.answered:
            if request["answer"]["type"] == "places":
                self.agreed = request["answer"]["held"]
                for place in self.agreed:
                    if place in request["body"]["want"] and place not in self.reserved:
                        self.reserved.append(place)
        for request in mine:
            if request["body"]["type"] == "where":
                self.obstacles.note_answer(request["to"], request["answer"])

    def answers_of(self, to, kind):
        """Return the answers of this tick of one agent to requests of one kind."""
        answers = []
        for request in self.answered:
            if (request["to"], request["body"]["type"]) == (to, kind):
                answers.append(request["answer"])
        return answers

    def say(self, doing, state):
        """Say what the carrier does now. That is a step, too."""
        self.doing = doing
        self.state = state
        self.steps += 1

    def drive(self, axis, target, needs=(), frees=(), blind=()):
        """Drive straight on to an x or y.

        `axis`: 'x' or 'y'. `needs`, `frees`: (place, the coordinate before which it must be held,
        or at which it is given back). `blind`: boxes that are no obstacles.
        """
        along_axis = EAST if axis == "x" else NORTH
        # 1.0 if the coordinate grows on the way.
        sign = 1.0 if abs(wrapped(self.yaw - along_axis)) < 1.0 else -1.0
        while True:
            here = self.x if axis == "x" else self.y
            for place, at in frees:
                if sign * (here - at) > -EXACT:
                    self.free(place)
            limit = target
            missing = self.first_missing(needs, here, target, sign)
            if missing is not None:
                place, limit = missing
                is_near = sign * (limit - here) < LOOK_AHEAD * min(1.0, self.cruise)
                if is_near and self.may_ask_for(place):
                    self.want(place)
            left = sign * (limit - here)
            if left > EXACT:
                self.speed = min(self.cruise, left / STEP)
                self.blind = blind
            elif missing is None:
                break
            yield
        self.steps += 1

    def first_missing(self, needs, here, target, sign):
        """Return the first place on the way that is not held, and its coordinate; None if none is.

        A place at which the drive has begun behind is not on the way.
        """
        for place, at in needs:
            is_on_the_way = -EXACT <= sign * (at - here) <= sign * (target - here)
            if is_on_the_way and place not in self.reserved:
                return place, at
        return None

    def may_ask_for(self, place):
        """Whether a place may be claimed now."""
        return True

    def face(self, heading, blind=()):
        """Turn to a heading, rad."""
        while abs(left := wrapped(heading - self.yaw)) > EXACT:
            self.rate = max(-self.most_rate, min(self.most_rate, left / STEP))
            self.left = left
            self.blind = blind
            yield
        self.steps += 1

    def need(self, *places):
        """Wait until the carrier holds some places."""
        while not {*places} <= {*self.reserved}:
            self.want(*places)
            yield

    def want(self, *places):
        """Claim some places in this tick."""
        self.wanted = [*places]
        self.waits_for = places[0]

    def free(self, *places):
        """Give places back."""
        self.reserved = [place for place in self.reserved if place not in places]

    def deed(self, deed):
        """Couple or uncouple in this tick, if carrier and bin stand."""
        self.waits_for = deed.get("bin", "")
        # The last three numbers of a state are velocities.
        bin_moves = self.hitch and any(self.hitch["state"][4:])
        if not any(self.twist) and not bin_moves:
            self.deeds = [deed]

    def ask(self, to, body, is_enough):
        """Ask again and again. Return the first answer that is enough."""
        asked = -PATIENCE
        while True:
            for answer in self.answers_of(to, body["type"]):
                if is_enough(answer):
                    self.steps += 1
                    return answer
            if self.tick - asked >= PATIENCE:
                asked = self.tick
                self.requests.append([to, body])
            self.waits_for = to
            yield

    def claim(self):
        """Tell `traffic` which places to keep and which to get, if one is wanted or given back."""
        since = self.tick - self.claimed
        is_wish = self.wanted and since >= PATIENCE
        is_news = sorted(self.agreed) != sorted(self.reserved) and since >= SETTLED
        if is_wish or is_news:
            self.claimed = self.tick
            body = {
                "type": "claim",
                "keep": list(self.reserved),
                "want": self.wanted,
                "beside": "",
            }
            self.requests.append(["traffic", body])

    def safe(self):
        """Return the speed, m/s, and the rate of turning, rad/s: 0 if something is in the way."""
        if self.tick - self.bumped < RECOVERY:
            return 0.0, 0.0
        if self.speed > 0.0 and self.obstacles.is_ahead(self.blind):
            self.waits_for = "" if self.queueing else "an obstacle ahead"
            return 0.0, 0.0
        if self.rate:
            for name in self.obstacles.to_ask():
                self.requests.append([name, {"type": "where"}])
            is_near = self.obstacles.is_somebody_near()
            if is_near or self.obstacles.is_in_turn(self.left, self.blind):
                self.waits_for = "an obstacle in its turn"
                return 0.0, 0.0
        return self.speed, self.rate
