"""What is in the way of a carrier, written from docs/reference.md alone: foreign_carrier.py stands
while something is. If a figure changes in the documents, it must change here.

A point is (ahead, left): metres from the carrier's centre, as it faces.
"""

import math
import struct

# Kind -> length and width, m, and the most that it walks, m/s.
BYSTANDERS = {
    "worker": (0.55, 1.0, 1.0),
    "visitor": (0.55, 1.0, 1.0),
    "dog": (1.0, 0.8, 3.0),
    "cat": (1.0, 0.8, 3.0),
}
# m: of the carrier; from its centre back to that of the bin that it tows; the side of a bin.
LENGTH = 1.8
WIDTH = 1.5
TOWS = 1.9
BIN = 1.0
# Angles of the beams, rad: 180 of the carrier's laser, at the middle of its front, from the right
# to the left; 60 of the bin's, at its centre, all around.
FRONT = [-math.pi / 2 + beam * math.pi / 179 for beam in range(180)]
AROUND = [beam * 2 * math.pi / 60 for beam in range(60)]
STEP = 0.1  # s of a tick

# The corridor ahead is so deep, and on each side so much wider than the carrier, m.
STOP_DISTANCE = 0.8
SIDE_MARGIN = 0.2
# What a turn sweeps has this margin, m. It is looked at in steps of so many rad.
TURN_MARGIN = 0.05
TURN_STEP = math.pi / 48
# Returns that are further away can be in no corridor, and in no turn, m.
AHEAD_REACH = 2.0
TURN_REACH = 3.5
# People and animals: they are asked so many s before they may be in the circle of the turn, and
# keep so many m from it. For so many ticks after a question without an answer the lasers decide.
ASK_AHEAD = 0.3
NEAR_MARGIN = 0.1
SILENT_TICKS = 50


def points_of(scan, angles, reach, ahead):
    """Return the points of a scan that are nearer than `reach`. `ahead`: of the laser, m."""
    points = []
    for distance, angle in zip(scan, angles, strict=True):
        if distance < reach:
            points.append((ahead + distance * math.cos(angle), distance * math.sin(angle)))
    return points


def is_in_box(point, box):
    """Whether a point is in a box: the x of its middle, half its length, half its width."""
    middle, half_length, half_width = box
    return abs(point[0] - middle) < half_length and abs(point[1]) < half_width


class Obstacles:
    """What the lasers of a carrier see at a tick, and where people and animals said that they are.

    `hitch`: the bin on its bar, as physics sends it; None without a bin.
    """

    def __init__(self, people):
        """`people`: the names of all people and animals."""
        self.people = people
        # Name -> tick of the newest question, and then the x and y of the answer, if there was one.
        self.sighted = {}

    def see(self, tick, pose, scan, hitch):
        """Take what is seen at a tick. `pose`: x, y, yaw. `scan`: ranges of the carrier's laser."""
        self.tick = tick
        self.x, self.y, self.yaw = pose
        self.scan = scan
        self.hitch = hitch

    def note_answer(self, name, answer):
        """Note what a person or an animal has answered to the question of the tick before."""
        place = []
        if answer and answer["type"] == "position":
            place = [answer["x"], answer["y"]]
        self.sighted[name] = (self.tick - 1, *place)

    def is_ahead(self, blind):
        """Whether something is in the corridor ahead. `blind`: boxes that are no obstacles."""
        corridor = (0.0, LENGTH / 2 + STOP_DISTANCE, WIDTH / 2 + SIDE_MARGIN)
        for point in points_of(self.scan, FRONT, AHEAD_REACH, LENGTH / 2):
            if is_in_box(point, corridor) and not self._is_blind(point, blind):
                return True
        return False

    def is_in_turn(self, left, blind):
        """Whether something is in what a turn still sweeps. `left`: the rest of the turn, rad."""
        boxes = [(0.0, LENGTH / 2 + TURN_MARGIN, WIDTH / 2 + TURN_MARGIN)]
        if self.hitch:
            boxes.append((-TOWS, BIN / 2 + TURN_MARGIN, BIN / 2 + TURN_MARGIN))
        points = [point for point in self._points_around() if not self._is_blind(point, blind)]
        steps = int(abs(left) / TURN_STEP) + 1
        for number in range(steps + 1):
            angle = left * number / steps
            sine = math.sin(angle)
            cosine = math.cos(angle)
            for ahead, aside in points:
                # The point, as the carrier will see it when it has turned so far.
                turned = (cosine * ahead + sine * aside, cosine * aside - sine * ahead)
                if any(is_in_box(turned, box) for box in boxes):
                    return True
        return False

    def _points_around(self):
        """Return the points of both lasers, without those on the carrier itself."""
        own = points_of(self.scan, FRONT, TURN_REACH, LENGTH / 2)
        if not self.hitch:
            return own
        x, y, z, w, *_ = self.hitch["state"]
        # Where the bin is, and how it is turned, seen from the carrier.
        ahead, left = self._seen_from_here(x, y)
        turn = 2 * math.atan2(z, w) - self.yaw
        sine = math.sin(turn)
        cosine = math.cos(turn)
        ranges = struct.unpack("<60f", self.hitch["ranges"])
        for a, b in points_of(ranges, AROUND, TURN_REACH, 0.0):
            point = (ahead + cosine * a - sine * b, left + sine * a + cosine * b)
            if not is_in_box(point, (0.0, LENGTH / 2 + 0.1, WIDTH / 2 + 0.1)):
                own.append(point)
        return own

    def _seen_from_here(self, x, y):
        """Return a place in `map` as a point."""
        sine = math.sin(self.yaw)
        cosine = math.cos(self.yaw)
        dx = x - self.x
        dy = y - self.y
        return cosine * dx + sine * dy, cosine * dy - sine * dx

    def _is_blind(self, point, blind):
        """Whether a point is in one of the boxes: x, y, half length, half width, in `map`."""
        ahead, left = point
        sine = math.sin(self.yaw)
        cosine = math.cos(self.yaw)
        x = self.x + cosine * ahead - sine * left
        y = self.y + sine * ahead + cosine * left
        for box_x, box_y, half_x, half_y in blind:
            if abs(x - box_x) <= half_x and abs(y - box_y) <= half_y:
                return True
        return False

    # people and animals

    def to_ask(self):
        """Return the people and animals that may soon be in the circle of a turn."""
        return [name for name in self.people if self._seconds_to(name) < ASK_AHEAD]

    def is_somebody_near(self):
        """Whether a person or an animal is, or may be, in the circle of a turn."""
        return any(self._seconds_to(name) < STEP for name in self.people)

    def _seconds_to(self, name):
        """Return after which time somebody can be in the circle of a turn: inf for never, -inf if
        it may be there by now.
        """
        if self.hitch:
            radius = math.hypot(TOWS + BIN / 2, BIN / 2)
        else:
            radius = math.hypot(LENGTH, WIDTH) / 2
        # Somebody that was never asked may be anywhere.
        tick, *place = self.sighted.get(name, (-2 * SILENT_TICKS,))
        if not place:
            return math.inf if self.tick - tick < SILENT_TICKS else -math.inf
        length, width, speed = BYSTANDERS[name.rsplit("_", 1)[0]]
        distance = math.hypot(place[0] - self.x, place[1] - self.y)
        room = distance - radius - math.hypot(length, width) / 2 - NEAR_MARGIN
        return room / speed - (self.tick - tick) * STEP
