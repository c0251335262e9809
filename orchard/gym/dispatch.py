"""Dispatch as a Gymnasium Env of events, over the fast model: at each decision an action names the
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

from orchard.discrete.calls import Decision, Dispatched
from orchard.discrete.generators import GeneratorHarvest
from orchard.dispatch.policy import Assignment, BinReport, CarrierReport
from orchard.event_model.results import JAM, LONGEST
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
        names = sorted(layout.names)
        self.bins, self.carriers = (
            [name for name in names if name.startswith(f"{kind}_")] for kind in ("bin", "carrier")
        )
        most = np.array([1.0, MOST_LANES, LONG, LONG, LONG, FAR], dtype=np.float32)
        self.action_space = spaces.Discrete(1 + len(self.bins) * len(self.carriers))
        self.observation_space = spaces.Dict(  # in the order in which Gymnasium sorts them
            bins=_box_up_to(np.tile(most, len(self.bins))),
            carriers=_box_up_to(np.tile(most[[0, 5]], len(self.carriers))),
            seconds=_box_up_to(np.array([LONG], np.float32)),
        )

    def observation(
        self, now: int, bins: Iterable[BinReport], carriers: Iterable[CarrierReport]
    ) -> Arrays:
        """Return what a policy is told, as arrays. `now`: the tick."""
        seconds = np.array([now * TIME_STEP], np.float32)
        calls, queue = (
            np.zeros((len(self.bins), 6), np.float32),
            np.zeros((len(self.carriers), 2), np.float32),
        )
        for one in bins:
            told = (
                1.0,
                one.lane,
                (now - one.since) * TIME_STEP,
                one.seconds_to_full,
                one.seconds_to_reach,
                one.metres,
            )
            calls[self.bins.index(one.name)] = told
        for carrier in carriers:
            queue[self.carriers.index(carrier.name)] = float(carrier.is_next), carrier.metres
        return {"seconds": seconds, "bins": calls.ravel(), "carriers": queue.ravel()}

    def mask(self, bins: Iterable[BinReport], carriers: Iterable[CarrierReport]) -> np.ndarray:
        """Return which actions can be, (actions,) int8; 0 always can."""
        mask = np.zeros(self.action_space.n, dtype=np.int8)
        free = [carrier.name for carrier in carriers if carrier.is_next]
        mask[
            [NO_ORDER, *(self.action(Assignment(one.name, name)) for one in bins for name in free)]
        ] = 1
        return mask

    def action(self, order: Assignment | None) -> int:
        if order is None:
            return NO_ORDER
        return (
            1 + self.bins.index(order.bin) * len(self.carriers) + self.carriers.index(order.carrier)
        )

    def number(self, action: Any) -> int:
        """Return an action as a number: a whole one, or an array of one.

        Raises ValueError for what is no action.
        """
        given = np.asarray(action)
        if (
            given.size != 1
            or given.dtype.kind not in "iu"
            or not self.action_space.contains(int(given.item()))
        ):
            raise ValueError(
                f"action {action!r}: must be a number from 0 to {self.action_space.n - 1}"
            )
        return int(given.item())

    def order(self, action: Any) -> Assignment | None:
        """Return the order that an action is; None for 0.

        Raises ValueError for what is no action.
        """
        number = self.number(action)
        bin_, carrier = divmod(number - 1, len(self.carriers))
        return None if number == NO_ORDER else Assignment(self.bins[bin_], self.carriers[carrier])

    def orders(
        self, choose: Choose, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport]
    ) -> list[Assignment]:
        """Return the orders of what has learned here: the body of a policy's `assign`.

        What cannot be sends none.
        """
        orders: list[Assignment] = []
        while (mask := self.mask(bins, carriers)).sum() > 1:
            action = self.number(choose(self.observation(now, bins, carriers), mask))
            order = self.order(action)
            if order is None or not mask[action]:
                break
            orders.append(order)
            bins, carriers = left(bins, order.bin), left(carriers, order.carrier)
        return orders


def _box_up_to(most: np.ndarray) -> spaces.Box:
    return spaces.Box(np.zeros_like(most), most)


def left(reports: Sequence[Any], name: str) -> list[Any]:
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
    return float(happened.delivered)


# Functions with names: an environment can be pickled with them.
REWARDS: Mapping[str, Reward] = {"time": time, "waiting": waiting, "delivery": delivery}


class Paused(Dispatched):
    """Dispatch that waits for what learns: a decision is kept, and nothing is sent until it is
    taken.
    """

    pending: Decision | None = None
    scripted: Sequence[Assignment] = ()

    def decide(self, decision: Decision) -> None:
        """Keep a decision, unless nothing can be sent, and what the scenario's policy decides.

        Raises PolicyFault.
        """
        self.scripted = self.orders(decision)
        self.pending = decision if decision.is_open else None


class DispatchEnv(gymnasium.Env[Arrays, Any]):
    """The dispatch of a scenario, over the fast model: which carrier fetches which bin.

    `harvest` is the model, from the first `reset` on.

    A step is an action at a decision: see `Dispatching`. A decision goes on until an action sends
    no carrier, or nothing more can be sent. An action that cannot be, by `info["action_mask"]`,
    sends no carrier. `info["scripted"]` is what the scenario's own policy would do; if that is
    `early`, bins report before they are full.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as Gymnasium has it
    harvest: GeneratorHarvest

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
        self.scenario, self._reward, self._longest = scenario, named(reward, REWARDS), longest
        self._episode, self._is_over = Episode(scenario.seed, -1), True
        # Those of this episode, by which a copy comes to the same decision.
        self._actions: list[int] = []
        # The steps of all robots, and the tick at which one of them moved on last.
        self._moved = (0, 0.0)
        layout = lay_out(scenario)
        GeneratorHarvest(layout)  # raises ValueError
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
        self.harvest = GeneratorHarvest(
            lay_out(with_changes(self.scenario, seed=episode.seed)), calls=Paused
        )
        self._episode, self._is_over = episode, True
        self._actions, self._moved = [], (0, 0.0)
        self._until_decision()

    def __getstate__(self) -> dict[str, Any]:
        """Return all but the model: its robots are generators, which Python cannot copy."""
        return {name: value for name, value in vars(self).items() if name != "harvest"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Be a copy: begin the same episode, and do the same actions."""
        vars(self).update(state)
        if self._episode.number < 0:
            return
        is_over, actions = self._is_over, self._actions
        self._begin(self._episode)
        for action in actions:
            self._act(action)
        self._is_over = is_over

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
        now, self._is_over = self._so_far(), self._calls.pending is None
        reward = self._reward(
            Transition(
                now.seconds - before.seconds,
                now.waited - before.waited,
                now.delivered - before.delivered,
            )
        )
        terminated = self._is_over and self.harvest.is_over
        return (
            self._observed(),
            float(reward),
            terminated,
            self._is_over and not terminated,
            self._info(),
        )

    def action_masks(self) -> np.ndarray:
        """Return which actions can be, (actions,) bool, as MaskablePPO of sb3-contrib asks
        for it.
        """
        return self.dispatching.mask(*self._reports()).astype(bool)

    @property
    def _calls(self) -> Paused:
        calls = self.harvest.calls
        assert isinstance(calls, Paused)
        return calls

    def _act(self, action: int) -> None:
        """Do an action, and move on to the next decision if this one is taken."""
        self._take(action)
        self._until_decision()
        self._actions.append(action)

    def _take(self, action: int) -> None:
        decision, order = self._calls.pending, self.dispatching.order(action)
        if (
            decision is None
            or order is None
            or not self.dispatching.mask(decision.bins, decision.carriers)[action]
        ):
            self._calls.pending = None
            return
        self._calls.send(decision, [order])
        decision.bins, decision.carriers = (
            left(decision.bins, order.bin),
            left(decision.carriers, order.carrier),
        )
        self._calls.pending = decision if decision.is_open else None

    def _until_decision(self) -> None:
        harvest, env = self.harvest, self.harvest.env
        while self._calls.pending is None and not harvest.is_over and env.peek() < self._longest:
            env.step()
            done, since = self._moved
            if harvest.done > done or harvest.drives:
                self._moved = harvest.done, env.now
            elif env.now - since > JAM:
                self._calls.pending = None
                break
        if harvest.is_over:
            harvest.run()  # the last robots drive home

    def _so_far(self) -> Transition:
        seconds = self.harvest.seconds if self.harvest.is_over else self.harvest.env.now * TIME_STEP
        return Transition(seconds, self.harvest.waited_seconds, self.harvest.delivered)

    def _reports(self) -> tuple[Sequence[BinReport], Sequence[CarrierReport]]:
        decision = self._calls.pending
        return (decision.bins, decision.carriers) if decision else ((), ())

    def _observed(self) -> Arrays:
        return self.dispatching.observation(int(self.harvest.env.now), *self._reports())

    def _info(self) -> dict[str, Any]:
        mask = self.action_masks()
        scripted = (self.dispatching.action(order) for order in self._calls.scripted)
        return {
            "action_mask": mask.astype(np.int8),
            "scripted": next((action for action in scripted if mask[action]), NO_ORDER),
        }


dispatch_env = DispatchEnv
