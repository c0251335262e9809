"""A stage for tests: an orchard in local mode, with commands and queries in the words of the domain
and in simulated time.
"""

import time
from collections.abc import Callable

from orchard.contract.agent import Action, Agent, Mail, Observation
from orchard.contract.events import Event
from orchard.field.geometry import HEADINGS, Twist, angle_between
from orchard.field.scenario import Animals, People, Scenario
from orchard.local import Local
from orchard.report.metrics import collisions
from orchard.server.figures import RunFigures
from orchard.sim.lookahead import Lookahead
from orchard.sim.world import NONE

# All pickers begin in the west, and the queue lies in the east.
ONE_WAY = {"route": "one-way", "rows_to_pickers": "balanced"}
# No people, animals and weeds.
EMPTY_SCENE = {
    "people": People(workers=0, visitors=0),
    "animals": Animals(dogs=0, cats=0),
    "weeds": 0,
}


def empty_orchard(**changes) -> Scenario:
    """Return a one-way orchard without people, animals, weeds and tractor, but for `changes`."""
    return Scenario(**{"rows": 3, "tractor": False, **ONE_WAY, **EMPTY_SCENE, **changes})


def small_orchard(policy: str, **changes) -> Scenario:
    """Return an orchard of 4 rows, 2 pickers and 2 carriers with this policy, but for `changes`."""
    return empty_orchard(**{"rows": 4, "pickers": 2, "carriers": 2, "dispatch": policy, **changes})


class Standing:
    """An agent that stands."""

    Memory = dict

    def tick(self, seen: Observation, mail: Mail, memory: object) -> Action:
        return Action(memory=memory, doing="standing")


class Acting:
    """An agent that does what a function of the test says."""

    Memory = dict

    def __init__(self, tick: Callable[[Observation, Mail, object], Action]) -> None:
        self.tick = tick


class Driven:
    """An agent that drives at one velocity."""

    Memory = dict

    def __init__(self, twist: Twist) -> None:
        self.twist = twist

    def tick(self, seen: Observation, mail: Mail, memory: object) -> Action:
        return Action(twist=self.twist, memory=memory)


class Stage:
    """An orchard that a test runs until a condition holds.

    Each wait is bounded in simulated time.
    """

    def __init__(
        self,
        scenario: Scenario,
        holds: type[Lookahead] = Lookahead,
        is_hashed: bool = False,
        **agents: Agent,
    ) -> None:
        self.local = Local(scenario, holds=holds, is_hashed=is_hashed)
        self.local.agents |= agents
        self.account = RunFigures(self.local.engine, time.monotonic)
        self.events: list[Event] = []

    @property
    def world(self):
        return self.local.engine.world

    @property
    def seconds(self) -> float:
        """The time since the start, simulated s. A tick is 0.1 s."""
        return self.world.tick / 10

    def put(self, name: str, x: float, y: float, heading: str = "EAST") -> None:
        """Set where a body is at the start. A robot takes its bin with it."""
        assert self.world.tick == 0, "put bodies before the first tick"
        i = self.world.index[name]
        bin_ = self.world.coupled[i]
        if bin_ != NONE:
            assert heading == "EAST", "put a robot with a bin facing east"
            self.world.pose[bin_, 0] += x - self.world.pose[i, 0]
            self.world.pose[bin_, 1] += y - self.world.pose[i, 1]
        self.world.pose[i] = x, y, HEADINGS[heading]

    def give(self, name: str, steps: list, **memory) -> None:
        """Replace the plan of an agent. `memory`: other fields of its memory, by name."""
        agent = self.local.agents[name]
        self.local.engine.wake([name])
        self.local.memories[name] = agent.Memory(plan=list(steps), **memory)

    def follow(self, name: str, steps: list, seconds: float = 60.0) -> float:
        """Give a plan, and run until it is done. Return the seconds that it took."""
        self.give(name, steps)
        return self.run_until(lambda: not self.local.memories[name].plan, seconds)

    def tick(self) -> None:
        # `Local.tick` refuses to go on where nothing goes on, which is what some tests are about.
        events = self.local.act(self.local.ask())
        self.account.update(events)
        self.events += events

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 10)):
            self.tick()

    def run_until(self, condition: Callable[[], bool], seconds: float = 600.0) -> float:
        """Run until a condition holds. Return the seconds that it took.

        An assertion fails if it takes longer than allowed.
        """
        start = self.world.tick
        while not condition():
            assert self.world.tick - start < seconds * 10, (
                f"not within {seconds} s; {self.who_is_where()}"
            )
            self.tick()
        return (self.world.tick - start) / 10

    def run_to_the_end(self, seconds: float = 4000.0) -> float:
        """Harvest to the end, without a violation. Return the seconds that it took."""
        took = self.run_until(lambda: self.local.engine.over, seconds)
        assert self.local.engine.violations() == []
        return took

    def who_is_where(self) -> str:
        """Return a line for each agent: where it is, what it does, and for what it waits."""
        lines = []
        for name, action in self.local.actions.items():
            # The desks for traffic and dispatch have no body.
            if name in self.world.index:
                cause = action.waits_for or "nothing"
                lines.append(f"{name} at {self.pose(name)}: {action.doing}, waits for {cause}")
        return "\n".join(["", *lines])

    # -- queries

    def pose(self, name: str) -> tuple[float, float, float]:
        """Return x and y, m, and the heading, rad."""
        return tuple(float(v) for v in self.world.pose[self.world.index[name]])

    def bin_of(self, name: str) -> str:
        """Return the bin that is coupled to a robot, '' without one."""
        other = self.world.coupled[self.world.index[name]]
        return "" if other == NONE else self.world.layout.names[other]

    def is_full(self, name: str) -> bool:
        """Whether a bin has the fruit of 70 m, the default row."""
        return bool(self.world.fill[self.world.index[name]] >= 70.0)

    def doing(self, name: str) -> str:
        return self.local.actions[name].doing

    def happened(self, what: str, who: str = "") -> list[Event]:
        """Return the events of a kind, of one body; "": of all bodies."""
        return [event for event in self.events if event.what == what and who in ("", event.who)]

    # -- assertions

    def assert_at(
        self, name: str, x: float | None = None, y: float | None = None, heading: str | None = None
    ) -> None:
        """Assert a place and a heading, to a micrometre and a microradian. None is not tested."""
        is_x, is_y, yaw = self.pose(name)
        if x is not None:
            assert abs(is_x - x) < 1e-6, f"{name}: x = {is_x}, not {x}"
        if y is not None:
            assert abs(is_y - y) < 1e-6, f"{name}: y = {is_y}, not {y}"
        if heading is not None:
            off = angle_between(yaw, HEADINGS[heading])
            assert abs(off) < 1e-6, f"{name} faces {yaw}, not {heading}"

    def assert_no_collisions(self) -> None:
        assert collisions(self.world) == 0, self.happened("collision")


def meadow(**changes) -> Stage:
    """Return a stage whose pickers and carriers have no plan until they are given one.

    carrier_01 stands free of the others.
    """
    stage = Stage(empty_orchard(**changes))
    for name in stage.local.agents:
        if name.startswith(("picker", "carrier")):
            stage.give(name, [])
    return stage


def one_guest(kind: str, x: float, y: float, heading: str = "EAST") -> Stage:
    """Return a stage with one worker, visitor, dog or cat, and no robot at work."""
    people = People(workers=int(kind == "worker"), visitors=int(kind == "visitor"))
    animals = Animals(dogs=int(kind == "dog"), cats=int(kind == "cat"))
    stage = meadow(people=people, animals=animals)
    stage.put(f"{kind}_01", x, y, heading)
    return stage
