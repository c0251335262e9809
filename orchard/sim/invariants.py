"""What must be so at every tick, whoever drives: bins, metres, calls and bodies are accounted for. Each violation is a sentence.

Looked at after every tick: metres and rows, calls, stopped robots, and where the bins are whenever one was coupled or uncoupled.
Looked at once a simulated second and at the end: where the bins are, and that nobody stands in anybody or in a tree. At the end of a
finished harvest: that every call ended in its exchange. That each robot's states add up to the run is `states.StateTimes.faults`.
"""

from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np

from orchard.contract.events import Event
from orchard.field.kinds import kind_of
from orchard.field.layout import ROW_LENGTH
from orchard.field.scenario import TIME_STEP
from orchard.sim.kernels.move import FULL_WITHIN
from orchard.sim.kernels.watch import who_stands_in_whom
from orchard.sim.world import NOBODY, World

LOOK_TICKS = round(1.0 / TIME_STEP)  # from one look at everybody's place to the next
MOST = 50  # violations that are told one by one


class Known(msgspec.Struct):
    """What the checker remembers of the ticks before, as plain data: a snapshot holds it, and a run that goes on begins with it."""

    delivered: int  # bins that were unloaded
    rows: list[str]  # those whose picking has ended
    calls: dict[str, str]  # full bin -> the carrier that has taken it; '' before
    lacking: dict[str, str]  # picker -> the full bin for which it wants an empty one
    told: dict[str, str] = {}  # what is violated, of whom -> the first time it was, in a sentence


class Invariants:
    """The invariants of one run, from any tick on."""

    def __init__(self, world: World, data: dict[str, Any] | None = None) -> None:
        """With the data of another, it goes on from there; raises ValueError where they are none. Else it knows what the world tells."""
        self.known = _known_of(world) if data is None else msgspec.convert(data, Known)
        self._rows = world.row_picked.tolist()
        self._coupled: list[int] = []
        self._tolerance = 2.0 * FULL_WITHIN * (len(self._rows) + len(world.layout.names))  # of rows and bins that are full within it

    def as_data(self) -> dict[str, Any]:
        """All that it must remember, plain: for a snapshot."""
        data: dict[str, Any] = msgspec.to_builtins(self.known)
        return data

    @property
    def violations(self) -> list[str]:
        """All so far, in the order in which they were found."""
        told = list(self.known.told.values())
        return told if len(told) <= MOST else [*told[:MOST], f"and {len(told) - MOST} more"]

    def update(self, world: World, events: list[Event]) -> None:
        """Look at the tick that has just ended, and at what happened in it."""
        tick = world.tick
        for event in events:
            self._tell(tick, self._heard(event))
        self._tell(tick, self._metres(world))
        coupled, stopped = world.coupled.tolist(), world.stopped.tolist()
        if True in stopped:
            self._tell(tick, _moving_though_stopped(world))
        if tick % LOOK_TICKS == 0:
            self._look(world)
        elif coupled != self._coupled:
            self._tell(tick, _misplaced_bins(world))
        self._coupled = coupled

    def end(self, world: World, finished: bool) -> list[str]:
        """All violations of the run, now that it is over; in a finished harvest every call has ended."""
        self._look(world)
        if finished:
            self._tell(world.tick, self._open_calls())
        return self.violations

    def _look(self, world: World) -> None:
        self._tell(world.tick, _misplaced_bins(world))
        self._tell(world.tick, _standing_in_others(world))

    def _tell(self, tick: int, found: Iterator[tuple[str, str]]) -> None:
        """Keep what was found, (what of whom, a sentence), the first time only: most things that are wrong stay so."""
        for what, sentence in found:
            self.known.told.setdefault(what, f"tick {tick}: {sentence}")

    # -- rows are picked once, and metres are in rows, bins and deliveries

    def _metres(self, world: World) -> Iterator[tuple[str, str]]:
        rows, fills = world.row_picked.tolist(), world.fill.tolist()
        if rows != self._rows:
            yield from _rows_amiss(self._rows, rows)
            self._rows = rows
        if min(fills) < 0.0 or max(fills) > ROW_LENGTH:
            wrong = [(name, fill) for name, fill in zip(world.layout.names, fills, strict=True) if not 0.0 <= fill <= ROW_LENGTH]
            yield from ((f"fill {name}", f"{name} holds {fill:g} m; a bin holds 0 to {ROW_LENGTH:g} m") for name, fill in wrong)
        picked, kept = sum(rows), sum(fills) + world.delivered * ROW_LENGTH
        if abs(picked - kept) > self._tolerance:
            yield "metres", f"{picked:.3f} m are picked, but {kept:.3f} m are in bins or delivered"
        if world.delivered != self.known.delivered:
            yield "delivered", f"{world.delivered} bins count as delivered, but {self.known.delivered} were unloaded"

    # -- every call ends in one exchange

    def _heard(self, event: Event) -> Iterator[tuple[str, str]]:
        """A full bin is taken by one carrier and unloaded by it, and its picker takes an empty one."""
        who, whom, known = event.who, event.whom, self.known
        match event.what:
            case "row picked":
                if event.detail in known.rows:
                    yield f"picked {event.detail}", f"{event.detail} was picked a second time, by {who}"
                known.rows.append(event.detail)
            case "bin full":
                if who in known.calls:
                    yield f"call {who}", f"{who} is full again, but was not unloaded since it was full last"
                known.calls[who], known.lacking[whom] = "", who
            case "coupled" if whom in known.calls and kind_of(who) == "carrier":
                if known.calls[whom]:
                    yield f"call {whom}", f"{whom} was taken twice for one call: by {known.calls[whom]}, and then by {who}"
                known.calls[whom] = who
            case "coupled" if known.lacking.get(who, whom) != whom:
                del known.lacking[who]
            case "unloaded":
                carrier, known.delivered = known.calls.pop(who, None), known.delivered + 1
                if carrier != whom:
                    yield f"call {who}", f"{who} was unloaded on {whom}, but {_taken(carrier)}"

    def _open_calls(self) -> Iterator[tuple[str, str]]:
        for bin_ in self.known.calls:
            yield f"call {bin_}", f"the harvest is over, but {bin_}'s call did not end in an exchange"
        for picker, bin_ in self.known.lacking.items():
            yield f"call {bin_}", f"the harvest is over, but {picker} got no empty bin for {bin_}"


def _known_of(world: World) -> Known:
    """What can be known of the ticks before a tick by the world alone."""
    names, full = world.layout.names, (world.fill >= ROW_LENGTH).nonzero()[0].tolist()
    others = {i: "" if world.coupled[i] == NOBODY else names[int(world.coupled[i])] for i in full}
    calls = {names[i]: other if kind_of(other) == "carrier" else "" for i, other in others.items()}
    lacking = {other: names[i] for i, other in others.items() if kind_of(other) == "picker"}
    return Known(world.delivered, [f"row {r + 1}" for r in (world.row_picked >= ROW_LENGTH).nonzero()[0].tolist()], calls, lacking)


def _taken(carrier: str | None) -> str:
    if carrier is None:
        return "it had not been full"
    return f"{carrier} had taken it" if carrier else "no carrier had taken it"


def _rows_amiss(before: list[float], rows: list[float]) -> Iterator[tuple[str, str]]:
    for r, (old, new) in enumerate(zip(before, rows, strict=True)):
        if not old <= new <= ROW_LENGTH:
            yield f"row {r + 1}", f"row {r + 1} was picked for {old:g} m, and now for {new:g} m; it only grows, to {ROW_LENGTH:g} m"


# -- bins = at pickers + on carriers + standing + unloading


def _misplaced_bins(world: World) -> Iterator[tuple[str, str]]:
    """Bins that are not at exactly one place: standing by themselves, or on the one robot that has them, unloading or not."""
    names, coupled, bay = world.layout.names, world.coupled.tolist(), world.bay_ticks.tolist()
    on: dict[int, list[str]] = {i: [] for i, name in enumerate(names) if kind_of(name) == "bin"}
    for i, j in enumerate(coupled):
        if i not in on and j != NOBODY:
            if j not in on or kind_of(names[i]) not in ("picker", "carrier"):
                yield f"bar {names[i]}", f"{names[i]} is coupled to {_name(names, j)}, which is no bin of a picker's or a carrier's"
            else:
                on[j].append(names[i])
    for bin_, robots in on.items():
        own = coupled[bin_]
        if robots != ([] if own == NOBODY else [_name(names, own)]):
            itself, theirs = "by itself" if own == NOBODY else f"on {_name(names, own)}", " and ".join(robots) or "nobody"
            yield f"place {names[bin_]}", f"{names[bin_]} is not at one place: it is {itself}, and coupled to {theirs}"
        elif bay[bin_] and (own == NOBODY or kind_of(names[own]) != "carrier"):
            yield f"place {names[bin_]}", f"{names[bin_]} is being unloaded, but on no carrier"


def _name(names: tuple[str, ...], i: int) -> str:
    return names[i] if 0 <= i < len(names) else f"number {i}"


# -- bodies


def _standing_in_others(world: World) -> Iterator[tuple[str, str]]:
    bodies, names = world.bodies, world.layout.names
    for i, k in who_stands_in_whom(world.pose, bodies.boxes, bodies.solid, world.walls, *world.wall_grid).tolist():
        other = names[k] if k < len(names) else "a fence, trunk or post"
        yield f"inside {names[i]} {other}", f"{names[i]} stands in {other}, at {_place(world.pose[i])}"


def _place(pose: np.ndarray) -> str:
    x, y, _ = pose.tolist()
    return f"({x:.2f}, {y:.2f})"


def _moving_though_stopped(world: World) -> Iterator[tuple[str, str]]:
    names = world.layout.names
    for i in world.stopped.nonzero()[0].tolist():
        other = int(world.coupled[i])
        if world.twist[i].any():
            yield f"stopped {names[i]}", f"{names[i]} moves, but is stopped"
        if other != NOBODY and not world.stopped[other]:
            yield f"stopped by half {names[i]}", f"{names[i]} is stopped, but {names[other]}, which is coupled to it, is not"
