"""Drives a robot until something is near ahead.

python client.py tcp/127.0.0.1:7447 picker_01
"""

import json
import struct
import sys
import time
from queue import Queue

import msgpack
import zenoh

ME = "foreign1"  # the id of this session: letters and digits that no other session uses
_, endpoint, name = sys.argv
config = zenoh.Config.from_json5('{mode: "client", connect: {timeout_ms: 60000}}')
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("connect/endpoints", json.dumps([endpoint]))


def ask(key, payload=b""):
    """Return the reply to a query. Ask again until there is one: the run may still start."""
    while not (replies := list(session.get(f"orchard/{key}", payload=payload))):
        time.sleep(0.1)
    if replies[0].err:
        sys.exit(f"{key}: {replies[0].err.payload.to_string()}")
    return msgpack.unpackb(replies[0].ok.payload.to_bytes())


def put(key, **message):
    payload = msgpack.packb({"run": run} | message)
    session.put(f"orchard/{key}", payload, congestion_control=zenoh.CongestionControl.BLOCK)


with zenoh.open(config) as session:
    run = ask("scenario")["run"]
    heard, tick = Queue(), -1
    keys = ("orchard/end", f"orchard/hosts/{ME}/seen")
    subscribers = [session.declare_subscriber(key, heard.put) for key in keys]
    token = session.liveliness().declare_token(f"orchard/alive/{name}/{ME}")
    join = {"run": run, "owner": ME, "names": [name]}
    while refused := ask(f"hosts/{ME}/join", msgpack.packb(join))["refused"]:
        # Physics learns of the token a moment later.
        if refused[name] != "its liveliness token is missing":
            sys.exit(f"refused: {refused}")
        time.sleep(0.1)
    while str((sample := heard.get()).key_expr) != "orchard/end":
        seen = msgpack.unpackb(sample.payload.to_bytes())
        x, y, z, w, *twist = struct.unpack("<7d", seen["states"])  # yaw = 2 atan2(z, w)
        ranges = struct.unpack("<180f", seen["ranges"])  # m, from the right to the left
        speed = 0.5 if min(ranges[60:120]) > 1.0 else 0.0  # decide here
        tick = seen["tick"]
        put(f"{name}/velocity", tick=tick, owner=ME, linear={"x": speed}, angular={"z": 0.0})
    put(f"hosts/{ME}/left")
    print(tick + 1, "ticks answered")
