"""Invariants of a run, which hold with any agents: bins, metres, calls and bodies are accounted for. Each violation is a sentence.

After each tick: metres, rows, calls, stopped robots, and the places of the bins if one was coupled or uncoupled. Once a simulated second
and at the end: the places of the bins, and that nothing overlaps. At the end of a finished harvest: that each call ended in an exchange.
"""

from collections.abc import Iterator
from operator import mul
from typing import Any

import msgspec

from orchard.contract.events import Event
from orchard.field.kinds import kind_of
from orchard.field.passes import FULL_WITHIN
from orchard.field.scenario import TIME_STEP
from orchard.sim.kernels.move import overlaps
from orchard.sim.world import NONE, World

LOOK_TICKS = round(1.0 / TIME_STEP)  # between two checks of the places of all bodies
MOST = 50  # violations that are listed


class Known(msgspec.Struct):
    """The facts that the checker keeps from earlier ticks, as plain data. A snapshot holds them, and a restored run starts with them."""

    delivered: int  # number of unloaded bins
    rows: list[str]  # rows that are picked
    calls: dict[str, str]  # full bin -> the carrier that took it, '' before
    lacking: dict[str, str]  # picker -> its full bin, until it has an empty one
    told: dict[str, str] = {}  # invariant and body -> the sentence on its first violation


class Invariants:
    """Checks the invariants of one run, from any tick on."""

    def __init__(self, world: World, data: dict[str, Any] | None = None) -> None:
        """`data`: `known` as plain data; without it, the earlier ticks are inferred from the world. Raises ValueError for wrong data."""
        self.known = _known_of(world) if data is None else msgspec.convert(data, Known)
        self._rows = world.row_ends.tolist()
        self._coupled: list[int] = []
        self._shares = world.fixed.row_share.tolist()
        self._tolerance = (
            2.0 * FULL_WITHIN * (len(self._rows) + len(world.layout.names))
        )  # m: full rows and bins are rounded up
        self._tolerance *= max(self._shares)

    @property
    def violations(self) -> list[str]:
        """All violations so far, in the order of their discovery; at most MOST, and the number of further ones."""
        told = list(self.known.told.values())
        return told if len(told) <= MOST else [*told[:MOST], f"and {len(told) - MOST} more"]

    def update(self, world: World, events: list[Event]) -> None:
        """Check the tick that has just ended, and its events."""
        tick = world.tick
        for event in events:
            self._record(tick, self._check_event(event))
        self._record(tick, self._check_metres(world))
        coupled, stopped = world.coupled.tolist(), world.stopped.tolist()
        if True in stopped:
            self._record(tick, _moving_though_stopped(world))
        if tick % LOOK_TICKS == 0:
            self._check_places(world)
        elif coupled != self._coupled:
            self._record(tick, _misplaced_bins(world))
        self._coupled = coupled

    def end(self, world: World, finished: bool) -> list[str]:
        """Check the end of the run, and return all its violations. `finished`: whether the harvest is over, so that no call is open."""
        self._check_places(world)
        if finished:
            self._record(world.tick, self._open_calls())
        return self.violations

    def _check_places(self, world: World) -> None:
        self._record(world.tick, _misplaced_bins(world))
        self._record(world.tick, overlapping_bodies(world))

    def _record(self, tick: int, found: Iterator[tuple[str, str]]) -> None:
        """Record violations, (invariant and body, sentence), the first time only: most violations last for many ticks."""
        for what, sentence in found:
            self.known.told.setdefault(what, f"tick {tick}: {sentence}")

    # -- each row is picked once, and the picked metres are in bins or delivered

    def _check_metres(self, world: World) -> Iterator[tuple[str, str]]:
        rows, fills, length = world.row_ends.tolist(), world.fill.tolist(), world.fixed.bin_full
        if rows != self._rows:
            yield from _row_faults(self._rows, rows, world.fixed.row_length.tolist())
            self._rows = rows
        if min(fills) < 0.0 or max(fills) > length:
            wrong = [
                (name, fill)
                for name, fill in zip(world.layout.names, fills, strict=True)
                if not 0.0 <= fill <= length
            ]
            yield from (
                (f"fill {name}", f"{name} holds {fill:g} m; a bin holds 0 to {length:g} m")
                for name, fill in wrong
            )
        picked, kept = (
            sum(map(mul, world.row_picked.tolist(), self._shares)),
            sum(fills) + world.delivered_metres,
        )
        if abs(picked - kept) > self._tolerance:
            yield "metres", f"{picked:.3f} m are picked, but {kept:.3f} m are in bins or delivered"
        if world.delivered != self.known.delivered:
            yield (
                "delivered",
                f"{world.delivered} bins count as delivered, but {self.known.delivered} were unloaded",
            )

    # -- each call ends in one exchange

    def _check_event(self, event: Event) -> Iterator[tuple[str, str]]:
        body, other, known = event.who, event.whom, self.known
        match event.what:
            case "row picked":
                if event.detail in known.rows:
                    yield (
                        f"picked {event.detail}",
                        f"{event.detail} was picked a second time, by {body}",
                    )
                known.rows.append(event.detail)
            case "bin full":
                if body in known.calls:
                    yield (
                        f"call {body}",
                        f"{body} is full again, but was not unloaded since it was last full",
                    )
                known.calls[body], known.lacking[other] = "", body
            case "coupled" if other in known.calls and kind_of(body) == "carrier":
                if known.calls[other]:
                    yield (
                        f"call {other}",
                        f"{other} was taken twice for one call: by {known.calls[other]}, and then by {body}",
                    )
                known.calls[other] = body
            case "coupled" if known.lacking.get(body, other) != other:
                del known.lacking[body]
            case "unloaded":
                carrier, known.delivered = known.calls.pop(body, None), known.delivered + 1
                if carrier != other:
                    taken = (
                        "it had not been full"
                        if carrier is None
                        else f"{carrier or 'no carrier'} had taken it"
                    )
                    yield f"call {body}", f"{body} was unloaded on {other}, but {taken}"

    def _open_calls(self) -> Iterator[tuple[str, str]]:
        for bin_ in self.known.calls:
            yield (
                f"call {bin_}",
                f"the harvest is over, but {bin_}'s call did not end in an exchange",
            )
        for picker, bin_ in self.known.lacking.items():
            yield f"call {bin_}", f"the harvest is over, but {picker} got no empty bin for {bin_}"


def _known_of(world: World) -> Known:
    names, full = world.layout.names, world.full.nonzero()[0].tolist()
    others = {i: "" if world.coupled[i] == NONE else names[int(world.coupled[i])] for i in full}
    calls = {names[i]: other if kind_of(other) == "carrier" else "" for i, other in others.items()}
    lacking = {other: names[i] for i, other in others.items() if kind_of(other) == "picker"}
    return Known(
        world.delivered,
        [f"row {r + 1}" for r in world.rows_done.nonzero()[0].tolist()],
        calls,
        lacking,
    )


def _row_faults(
    before: list[list[float]], rows: list[list[float]], lengths: list[float]
) -> Iterator[tuple[str, str]]:
    """`before`, `rows`: what is picked of each row from its west end, and from its east end, m, and up to where inside."""
    for r, (old, new, length) in enumerate(zip(before, rows, lengths, strict=True)):
        if not (old[0] <= new[0] and old[1] <= new[1] and sum(new[:2]) <= length + FULL_WITHIN):
            was, now = sum(old[:2]), sum(new[:2])
            yield (
                f"row {r + 1}",
                f"row {r + 1} was picked for {was:g} m, and now for {now:g} m; this may only grow, to {length:g} m",
            )


# -- bins = at pickers + on carriers + standing + unloading


def _misplaced_bins(world: World) -> Iterator[tuple[str, str]]:
    names, coupled, bay = world.layout.names, world.coupled.tolist(), world.bay_ticks.tolist()
    on: dict[int, list[str]] = {i: [] for i, name in enumerate(names) if kind_of(name) == "bin"}
    for i, j in enumerate(coupled):
        if i not in on and j != NONE:
            if j not in on or kind_of(names[i]) not in ("picker", "carrier"):
                yield (
                    f"bar {names[i]}",
                    f"{names[i]} is coupled to {_name(names, j)}; a coupling needs a picker or carrier and a bin",
                )
            else:
                on[j].append(names[i])
    for bin_, robots in on.items():
        own = coupled[bin_]
        if robots != ([] if own == NONE else [_name(names, own)]):
            itself, theirs = (
                "by itself" if own == NONE else f"on {_name(names, own)}",
                " and ".join(robots) or "no robot",
            )
            yield (
                f"place {names[bin_]}",
                f"{names[bin_]} is not at one place: it is {itself}, and coupled to {theirs}",
            )
        elif bay[bin_] and (own == NONE or kind_of(names[own]) != "carrier"):
            yield f"place {names[bin_]}", f"{names[bin_]} is being unloaded, but is on no carrier"


def _name(names: tuple[str, ...], i: int) -> str:
    return names[i] if 0 <= i < len(names) else f"number {i}"


# -- bodies


def overlapping_bodies(world: World) -> Iterator[tuple[str, str]]:
    """Yield ("inside BODY OTHER", sentence) for each solid body that overlaps another one, or a fence, trunk or post."""
    fixed, names = world.fixed, world.layout.names
    walls = fixed.walls, fixed.wall_frame, fixed.wall_begin, fixed.wall_members
    for i, k in overlaps(world.pose, fixed.shapes, fixed.solid, *walls).tolist():
        other, (x, y, _) = (
            names[k] if k < len(names) else "a fence, trunk or post",
            world.pose[i].tolist(),
        )
        yield f"inside {names[i]} {other}", f"{names[i]} overlaps {other}, at ({x:.2f}, {y:.2f})"


def _moving_though_stopped(world: World) -> Iterator[tuple[str, str]]:
    names = world.layout.names
    for i in world.stopped.nonzero()[0].tolist():
        other = int(world.coupled[i])
        if world.twist[i].any():
            yield f"stopped {names[i]}", f"{names[i]} moves, but is stopped"
        if other != NONE and not world.stopped[other]:
            yield (
                f"stopped by half {names[i]}",
                f"{names[i]} is stopped, but {names[other]}, which is coupled to it, is not",
            )
