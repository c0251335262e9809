"""Which carrier has a charger, and when: the simulator and the event model in equal random cases.

Carriers come to their charging lines, wait there for a charger, charge, and move up meanwhile. Only
the batteries of both models are run: the test moves the carriers as their visits say, in the world
of the simulator and in the arrays of the event model. Both must give each charger in the same tick,
or the next one.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from random import Random
from typing import Any

import numpy as np
import pytest
from quiet import NOBODY

from orchard.event_model import codes as c
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.kernel import batteries as kernel
from orchard.event_model.plain import as_python
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario
from orchard.sim import batteries
from orchard.sim.world import World

CASES = 12
CASES_OF_SOAK = 100
# For so many ticks each case is compared. By ARRIVALS the last carrier has come.
TICKS = 700
ARRIVALS = 250
# For so many ticks a carrier drives along its line before it stands there.
IN_LINE = 20
# In so many ticks of a case a carrier may charge in one model only: parts of a tick are rounded, so
# a battery may be full a tick earlier, and its charger go to the next carrier earlier.
ROUNDED = 4
# m by which a carrier moves up, at most.
FARTHEST_UP = 2.5
# m that a carrier drives in a tick.
CARRIER_STEP = 0.1


@dataclass(frozen=True)
class Visit:
    """A carrier that charges: it comes with a charge, stands in a line, and moves up."""

    # A share of a full battery.
    charge: float
    # The tick at which it stands, and where, m.
    came: int
    x: float
    y: float
    # The tick at which it begins to move up, and for how many ticks it does; 0: it does not.
    moved_up: int
    moved_for: int

    def is_moving(self, tick: int) -> bool:
        """Whether the carrier drives in a tick."""
        return tick < self.came or self.moved_up <= tick < self.moved_up + self.moved_for

    def x_at(self, tick: int) -> float:
        """Return where the carrier is at the begin of a tick, m."""
        if tick < self.came:
            return self.x - CARRIER_STEP * (self.came - tick)
        return self.x + CARRIER_STEP * min(max(0, tick - self.moved_up), self.moved_for)


def cases(seed: int, count: int) -> Iterator[tuple[Layout, list[Visit]]]:
    """Yield random orchards with chargers, each with what its carriers do."""
    chances = Random(seed)
    for _ in range(count):
        carriers = chances.randint(1, 6)
        battery = {
            "hours": chances.choice([0.1, 0.5, 2.0]),
            "hours_to_charge": chances.choice([0.01, 0.02]),
            "reserve": 0.9,
            "standing": chances.random(),
        }
        scenario = Scenario(
            **NOBODY | {"rows": 6, "pickers": 2, "carriers": carriers},
            chargers=chances.randint(1, 3),
            carrying={"battery": battery},
        )
        layout = lay_out(scenario)
        yield layout, [_visit(chances, layout) for _ in range(carriers)]


def _visit(chances: Random, layout: Layout) -> Visit:
    """Draw the visit of a carrier."""
    came = chances.randint(IN_LINE, ARRIVALS)
    return Visit(
        charge=chances.uniform(0.3, 0.85),
        came=came,
        x=chances.uniform(layout.queue.area.west, layout.queue.head - FARTHEST_UP),
        y=chances.choice(layout.charging_lines),
        moved_up=came + chances.randint(5, 300),
        moved_for=chances.choice([0, 10, 25]),
    )


def charging_in_simulator(layout: Layout, visits: list[Visit]) -> np.ndarray:
    """Return whether each carrier charges in each tick, (ticks, carriers) bool."""
    world = World(layout)
    carriers = world.fixed.carriers
    world.charge[carriers] = [visit.charge for visit in visits]
    charging = np.zeros((TICKS, len(visits)), dtype=bool)
    for tick in range(TICKS):
        for number, visit in enumerate(visits):
            # Physics looks at its batteries after bodies have moved.
            world.pose[carriers[number]] = (visit.x_at(tick + 1), visit.y, 0.0)
            world.twist[carriers[number]] = (float(visit.is_moving(tick)), 0.0, 0.0)
        full = [event.who for event in batteries.advance(world) if event.what == "charged"]
        charging[tick] = world.plugged[carriers]
        for name in full:
            charging[tick, carriers.tolist().index(layout.index[name])] = True
        world.tick += 1
    return charging


class ChargersOfModel:
    """Carriers of the event model that come, charge and move up as their visits say."""

    def __init__(self, layout: Layout, visits: list[Visit]) -> None:
        harvest = EventHarvest(layout)
        self.model = harvest.model
        self.visits = [(harvest.names.index(name), visit) for name, visit in named(layout, visits)]
        self.charging = np.zeros((TICKS, len(visits)), dtype=bool)
        self._since: dict[int, int] = {}
        self.model.timers[:] = c.NEVER
        for robot, visit in self.visits:
            me = self.model.robots[robot]
            me.state = c.DRIVING
            me.charge = visit.charge
            me.y = visit.y

    def advance(self, tick: int) -> None:
        """Let all happen that does at a tick. The clock of the machine counts quarters of ticks."""
        self.model.desk.now = c.QUARTERS * tick
        for robot, _ in self.visits:
            # A carrier that parks has stood since the tick before. A charger that becomes free is
            # given in the same tick.
            if self._is_due(c.PARK, robot):
                self._do(kernel.park, robot, begun=tick - 1)
        for robot, visit in self.visits:
            self._drive(robot, visit, tick)
        for robot, _ in self.visits:
            if self._is_due(c.FULLY_CHARGED, robot):
                self._do(kernel.end_charging, robot, begun=tick)
                if not self.model.robots[robot].is_charging:
                    self._since.pop(robot)
        for robot, since in self._since.items():
            self.charging[since : tick + 1, self._number(robot)] = True

    def _drive(self, robot: int, visit: Visit, tick: int) -> None:
        """Begin or end a drive of a carrier, as its visit says."""
        me = self.model.robots[robot]
        if tick == visit.came - IN_LINE:
            # It has driven since tick 0.
            me.moved += tick
            me.moved_at = tick
            me.leg_begun = tick
            as_python(kernel.ask_for_charger)(self.model, robot)
        elif tick == visit.came:
            self._stand(robot, visit, IN_LINE, tick)
        elif visit.moved_for and tick == visit.moved_up:
            as_python(kernel.note_rest)(self.model, robot)
            me.leg_begun = tick
            me.state = c.DRIVING
        elif visit.moved_for and tick == visit.moved_up + visit.moved_for:
            self._stand(robot, visit, visit.moved_for, tick)

    def _stand(self, robot: int, visit: Visit, moved: int, tick: int) -> None:
        """Stand after a drive of some ticks."""
        me = self.model.robots[robot]
        me.moved += moved
        me.moved_at = tick
        me.x = visit.x_at(tick)
        me.stood = tick
        me.state = c.STANDING
        if me.is_charging:
            as_python(kernel.delay_charge)(self.model, robot, moved)

    def _is_due(self, kind: int, robot: int) -> bool:
        """Whether an event of a kind happens now. It does so once."""
        is_due = bool(self.model.timers[kind, robot] == self.model.desk[0].now)
        if is_due:
            self.model.timers[kind, robot] = c.NEVER
        return is_due

    def _do(self, event: Any, robot: int, begun: int) -> None:
        """Let an event happen.

        `begun`: the first tick in which a carrier charges to which it gives a charger.
        """
        as_python(event)(self.model, robot)
        for other, _ in self.visits:
            if self.model.robots[other].is_charging:
                self._since.setdefault(other, begun)

    def _number(self, robot: int) -> int:
        return [carrier for carrier, _ in self.visits].index(robot)


def charging_in_model(layout: Layout, visits: list[Visit]) -> np.ndarray:
    """Return whether each carrier charges in each tick, (ticks, carriers) bool."""
    chargers = ChargersOfModel(layout, visits)
    for tick in range(TICKS):
        chargers.advance(tick)
    return chargers.charging


def named(layout: Layout, visits: list[Visit]) -> list[tuple[str, Visit]]:
    """Return the visits with the names of their carriers, in the order of the simulator's."""
    carriers = [start.name for start in layout.starts if start.kind == "carrier"]
    return [*zip(carriers, visits, strict=True)]


def assert_chargers_are_given_alike(seed: int, count: int) -> None:
    """Compare which carriers charge, tick by tick, in so many random cases."""
    charged = 0
    for layout, visits in cases(seed, count):
        expected = charging_in_simulator(layout, visits)
        differs = (expected != charging_in_model(layout, visits)).sum(axis=0)
        assert (differs <= ROUNDED).all(), (layout.scenario.chargers, visits, differs)
        charged += int(expected.any(axis=0).sum())
    assert charged > count, "more than one carrier has charged in a case, on average"


def test_chargers_go_to_the_same_carriers_in_the_same_ticks() -> None:
    """Batteries are used alike before that, so each is full in the same tick, too."""
    assert_chargers_are_given_alike(seed=3, count=CASES)


@pytest.mark.soak
def test_soak_chargers_go_to_the_same_carriers() -> None:
    assert_chargers_are_given_alike(seed=4, count=CASES_OF_SOAK)
