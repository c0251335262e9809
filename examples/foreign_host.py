"""An agent in lockstep by keyspace.md and docs/protocol.md alone: zenoh, msgpack, and nothing of
this program. See foreign_carrier.py.
"""

import hashlib
import json
import queue
import time
from contextlib import suppress

import msgpack
import zenoh
from zenoh.handlers import Callback

SESSION = "foreignclient"


def opened(endpoint):
    config = zenoh.Config()
    settings = {
        "mode": "client",
        "scouting/multicast/enabled": False,
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 7000,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


class RunOver(Exception):
    """Raised when physics has published the end."""


class Host:
    """Holds one agent: what arrives, when a tick is complete, what is sent."""

    def __init__(self, session, name):
        self.session, self.name, self.inbox = session, name, queue.Queue()
        self.info = self.query("scenario")
        self.run, self.answer = self.info["run"], b""
        put = lambda sample: self.inbox.put((sample.key_expr, sample.payload.to_bytes()))  # noqa: E731
        self.heard_keys = [
            session.declare_subscriber(f"orchard/{key}", put)
            for key in (f"hosts/{SESSION}/seen", "lost", "end")
        ]
        self.mail = session.declare_queryable(
            f"orchard/{name}/mail", lambda query: self.inbox.put(("query", query))
        )
        self.token = session.liveliness().declare_token(f"orchard/alive/{name}/{SESSION}")
        self.join()

    def query(self, key, message=None, seconds=5.0):
        """The reply to a query, which is repeated until one comes."""
        payload = b"" if message is None else msgpack.packb({"run": self.run} | message)
        for _ in range(50):
            for reply in self.session.get(f"orchard/{key}", payload=payload, timeout=seconds):
                if reply.ok:
                    return msgpack.unpackb(reply.ok.payload.to_bytes())
            time.sleep(0.1)
        raise SystemExit(f"no reply to {key}")

    def join(self):
        for _ in range(50):
            joined = self.query(f"hosts/{SESSION}/join", {"owner": SESSION, "names": [self.name]})
            if not joined["refused"]:
                break
            time.sleep(0.1)
        else:
            raise SystemExit(joined["refused"][self.name])
        self.joined, self.last, self.seen = joined["tick"], joined["tick"] - 1, None
        self.waiting, self.asked = (
            {},
            {},
        )  # (sender, tick, number) -> [query, letter]; tick -> the requests of mine

    def ticks(self, decide):
        """Answer ticks until the run ends.

        `decide`: of seen, the requests heard and my requests with their answers; returns a drive,
        requests and answers.
        """
        with suppress(RunOver):
            while True:
                seen = self.next_seen()
                heard, mine = self.heard(seen)
                drive, requests, answers = decide(seen, heard, mine)
                drive["mail"] = digest_of(
                    heard, [[r["to"], r["number"], r["answer"]] for r in mine]
                )
                drive |= {"requests": requests, "answers": answers}
                self.send(drive, requests, answers)
        self.token.undeclare()
        self.mail.undeclare()

    # what arrives

    def next_seen(self):
        while self.seen is None or self.seen["tick"] <= self.last:
            self.take(self.inbox.get())
        if (
            self.last < self.joined < self.seen["tick"]
        ):  # physics went on with an answer from before the join
            self.join()
            return self.next_seen()
        return self.seen

    def take(self, item):
        what, *rest = item
        match str(what).removeprefix("orchard/"), rest:
            case "query", [query]:
                self.hold(query)
            case "reply", [request, payload]:
                message = msgpack.unpackb(payload)
                if message["type"] == "answered" and message["tick"] == request["tick"] + 1:
                    request |= {"answered": True, "answer": message["body"]}
            case "final", [request]:
                request["final"] = True
            case "end", [payload]:
                self.end = msgpack.unpackb(payload)
                self.put("left", msgpack.packb({"run": self.run}))
                raise RunOver
            case "lost", [payload]:
                if msgpack.unpackb(payload)["owner"] == SESSION:
                    self.join()
            case _, [payload]:
                self.see(msgpack.unpackb(payload))

    def see(self, seen):
        if seen["tick"] == self.last:
            self.publish()
        elif seen["tick"] > self.last:
            self.seen = seen

    def hold(self, query):
        letter = msgpack.unpackb(query.payload.to_bytes())
        if letter["run"] != self.run or letter["tick"] not in (self.last, self.last + 1):
            query.reply_err(b"past tick")
            query.drop()
            return
        key = letter["sender"], letter["tick"], letter["number"]
        if key in self.waiting:
            self.waiting[key][0].drop()
        self.waiting[key] = query, letter["body"]
        query.reply(
            f"orchard/{self.name}/mail",
            msgpack.packb({"type": "received", "run": self.run, "tick": letter["tick"]}),
        )

    # the mail of a tick

    def heard(self, seen):
        """Return the requests, [sender, tick, number, body], and my own requests of two ticks ago
        with their answers, in their order.
        """
        tick, wanted = (
            seen["tick"],
            [(sender, seen["tick"] - 1, number) for _, sender, number in seen["asked"]],
        )
        mine, deadline = self.asked.pop(tick - 2, []), time.monotonic() + 1.0
        is_new = tick <= self.joined + 1
        while (
            not is_new
            and not (all(k in self.waiting for k in wanted) and all(r["final"] for r in mine))
            and time.monotonic() < deadline
        ):
            with suppress(queue.Empty):
                self.take(self.inbox.get(timeout=0.1))
        if is_new or not (
            all(k in self.waiting for k in wanted) and all(r["answered"] for r in mine)
        ):
            return self.recalled(tick)
        requests = [[*key, body] for key, (_, body) in self.waiting.items() if key[1] == tick - 1]
        return in_order(requests), mine

    def recalled(self, tick):
        """The same, from the copies of physics."""
        letters = dict(self.query("recall", {"tick": tick})["letters"])
        requests, answers = [], {}
        for sender, written in letters.get(tick - 1, {}).items():
            requests += [
                [sender, tick - 1, n, body]
                for n, (to, body) in enumerate(written["requests"])
                if to == self.name
            ]
            answers |= {
                (sender, n): body
                for to, at, n, body in written["answers"]
                if (to, at) == (self.name, tick - 2)
            }
        mine = letters.get(tick - 2, {}).get(self.name, {"requests": []})["requests"]
        asked = [
            {"to": to, "number": number, "body": body} for number, (to, body) in enumerate(mine)
        ]
        return in_order(requests), [
            request | {"answer": answers.get((request["to"], request["number"]))}
            for request in asked
        ]

    # what is sent

    def send(self, drive, requests, answers):
        tick = self.last = self.seen["tick"]
        velocities = {
            "run": self.run,
            "tick": tick,
            "owner": SESSION,
            "velocities": {self.name: drive},
        }
        self.answer = msgpack.packb(velocities)
        self.publish()
        new = {"tick": tick, "final": False, "answered": False}
        self.asked[tick] = [
            new | {"to": to, "number": number, "body": body}
            for number, (to, body) in enumerate(requests)
        ]
        for request in self.asked[tick]:
            self.get(request)
        self.close({(to, at, n): body for to, at, n, body in answers})

    def publish(self):
        self.put("velocities", self.answer)

    def put(self, what, payload):
        self.session.put(
            f"orchard/hosts/{SESSION}/{what}",
            payload,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    def get(self, request):
        letter = {"run": self.run, "sender": self.name} | {
            field: request[field] for field in ("tick", "number", "body")
        }
        handler = Callback(
            lambda reply: (
                self.inbox.put(("reply", request, reply.ok.payload.to_bytes()))
                if reply.ok
                else None
            ),
            lambda: self.inbox.put(("final", request)),
        )
        how = {
            "target": zenoh.QueryTarget.ALL,
            "consolidation": zenoh.ConsolidationMode.NONE,
            "timeout": 10.0,
        }
        self.session.get(
            f"orchard/{request['to']}/mail", handler, payload=msgpack.packb(letter), **how
        )

    def close(self, answers):
        """Answer the requests that were heard in this tick, and drop all that are older."""
        for key in [key for key in self.waiting if key[1] < self.last]:
            query, _ = self.waiting.pop(key)
            reply = {
                "type": "answered",
                "run": self.run,
                "tick": self.last,
                "body": answers.get(key),
            }
            query.reply(f"orchard/{self.name}/mail", msgpack.packb(reply))
            query.drop()


def in_order(requests):
    return sorted(requests, key=lambda heard: (heard[3]["type"], *heard[:3]))


def digest_of(requests, replies):
    mail = msgpack.packb([requests, replies])
    return hashlib.blake2b(mail, digest_size=16).digest() if requests or replies else b""
