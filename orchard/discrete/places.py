"""Traffic in the discrete-event model: the reservations of the agent `traffic`, asked by letters
that take a tick each way.
"""

from collections import deque
from collections.abc import Callable, Sequence
from math import ceil
from typing import Any

import simpy

from orchard.behaviour.traffic import ReservationTable, grant, note
from orchard.contract.messages import Claim
from orchard.plans.robot import GIVEN_BACK, PATIENCE

MAIL = 0.5  # ticks: letters arrive between two ticks, so that a robot hears them before it acts
# Ticks before a robot acts, it hears answers of traffic: before traffic hears the claims of the
# last tick.
ANSWERS = 0.75


class Claimant:
    """The places of one robot: what is reserved for it, what it wants, and when it claims."""

    def __init__(self, env: simpy.Environment, reservations: "Reservations", name: str) -> None:
        self.env, self.reservations, self.name = env, reservations, name
        self.reserved: list[str] = []
        self.wanted: list[str] = []
        self.beside = ""
        self.claimed = -PATIENCE
        self._answers = deque(
            [(0.0, ReservationTable({name: []}))]
        )  # of traffic: when it is heard, and the table
        self._told = self._claim()  # its last claim
        self._due = -1  # tick at which the next claim is sent
        self._pause: simpy.Event | None = (
            None  # what its robot waits for, unless it gets places before
        )
        reservations.claimants[name] = self

    def has(self, places: list[str]) -> bool:
        return places is not self.wanted and set(places).issubset(self.reserved)

    def want(self, places: list[str], beside: str = "") -> None:
        """Claim places, unless this claim is on its way."""
        if places != self.wanted:
            self.claimed = self._repeated()
            self.wanted, self.beside = places, beside
            self._plan()

    def free(self, places: list[str]) -> None:
        kept = [place for place in self.reserved if place not in places]
        if len(kept) != len(self.reserved):
            self.claimed, self.reserved = self._repeated(), kept
            self._plan()

    def _plan(self) -> None:
        given_back = set(self.seen.reserved[self.name]) != set(self.reserved)
        if not (self.wanted or given_back) or self._told == self._claim():
            return
        due = max(ceil(self.env.now), self.claimed + (GIVEN_BACK if given_back else PATIENCE))
        if self._due < 0 or due < self._due:
            self._due = due
            self.reservations.expect(self, due)

    def claim(self, tick: int) -> Claim | None:
        """Return the claim that the robot has sent at a tick, if any."""
        if tick != self._due:
            return None
        self._due, self.claimed, self._told = -1, tick, self._claim()
        return self._told

    def _claim(self) -> Claim:
        return Claim(keep=self.reserved, want=self.wanted, beside=self.beside)

    def _repeated(self) -> int:
        """The tick of its last claim.

        While it waits it claims the same every PATIENCE ticks. That changes nothing, so it is no
        event.
        """
        now = ceil(self.env.now)
        return now - (now - self.claimed) % PATIENCE if self.wanted else self.claimed

    def ticks_to_answer(self) -> int:
        """The ticks until it hears the next answer, while it waits."""
        return 1 + (max(self.claimed, self._due) + 1 - ceil(self.env.now)) % PATIENCE

    @property
    def seen(self) -> ReservationTable:
        """Traffic's table, as it was when the robot last heard of it."""
        while len(self._answers) > 1 and self._answers[1][0] <= self.env.now:
            self._answers.popleft()
        return self._answers[0][1]

    def is_answered(self, heard: float, table: ReservationTable) -> None:
        """Hear traffic's table at a time, in ticks.

        A robot that is granted nothing goes on as before.
        """
        self._answers.append((heard, table))

    def is_granted(self, places: list[str]) -> None:
        self.claimed, reserved = self._repeated(), self.reservations.table.reserved
        self.is_answered(self.env.now, ReservationTable(dict(reserved)))
        granted = [
            place for place in reserved[self.name] if place in places and place not in self.reserved
        ]
        self.reserved = self.reserved + granted
        if set(self.wanted).issubset(self.reserved):
            self.wanted = []
        self._plan()
        if granted and self._pause is not None and self._pause.callbacks:
            sooner = self.env.timeout(
                ceil(self.env.now) - self.env.now
            )  # what waits for the pause waits for this
            assert sooner.callbacks is not None
            sooner.callbacks.extend(self._pause.callbacks)
            self._pause.callbacks.clear()

    def granted_or(self, event: simpy.Event) -> simpy.Event:
        """Return an event for the robot to wait for: it waits only until the tick after it is
        granted places, if that is before.
        """
        self._pause = event
        return event


class Reservations:
    """The agent `traffic`: claims that are sent in one tick are heard together in the next."""

    def __init__(self, env: simpy.Environment) -> None:
        self.env, self.table = env, ReservationTable()
        self.claimants: dict[str, Claimant] = {}
        self._expected: dict[int, list[Claimant]] = {}  # tick -> those that will claim then

    def expect(self, claimant: Claimant, tick: int) -> None:
        if tick not in self._expected:
            self._expected[tick] = []
            at(self.env, tick + MAIL, self._hear, tick)
        self._expected[tick].append(claimant)

    def _hear(self, tick: int) -> None:
        claims = {
            claimant.name: claim
            for claimant in self._expected.pop(tick)
            if (claim := claimant.claim(tick)) is not None
        }
        for name, claim in claims.items():
            note(self.table, name, claim, tick + 1)
        wanted = {name: wish.places for name, wish in self.table.wishes.items()}
        if wanted:
            grant(self.table)
        table = ReservationTable(dict(self.table.reserved))
        for name in claims:
            self.claimants[name].is_answered(tick + 2 - ANSWERS, table)
        for name in sorted(wanted.keys() - self.table.wishes.keys()):
            next_claim = tick + (self.claimants[name].claimed - tick) % PATIENCE
            at(self.env, next_claim + 2 - ANSWERS, self.claimants[name].is_granted, wanted[name])


def at(env: simpy.Environment, time: float, act: Callable[..., Any], *words: Any) -> None:
    """Let a function run with these arguments at a time, in ticks."""
    env.timeout(time - env.now).callbacks.append(lambda _: act(*words))


def first_of(env: simpy.Environment, events: Sequence[simpy.Event]) -> simpy.Event:
    """Return what happens as soon as one of some events does.

    It does the work of simpy's `any_of`, which also gathers their values.
    """
    first = env.event()

    def happen(_: simpy.Event) -> None:
        if not first.triggered:
            first.succeed()

    for event in events:
        if event.callbacks is None:
            happen(event)
        else:
            event.callbacks.append(happen)
    return first
