"""A person that is written from keyspace.md alone, as it could be in any language, and holds its
velocity: zenoh and msgpack.

    python foreign_holder.py ENDPOINT NAME

It walks on until something is in the zone before it, and then turns on the spot. It is asked only
when its hold ends.
"""

import math
import struct
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from foreign_host import Host, opened

ZONE = (0.0, 1.5, -0.5, 0.5)
HELD = 40  # ticks


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
    """The answer to what the only body sees."""
    ranges = struct.unpack(f"<{len(seen['ranges']) // 4}f", seen["ranges"])
    free = not any(
        enter <= r < leave
        for r, (enter, leave) in zip(ranges, map(span, range(len(ranges))), strict=True)
    )
    hold = {"until": seen["tick"] + HELD, "watch": [ZONE]}
    twist = [0.5, 0.0, 0.0] if free else [0.0, 0.0, 0.5]
    return {"twist": twist, "once": True, "doing": "walking", "state": "driving", "hold": hold}


def span(beam):
    """The ranges at which a beam of 180 enters and leaves the zone."""
    angle = -math.pi / 2 + beam * math.pi / 179
    x, y = (
        sorted(limit / part for limit in limits)
        for part, limits in ((math.cos(angle), ZONE[:2]), (math.sin(angle), ZONE[2:]))
    )
    return max(0.0, x[0], y[0]), min(x[1], y[1])


if __name__ == "__main__":
    main(*sys.argv[1:])
