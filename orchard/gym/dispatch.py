"""Dispatch as a Gymnasium Env of events, over the event model: at each decision an action names the
carrier that fetches a bin, or none.

The decisions are those of a dispatch policy (`orchard.dispatch.policy`): the same reports, at the
same times. So what has learned here can be a policy of the simulator: `Dispatching.orders` is the
body of its `assign`.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from orchard.dispatch.policy import Assignment, BinReport, CarrierReport
from orchard.event_model import codes as c
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.known import refuse_unknown
from orchard.event_model.policies import AskedPolicy, PolicyQuestion
from orchard.event_model.results import JAM, LONGEST, LOOK_AT
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import TIME_STEP, Scenario, with_changes
from orchard.gym.episodes import Episode, plain, refuse_what_is_no_episode
from orchard.gym.rewards import named
from orchard.gym.spaces import FAR, MOST_LANES, Arrays

NO_ORDER = 0  # the action that sends no carrier, and ends the decision
LONG = 1e6  # s: no harvest takes so long

Choose = Callable[[Arrays, np.ndarray], int]  # observation and mask -> action


class Dispatching:
    """Dispatch in one orchard as arrays.

    An action is 0, which sends no carrier, or 1 + b * C + c: carrier c of C fetches bin b, both in
    the order of their names.

    An observation holds `seconds` since the start, (1,); `bins`, six numbers for each bin: 1 if it
    needs a carrier, its lane, s since it began to call, s until it is full, s in which a carrier
    can be there, m by road to it, and all 0 if it needs none; `carriers`, two numbers for each: 1
    if it can leave now, and m by road to the queue's head.
    """

    def __init__(self, layout: Layout) -> None:
        """`layout`: of the orchard."""
        names = sorted(layout.names)
        self.bins = [name for name in names if name.startswith("bin_")]
        self.carriers = [name for name in names if name.startswith("carrier_")]
        most_of_bin = np.array([1.0, MOST_LANES, LONG, LONG, LONG, FAR], dtype=np.float32)
        self.action_space = spaces.Discrete(1 + len(self.bins) * len(self.carriers))
        most_of_carrier = np.array([1.0, FAR], dtype=np.float32)
        # In the order in which Gymnasium sorts them.
        self.observation_space = spaces.Dict(
            bins=_box_up_to(np.tile(most_of_bin, len(self.bins))),
            carriers=_box_up_to(np.tile(most_of_carrier, len(self.carriers))),
            seconds=_box_up_to(np.array([LONG], np.float32)),
        )

    def observation(
        self, now: int, bins: Iterable[BinReport], carriers: Iterable[CarrierReport]
    ) -> Arrays:
        """Return what a policy is told, as arrays. `now`: the tick."""
        calls = np.zeros((len(self.bins), 6), np.float32)
        for report in bins:
            calls[self.bins.index(report.name)] = (
                1.0,
                report.lane,
                (now - report.since) * TIME_STEP,
                report.seconds_to_full,
                report.seconds_to_reach,
                report.metres,
            )
        queue = np.zeros((len(self.carriers), 2), np.float32)
        for carrier in carriers:
            queue[self.carriers.index(carrier.name)] = float(carrier.is_next), carrier.metres
        seconds = np.array([now * TIME_STEP], np.float32)
        return {"seconds": seconds, "bins": calls.ravel(), "carriers": queue.ravel()}

    def mask(self, bins: Iterable[BinReport], carriers: Iterable[CarrierReport]) -> np.ndarray:
        """Return which actions can be, (actions,) int8; 0 always can."""
        ready = [carrier.name for carrier in carriers if carrier.is_next]
        mask = np.zeros(self.action_space.n, dtype=np.int8)
        mask[NO_ORDER] = 1
        for report in bins:
            for carrier_name in ready:
                mask[self.action(Assignment(report.name, carrier_name))] = 1
        return mask

    def action(self, order: Assignment | None) -> int:
        """Return the action that is an order; 0 for none."""
        if order is None:
            return NO_ORDER
        first_of_bin = 1 + self.bins.index(order.bin) * len(self.carriers)
        return first_of_bin + self.carriers.index(order.carrier)

    def number(self, action: Any) -> int:
        """Return an action as a number: a whole one, or an array of one.

        Raises ValueError for what is no action.
        """
        value = np.asarray(action)
        is_whole = value.size == 1 and value.dtype.kind in "iu"
        if not is_whole or not self.action_space.contains(int(value.item())):
            most = self.action_space.n - 1
            raise ValueError(f"action {action!r}: must be a number from 0 to {most}")
        return int(value.item())

    def order(self, action: Any) -> Assignment | None:
        """Return the order that an action is; None for 0.

        Raises ValueError for what is no action.
        """
        number = self.number(action)
        if number == NO_ORDER:
            return None
        bin_index, carrier_index = divmod(number - 1, len(self.carriers))
        return Assignment(self.bins[bin_index], self.carriers[carrier_index])

    def orders(
        self, choose: Choose, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport]
    ) -> list[Assignment]:
        """Return the orders of what has learned here: the body of a policy's `assign`.

        What cannot be sends none.
        """
        orders: list[Assignment] = []
        while True:
            mask = self.mask(bins, carriers)
            if mask.sum() == 1:
                # Only the action that sends no carrier remains.
                break
            action = self.number(choose(self.observation(now, bins, carriers), mask))
            order = self.order(action)
            if order is None or not mask[action]:
                break
            orders.append(order)
            bins = without(bins, order.bin)
            carriers = without(carriers, order.carrier)
        return orders


def _box_up_to(most: np.ndarray) -> spaces.Box:
    """Return the space of arrays with numbers from 0 to these."""
    return spaces.Box(np.zeros_like(most), most)


def without(reports: Sequence[Any], name: str) -> list[Any]:
    """Return all reports but that of a name."""
    return [report for report in reports if report.name != name]


class Transition(NamedTuple):
    """What happened from one action to the next, for a reward."""

    seconds: float  #: that passed
    waited: float  #: s for which all pickers together have waited for empty bins
    delivered: int  #: bins unloaded


Reward = Callable[[Transition], float]


def time(happened: Transition) -> float:
    """Minus the seconds that passed."""
    return -happened.seconds


def waiting(happened: Transition) -> float:
    """Minus the seconds for which pickers waited."""
    return -happened.waited


def delivery(happened: Transition) -> float:
    """The bins that were unloaded."""
    return 1.0 * happened.delivered


# Functions with names: an environment can be pickled with them. They take arrays too.
REWARDS: Mapping[str, Reward] = {"time": time, "waiting": waiting, "delivery": delivery}


class DispatchEnv(gymnasium.Env[Arrays, Any]):
    """The dispatch of a scenario, over the fast model: which carrier fetches which bin.

    `harvest` is the model, from the first `reset` on.

    A step is an action at a decision: see `Dispatching`. A decision goes on until an action sends
    no carrier, or nothing more can be sent. An action that cannot be, by `info["action_mask"]`,
    sends no carrier. `info["scripted"]` is what the scenario's own policy would do; if that is
    `early`, bins report before they are full.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as Gymnasium has it
    harvest: EventHarvest

    def __init__(
        self, scenario: Scenario, *, reward: str | Reward = "time", longest: int = LONGEST
    ) -> None:
        """`reward`: "time", "waiting", "delivery", or a function of a `Transition`. `longest`:
        ticks, after which an episode is truncated, as it is after 600 s in which nothing moves on,
        because robots wait for each other or for a carrier that is never sent.

        Raises TypeError for what is no scenario, and ValueError for an unknown reward, an episode
        without a tick, and for a scenario with agents of one's own or errors of sensors.
        """
        refuse_what_is_no_episode(scenario, longest)
        self.scenario = scenario
        self._reward = named(reward, REWARDS)
        self._longest = longest
        self._episode = Episode(scenario.seed, -1)
        self._is_over = True
        # The decision that waits, and the orders at it so far; None: nothing can be decided.
        self._pending: PolicyQuestion | None = None
        self._orders: list[Assignment] = []
        # What the scenario's policy decides there.
        self._scripted: Sequence[Assignment] = ()
        # The steps of all robots, and the tick at which one of them moved on last.
        self._moved = (0, 0.0)
        refuse_unknown(scenario)
        layout = lay_out(scenario)
        self._policy = AskedPolicy(layout)
        self.dispatching = Dispatching(layout)
        self.observation_space: spaces.Space[Any] = self.dispatching.observation_space
        self.action_space: spaces.Space[Any] = self.dispatching.action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Arrays, dict[str, Any]]:
        """Begin an episode, and return observation and info at its first decision.

        `seed`: that of the scenario, as for `HarvestEnv`.
        """
        super().reset(seed=plain(seed))
        if options:
            raise ValueError(
                f"options {', '.join(map(str, options))}: unknown; a dispatch_env has none"
            )
        self._begin(self._episode.after(plain(seed)))
        self._is_over = False
        return self._observed(), self._info()

    def _begin(self, episode: Episode) -> None:
        """Go to the first decision of an episode.

        If the scenario's policy fails, the episode is over.
        """
        layout = lay_out(with_changes(self.scenario, seed=episode.seed))
        self._policy = AskedPolicy(layout)
        self.harvest = EventHarvest.paused(layout, self._policy.is_early)
        self._episode = episode
        self._is_over = True
        self._pending = None
        self._moved = (0, 0.0)
        self._until_decision()

    def step(self, action: Any) -> tuple[Arrays, float, bool, bool, dict[str, Any]]:
        """Do an action, and move on to the next decision if this one is taken.

        Return observation, reward, terminated, truncated and info.

        Raises ResetNeeded before the first reset and after the end of an episode, ValueError for
        what is no action. This and `reset` raise RuntimeError, which says what and where, if the
        scenario's own policy raises an error or decides what cannot be.
        """
        if self._is_over:
            raise ResetNeeded("the episode is over, or none has begun: call reset()")
        before = self._so_far()
        self._act(self.dispatching.number(action))
        now = self._so_far()
        happened = Transition(
            seconds=now.seconds - before.seconds,
            waited=now.waited - before.waited,
            delivered=now.delivered - before.delivered,
        )
        self._is_over = self._pending is None
        reward = float(self._reward(happened))
        terminated = self._is_over and self.harvest.is_over
        truncated = self._is_over and not terminated
        return self._observed(), reward, terminated, truncated, self._info()

    def action_masks(self) -> np.ndarray:
        """Return which actions can be, (actions,) bool, as MaskablePPO of sb3-contrib asks
        for it.
        """
        return self.dispatching.mask(*self._reports()).astype(bool)

    def _act(self, action: int) -> None:
        """Do an action, and move on to the next decision if this one is taken."""
        decision = self._pending
        if decision is None:
            return
        order = self.dispatching.order(action)
        if order is not None and self.dispatching.mask(*self._reports())[action]:
            self._orders.append(order)
            decision.bins = without(decision.bins, order.bin)
            decision.carriers = without(decision.carriers, order.carrier)
            if decision.is_open:
                return
        self._pending = None
        self.harvest.decide(decision, self._orders)
        self._until_decision()

    def _until_decision(self) -> None:
        """Let the model go on until something is to be decided, or the episode is over.

        Raises PolicyFault.
        """
        harvest = self.harvest
        goes_on = True
        until = int(harvest.now)
        while goes_on and self._pending is None:
            until = min(self._longest, until + LOOK_AT)
            reason = harvest.advance(until)
            goes_on = self._has_moved(harvest.now if reason == c.ASKS_POLICY else float(until))
            if reason == c.ASKS_POLICY:
                self._come_to(harvest.decision, goes_on)
            elif reason == c.ENDED or until == self._longest:
                goes_on = False
        if harvest.is_over:
            # The last robots drive home.
            harvest.run()

    def _has_moved(self, now: float) -> bool:
        """Note whether a robot has moved on by a tick. Return False if none has for long."""
        done, since = self._moved
        if self.harvest.done > done or self.harvest.drives:
            self._moved = (self.harvest.done, now)
            return True
        return now - since <= JAM

    def _come_to(self, decision: PolicyQuestion, goes_on: bool) -> None:
        """Ask the scenario's policy, and let the decision wait if a carrier can be sent.

        `goes_on`: whether the episode does.
        """
        now = decision.now
        bins = decision.bins
        carriers = decision.carriers
        self._scripted = self._policy.orders(now, bins, carriers)
        self._orders = []
        if goes_on and decision.is_open:
            self._pending = decision
        else:
            self.harvest.decide(decision, [])

    def _so_far(self) -> Transition:
        """Return what has happened since the start."""
        harvest = self.harvest
        seconds = harvest.seconds if harvest.is_over else harvest.now * TIME_STEP
        return Transition(seconds, harvest.waited_seconds, harvest.delivered)

    def _reports(self) -> tuple[Sequence[BinReport], Sequence[CarrierReport]]:
        """Return the bins and carriers of the decision that waits; none without one."""
        decision = self._pending
        if decision is None:
            return (), ()
        return decision.bins, decision.carriers

    def _observed(self) -> Arrays:
        """Return what there is to decide about."""
        return self.dispatching.observation(int(self.harvest.now), *self._reports())

    def _info(self) -> dict[str, Any]:
        """Return which actions can be, and the first one of the scenario's policy that can."""
        mask = self.action_masks()
        scripted = (self.dispatching.action(order) for order in self._scripted)
        return {
            "action_mask": mask.astype(np.int8),
            "scripted": next((action for action in scripted if mask[action]), NO_ORDER),
        }


dispatch_env = DispatchEnv
