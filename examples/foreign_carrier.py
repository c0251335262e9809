"""A carrier that is written from keyspace.md and docs/reference.md alone, as it could be in any
language: zenoh, msgpack, and nothing of this program.

    python foreign_carrier.py ENDPOINT NAME

It owns the agent of a carrier in lockstep until the run ends. Here is its job, letter by letter, as
docs/reference.md tells it. foreign_steps.py drives and claims, foreign_host.py speaks the protocol,
foreign_field.py has the places of the orchard, and foreign_obstacles.py what is in the way. If a
figure changes in the documents, it must change here.
"""

import math
import sys
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parent))
from foreign_field import EAST, NORTH, SOUTH, WEST, Field
from foreign_host import Host, opened
from foreign_obstacles import BIN, STEP
from foreign_steps import EXACT, Driver

LOOK_AGAIN = 20  # ticks after which a bin is asked again whether it is left in the lane
REMEMBERED = 25  # ticks for which a call counts
CHOOSING = 5  # ticks within which a bin sends for the carrier that has offered itself
# It is next of its line if it stands so near to the head, m, or drives on so near to it.
AT_HEAD = 0.1
SOON_AT_HEAD = 4.2


class Job(NamedTuple):
    """The full bin that the carrier fetches, the lane and its side, and the picker there."""

    full: str
    lane: int
    side: Any
    picker: str


class Call(NamedTuple):
    """A call of a full bin: the ticks since which it calls, at which it was heard last, and at
    which the carrier has offered itself to it first; inf for never.
    """

    since: int
    heard: int
    offered: float


class Carrier(Driver):
    """One carrier. Its job is the coroutine `work`, which goes on by one tick in `decide`."""

    def __init__(self, info, name):
        """`info`: as physics replies to the query `scenario`."""
        super().__init__(info, name)
        self.field = Field(info["scenario"], name)
        # What it has to do: None without a job. How many jobs it has done.
        self.job = None
        self.jobs = 0
        # Bin -> its newest call.
        self.calls = {}
        self.doing = "waiting in the queue"
        self.working = self.work()

    def decide(self, seen, heard, mine):
        """Return what to do in a tick, the requests to send, and the answers to those heard.

        `heard`: requests of others. `mine`: the requests of two ticks ago, with their answers.
        """
        self.observe(seen)
        self.hear(mine)
        self.hear_calls(heard)
        answers = []
        for sender, tick, number, body in heard:
            answers.append([sender, tick, number, self.reply_to(sender, body)])
        next(self.working)
        self.claim()
        speed, rate = self.safe()
        self.moved = (speed, rate) != (0.0, 0.0)
        drive = {
            "twist": [speed, 0.0, rate],
            "deeds": self.deeds,
            "doing": self.doing,
            "state": self.state,
            "waits_for": self.waits_for,
            "steps_done": self.steps,
        }
        return drive, self.requests, answers

    # requests of others

    def reply_to(self, sender, body):
        """Return the answer to a request."""
        if body["type"] == "carrierquery":
            return {
                "type": "carrierstatus",
                "job": self.job.full if self.job else "",
                "is_next": self.is_next(),
                "metres": max(0.0, self.field.HEAD - self.x),
            }
        if body["type"] not in ("call", "come"):
            return no("a carrier knows nothing of that")
        if body["type"] == "come" and self.job and self.job.full == sender:
            return {"type": "yes"}
        if not 1 <= body["lane"] <= self.field.rows:
            return no("there is no such lane")
        if self.job:
            return no(f"busy with {self.job.full}")
        if body["type"] == "come":
            return self.accept(sender, body)
        if not self.is_next():
            return no("another one goes first")
        if not self.is_oldest(sender):
            return no("an older call comes first")
        return self.offer(sender, body)

    def hear_calls(self, heard):
        """Remember the calls that are heard, and forget old ones."""
        for sender, _, _, body in heard:
            if body["type"] == "call":
                offered = math.inf
                known = self.calls.get(sender)
                if known and known.since == body["since"]:
                    offered = known.offered
                self.calls[sender] = Call(body["since"], self.tick, offered)
        for name, call in list(self.calls.items()):
            if self.tick - call.heard > REMEMBERED:
                del self.calls[name]

    def is_oldest(self, sender):
        """Whether the call of a bin is the oldest; bins that let an offer pass come last."""

        def rank(name):
            call = self.calls[name]
            let_pass = self.tick - call.offered > CHOOSING
            return let_pass, call.since, name

        return min(self.calls, key=rank) == sender

    def offer(self, sender, body):
        """Return the offer to fetch a bin."""
        call = self.calls[sender]
        self.calls[sender] = call._replace(offered=min(call.offered, self.tick))
        distance = self.field.distance(self.x, self.y, body["lane"], self.field.side(body["side"]))
        return {"type": "offer", "x": self.x, "y": self.y, "distance": distance}

    def accept(self, sender, body):
        """Take a job, and return that."""
        self.job = Job(sender, body["lane"], self.field.side(body["side"]), body["picker"])
        # Whether the full bin is left in the lane, and when the bin was asked for that.
        self.is_left = False
        self.looked = -LOOK_AGAIN
        return {"type": "yes"}

    def is_next(self):
        """Whether the carrier is the next one of its line that can leave."""
        short = self.field.HEAD - self.x
        is_coming = short < SOON_AT_HEAD and self.twist[0] > 0.0
        return not self.job and (short < AT_HEAD or is_coming)

    # the job

    def work(self):
        """Wait in the queue for jobs, and do them."""
        yield from self.face(EAST)
        while True:
            self.say("waiting in the queue", "waiting")
            while not self.job:
                # Up to the head, behind what is ahead.
                left = self.field.HEAD - self.x
                self.queueing = True
                if left > EXACT:
                    self.speed = min(self.cruise, left / STEP)
                yield
            answer = yield from self.ask(self.job.full, {"type": "confirm"}, is_any)
            if answer["type"] == "yes":
                yield from self.fetch(*self.job)
                self.jobs += 1
            self.job = None

    def fetch(self, full, lane, side, picker):
        """Bring an empty bin, take the full one to the bay, and return to the queue."""
        self.say(f"bringing an empty bin to {picker}", "driving")
        yield from self.bring(lane, side)
        empty = self.hitch["name"]
        while self.hitch:
            self.deed({"type": "uncouple"})
            yield
        yield from self.ask(picker, {"type": "here", "bin": empty}, is_yes)
        yield from self.loop(lane, side)
        while not self.hitch or self.hitch["name"] != full:
            self.deed({"type": "couple", "bin": full})
            yield
        self.say(f"taking {full} to the bay", "hauling")
        yield from self.haul(lane, side)
        self.say(f"unloading {full}", "unloading")
        yield from self.ask(full, {"type": "state"}, is_empty)
        self.say("returning to the queue", "driving")
        yield from self.go_home()

    def bring(self, lane, side):
        """Drive from the queue along the road of deliveries to the stop at a lane."""
        field = self.field
        east = field.east
        west = field.west
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
            corner = ("corner/south-west", field.CORNER_HOLD)
            yield from self.drive("x", west.x(field.D), [corner])
            yield from self.face(NORTH)
            self.free("corner/south-west")
            leave_top = []
        yield from self.drive("y", side.y(lane, field.STOP), needs, frees + leave_top)

    def loop(self, lane, side):
        """Drive from the empty bin, round the lane's mouth, to where the full bin is behind."""
        blind = self.at_work(lane, side)
        yield from self.need(f"{side.name}/F/{lane}")
        yield from self.face(side.heading(WEST), blind)
        yield from self.drive(
            "x",
            side.x(self.field.COUPLES),
            frees=[(f"{side.name}/D/{lane}", side.x(self.field.LEFT_D))],
            blind=blind,
        )
        yield from self.face(side.heading(NORTH), blind)
        yield from self.drive("y", self.field.lane(lane), blind=blind)
        yield from self.face(side.heading(EAST), blind)

    def haul(self, lane, side):
        """Drive with the full bin along its road to the bay."""
        field = self.field
        west = field.west
        blind = self.at_work(lane, side)
        corner = []
        first = lane
        yield from self.drive("x", side.x(field.F), blind=blind)
        yield from self.face(side.heading(SOUTH), blind)
        if side is not west:
            needs, frees = field.along(side, "F", side.lanes(first=lane))
            yield from self.drive("y", field.bottom_f, needs, frees)
            yield from self.need("corner/south-east")
            yield from self.face(WEST)
            leave_east = ("corner/south-east", field.LEFT_EAST)
            yield from self.drive("x", west.x(field.F), frees=[leave_east])
            yield from self.need("corner/south-west", "turn/south-west")
            yield from self.face(NORTH)
            corner = [
                ("corner/south-west", field.bottom_f + field.LEFT_CORNER),
                ("turn/south-west", field.bottom_f + field.LEFT_TURN),
            ]
            # From the east it passes all lanes of the west.
            first = None
        needs, frees = field.along(west, "F", west.lanes(first=first))
        yield from self.drive("y", field.TOP_ROAD, needs, frees + corner)
        yield from self.face(EAST)
        yield from self.drive("x", field.BAY_STOP)

    def go_home(self):
        """Drive from the bay to its line of the queue."""
        field = self.field
        yield from self.drive("x", field.TURN_OFF)
        if field.line != field.TOP_ROAD:
            yield from self.face(SOUTH if field.line < field.TOP_ROAD else NORTH)
            yield from self.drive("y", field.line)
            yield from self.face(EAST)

    def at_work(self, lane, side):
        """Return the boxes that are no obstacles at a lane: full bin, empty bin and picker.

        Each is x, y, half length, half width, m, widened by 0.1 m.
        """
        field = self.field
        y = field.lane(lane)
        half = BIN / 2 + 0.1
        return [
            (side.x(field.FULL), y, half, half),
            (side.x(field.D), y, half, half),
            (side.x(field.PICKER), y, 1.35, 0.85),
        ]

    def may_ask_for(self, place):
        """Whether the picker can come out without this place: it has left its full bin.

        That matters for the place of the lane itself. The bin is asked until it is left.
        """
        full, lane, side, _ = self.job
        if place != f"{side.name}/D/{lane}" or self.is_left:
            return True
        for answer in self.answers_of(full, "state"):
            if answer["type"] == "binstate" and answer["full"] and not answer["coupled_to"]:
                self.is_left = True
        if not self.is_left and self.tick - self.looked >= LOOK_AGAIN:
            self.looked = self.tick
            self.requests.append([full, {"type": "state"}])
        self.waits_for = full
        return self.is_left


def is_any(answer):
    """Whether an answer is enough that may be any."""
    return True


def is_yes(answer):
    """Whether an answer agrees."""
    return answer["type"] == "yes"


def is_empty(answer):
    """Whether a bin answers that it is not full any more."""
    return answer["type"] == "binstate" and not answer["full"]


def no(reason):
    """Return an answer that refuses."""
    return {"type": "no", "reason": reason}


def main(endpoint, name):
    """Work until the run ends, and print how many bins were taken."""
    with opened(endpoint) as session:
        host = Host(session, name)
        carrier = Carrier(host.info, name)
        host.ticks(carrier.decide)
        print(carrier.jobs, "bins taken", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
