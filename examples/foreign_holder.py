"""A person that is written from keyspace.md alone, as it could be in any language, and holds its
velocity: zenoh and msgpack.

    python foreign_holder.py ENDPOINT NAME

It walks on until something is in the zone before it, and then turns on the spot. With each velocity
it sends a hold, for which the velocity stands without an answer: up to a tick, or until something
comes into the zone, or leaves it. So it is asked only when its hold ends.
"""

import math
import struct
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from foreign_host import Host, opened

# m from its centre: ahead from and to, to the left from and to.
ZONE = (0.0, 1.5, -0.5, 0.5)
HELD = 40  # ticks of a hold, at most
BEAMS = 180  # of its laser, over half a turn, from the right to the left


def main(endpoint, name):
    """Hold the velocity of an agent until the end.

    Print how often it was asked, and the last tick.
    """
    asked = []

    def decide(seen, heard, mine):
        asked.append(seen["tick"])
        return drive(seen), [], []

    with opened(endpoint) as session:
        host = Host(session, name)
        host.ticks(decide)
        print(len(asked), host.end["tick"], flush=True)


def drive(seen):
    """Return what to do: walk on at 0.5 m/s, or turn at 0.5 rad/s."""
    ranges = struct.unpack(f"<{BEAMS}f", seen["ranges"])
    twist = [0.5, 0.0, 0.0]
    for beam, distance in enumerate(ranges):
        enters, leaves = span(beam)
        if enters <= distance < leaves:
            twist = [0.0, 0.0, 0.5]
    hold = {"until": seen["tick"] + HELD, "watch": [ZONE]}
    return {"twist": twist, "once": True, "doing": "walking", "state": "driving", "hold": hold}


def span(beam):
    """Return the ranges at which a beam enters and leaves the zone."""
    angle = -math.pi / 2 + beam * math.pi / (BEAMS - 1)
    behind, ahead, right, left = ZONE
    # A beam has gone `range * cosine` ahead and `range * sine` to the left. It is in the zone where
    # both are within the zone's limits.
    enters_ahead, leaves_ahead = sorted(limit / math.cos(angle) for limit in (behind, ahead))
    enters_aside, leaves_aside = sorted(limit / math.sin(angle) for limit in (right, left))
    return max(0.0, enters_ahead, enters_aside), min(leaves_ahead, leaves_aside)


if __name__ == "__main__":
    main(*sys.argv[1:])
