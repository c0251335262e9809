"""A host of one agent in lockstep, written from keyspace.md and docs/protocol.md alone: zenoh,
msgpack, and nothing of this program. foreign_carrier.py and foreign_holder.py run their agents in
it.

At each tick at which the agent is asked, physics sends what it sees. The tick is complete when all
requests of others to the agent are here, and all answers to its own requests. Then the agent
decides, and its velocity, requests and answers are sent. A request of tick k is heard in tick k +
1, and its answer in tick k + 2.
"""

import hashlib
import json
import queue
import time
from contextlib import suppress

import msgpack
import zenoh
from zenoh.handlers import Callback

# The id of this session: letters and digits that no other session uses.
SESSION = "foreignclient"
TRIES = 50  # of a query or a join, before the host gives up
AGAIN_SECONDS = 0.1  # between two of them
MAIL_SECONDS = 1.0  # for which a tick waits for its mail, before physics is asked for copies
GET_SECONDS = 10.0  # for which a request of the agent waits for its answer


def opened(endpoint):
    """Open a session with the router at an endpoint."""
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
    """Holds one agent: what arrives, when a tick is complete, what is sent.

    Zenoh's threads put what arrives into `inbox`, and the thread of `ticks` takes it from there.
    """

    def __init__(self, session, name):
        """Join the run with the agent of this name."""
        self.session = session
        self.name = name
        self.inbox = queue.Queue()
        self.info = self.query("scenario")
        self.run = self.info["run"]
        # The newest message `velocities`, as bytes.
        self.answer = b""

        def put(sample):
            self.inbox.put((sample.key_expr, sample.payload.to_bytes()))

        # Zenoh ends a subscription that nothing refers to.
        self.subscribers = []
        for key in (f"hosts/{SESSION}/seen", "lost", "end"):
            self.subscribers.append(session.declare_subscriber(f"orchard/{key}", put))
        self.mail = session.declare_queryable(
            f"orchard/{name}/mail", lambda query: self.inbox.put(("query", query))
        )
        self.token = session.liveliness().declare_token(f"orchard/alive/{name}/{SESSION}")
        self.join()

    def query(self, key, message=None, seconds=5.0):
        """The reply to a query, which is repeated until one comes."""
        payload = b""
        if message is not None:
            payload = msgpack.packb({"run": self.run} | message)
        for _ in range(TRIES):
            for reply in self.session.get(f"orchard/{key}", payload=payload, timeout=seconds):
                if reply.ok:
                    return msgpack.unpackb(reply.ok.payload.to_bytes())
            time.sleep(AGAIN_SECONDS)
        raise SystemExit(f"no reply to {key}")

    def join(self):
        """Own the agent from now on, after the first join or when physics has lost the agent."""
        for _ in range(TRIES):
            joined = self.query(f"hosts/{SESSION}/join", {"owner": SESSION, "names": [self.name]})
            if not joined["refused"]:
                break
            # Physics learns of the liveliness token a moment later.
            time.sleep(AGAIN_SECONDS)
        else:
            raise SystemExit(joined["refused"][self.name])
        # The tick of the join, the newest tick that was answered, and what is seen now.
        self.joined = joined["tick"]
        self.last = self.joined - 1
        self.seen = None
        # Requests of others that wait: (sender, tick, number) -> (query, body).
        self.waiting = {}
        # Requests of the agent: tick -> list of maps with `to`, `number`, `body`, and how far each
        # is: `final` when nothing more comes, `answered` when its `answer` is here.
        self.asked = {}

    def ticks(self, decide):
        """Answer ticks until the run ends.

        `decide`: takes what is seen, the requests that are heard, and the agent's own requests of
        two ticks ago with their answers. It returns what to do, requests, and answers.
        """
        with suppress(RunOver):
            while True:
                seen = self.next_seen()
                heard, mine = self.heard(seen)
                drive, requests, answers = decide(seen, heard, mine)
                replies = [[own["to"], own["number"], own["answer"]] for own in mine]
                # By the digest physics sees that the agent has heard all that it should.
                drive["mail"] = digest_of(heard, replies)
                drive |= {"requests": requests, "answers": answers}
                self.send(drive, requests, answers)
        self.token.undeclare()
        self.mail.undeclare()

    # what arrives

    def next_seen(self):
        """Wait for a tick that is not answered yet, and return what is seen then."""
        while self.seen is None or self.seen["tick"] <= self.last:
            self.take(self.inbox.get())
        has_missed_join = self.last < self.joined < self.seen["tick"]
        if has_missed_join:
            # Physics has gone on with an answer of before the join.
            self.join()
            return self.next_seen()
        return self.seen

    def take(self, item):
        """Take what has arrived: a key and its payload, or a word and what belongs to it."""
        key, *rest = item
        match str(key).removeprefix("orchard/"), rest:
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
        """Take what is seen at a tick. Physics sends it again if it has missed the answer."""
        if seen["tick"] == self.last:
            self.publish()
        elif seen["tick"] > self.last:
            self.seen = seen

    def hold(self, query):
        """Keep a request until the tick in which it is answered, and reply that it is here."""
        letter = msgpack.unpackb(query.payload.to_bytes())
        if letter["run"] != self.run or letter["tick"] not in (self.last, self.last + 1):
            query.reply_err(b"past tick")
            query.drop()
            return
        key = letter["sender"], letter["tick"], letter["number"]
        # It may come twice: then the second query gets the answer.
        if key in self.waiting:
            self.waiting[key][0].drop()
        self.waiting[key] = query, letter["body"]
        query.reply(
            f"orchard/{self.name}/mail",
            msgpack.packb({"type": "received", "run": self.run, "tick": letter["tick"]}),
        )

    # the mail of a tick

    def heard(self, seen):
        """Return the requests, [sender, tick, number, body], and the agent's own requests of two
        ticks ago with their answers, each in its order.
        """
        tick = seen["tick"]
        # What of the mail must be here: physics tells which requests were sent.
        wanted = [(sender, tick - 1, number) for _, sender, number in seen["asked"]]
        mine = self.asked.pop(tick - 2, [])
        # After a join this session has not got the mail of the ticks before.
        if tick <= self.joined + 1:
            return self.recalled(tick)
        deadline = time.monotonic() + MAIL_SECONDS
        while not self.is_mail_here(wanted, mine, "final") and time.monotonic() < deadline:
            with suppress(queue.Empty):
                self.take(self.inbox.get(timeout=0.1))
        if not self.is_mail_here(wanted, mine, "answered"):
            return self.recalled(tick)
        requests = []
        for key, (_, body) in self.waiting.items():
            sent_at = key[1]
            if sent_at == tick - 1:
                requests.append([*key, body])
        return in_order(requests), mine

    def is_mail_here(self, wanted, mine, progress):
        """Whether all requests that are wanted are here, and all of the agent's own requests have
        come so far: 'final' or 'answered'.
        """
        has_requests = all(key in self.waiting for key in wanted)
        return has_requests and all(request[progress] for request in mine)

    def recalled(self, tick):
        """Return the same as `heard`, from the copies that physics keeps."""
        letters = dict(self.query("recall", {"tick": tick})["letters"])
        requests = []
        answers = {}
        for sender, written in letters.get(tick - 1, {}).items():
            for number, (to, body) in enumerate(written["requests"]):
                if to == self.name:
                    requests.append([sender, tick - 1, number, body])
            for to, asked_at, number, body in written["answers"]:
                if (to, asked_at) == (self.name, tick - 2):
                    answers[sender, number] = body
        own = letters.get(tick - 2, {}).get(self.name, {"requests": []})
        mine = []
        for number, (to, body) in enumerate(own["requests"]):
            answer = answers.get((to, number))
            mine.append({"to": to, "number": number, "body": body, "answer": answer})
        return in_order(requests), mine

    # what is sent

    def send(self, drive, requests, answers):
        """Send what the agent does in this tick, its requests, and its answers.

        `requests`: [to, body]. `answers`: [sender, tick, number, body] of the request, and the body
        of the answer.
        """
        tick = self.seen["tick"]
        self.last = tick
        velocities = {
            "run": self.run,
            "tick": tick,
            "owner": SESSION,
            "velocities": {self.name: drive},
        }
        self.answer = msgpack.packb(velocities)
        self.publish()
        self.asked[tick] = []
        for number, (to, body) in enumerate(requests):
            request = {"tick": tick, "to": to, "number": number, "body": body}
            request |= {"final": False, "answered": False}
            self.asked[tick].append(request)
            self.get(request)
        self.close({(to, asked_at, number): body for to, asked_at, number, body in answers})

    def publish(self):
        """Publish the newest velocity, perhaps once more."""
        self.put("velocities", self.answer)

    def put(self, key, payload):
        """Publish a message of this host that must not be lost."""
        self.session.put(
            f"orchard/hosts/{SESSION}/{key}",
            payload,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    def get(self, request):
        """Send a request of the agent, as a query to which two replies come: received, answered."""
        letter = {"run": self.run, "sender": self.name}
        for field in ("tick", "number", "body"):
            letter[field] = request[field]

        def reply_has_come(reply):
            if reply.ok:
                self.inbox.put(("reply", request, reply.ok.payload.to_bytes()))

        def nothing_more_comes():
            self.inbox.put(("final", request))

        self.session.get(
            f"orchard/{request['to']}/mail",
            Callback(reply_has_come, nothing_more_comes),
            payload=msgpack.packb(letter),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=GET_SECONDS,
        )

    def close(self, answers):
        """Answer the requests of the tick before, and drop all that are older."""
        for key in list(self.waiting):
            sent_at = key[1]
            if sent_at >= self.last:
                continue
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
    """Return requests, [sender, tick, number, body], in the order in which an agent hears them."""

    def place(request):
        sender, tick, number, body = request
        return body["type"], sender, tick, number

    return sorted(requests, key=place)


def digest_of(requests, replies):
    """Return the digest of a tick's mail, of no bytes without any mail.

    `replies`: [to, number, answer] of the agent's own requests.
    """
    if not requests and not replies:
        return b""
    mail = msgpack.packb([requests, replies])
    return hashlib.blake2b(mail, digest_size=16).digest()
