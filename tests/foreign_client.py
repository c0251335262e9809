"""A client as one can write it from keyspace.md alone: zenoh and msgpack, and nothing of this program.

    python foreign_client.py ENDPOINT NAME

Holds an agent in lockstep: drives its robot forward, answers every tick and every request, and leaves at the end.
"""

import json
import sys

import msgpack
import zenoh


def main(endpoint, name):
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    with zenoh.open(config) as session:
        print(drive(session, name), "ticks answered", flush=True)


def unpacked(sample):
    return msgpack.unpackb(sample.payload.to_bytes())


def drive(session, name):
    run = unpacked(next(iter(session.get("orchard/scenario"))).ok)["run"]
    heard = session.declare_subscriber("orchard/*")
    mail = session.declare_queryable(f"orchard/{name}/mail", lambda query: receive(session, name, run, query))
    token = session.liveliness().declare_token(f"orchard/alive/{name}/foreign1")
    wish = msgpack.packb({"run": run, "holder": "foreign1", "names": [name]})
    (joined,) = list(session.get("orchard/hosts/foreign1/join", payload=wish))
    assert not unpacked(joined.ok)["refused"]
    answered = -1
    for sample in heard:
        message = unpacked(sample)
        if str(sample.key_expr) == "orchard/end":
            break
        if str(sample.key_expr) == "orchard/clock" and message["tick"] > answered:
            answered = message["tick"]
            velocity = {"run": run, "tick": answered, "holder": "foreign1", "linear": {"x": 0.5}, "angular": {"z": 0.0}}
            session.put(f"orchard/{name}/velocity", msgpack.packb(velocity), congestion_control=zenoh.CongestionControl.BLOCK)
    session.put("orchard/hosts/foreign1/left", msgpack.packb({"run": run}), congestion_control=zenoh.CongestionControl.BLOCK)
    mail.undeclare()
    token.undeclare()
    return answered + 1


def receive(session, name, run, query):
    """It hears requests, and never answers."""
    asked = msgpack.unpackb(query.payload.to_bytes())
    query.reply(f"orchard/{name}/mail", msgpack.packb({"type": "received", "run": run, "tick": asked["tick"]}))
    query.drop()


if __name__ == "__main__":
    main(*sys.argv[1:])
