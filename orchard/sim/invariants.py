"""Invariants of a run, which hold with any agents: bins, metres, calls and bodies add up.

`orchard.sim.engine` has them checked, and a run with a violation fails. A "call" begins when a bin
is full, and ends when a carrier has unloaded it; it "ends in an exchange" if its picker got an
empty bin for it. Each violation is a sentence. What is checked when:

    after each tick                      | metres, rows, calls, stopped robots; the places of bins
                                         | if one was coupled or uncoupled
    each simulated second and at the end | the places of bins, and that nothing overlaps
    at the end of a finished harvest     | that each call ended in an exchange
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

# Ticks between two checks of the places of all bodies.
LOOK_TICKS = round(1.0 / TIME_STEP)
# Violations that are listed.
MOST = 50

# A violation: the invariant with its body, and a sentence.
Violation = tuple[str, str]


class Known(msgspec.Struct):
    """The facts that the checker keeps from earlier ticks, as plain data.

    A snapshot holds them, and a restored run starts with them.
    """

    # Number of unloaded bins.
    delivered: int
    # Rows that are picked.
    rows: list[str]
    # Full bin that is not unloaded -> the carrier that took it; '' while none has.
    calls: dict[str, str]
    # Picker -> its full bin, until it has an empty one.
    lacking: dict[str, str]
    # Invariant with its body -> the sentence on its first violation: what was told to the user.
    told: dict[str, str] = {}


class Invariants:
    """Checks the invariants of one run, from any tick on."""

    def __init__(self, world: World, data: dict[str, Any] | None = None) -> None:
        """Begin with what is known of earlier ticks.

        `data`: `known` as plain data; without it, the earlier ticks are inferred from the world.
        Raises ValueError for wrong data.
        """
        if data is None:
            self.known = _known_of(world)
        else:
            self.known = msgspec.convert(data, Known)
        # As `World.row_ends` and `World.coupled` were after the tick before. Couplings are empty
        # before the first check, so that this one looks at all of them.
        self._rows = world.row_ends.tolist()
        self._coupled: list[int] = []
        # m in a bin for each metre of a row.
        self._shares = world.fixed.row_share.tolist()
        # m by which the picked metres may differ from those in bins. Physics rounds each full row
        # and each full bin up by at most FULL_WITHIN; twice that is allowed.
        rounded = len(self._rows) + len(world.layout.names)
        self._tolerance = 2.0 * FULL_WITHIN * rounded * max(self._shares)

    @property
    def violations(self) -> list[str]:
        """All violations so far, in the order of their discovery.

        They are at most MOST, and the number of further ones.
        """
        sentences = list(self.known.told.values())
        if len(sentences) <= MOST:
            return sentences
        return [*sentences[:MOST], f"and {len(sentences) - MOST} more"]

    def update(self, world: World, events: list[Event]) -> None:
        """Check the tick that has just ended, and its events."""
        tick = world.tick
        for event in events:
            self._record(tick, self._check_event(event))
        self._record(tick, self._check_metres(world))
        coupled = world.coupled.tolist()
        if True in world.stopped.tolist():
            self._record(tick, _moving_though_stopped(world))
        if tick % LOOK_TICKS == 0:
            self._check_places(world)
        elif coupled != self._coupled:
            self._record(tick, _misplaced_bins(world))
        self._coupled = coupled

    def end(self, world: World, finished: bool) -> list[str]:
        """Check the end of the run, and return all its violations.

        `finished`: whether the harvest is over, so that no call is open.
        """
        self._check_places(world)
        if finished:
            self._record(world.tick, self._open_calls())
        return self.violations

    def _check_places(self, world: World) -> None:
        self._record(world.tick, _misplaced_bins(world))
        self._record(world.tick, overlapping_bodies(world))

    def _record(self, tick: int, violations: Iterator[Violation]) -> None:
        """Record violations, the first time only: most violations last for many ticks."""
        for invariant, sentence in violations:
            self.known.told.setdefault(invariant, f"tick {tick}: {sentence}")

    # -- each row is picked once, and the picked metres are in bins or delivered

    def _check_metres(self, world: World) -> Iterator[Violation]:
        rows = world.row_ends.tolist()
        fills = world.fill.tolist()
        if rows != self._rows:
            yield from _row_faults(self._rows, rows, world.fixed.row_length.tolist())
            self._rows = rows
        yield from _fill_faults(world, fills)
        shares = map(mul, world.row_picked.tolist(), self._shares)
        picked = sum(shares)
        kept = sum(fills) + world.delivered_metres
        if abs(picked - kept) > self._tolerance:
            yield "metres", f"{picked:.3f} m are picked, but {kept:.3f} m are in bins or delivered"
        unloaded = self.known.delivered
        if world.delivered != unloaded:
            counted = f"{world.delivered} bins count as delivered"
            yield "delivered", f"{counted}, but {unloaded} were unloaded"

    # -- each call ends in one exchange

    def _check_event(self, event: Event) -> Iterator[Violation]:
        known = self.known
        match event.what:
            case "row picked":
                yield from self._note_picked_row(event.detail, event.who)
            case "bin full":
                yield from self._note_full_bin(event.who, event.whom)
            case "coupled" if event.whom in known.calls and kind_of(event.who) == "carrier":
                yield from self._note_taken_bin(event.whom, event.who)
            # A picker that lacks an empty bin has coupled another bin than its full one.
            case "coupled" if event.who in known.lacking:
                if known.lacking[event.who] != event.whom:
                    del known.lacking[event.who]
            case "unloaded":
                yield from self._note_unloaded_bin(event.who, event.whom)

    def _note_picked_row(self, row: str, picker: str) -> Iterator[Violation]:
        if row in self.known.rows:
            yield f"picked {row}", f"{row} was picked a second time, by {picker}"
        self.known.rows.append(row)

    def _note_full_bin(self, bin_: str, picker: str) -> Iterator[Violation]:
        if bin_ in self.known.calls:
            fault = "is full again, but was not unloaded since it was last full"
            yield f"call {bin_}", f"{bin_} {fault}"
        self.known.calls[bin_] = ""
        self.known.lacking[picker] = bin_

    def _note_taken_bin(self, bin_: str, carrier: str) -> Iterator[Violation]:
        before = self.known.calls[bin_]
        if before:
            takers = f"by {before}, and then by {carrier}"
            yield f"call {bin_}", f"{bin_} was taken twice for one call: {takers}"
        self.known.calls[bin_] = carrier

    def _note_unloaded_bin(self, bin_: str, carrier: str) -> Iterator[Violation]:
        taker = self.known.calls.pop(bin_, None)
        self.known.delivered += 1
        if taker == carrier:
            return
        if taker is None:
            fault = "it had not been full"
        else:
            fault = f"{taker or 'no carrier'} had taken it"
        yield f"call {bin_}", f"{bin_} was unloaded on {carrier}, but {fault}"

    def _open_calls(self) -> Iterator[Violation]:
        over = "the harvest is over, but"
        for bin_ in self.known.calls:
            yield f"call {bin_}", f"{over} {bin_}'s call did not end in an exchange"
        for picker, bin_ in self.known.lacking.items():
            yield f"call {bin_}", f"{over} {picker} got no empty bin for {bin_}"


def _known_of(world: World) -> Known:
    """Return what is known of a world of which no earlier tick was seen."""
    names = world.layout.names
    calls = {}
    lacking = {}
    for body in world.full.nonzero()[0].tolist():
        bin_ = names[body]
        robot = ""
        if world.coupled[body] != NONE:
            robot = names[int(world.coupled[body])]
        calls[bin_] = ""
        if kind_of(robot) == "carrier":
            calls[bin_] = robot
        elif kind_of(robot) == "picker":
            lacking[robot] = bin_
    rows = [f"row {row + 1}" for row in world.rows_done.nonzero()[0].tolist()]
    return Known(world.delivered, rows, calls, lacking)


def _row_faults(
    before: list[list[float]], rows: list[list[float]], lengths: list[float]
) -> Iterator[Violation]:
    """Yield a violation for each row of which less is picked than before, or more than there is.

    `before`, `rows`: the lines of `World.row_ends`, m: what is picked of each row from its west
    end, and from its east end, and two numbers of a part inside. `lengths`: of the rows, m.
    """
    pairs = zip(before, rows, lengths, strict=True)
    for number, (old, new, length) in enumerate(pairs, start=1):
        # From the west end and from the east end together.
        was = old[0] + old[1]
        now = new[0] + new[1]
        has_grown = old[0] <= new[0] and old[1] <= new[1]
        if not (has_grown and now <= length + FULL_WITHIN):
            change = f"was picked for {was:g} m, and now for {now:g} m"
            yield f"row {number}", f"row {number} {change}; this may only grow, to {length:g} m"


def _fill_faults(world: World, fills: list[float]) -> Iterator[Violation]:
    """Yield a violation for each bin that holds less than nothing, or more than it can."""
    most = world.fixed.bin_full
    if min(fills) >= 0.0 and max(fills) <= most:
        return
    for name, fill in zip(world.layout.names, fills, strict=True):
        if not 0.0 <= fill <= most:
            yield f"fill {name}", f"{name} holds {fill:g} m; a bin holds 0 to {most:g} m"


# -- bins = at pickers + on carriers + standing + unloading


def _misplaced_bins(world: World) -> Iterator[Violation]:
    """Yield a violation for each wrong coupling, and each bin that is at no place, or at two."""
    names = world.layout.names
    coupled = world.coupled.tolist()
    bay_ticks = world.bay_ticks.tolist()
    robots_at = _robots_at_bins(world)
    for body, partner in enumerate(coupled):
        is_bin = body in robots_at
        if is_bin or partner == NONE:
            continue
        if names[body] not in robots_at.get(partner, []):
            yield _wrong_coupling(names[body], _name(names, partner))
    for bin_, robots in robots_at.items():
        robot = ""
        if coupled[bin_] != NONE:
            robot = _name(names, coupled[bin_])
        fault = _place_fault(robot, robots, is_unloading=bay_ticks[bin_] > 0)
        if fault:
            yield f"place {names[bin_]}", f"{names[bin_]} {fault}"


def _robots_at_bins(world: World) -> dict[int, list[str]]:
    """Return the names of the pickers and carriers that are coupled to each bin."""
    robots_at: dict[int, list[str]] = {}
    for body, name in enumerate(world.layout.names):
        if kind_of(name) == "bin":
            robots_at[body] = []
    for name, partner in zip(world.layout.names, world.coupled.tolist(), strict=True):
        if partner in robots_at and kind_of(name) in ("picker", "carrier"):
            robots_at[partner].append(name)
    return robots_at


def _wrong_coupling(name: str, partner: str) -> Violation:
    """Return the violation of a body that is coupled to what it cannot be coupled to."""
    wanted = "a coupling needs a picker or carrier and a bin"
    return f"bar {name}", f"{name} is coupled to {partner}; {wanted}"


def _place_fault(robot: str, robots: list[str], is_unloading: bool) -> str:
    """Return what is wrong with the place of a bin; '' if nothing is.

    `robot`: to which the bin is coupled, '' for none. `robots`: those that are coupled to the bin.
    """
    if robot:
        expected = [robot]
        itself = f"on {robot}"
    else:
        expected = []
        itself = "by itself"
    if robots != expected:
        theirs = " and ".join(robots) or "no robot"
        return f"is not at one place: it is {itself}, and coupled to {theirs}"
    if is_unloading and kind_of(robot) != "carrier":
        return "is being unloaded, but is on no carrier"
    return ""


def _name(names: tuple[str, ...], body: int) -> str:
    """Return the name of a body; its number if there is no such body."""
    if 0 <= body < len(names):
        return names[body]
    return f"number {body}"


# -- bodies


def overlapping_bodies(world: World) -> Iterator[Violation]:
    """Yield ("inside BODY OTHER", sentence) for each solid body that overlaps something solid.

    That is another body, or a fence, trunk or post.
    """
    fixed = world.fixed
    names = world.layout.names
    walls = fixed.walls, fixed.wall_frame, fixed.wall_begin, fixed.wall_members
    for body, obstacle in overlaps(world.pose, fixed.shapes, fixed.solid, *walls).tolist():
        thing = "a fence, trunk or post"
        if obstacle < len(names):
            thing = names[obstacle]
        x, y, _ = world.pose[body].tolist()
        sentence = f"{names[body]} overlaps {thing}, at ({x:.2f}, {y:.2f})"
        yield f"inside {names[body]} {thing}", sentence


def _moving_though_stopped(world: World) -> Iterator[Violation]:
    """Yield a violation for each body that moves though it, or what it tows, is stopped."""
    names = world.layout.names
    for body in world.stopped.nonzero()[0].tolist():
        name = names[body]
        partner = int(world.coupled[body])
        if world.twist[body].any():
            yield f"stopped {name}", f"{name} moves, but is stopped"
        if partner != NONE and not world.stopped[partner]:
            fault = f"{names[partner]}, which is coupled to it, is not"
            yield f"stopped by half {name}", f"{name} is stopped, but {fault}"
