"""A person that is written from keyspace.md alone, as it could be in any language, and holds its velocity: zenoh and msgpack.

    python foreign_holder.py ENDPOINT NAME

It walks on until something is in the zone before it, and then turns on the spot. It is asked only when its hold ends.
"""

import json
import math
import queue
import struct
import sys

import msgpack
import zenoh

SESSION, KEY = "foreignholder", "orchard/hosts/foreignholder"
ZONE = (0.0, 1.5, -0.5, 0.5)
HELD = 40  # ticks


def main(endpoint, name):
    config = zenoh.Config()
    for key, value in {"mode": "client", "scouting/multicast/enabled": False, "connect/endpoints": [endpoint]}.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        print(*walk(session, name), flush=True)


def walk(session, name):
    """Hold the agent until the end. Return how often it was asked, and the last tick."""
    heard, asked = queue.Queue(), 0
    put = lambda sample: heard.put((str(sample.key_expr), msgpack.unpackb(sample.payload.to_bytes())))  # noqa: E731
    declared = [session.declare_subscriber(key, put) for key in (f"{KEY}/seen", "orchard/end")]
    run = unpacked(session.get("orchard/scenario"))["run"]
    declared.append(session.liveliness().declare_token(f"orchard/alive/{name}/{SESSION}"))
    wish = msgpack.packb({"run": run, "owner": SESSION, "names": [name]})
    while unpacked(session.get(f"{KEY}/join", payload=wish))["refused"]:
        pass
    last = -1
    while True:
        key, message = heard.get(timeout=60.0)
        if key == "orchard/end":
            session.put(f"{KEY}/left", msgpack.packb({"run": run}), congestion_control=zenoh.CongestionControl.BLOCK)
            return asked, message["tick"]
        if message["tick"] > last:
            asked, last = asked + 1, message["tick"]
            drives = msgpack.packb({"run": run, "tick": last, "owner": SESSION, "velocities": {name: drive(message)}})
        session.put(f"{KEY}/velocities", drives, congestion_control=zenoh.CongestionControl.BLOCK)


def unpacked(replies):
    return msgpack.unpackb(next(iter(replies)).ok.payload.to_bytes())


def drive(seen):
    """The answer to what the only body sees."""
    ranges = struct.unpack(f"<{len(seen['ranges']) // 4}f", seen["ranges"])
    free = not any(enter <= r < leave for r, (enter, leave) in zip(ranges, map(span, range(len(ranges))), strict=True))
    hold = {"until": seen["tick"] + HELD, "watch": [ZONE]}
    twist = [0.5, 0.0, 0.0] if free else [0.0, 0.0, 0.5]
    return {"twist": twist, "once": True, "doing": "walking", "state": "driving", "hold": hold}


def span(beam):
    """The ranges at which a beam of 180 enters and leaves the zone."""
    angle = -math.pi / 2 + beam * math.pi / 179
    x, y = (sorted(limit / part for limit in limits) for part, limits in ((math.cos(angle), ZONE[:2]), (math.sin(angle), ZONE[2:])))
    return max(0.0, x[0], y[0]), min(x[1], y[1])


if __name__ == "__main__":
    main(*sys.argv[1:])
