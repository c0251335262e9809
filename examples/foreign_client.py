"""Drives a robot until something is near ahead: python foreign_client.py tcp/127.0.0.1:7447 picker_01"""

import json
import queue
import struct
import sys

import msgpack
import zenoh

endpoint, name, me = (
    sys.argv[1],
    sys.argv[2],
    "foreign1",
)  # `me`: a session id of letters and digits that no other session uses
config = zenoh.Config()
for key, value in {
    "mode": "client",
    "scouting/multicast/enabled": False,
    "connect/endpoints": [endpoint],
}.items():
    config.insert_json5(key, json.dumps(value))


def unpacked(part):
    return msgpack.unpackb(part.payload.to_bytes())


def put(key, **message):
    session.put(
        f"orchard/{key}",
        msgpack.packb({"run": run} | message),
        congestion_control=zenoh.CongestionControl.BLOCK,
    )


with zenoh.open(config) as session:
    run, heard, tick = (
        unpacked(next(iter(session.get("orchard/scenario"))).ok)["run"],
        queue.Queue(),
        -1,
    )
    listen = [
        session.declare_subscriber(f"orchard/{key}", heard.put)
        for key in (f"hosts/{me}/seen", "end")
    ]
    token = session.liveliness().declare_token(f"orchard/alive/{name}/{me}")
    join = msgpack.packb({"run": run, "owner": me, "names": [name]})
    while unpacked(next(iter(session.get(f"orchard/hosts/{me}/join", payload=join))).ok)["refused"]:
        pass  # physics learns of the token a moment later
    while str((sample := heard.get()).key_expr) != "orchard/end":
        seen = unpacked(sample)
        tick, (x, y, z, w, *twist) = (
            seen["tick"],
            struct.unpack("<7d", seen["states"]),
        )  # yaw = 2 atan2(z, w)
        ranges = struct.unpack("<180f", seen["ranges"])  # m, from the right to the left
        speed = 0.5 if min(ranges[60:120]) > 1.0 else 0.0  # decide here
        put(f"{name}/velocity", tick=tick, owner=me, linear={"x": speed}, angular={"z": 0.0})
    put(f"hosts/{me}/left")
    token.undeclare()
    print(tick + 1, "ticks answered")
