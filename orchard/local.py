"""The whole program in one loop, without a network.

At each tick the engine observes, agents are asked, their mail is collected, and the world steps.

Start reading here, and then follow the data:

    orchard.field.scenario   what a user sets, read from YAML and checked
    orchard.field.layout     scenario -> fences, trees, lanes, and the start of each body
    orchard.sim.engine       one step of the simulation, by world (the state), physics and scan
    orchard.contract         what an agent receives and returns: observation, mail, action
    orchard.behaviour        what each kind of robot, person and animal does

`orchard.saved_run` makes a snapshot of a run, and `orchard.fork` changes one.
`orchard.server.loop` is the same loop with the network in the middle.
"""

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from orchard.behaviour.catalogue import guarded, make_agents
from orchard.contract.agent import Action, Agent, Mail, Observation, Observations
from orchard.contract.events import Event
from orchard.contract.guard import Guard
from orchard.contract.mail import LocalMail, digest_of
from orchard.contract.messages import pack, unpack
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.fork.forked import forked
from orchard.report.ending import jam_of, why_over
from orchard.report.metrics import HarvestFigures
from orchard.report.plan import present_plan
from orchard.saved_run import figures_in, memories_in, snapshot_of, without_players
from orchard.sim.engine import Engine
from orchard.sim.lookahead import Lookahead
from orchard.sim.snapshot import Snapshot


class Local:
    """An orchard and all its agents in one process. Call `tick()` until the run has `ended`.

    >>> run = Local(Scenario(rows=3, row_length=20.0))
    >>> for _ in range(20):
    ...     events = run.tick()
    >>> run.engine.tick, run.ended
    (20, '')
    >>> again = Local.resume(run.snapshot())
    >>> again.engine.hash == run.engine.hash
    True
    """

    def __init__(
        self,
        scenario: Scenario,
        agents: dict[str, Agent] | None = None,
        check_agents: bool = False,
        *,
        holds: type[Lookahead] = Lookahead,
        is_hashed: bool = True,
        engine: type[Engine] = Engine,
    ) -> None:
        """`agents`: name -> agent; each is guarded. None: those of the scenario.

        `check_agents`: check that own agents are repeatable; what is not is logged, and the state
        of its action is `broken`. `holds`: which agents are asked at a tick, see
        `orchard.sim.lookahead`. `is_hashed`: False for a run of a study, which is a tenth faster
        without its hash. `engine`: `Unaudited` for a run that is neither hashed nor checked.
        """
        self.engine = engine.begin(scenario, holds, is_hashed)
        self._check_agents = check_agents
        self._figures = HarvestFigures()
        if agents is None:
            agents = dict(make_agents(self.engine.layout))
        self.agents = {name: self._guarded(name, agent) for name, agent in agents.items()}
        self.memories: dict[str, Any] = {}
        # The actions of the agents that were asked at the last tick.
        self.answers: dict[str, Action] = {}
        # The agent that was ticked last.
        self.thinking = ""
        self.post = LocalMail()
        self._seen: Observations | None = None
        # The observations of the agents that were asked.
        self.observed: dict[str, Observation] = {}
        # The names given to `play`.
        self._played = set[str]()
        # Name -> digest of the mail that the agent heard at that tick.
        self._digests: dict[str, bytes] = {}

    @classmethod
    def resume(
        cls,
        snapshot: Snapshot,
        check_agents: bool = False,
        holds: type[Lookahead] = Lookahead,
        is_hashed: bool = True,
    ) -> "Local":
        """Return the run of a snapshot, which continues at the snapshot's tick, as often as you
        resume it. Raises SnapshotError.
        """
        engine = Engine.resume(snapshot, holds, is_hashed)
        local = cls(engine.scenario, check_agents=check_agents)
        local.engine = engine
        local.post = LocalMail(dict(snapshot.letters))
        local._figures = figures_in(snapshot, engine.tick)
        local.memories = memories_in(snapshot, local.agents)
        return local

    def snapshot(self) -> Snapshot:
        """Return the state of the run between two ticks, as data."""
        return snapshot_of(self.engine, self.agents, self.memories, self.post, self._figures)

    def fork(self, stop: Sequence[str] = (), **changes: Any) -> "Local":
        """Return a run that goes on from this moment with some values changed, as with
        `with_changes`: see `orchard.fork`.

        `stop`: robots that stand from now on. This run stays as it is. Agents that are not of the
        scenario are left behind.
        """
        snapshot = without_players(self.snapshot(), self._played)
        return Local.resume(forked(snapshot, changes, stop))

    def play(self, name: str, agent: Agent) -> None:
        """Let `agent` drive `name` from the next tick on.

        If it raises an error, its robot stands and the run goes on (see `Guard`).

        It receives the memory of the agent that it replaces, or None if it does not fit `Memory`.
        Raises ValueError for an unknown name, TypeError for an agent that derives from a built-in
        one and has another `Memory`.
        """
        if name not in self.engine.layout.agents:
            raise ValueError(
                f"{name}: no such agent; there are {', '.join(self.engine.layout.agents)}"
            )
        self.agents = dict(sorted({**self.agents, name: self._guarded(name, agent)}.items()))
        self._played.add(name)
        self.engine.wake([name])
        memory = self.memories.pop(name, None)
        # The memory of another class of agent may not fit: then this one begins without.
        with suppress(ValueError):
            self.memories[name] = unpack(pack(memory), self.agents[name].Memory)

    def _guarded(self, name: str, agent: Agent) -> Guard:
        """Return an agent so that its mistakes do not end the run."""
        guard = guarded(self.engine.layout, name, agent)
        if self._check_agents:
            guard.check()
        return guard

    def _repr_svg_(self) -> str:
        """Return the plan of the orchard as it is now: Jupyter shows it for a run."""
        return present_plan(self.engine.world)

    @property
    def ended(self) -> str:
        """Why the run is over, as in a summary: 'harvested', 'jammed', 'broken' (all pickers), or
        'refused'; '' while it goes on.
        """
        return why_over(self.engine, self._figures)

    @property
    def jam(self) -> list[str]:
        """Which robot waits for what, one line each, once the run has jammed; else empty."""
        return jam_of(self.engine, self._figures)

    @property
    def seen(self) -> Observations:
        """What all bodies observed at the tick at which agents were asked last; before the first
        tick, what they observe now.
        """
        if self._seen is None:
            self._seen = self.engine.observe()
        return self._seen

    def tick(self) -> list[Event]:
        """Advance the run by one tick, 0.1 s, and return the events of the step.

        Raises RuntimeError if the run has `ended` without being harvested, and nothing has gone on
        for twice the time after which a run is jammed. To go on all the same, call `act(ask())`.
        """
        if self._figures.stuck(self.engine.world):
            self._refuse_to_wait()
        return self.act(self.ask())

    def _refuse_to_wait(self) -> None:
        """Raise RuntimeError unless the run is harvested."""
        if self.ended == "harvested":
            return
        idle = self.engine.tick - self._figures.progress_tick
        jam = "".join(f"\n  {line}" for line in self.jam)
        raise RuntimeError(
            f"the run has ended ({self.ended}): nothing has gone on for {idle * TIME_STEP:.0f} s,"
            f" up to tick {self.engine.tick}:{jam}\nEnd a loop with `while not run.ended`. To go on"
            " all the same, call `run.act(run.ask())`."
        )

    def ask(self) -> dict[str, Action]:
        """Let the agents that are due at this tick act on what they observe and hear.

        Return their actions, for `act`.
        """
        self._seen = self.engine.observe()
        mail = self.post.deliver(self.engine.tick)
        asked = [name for name in self.engine.due(mail) if name in self.agents]
        self._digests = {}
        if self.engine.is_hashed:
            # The digests are made before the agents can change their mail.
            self._digests = {name: digest_of(heard) for name, heard in mail.items()}
        self.observed = self._seen.of(asked)
        answers = {}
        for name, observation in self.observed.items():
            answers[name] = self._ask(name, observation, mail.get(name) or Mail())
        return answers

    def act(self, answers: dict[str, Action]) -> list[Event]:
        """Collect the mail of these actions, advance the run by one tick, and return the events of
        the step.
        """
        self.answers = answers
        for name, action in answers.items():
            self.post.collect(name, self.engine.tick, action)
        events = self.engine.advance(answers, self._digests)
        self._figures.watch(self.engine.world, self.engine.answers)
        return events

    def _ask(self, name: str, observation: Observation, heard: Mail) -> Action:
        """Let an agent act on what it observes and hears."""
        self.thinking = name
        action = self.agents[name].tick(observation, heard, self.memories.get(name))
        self.memories[name] = action.memory
        return action

    @property
    def actions(self) -> dict[str, Action]:
        """The newest action of each agent that drives or holds."""
        return self.engine.actions
