"""Dispatch as a Gymnasium Env over the event model: at each decision an action names the carrier
that fetches a bin, or none.

A dispatch policy (`orchard.dispatch.policy`) would decide here: it gets reports of all bins that
need a carrier and of all carriers, and gives orders, each of which sends a carrier to a bin. The
environment asks for these orders one after another: a decision is a moment at which the model stops
for a policy, and an action is one order.

What has learned here can be a policy of the simulator: `Dispatching.orders` does what the method
`assign` of a policy must do.
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

# The action that sends no carrier, and ends the decision.
NO_ORDER = 0
LONG = 1e6  # s, the limit of times in the observation space: no harvest takes so long
# Numbers for each bin and for each carrier in an observation.
OF_BIN = 6
OF_CARRIER = 2

# What has learned: observation and mask -> action.
Choose = Callable[[Arrays, np.ndarray], int]


class Dispatching:
    """Dispatch in one orchard as arrays.

    An action is 0, which sends no carrier, or 1 + b * C + c: carrier c of C fetches bin b, both in
    the order of their names.

    An observation holds three arrays:

    - `seconds`, (1,): since the start;
    - `bins`, (6 * bins,): for each bin 1 if it needs a carrier, its lane, s since it began to call,
      s until it is full, s in which a carrier can be there, and m by road to it; six times 0 if it
      needs no carrier;
    - `carriers`, (2 * carriers,): for each 1 if it can leave now, and m by road to the queue's
      head.
    """

    def __init__(self, layout: Layout) -> None:
        """`layout`: of the orchard."""
        names = sorted(layout.names)
        self.bins = [name for name in names if name.startswith("bin_")]
        self.carriers = [name for name in names if name.startswith("carrier_")]
        most_of_bin = np.array([1.0, MOST_LANES, LONG, LONG, LONG, FAR], dtype=np.float32)
        self.action_space = spaces.Discrete(1 + len(self.bins) * len(self.carriers))
        most_of_carrier = np.array([1.0, FAR], dtype=np.float32)
        # In the order of their names, as Gymnasium sorts them anyway.
        self.observation_space = spaces.Dict(
            bins=_box_up_to(np.tile(most_of_bin, len(self.bins))),
            carriers=_box_up_to(np.tile(most_of_carrier, len(self.carriers))),
            seconds=_box_up_to(np.array([LONG], np.float32)),
        )

    def observation(
        self, now: int, bins: Iterable[BinReport], carriers: Iterable[CarrierReport]
    ) -> Arrays:
        """Return the reports that a policy gets, as an observation. `now`: the tick."""
        calls = np.zeros((len(self.bins), OF_BIN), np.float32)
        for report in bins:
            calls[self.bins.index(report.name)] = (
                1.0,
                report.lane,
                (now - report.since) * TIME_STEP,
                report.seconds_to_full,
                report.seconds_to_reach,
                report.metres,
            )
        queue = np.zeros((len(self.carriers), OF_CARRIER), np.float32)
        for carrier in carriers:
            queue[self.carriers.index(carrier.name)] = float(carrier.is_next), carrier.metres
        seconds = np.array([now * TIME_STEP], np.float32)
        return {"seconds": seconds, "bins": calls.ravel(), "carriers": queue.ravel()}

    def mask(self, bins: Iterable[BinReport], carriers: Iterable[CarrierReport]) -> np.ndarray:
        """Return which actions are possible, (actions,) int8: 1 if one is. Action 0 always is."""
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
        """Return the orders of what has learned here, as a policy's `assign` returns them.

        `choose` is asked again, without the bin and the carrier of its last order, until it sends
        no carrier. An action that is not possible counts as action 0.
        """
        orders: list[Assignment] = []
        while True:
            mask = self.mask(bins, carriers)
            if mask.sum() == 1:
                # Only action 0 remains.
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
    """Return the space of arrays with numbers from 0 to those of `most`."""
    return spaces.Box(np.zeros_like(most), most)


def without(reports: Sequence[Any], name: str) -> list[Any]:
    """Return the reports without that of the bin or carrier with this name."""
    return [report for report in reports if report.name != name]


class Transition(NamedTuple):
    """What happened from one action to the next, for a reward; or since the episode began."""

    #: The time that passed, s.
    seconds: float
    #: How long pickers have waited for empty bins, s of all pickers together.
    waited: float
    #: Bins unloaded.
    delivered: int


Reward = Callable[[Transition], float]


def time(happened: Transition) -> float:
    """Minus the seconds that passed."""
    return -happened.seconds


def waiting(happened: Transition) -> float:
    """Minus the seconds for which pickers waited."""
    return -happened.waited


def delivery(happened: Transition) -> float:
    """The bins that were unloaded."""
    # A factor and no float(): in `DispatchVecEnv` it is an array.
    return 1.0 * happened.delivered


# Functions with names: an environment can be pickled with them. `DispatchVecEnv` calls them with
# arrays in place of numbers, a value for each orchard.
REWARDS: Mapping[str, Reward] = {"time": time, "waiting": waiting, "delivery": delivery}


class DispatchEnv(gymnasium.Env[Arrays, Any]):
    """The dispatch of a scenario, over the fast model: which carrier fetches which bin.

    `harvest` is the model, from the first `reset` on.

    A step is an action at a decision: see `Dispatching`. A decision goes on until an action sends
    no carrier, or no carrier can be sent any more. An action that `info["action_mask"]` does not
    allow counts as action 0. `info["scripted"]` is the action that the scenario's own policy would
    choose. If that policy is `early`, bins report before they are full.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as Gymnasium has it
    harvest: EventHarvest

    def __init__(
        self, scenario: Scenario, *, reward: str | Reward = "time", longest: int = LONGEST
    ) -> None:
        """`reward`: "time", "waiting", "delivery", or a function of a `Transition`. `longest`:
        ticks, after which an episode is truncated. It is also truncated if no robot moves on for
        600 s (JAM), because robots wait for each other or for a carrier that is never sent.

        Raises TypeError for what is no scenario, and ValueError for an unknown reward, an episode
        without a tick, and for a scenario with agents of one's own or errors of sensors.
        """
        refuse_what_is_no_episode(scenario, longest)
        self.scenario = scenario
        self._reward = named(reward, REWARDS)
        self._longest = longest
        # The one before the first, which has the number 0.
        self._episode = Episode(scenario.seed, -1)
        self._is_over = True
        # The decision for which the model has stopped, and the orders at it so far. None: no model
        # stands at a decision, because the episode is over or none has begun.
        self._pending: PolicyQuestion | None = None
        self._orders: list[Assignment] = []
        # What the scenario's policy would order there.
        self._scripted: Sequence[Assignment] = ()
        # How many steps all robots had done when one last moved on, and the tick of that.
        self._moved = (0, 0.0)
        refuse_unknown(scenario)
        layout = lay_out(scenario)
        # Made here too, so that a policy that cannot be used is refused at once.
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
        """Make a new harvest, and go to its first decision.

        If the scenario's policy fails, this raises, and the episode is over.
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
        """Return which actions are possible, (actions,) bool.

        MaskablePPO of sb3-contrib asks for it by this name.
        """
        return self.dispatching.mask(*self._reports()).astype(bool)

    def _act(self, action: int) -> None:
        """Do an action, and move on to the next decision if this one is taken."""
        decision = self._pending
        if decision is None:
            # The harvest was over before anything could be decided.
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
            # By short parts, to see between them whether robots still move.
            until = min(self._longest, until + LOOK_AT)
            reason = harvest.advance(until)
            if reason == c.ASKS_POLICY:
                # It stands before `until`. After the decision it may go on up to there.
                goes_on = self._has_moved(harvest.now)
                self._come_to(harvest.decision, goes_on)
            else:
                # It stands at `until`, or the harvest is over.
                has_moved = self._has_moved(float(until))
                goes_on = has_moved and reason != c.ENDED and until != self._longest
        if harvest.is_over:
            # The last robots drive home.
            harvest.run()

    def _has_moved(self, now: float) -> bool:
        """Note whether a robot has moved on by tick `now`. Return whether one has in JAM ticks."""
        done, since = self._moved
        if self.harvest.done > done or self.harvest.drives:
            self._moved = (self.harvest.done, now)
            return True
        return now - since <= JAM

    def _come_to(self, decision: PolicyQuestion, goes_on: bool) -> None:
        """Ask the scenario's policy for `info`, and let the decision wait for actions if a carrier
        can be sent.

        `goes_on`: whether the episode goes on. Else no carrier is sent.
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
        """Return what has happened since the beginning of the episode."""
        harvest = self.harvest
        seconds = harvest.seconds if harvest.is_over else harvest.now * TIME_STEP
        return Transition(seconds, harvest.waited_seconds, harvest.delivered)

    def _reports(self) -> tuple[Sequence[BinReport], Sequence[CarrierReport]]:
        """Return the reports of bins and carriers at the decision that waits; without one none."""
        decision = self._pending
        if decision is None:
            return (), ()
        return decision.bins, decision.carriers

    def _observed(self) -> Arrays:
        """Return the observation of the decision that waits."""
        return self.dispatching.observation(int(self.harvest.now), *self._reports())

    def _info(self) -> dict[str, Any]:
        """Return the mask, and the first order of the scenario's policy that is still possible."""
        mask = self.action_masks()
        scripted = NO_ORDER
        for order in self._scripted:
            action = self.dispatching.action(order)
            if mask[action]:
                scripted = action
                break
        return {"action_mask": mask.astype(np.int8), "scripted": scripted}


dispatch_env = DispatchEnv
