"""A whole harvest by generators: pickers, carriers, the bins' calls, and the places on the roads.

It knows all that the discrete-event model knows, and needs nothing compiled. `orchard.event_model`
does the same harvests faster.
"""

from collections.abc import Callable
from math import ceil, inf
from statistics import fmean

import simpy

from orchard.discrete.calls import Calls, Dispatched
from orchard.discrete.robots import Events, Roads, Robot
from orchard.event_model.bystanders import Bystanders
from orchard.event_model.results import JAM, LONGEST, Exchange
from orchard.field.kinds import DISPATCH, kind_of
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP
from orchard.plans.forecast import until_full
from orchard.plans.robot import PATIENCE
from orchard.plans.routes import route_of
from orchard.plans.steps import CRUISE, Confirmed


class GeneratorHarvest:
    """One harvest. `run` does it; then `seconds` and `delivered` tell how it went."""

    def __init__(
        self,
        layout: Layout,
        calls: type[Calls] | None = None,
        free_roads: bool = False,
    ) -> None:
        """`calls`: what sends carriers; None: what the scenario says. `free_roads`: no robot is in
        another's way.

        Raises ValueError for agents of the user's own, and for sensors that are not exact.
        """
        scenario = layout.scenario
        if not scenario.sensors.are_exact:
            raise ValueError(
                "the discrete-event model knows no errors of sensors; run the simulator"
            )
        if own := {**scenario.agents, **scenario.agents_without_body}:
            raise ValueError(
                "the discrete-event model knows built-in agents only, and not"
                f" {', '.join(sorted(own))}; run the simulator"
            )
        self.layout, self.route, self.env = layout, route_of(layout), simpy.Environment()
        self.battery, self.chargers = (
            scenario.carrying.battery,
            simpy.Resource(self.env, max(1, scenario.chargers)),
        )
        self.bystanders, self.exit = Bystanders(layout), layout.queue.area.east
        self.deliveries: list[float] = []  # s, when each bin was unloaded
        self._full_since: dict[
            str, int
        ] = {}  # picker that waits for an empty bin -> tick at which its bin was full
        # Tick at which a picker got an empty bin; ticks since it stood there; since its bin was
        # full.
        self._waits: list[tuple[int, int, int]] = []
        # Of each picker, in the order in which it got empty bins for full ones.
        self.exchanges: dict[str, list[Exchange]] = {name: [] for name in layout.blocks}
        self._trips: list[
            tuple[float, float]
        ] = []  # of carriers: the ticks between which one was outside the queue
        self.left: dict[str, simpy.Event] = {}  # full bin -> it is left in its lane
        self._passes = {name: layout.passes(block) for name, block in layout.blocks.items()}
        self.bins = sum(one.leaves_bin for passes in self._passes.values() for one in passes)
        starts = [start for start in layout.starts if start.kind in ("picker", "carrier")]
        roads = (
            [Roads(self.env)] * len(starts) if not free_roads else [Roads(self.env) for _ in starts]
        )
        self.robots = {
            one.name: Robot(self, one.name, one.pose, one.bin, way)
            for one, way in zip(starts, roads, strict=True)
        }
        self._carriers = [
            robot for robot in self.robots.values() if kind_of(robot.name) == "carrier"
        ]
        has_dispatcher = DISPATCH in scenario.bodiless_agents
        self.calls = (calls or (Dispatched if has_dispatcher else Calls))(
            self.env, self.route, self._carriers
        )
        self._steps: dict[str, int] = {}
        for name, block in layout.blocks.items():
            self.robots[name].plan = list(self.route.harvest(block))
            self._steps[name] = len(self.robots[name].plan)
        for robot in self._carriers:
            robot.plan = list(self.route.wait_in_queue())
        for robot in sorted(self.robots.values(), key=lambda robot: (-robot.x, robot.name)):
            self.env.process(robot.run())

    def run(self, goes_on: Callable[[], bool] = lambda: True) -> "GeneratorHarvest":
        """Do the whole harvest, or all until robots wait for each other, or it no longer `goes_on`,
        and return it.
        """
        before, longest = -1, LONGEST * self.bins
        while goes_on() and self.env.peek() < longest and (self.done > before or self.drives):
            before = self.done
            self.env.run(until=min(longest, self.env.now + JAM))
        return self

    @property
    def flat(self) -> list[str]:
        """The carriers whose batteries are flat."""
        return [robot.name for robot in self._carriers if robot.charge <= 0.0]

    @property
    def stood(self) -> dict[str, float]:
        """The time since which each robot stands, s."""
        return {name: robot.stood * TIME_STEP for name, robot in self.robots.items()}

    def share_done(self, picker: str) -> float:
        """Return which share of its plan a picker has begun, 0 to 1."""
        return 1.0 - len(self.robots[picker].plan) / self._steps[picker]

    @property
    def drives(self) -> bool:
        """Whether a robot is on its way, or charges: the harvest goes on."""
        return bool(self.chargers.count) or any(
            robot.is_on_the_way for robot in self.robots.values()
        )

    @property
    def done(self) -> int:
        return sum(robot.done for robot in self.robots.values())

    def begin_row(self, picker: Robot, before: float = 0.0) -> None:
        """Hear that a picker begins its next pass through a row, or begins to drive into the row
        from so many metres before it picks.
        """
        one = self._passes[picker.name][0]
        row, side, lane = one.row, self.route.sides[one.end], self.layout.lane(one.row)
        if not one.leaves_bin:
            return
        if picker.bin not in self.left or self.left[picker.bin].triggered:
            self.left[picker.bin] = self.env.event()
        # a bin sees how fast its row is picked only there
        speed = self.layout.scenario.mean_picking_speed if before else lane.picking_speed
        seconds = until_full(
            self.layout,
            row,
            side.name,
            one.metres / speed,
            before + abs(self.route.end(row, side) - one.stop),
        )
        self.calls.begins(
            picker, row, side, seconds, picker.tick + (1 if before else 0)
        )  # its bin must see that it drives

    def end_row(self, picker: Robot) -> None:
        if not self._passes[picker.name][0].leaves_bin:
            del self._passes[picker.name][0]
        elif self._passes[picker.name][0].is_full:
            self._full_since[picker.name] = picker.tick

    def couple(self, picker: Robot) -> None:
        exchange = Exchange(picker.tick)
        self.exchanges[picker.name].append(exchange)
        self.robots[picker.carrier].exchange = exchange
        full_since = self._full_since.pop(picker.name)
        self._waits.append((picker.tick, picker.tick - picker.stood, picker.tick - full_since))

    def leave(self, picker: Robot) -> None:
        one = self._passes[picker.name].pop(0)
        if not one.is_full:
            self._full_since[picker.name] = picker.tick
        self.left[picker.full_bin].succeed()
        self.calls.left(picker, one.row, self.route.sides[one.end])

    def deliver(self) -> None:
        self.deliveries.append(self.env.now * TIME_STEP)

    def home(self, carrier: Robot) -> None:
        carrier.use_battery(self.battery.standing)
        self._end_job(carrier)
        self._trips.append((carrier.away, carrier.tick))
        self.calls.home(carrier)

    def _end_job(self, carrier: Robot) -> None:
        """Note what the job of a carrier took that has turned into its line of the queue.

        A job is counted from the queue's exit to the queue's exit. So the way through the line, to
        the next order and out of the queue belongs to it, as if nobody stood in that line.
        """
        if carrier.exchange is None:
            return
        through = (self.exit - carrier.x) / CRUISE / TIME_STEP
        out_ticks = carrier.tick - carrier.away
        battery_hours = self.battery.hours or inf
        carrier.exchange.carrier_ticks = out_ticks + through + Confirmed.ticks
        carrier.exchange.battery_used = (
            carrier.charge_at_start - carrier.charge + through * TIME_STEP / 3600.0 / battery_hours
        )
        carrier.exchange = None

    def spread_charges(self) -> None:
        """Let carriers begin with batteries charged differently, as they are after some days, and
        not all full.
        """
        for number, carrier in enumerate(self._carriers):
            carrier.charge = 1.0 - (1.0 - self.battery.reserve) * number / len(self._carriers)

    def charge(self, carrier: Robot) -> Events:
        """Charge a battery, once its carrier stands in its line and a charger is free."""
        self._trips.append((carrier.away, carrier.tick))
        carrier.use_battery(self.battery.standing)
        self._end_job(carrier)
        carrier.away = inf
        yield self.env.timeout(1)
        while carrier.is_on_the_way:
            yield self.env.timeout(PATIENCE)
        carrier.parked = carrier.stood
        with self.chargers.request() as free:
            yield free
            carrier.use_battery(0.0)
            yield self.env.timeout(
                ceil(
                    (1.0 - max(0.0, carrier.charge))
                    * self.battery.hours_to_charge
                    * 3600.0
                    / TIME_STEP
                )
            )
        carrier.charge, carrier.since, carrier.moved_ticks = 1.0, carrier.tick, 0
        carrier.is_charged.succeed()

    @property
    def seconds(self) -> float:
        """The length of the harvest, s."""
        return max(min(robot.stood, robot.parked) for robot in self.robots.values()) * TIME_STEP

    def picker_waiting_seconds(self, since: float = 0.0, until: float = inf) -> float:
        """Return the mean time for which pickers stood until they got empty bins, s; 0 if they got
        none.

        Of bins that they got between two times. The drive to the place where they stand is no wait.
        """
        waits = [wait for tick, wait, _ in self._waits if since <= tick * TIME_STEP <= until]
        return fmean(waits) * TIME_STEP if waits else 0.0

    @property
    def waited_seconds(self) -> float:
        """The time for which all pickers together have had no bin to fill so far, s, drives
        included.
        """
        still = [
            max(0.0, self.env.now - tick) for tick in self._full_since.values()
        ]  # of those that wait now
        return sum([*(without for _, _, without in self._waits), *still]) * TIME_STEP

    def carrier_utilisation(self, since: float = 0.0, until: float | None = None) -> float:
        """Return the share of the time for which a carrier is outside the queue, 0 to 1, mean over
        the carriers; None: to the end.
        """
        end = self.seconds if until is None else until
        away = [(carrier.away, inf) for carrier in self._carriers if carrier not in self.calls.free]
        busy = sum(
            max(0.0, min(end, to * TIME_STEP) - max(since, of * TIME_STEP))
            for of, to in [*self._trips, *away]
        )
        return busy / ((end - since) * len(self._carriers))

    @property
    def is_over(self) -> bool:
        """Whether all bins were delivered, and no battery is flat; if not, robots wait for each
        other.
        """
        return self.delivered == self.bins and all(
            carrier.charge > 0.0 for carrier in self._carriers
        )

    @property
    def delivered(self) -> int:
        return len(self.deliveries)
