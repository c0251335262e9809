"""What occurs in a run stands in keyspace.md, with the program that sends it: all keys, and all
gets that are answered.

The sessions of the simulated network note each use of a key: they put a message on it, get
something from it, answer a get, or declare a token. The table of keyspace.md must allow each use.
"""

import re
from collections.abc import Iterator
from typing import NamedTuple

import pytest
from fleet import wait_for
from local_runs import SMALL

from chaos.simulated.session import SimulatedBus
from docs.keyspace import keyspace
from orchard.contract.messages import Claim, Couple, Here, No, Yes
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.wire.codec import orchard_of
from orchard.wire.keys import LIVELINESS, QUERY

# The process of the simulated network -> the words for it in the column "sender".
WORDS = {
    "physics": ("physics",),
    "agents": ("host", "session"),
    "logger": ("logger", "session"),
    "client": ("client", "session"),
}
# How a key is used, and the method of a session that does it.
PUT = "put"
GET = "get"
TOKEN = "token"
ANSWER = "answer"
MEANS = {"publish": PUT, "ask": GET, "declare_alive": TOKEN, "answer": ANSWER}
LAYOUT = lay_out(SMALL)
# What may stand for each placeholder of a key in the table, as a regular expression.
PLACEHOLDERS = {
    "prefix": "orchard",
    "body": "|".join(LAYOUT.names),
    "agent": "|".join(LAYOUT.agents),
    "bin": r"bin_\d+",
    "name": "|".join([*LAYOUT.agents, "logger"]),
    "run": r"\w+",
    "session": r"\w+",
}


class Row(NamedTuple):
    """A row of the table of keyspace.md."""

    key: str
    message: str
    sender: str
    rate: str
    delivery: str

    def fits(self, key: str) -> bool:
        """Whether a key of a run is one of this row."""
        pattern = re.sub(r"\{(\w+)\}", lambda name: f"({PLACEHOLDERS[name[1]]})", self.key)
        return bool(re.fullmatch(pattern, key))

    @property
    def means(self) -> set[str]:
        """How the key is used."""
        if self.delivery == LIVELINESS:
            return {TOKEN}
        if self.delivery == QUERY:
            return {GET, ANSWER}
        return {PUT, GET, ANSWER} if "also a query" in self.delivery else {PUT}


def rows() -> Iterator[Row]:
    """Yield the rows of the table of keyspace.md."""
    for line in keyspace().splitlines():
        if line.startswith("| `{prefix}"):
            yield Row(*(part.strip(" `") for part in line.strip("|").split("|")))


@pytest.fixture
def used(monkeypatch):
    """Return a set to which (how, key, process) of each use by a session is added.

    `process` is the kind of it, such as `agents`: the name without its number.
    """
    uses = set()

    def note(method: str) -> None:
        real = getattr(SimulatedBus, method)

        def noted(self, key, *arguments, **more):
            uses.add((MEANS[method], key, self.name.rstrip("_0123456789")))
            return real(self, key, *arguments, **more)

        monkeypatch.setattr(SimulatedBus, method, noted)

    for method in MEANS:
        note(method)
    return uses


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_each_key_of_a_run_stands_in_keyspace_with_its_sender(fleet, used, mode):
    fleet.physics(SMALL, "--mode", mode, "--duration", "40", "--recorded")
    client = fleet.client()
    keys = client.keys
    everything = client.hear("orchard/**")
    fleet.start("orchard.processes.logger", "--connect", fleet.endpoint)
    fleet.host("--without", "worker_01")
    client.drive("worker_01", 0, 0.5)

    def has_poses_of_tick_30(message) -> bool:
        return bool(message.get("poses")) and message["tick"] >= 30

    tick = wait_for(everything, has_poses_of_tick_30)["tick"]
    client.put(keys.of("advice", "picker_01"), tick=tick, linear={"x": 0.1}, angular={"z": 0.0})
    for key in ("scenario", "layout", "simulation_state"):
        client.ask(keys.of(key))
    client.ask(keys.of("state", "bin_01"))
    client.ask(keys.of("stop"), client._of_run(stop=True, names=["picker_01"]))
    client.ask(keys.of("set_simulation_state"), client._of_run(state="paused"))
    client.ask(keys.of("step_simulation"), client._of_run(steps=1))
    client.ask(keys.of("set_simulation_state"), client._of_run(state="playing"))
    fleet.end()

    # A line of the table names each use; of puts and tokens it names the sender, too.
    table = list(rows())
    wrong = []
    for how, key, process in sorted(used):
        # A key with a wildcard may stand for keys of any row.
        fitting = [row for row in table if "*" in key or row.fits(key)]
        is_used = any(how in row.means for row in fitting)
        is_named = any(word in row.sender for row in fitting for word in WORDS[process])
        if not is_used or (how in (PUT, TOKEN) and not is_named):
            wrong.append((how, key, process))
    assert wrong == []

    senders = {(key, process) for how, key, process in used if how == PUT}
    assert {("orchard/traffic/velocity", "physics"), ("orchard/bin_01/state", "agents")} <= senders
    assert ("orchard/worker_01/velocity", "client") in senders
    assert (ANSWER, "orchard/bin_01/state", "agents") in used
    assert (TOKEN, "orchard/alive/logger/" + fleet.run, "logger") in used


def test_the_reply_to_layout_has_the_rows_of_each_picker():
    layout = lay_out(Scenario(rows=5, pickers=2))
    bodies = orchard_of("run1", 0, layout).bodies
    picked = {body.name: body.rows for body in bodies if body.rows}
    assert picked == {"picker_01": [1, 2], "picker_02": [3, 4, 5]}


def test_an_exchange_has_the_order_that_keyspace_tells():
    """Where a row ends: `here`, couple, `claim` beside the carrier, and then `yes`."""
    local = Local(SMALL)
    steps: list[tuple[str, str]] = []
    exchanged = 0
    while exchanged < SMALL.rows:
        local.tick()
        # The tick at which these actions and letters were made.
        tick = local.engine.tick - 1
        assert tick < 9000, "the harvest does not go on"
        for name, action in sorted(local.actions.items()):
            # An agent that was not asked in this tick keeps its last action, whose deeds are done.
            if name.startswith("picker") and name in local.answers:
                couples = [deed for deed in action.deeds if isinstance(deed, Couple)]
                steps += [("couple", name)] * len(couples)
        for sender, written in sorted(local.post.written.get(tick, {}).items()):
            steps += list(_words_of(sender, written))
        exchanged = sum(kind == "yes" for kind, _ in steps)
    exchange = r"(here )+(couple )+(here )*claim (here )+yes "
    for picker in ("picker_01", "picker_02"):
        kinds = [kind for kind, name in steps if name == picker]
        in_order = "".join(f"{kind} " for kind in kinds if kind != "no")
        assert re.fullmatch(f"({exchange})+", in_order), kinds
        # Each `here` is answered: by yes, or else by no.
        assert kinds.count("no") == kinds.count("here") - kinds.count("yes"), kinds


def _words_of(sender, written):
    """Return (kind, picker) of the messages of an exchange."""
    for to, body in written.sent:
        if isinstance(body, Here):
            yield "here", to
        if isinstance(body, Claim) and body.beside:
            yield "claim", sender
        if isinstance(body, Yes | No) and sender.startswith("picker"):
            yield type(body).__name__.lower(), sender
