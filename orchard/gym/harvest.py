"""A harvest as a PettingZoo ParallelEnv: a run in one process (local mode) in which some bodies
learn, and all others follow our agents.

A learned body keeps its own built-in agent too. This agent is asked at each tick and sees to plan,
messages and deeds; an action replaces its velocity only.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from msgspec.structs import replace
from pettingzoo import ParallelEnv

from orchard.contract.agent import Action, Observation
from orchard.contract.events import Event
from orchard.contract.messages import PickFrom
from orchard.field.geometry import STILL, Twist
from orchard.field.kinds import MOVERS, kind_of
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario, with_changes
from orchard.gym import spaces as arrays
from orchard.gym.episodes import Episode, plain, refuse_what_is_no_episode
from orchard.gym.rewards import REWARDS, Moment, Reward, named
from orchard.gym.spaces import Arrays
from orchard.local import Local
from orchard.plans.robot_memory import RobotMemory
from orchard.sim.engine import Engine, Unaudited

# Ticks of an episode, at most: 2000 s. The default orchard's harvest takes 5,446 ticks with our
# agents, and bodies that learn may need some times as long.
LONGEST = 20_000

Infos = dict[str, dict[str, Any]]


class Look(NamedTuple):
    """What is known of a learned body at one tick."""

    seen: Observation
    # Of its own agent: the newest one.
    action: Action
    # What its plan asks for.
    goal: arrays.Goal
    fill: float  # m of row in its bin


class HarvestEnv(ParallelEnv[str, Arrays, Any]):  # type: ignore[misc]  # PettingZoo has no types
    """A harvest in which the bodies `learned` learn; all others follow our agents.

    `local` is its run, from the first `reset` on.

    An action is a velocity, m/s forward and rad/s counter-clockwise. The body's own agent keeps its
    plan, its mail and its deeds, so a harvest goes on; `info["scripted"]` is the velocity that this
    agent would have chosen. A body that gets no action follows its agent.
    """

    # As PettingZoo has it.
    metadata: dict[str, Any] = {  # noqa: RUF012
        "name": "orchard_v0",
        "render_modes": [],
        "is_parallelizable": True,
    }
    render_mode = None
    local: Local

    def __init__(
        self,
        scenario: Scenario,
        learned: Sequence[str],
        *,
        reward: str | Reward = "delivery",
        deeds: bool = False,
        longest: int = LONGEST,
        is_hashed: bool = False,
    ) -> None:
        """`reward`: a name in `REWARDS`, or a function of a `Moment`. `deeds`: an action also names
        a deed, in place of its agent's; the info's `action_mask` says which can be. `longest`:
        ticks, after which an episode is truncated. `is_hashed`: whether the run computes its hash
        and checks its invariants, which is slower.

        Raises TypeError for what is no scenario, ValueError for a name that cannot learn, an
        unknown reward, or an episode without ticks.
        """
        refuse_what_is_no_episode(scenario, longest)
        if isinstance(learned, str) or not isinstance(learned, Sequence):
            raise ValueError(
                f"learned = {learned!r}: must be a list of names, such as ['carrier_01']"
            )
        layout = lay_out(scenario)
        _refuse_what_cannot_learn(layout, learned)
        self.scenario = scenario
        self._machines = {name: layout.machines[kind_of(name)] for name in learned}
        self.possible_agents = list(learned)
        self.agents: list[str] = []
        self._reward = named(reward, REWARDS)
        self._deeds = deeds
        self._longest = longest
        self._is_hashed = is_hashed
        self._episode = Episode(scenario.seed, -1)
        self.observation_spaces = {}
        self.action_spaces = {}
        for name, machine in self._machines.items():
            self.observation_spaces[name] = arrays.observation_space(name, machine)
            self.action_spaces[name] = arrays.action_space(machine, deeds)
        # The actions of the agents that were asked at this tick; some are replaced before the step.
        self._answers: dict[str, Action] = {}
        # Learned body -> what is known of it at this tick.
        self._looks: dict[str, Look] = {}

    def _refuse_other_machines(self, layout: Layout) -> None:
        """Raise ValueError if a learned body has a machine that its spaces do not fit."""
        for name, machine in self._machines.items():
            if layout.machines[kind_of(name)] != machine:
                raise ValueError(
                    f"{name}: its speed, turning and handling stay those of the environment, whose"
                    " spaces follow from them; make another environment for another machine"
                )

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of what a body observes: see `orchard.gym.spaces`."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of what a body does."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Arrays], Infos]:
        """Begin an episode. Return the observations and infos of the learned bodies.

        `seed`: that of the scenario. Without it, the first episode has the scenario's own, and each
        further one a seed that is drawn from the one given last. `options["scenario"]`: changes of
        the scenario as for `with_changes`, for a curriculum. Raises ScenarioError or ValueError for
        changes that cannot be.
        """
        changes = _changes_in(options or {})
        episode = self._episode.after(plain(seed))
        scenario = with_changes(self.scenario, **changes | {"seed": episode.seed})
        layout = lay_out(scenario)
        _refuse_what_cannot_learn(layout, self.possible_agents)
        self._refuse_other_machines(layout)
        self._episode = episode
        engine: type[Engine] = Unaudited
        if self._is_hashed:
            engine = Engine
        self.local = Local(scenario, is_hashed=self._is_hashed, engine=engine)
        self.agents = list(self.possible_agents)
        self._look()
        return self._observed(), self._infos()

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[dict[str, Arrays], dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """Move on by a tick, 0.1 s.

        Return observations, rewards, terminations, truncations and infos of the learned bodies.

        Raises ResetNeeded before the first reset and after the end of an episode, ValueError for an
        action that cannot be: then nothing has moved, and no action counts.
        """
        if not self.agents:
            raise ResetNeeded("the episode is over, or none has begun: call reset()")
        unknown = [str(name) for name in actions if name not in self.agents]
        if unknown:
            raise ValueError(
                f"actions for {', '.join(unknown)}, which do not learn here;"
                f" {', '.join(self.agents)} do"
            )
        # All actions are checked before the first one counts.
        commands = {}
        for name, action in actions.items():
            commands[name] = arrays.decode(name, self._machines[name], action, self._deeds)
        for name, command in commands.items():
            self._command(name, command)
        before = self._looks
        events = self.local.act(self._answers)
        self._look()
        rewards = {}
        for name in self.agents:
            velocity = before[name].action.twist
            if name in commands:
                velocity = commands[name].velocity
            moment = _moment(before[name], self._looks[name], velocity, events)
            rewards[name] = float(self._reward(moment))
        over = self.local.engine.over
        too_long = not over and self.local.engine.tick >= self._longest
        terminations = dict.fromkeys(self.agents, over)
        truncations = dict.fromkeys(self.agents, too_long)
        if over or too_long:
            self.agents = []
        return self._observed(), rewards, terminations, truncations, self._infos()

    def _look(self) -> None:
        """Ask the agents, and keep what is known of the learned bodies."""
        self._answers = self.local.ask()
        self._looks = {name: self._look_at(name) for name in self.agents}

    def _look_at(self, name: str) -> Look:
        """Return what is known of a body now."""
        local = self.local
        # An agent that need not be asked at this tick has no new observation and no new action.
        seen = local.observed.get(name) or local.seen[name]
        action = self._answers.get(name) or local.actions[name]
        fill = 0.0
        if seen.hitch:
            fill = local.seen.fills.get(seen.hitch.name, 0.0)
        return Look(seen, action, arrays.goal_of(seen, action.memory), fill)

    def _command(self, name: str, command: arrays.DecodedAction) -> None:
        """Put an action in the place of what the body's own agent commands.

        The agent's hold says until when it need not be asked again, and it counts only for the
        agent's own velocity. What the agent remembers of its own motion becomes what is commanded.
        Otherwise it would take a body that an action lets stand for one that collided.
        """
        look = self._looks[name]
        if command.velocity == look.action.twist and not self._deeds:
            return
        # An agent that was not asked has done its deeds and sent its messages at an earlier tick.
        action = self._answers.get(name) or replace(look.action, deeds=[], requests=[], answers=[])
        deeds = action.deeds
        if self._deeds:
            # The deed that begins picking stays the agent's: no action can name it.
            own = [deed for deed in action.deeds if isinstance(deed, PickFrom)]
            deeds = [*arrays.deeds_of(self.local.engine.world, name, command.deed), *own]
        self._answers[name] = replace(action, twist=command.velocity, deeds=deeds, hold=None)
        if isinstance(action.memory, RobotMemory):
            action.memory.moving = command.velocity != STILL

    def _observed(self) -> dict[str, Arrays]:
        """Return what each learned body observes."""
        observed = {}
        for name, look in self._looks.items():
            observed[name] = arrays.observed(look.seen, look.fill, look.goal, look.action)
        return observed

    def _infos(self) -> Infos:
        """Return the scripted velocity of each learned body, and which deeds it can try."""
        infos: Infos = {}
        for name, look in self._looks.items():
            twist = look.action.twist
            infos[name] = {"scripted": np.array((twist.x, twist.yaw))}
            if self._deeds:
                deed_mask = arrays.deed_mask(self.local.engine.world, name)
                infos[name]["action_mask"] = {"velocity": None, "deed": deed_mask}
        return infos


def _moment(before: Look, after: Look, velocity: Twist, events: list[Event]) -> Moment:
    """Return the step of a body between two looks at it. `velocity`: with which it was to move."""
    # A body that has another bin has filled nothing in this step.
    filled = 0.0
    if _bin_of(before) == _bin_of(after):
        filled = max(0.0, after.fill - before.fill)
    return Moment(
        before=before.seen,
        after=after.seen,
        goal=before.goal,
        velocity=velocity,
        scripted=before.action.twist,
        filled=filled,
        events=events,
    )


def _bin_of(look: Look) -> str:
    """Return the name of the bin that a body tows; '' without one."""
    if look.seen.hitch:
        return look.seen.hitch.name
    return ""


def _changes_in(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the changes of the scenario in the options of a reset.

    Other options are ignored, because PettingZoo's own test of environments gives some.
    """
    changes = options.get("scenario", {})
    if not isinstance(changes, Mapping):
        raise ValueError(f"options: scenario = {changes!r}: must be a map of keys and values")
    return dict(changes)


def _refuse_what_cannot_learn(layout: Layout, learned: Sequence[str]) -> None:
    """Raise ValueError for a name of which no body can learn, for one given twice, and for none."""
    able = layout.names_of(*MOVERS)
    problems = []
    for name in learned:
        if name not in able:
            problems.append(f"{name}: no such body can learn")
        elif learned.count(name) > 1:
            problems.append(f"{name}: given twice")
    if not learned:
        problems.append("empty")
    if problems:
        problem = "; ".join(dict.fromkeys(problems))
        raise ValueError(f"learned: {problem}; there are {', '.join(able)}")


parallel_env = HarvestEnv  # PettingZoo's name for what makes an environment


class SingleEnv(gymnasium.Env[Arrays, Any]):
    """A harvest in which one body learns; all others follow our agents.

    `harvest` is a HarvestEnv in which no other body learns.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as Gymnasium has it

    def __init__(self, scenario: Scenario, robot: str, **options: Any) -> None:
        """`options`: reward, deeds, longest and is_hashed, as for `HarvestEnv`. Raises as
        it does.
        """
        self.robot = robot
        self.harvest = HarvestEnv(scenario, [robot], **options)
        self.observation_space: spaces.Space[Any] = self.harvest.observation_space(robot)
        self.action_space: spaces.Space[Any] = self.harvest.action_space(robot)

    @property
    def local(self) -> Local:
        """The run of this episode, from the first `reset` on."""
        return self.harvest.local

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Arrays, dict[str, Any]]:
        """Begin an episode, as `HarvestEnv.reset` does. Return observation and info."""
        super().reset(seed=plain(seed))
        observations, infos = self.harvest.reset(seed, options)
        return observations[self.robot], infos[self.robot]

    def step(self, action: Any) -> tuple[Arrays, float, bool, bool, dict[str, Any]]:
        """Move on by a tick, 0.1 s.

        Return observation, reward, terminated, truncated and info. Raises as `HarvestEnv.step`
        does.
        """
        observations, rewards, terminated, truncated, infos = self.harvest.step(
            {self.robot: action}
        )
        name = self.robot
        return observations[name], rewards[name], terminated[name], truncated[name], infos[name]


single_env = SingleEnv
