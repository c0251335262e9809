"""Foreign clients of a simulated run: each connects, does one thing, and goes.

CLIENTS has them by the name of their fault. None may do harm: what each of them does is allowed to
a client, or is refused.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from random import Random

from chaos.fuzzer import ASKED, NAMES, invalid_message
from orchard.contract.messages import Confirm, pack, unpack
from orchard.field.geometry import Twist
from orchard.net.bus import Bus, Final, Item, Query, Replied, Sample
from orchard.net.endpoints import BusError
from orchard.net.requests import fetch_run
from orchard.wire import messages as wire
from orchard.wire.keys import Keys
from orchard.wire.messages import RunMessage

RUN = "run1"
KEYS = Keys()
ANOTHER_SEED = 5  # the seed of a scenario after a reset
ASK_SECONDS = 3.0  # s that a client waits for replies
PLAY_TRIES = 100  # tries to let a paused run play


@dataclass
class Client:
    """A client with its session."""

    bus: Bus
    random: Random
    seconds: float  # how long it stays
    # ("stopped" or "reset", what physics replied) for each emergency stop and its end.
    stops: list[tuple[str, wire.Stopped]] = field(default_factory=list)
    # How often physics has said that it begins the run again.
    resets: int = 0
    # How often physics has said that it ends the run.
    quits: int = 0
    complaints: list[str] = field(default_factory=list)

    def hear(self, seconds: float) -> Iterator[Item]:
        """Yield what arrives in so many seconds, as it arrives."""
        deadline = self.bus.clock() + seconds
        remaining = seconds
        while remaining > 0.0:
            item = self.bus.inbox.take(remaining)
            if item is not None:
                yield item
            remaining = deadline - self.bus.clock()

    def wait(self, seconds: float) -> list[Item]:
        """Return what has arrived after so many seconds."""
        return list(self.hear(seconds))

    def ask(
        self, what: str, message: RunMessage | None, session: str = "*", name: str = "*"
    ) -> list[bytes]:
        """Send a query, and wait until its replies have come. Return them, without errors.

        `what`: a kind of key. `message`: None for a query without a payload.
        """
        payload = b""
        if message is not None:
            payload = pack(message)
        self.bus.ask(KEYS.of(what, name, session), payload, what, ASK_SECONDS)
        replies: list[bytes] = []
        item = self.bus.inbox.take(ASK_SECONDS)
        while item is not None and not isinstance(item, Final):
            if isinstance(item, Replied) and not item.error:
                replies.append(item.payload)
            item = self.bus.inbox.take(ASK_SECONDS)
        return replies

    def state(
        self, what: str = "simulation_state", message: RunMessage | None = None
    ) -> wire.SimulationState | None:
        """Return the state of the run, as physics replies to a query; None without a reply."""
        for reply in self.ask(what, message):
            with suppress(ValueError):
                return wire.read(reply, wire.SimulationState)
        return None


def claim(client: Client) -> None:
    """Ask for agents that a host has, and leave. It gets them only if the host is just gone."""
    bus = client.bus
    names = client.random.sample(fetch_run(bus, KEYS).agents, 3)
    for name in names:
        bus.declare_alive(KEYS.of("alive", name, bus.id))
    client.ask("join", wire.Join(RUN, bus.id, names), bus.id)
    client.wait(client.seconds)
    for name in names:
        bus.withdraw(KEYS.of("alive", name, bus.id))


def talk_nonsense(client: Client) -> None:
    """Publish and ask what makes no sense, and what other runs and sessions would send."""
    bus = client.bus
    bus.subscribe(f"{KEYS.prefix}/**")
    samples = [item for item in client.wait(client.seconds) if isinstance(item, Sample)]
    for _ in range(30):
        key, payload = invalid_message(client.random, samples, RUN)
        bus.publish(key, payload, newest_wins=True)
    for what in ASKED:
        bus.ask(
            KEYS.of(what, client.random.choice(NAMES), "unknown"),
            client.random.randbytes(20),
            None,
            5.0,
        )
    for key in ("orchard/*", "orchard/**", "**"):
        bus.ask(key, pack(wire.SetSimulationState(RUN, "quitting")), None, 5.0)


def repeat(client: Client) -> None:
    """Publish again what others have published: late, and twice."""
    client.bus.subscribe(f"{KEYS.prefix}/hosts/*/velocities")
    for item in client.wait(client.seconds):
        if isinstance(item, Sample):
            client.bus.publish(item.key, item.payload)


def lie(client: Client) -> None:
    """Drive robots as soon as their owners are asked: as another session, for another run, and for
    ticks of the past and the future.
    """
    bus = client.bus
    bus.subscribe(f"{KEYS.prefix}/hosts/*/seen")
    for item in client.hear(client.seconds):
        if isinstance(item, Sample):
            _lie_about(bus, unpack(item.payload, wire.Seen), item.key.split("/")[-2])


def _lie_about(bus: Bus, seen: wire.Seen, owner: str) -> None:
    """Publish false answers to a tick that the session `owner` is asked."""

    def publish(session: str, run: str = RUN, tick: int = seen.tick, owner: str = owner) -> None:
        """Publish velocities on the key of a session. They name a run, a tick and an owner."""
        velocities = dict.fromkeys(seen.due, wire.Report(Twist(0.1, 0.0, 0.1)))
        bus.publish(
            KEYS.of("velocities", session=session),
            pack(wire.Velocities(run, tick, owner, velocities)),
        )

    publish(bus.id, owner=bus.id)
    publish(bus.id)
    publish(owner, run="another")
    publish(owner, tick=seen.tick + 10**6)
    publish(owner, tick=seen.tick - 1)


def end_it(client: Client) -> None:
    """Say that the run is over, which only physics may say."""
    for _ in range(5):
        client.bus.publish(KEYS.of("end"), pack(wire.End(RUN, 3, True, "harvested", "0" * 64, {})))
        client.wait(client.seconds / 5.0)


def pause(client: Client) -> None:
    """Pause the run, do some steps, and let it play."""
    paused = client.state("set_simulation_state", wire.SetSimulationState(RUN, "paused"))
    if paused is not None and paused.state == "playing":
        client.complaints.append(f"a run that is to pause plays: tick {paused.tick}")
    client.wait(client.seconds)
    steps = _steps_between(paused, client.state())
    # After a reset it is at one of its first ticks.
    if steps is not None and steps > 0:
        client.complaints.append(f"a paused run goes on for {steps} steps")
    for _ in range(client.random.randrange(3)):
        step(client, client.random.randint(1, 5))
    client.wait(client.random.random())
    # A query may be lost while physics is away, and then the run would stay paused.
    for _ in range(PLAY_TRIES):
        if client.ask("set_simulation_state", wire.SetSimulationState(RUN, "playing")):
            return
        client.wait(0.2)


def _steps_between(
    before: wire.SimulationState | None, after: wire.SimulationState | None
) -> int | None:
    """Return the steps between two states of a run; None if it was not paused at both."""
    if before is None or after is None:
        return None
    if before.state != "paused" or after.state != "paused":
        return None
    return after.tick - before.tick


def step(client: Client, steps: int) -> None:
    """Do some steps of a paused run. Complain if there were more, or fewer.

    After a reset the run is at one of its first ticks.
    """
    before = client.state()
    after = client.state("step_simulation", wire.StepSimulation(RUN, steps))
    done = _steps_between(before, after)
    if before is None or done is None:
        return
    # If a reset came in between, the tick is a small one, or less than before.
    is_same_run = before.tick > steps and done >= 0
    if done > steps or (is_same_run and done < steps):
        client.complaints.append(f"{done} steps are done, and not {steps}")


def survey(client: Client) -> None:
    """Ask for all that can be asked for."""
    for what in ("layout", "scenario", "simulation_state", "state"):
        client.ask(what, None)
        client.wait(client.seconds / 4.0)


def write_late(client: Client) -> None:
    """Send agents letters that none has written: of ticks that are long over, or of no agent."""
    run = fetch_run(client.bus, KEYS)
    for _ in range(10):
        sender = client.random.choice([*run.agents, "nobody"])
        tick = client.random.choice((0, max(0, run.tick - 100), run.tick + 10**6))
        letter = wire.Letter(RUN, tick, sender, 0, Confirm())
        client.ask("mail", letter, name=client.random.choice(run.agents))
        client.wait(client.seconds / 10.0)


def listen(client: Client) -> None:
    """Hear all that is published."""
    client.bus.subscribe(f"{KEYS.prefix}/**")
    client.wait(client.seconds)


def stay_mute(client: Client) -> None:
    """Receive all queries, and answer none."""
    client.bus.answer(f"{KEYS.prefix}/**")
    client.wait(client.seconds)


def answer_falsely(client: Client) -> None:
    """Answer the questions of hosts before physics does: with nonsense, with errors, and for
    another run.
    """
    for what in ("scenario", "join", "recall"):
        client.bus.answer(KEYS.of(what))
    for item in client.hear(client.seconds):
        if isinstance(item, Query):
            what = KEYS.parts(item.key)[-1]
            kind = client.random.choice(("nonsense", "error", "another run"))
            if kind == "error":
                item.refuse("no")
            else:
                item.reply(_false_answer(client.random, what, kind))
                item.drop()


def _false_answer(random: Random, what: str, kind: str) -> bytes:
    """Return a reply that is no message, or one of another run. `what`: the kind of the query."""
    if kind == "nonsense" or what == "scenario":
        return random.randbytes(random.randrange(30))
    if what == "join":
        return pack(wire.Joined("another", random.randrange(1000), {}, {}))
    return pack(wire.Recalled("another", random.randrange(1000), []))


def flap(client: Client) -> None:
    """Declare that physics is there, and withdraw that, again and again."""
    bus = client.bus
    token = KEYS.of("physics", RUN, bus.id)
    for _ in range(5):
        bus.declare_alive(token)
        client.wait(client.seconds / 10.0)
        bus.withdraw(token)
        client.wait(client.seconds / 10.0)


def stop_robots(client: Client) -> None:
    """Stop all robots in an emergency, and reset them."""
    for what in ("stopped", "reset"):
        for reply in client.ask("stop", wire.Stop(RUN, what == "stopped", [])):
            with suppress(ValueError):
                client.stops.append((what, wire.read(reply, wire.Stopped)))
        client.wait(client.seconds)


def advise(client: Client) -> None:
    """Drive a robot whose agent goes on."""
    for _ in range(20):
        tick = fetch_run(client.bus, KEYS).tick
        advice = wire.Advice(
            RUN, tick, wire.Linear(client.random.uniform(-0.5, 1.0)), wire.Angular(0.0)
        )
        client.bus.publish(
            KEYS.of("advice", client.random.choice(["picker_01", "carrier_01", "tractor_01"])),
            pack(advice),
        )
        client.wait(client.seconds / 20.0)


def reset(client: Client) -> None:
    """Let the run begin again, as before or with another seed."""
    seed = client.random.choice((None, ANOTHER_SEED))
    client.resets += len(client.ask("reset_simulation", wire.ResetSimulation(RUN, seed)))


def quit_run(client: Client) -> None:
    """End the run."""
    quitting = wire.SetSimulationState(RUN, "quitting")
    client.quits += len(client.ask("set_simulation_state", quitting))


CLIENTS: dict[str, Callable[[Client], None]] = {
    "claim": claim,
    "nonsense": talk_nonsense,
    "repeat": repeat,
    "lie": lie,
    "false end": end_it,
    "pause": pause,
    "listen": listen,
    "survey": survey,
    "late letters": write_late,
    "mute": stay_mute,
    "false answers": answer_falsely,
    "flap": flap,
    "stop robots": stop_robots,
    "advise": advise,
    "reset": reset,
    "quit": quit_run,
}
# Clients after which the hash is another one than that of local mode.
CHANGES_THE_HASH = ("advise",)


def let_act(what: str, client: Client) -> None:
    """Let a client do what its name says. It ends if it finds no run."""
    with suppress(BusError):
        CLIENTS[what](client)
