"""Runs all benchmarks one after another, and compares the results with the goals.

A scenario is named by its rows and pickers, as 20x20. "Asked" are the agents, or processes, that
must answer at a tick; with "holds ignored" all are asked at each tick. `report.py` writes the
results.
"""

import os
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import field as made
from functools import partial
from statistics import median

from bench import core, floor, peer_simulators, program
from bench.field import field, growing

REALTIME_SECONDS = 60  # of a realtime run
ROBOTS = (10, 30, 100, 300, 1000)
SECONDS = 3.0  # of measurement for one figure
# Of lockstep. Each has a run with holds, one with holds ignored, and one with a recording.
ROUNDS = 3
# Scenario -> ticks of each of the five measurements in local mode.
TICKS = {"3x2": 600, "default": 1000, "20x20": 600}
# Ticks of which the messages are recorded.
PROFILE_TICKS = 600
# Scenario -> options of `orchard`.
OPTIONS = {"default": [], "20x20": ["--rows", "20", "--pickers", "20"]}
SMALL = ["--rows", "3", "--pickers", "2"]
# Name -> scenario, hosts, ticks.
LOCKSTEP_RUNS = {
    "default, 2": ("default", "2", 4000),
    "default, each": ("default", "each", 2000),
    "20x20, 2": ("20x20", "2", 2000),
}

Say = Callable[[str], None]
# The goal, the value that is wanted, the value that was measured, and whether the goal is met.
Goal = tuple[str, str, str, bool]


@dataclass(frozen=True)
class Lockstep:
    """Rates of one lockstep run, ticks/s."""

    hosts: str
    asked: float  # processes that are asked at a tick, mean
    requests: float  # of agents to each other at a tick, mean
    messages: float  # s a tick that bare Zenoh takes for the messages that are really sent
    chain: float  # s a tick of the longest chain of computing
    plain: float  # without a recording
    ignored: float  # the same with holds ignored
    recorded: float

    @property
    def attainable(self) -> float:
        """The rate at which messages and computing take turns without any loss."""
        return 1.0 / (self.messages + self.chain)


@dataclass
class Results:
    """All results. Rates are steps/s unless the comment says otherwise."""

    core: dict[int, float] = made(default_factory=dict)  # robots -> rate
    growing: dict[int, float] = made(default_factory=dict)  # robots -> us for a step of one robot
    peers: dict[str, dict[int, float]] = made(default_factory=dict)  # simulator -> robots -> rate
    # Simulator -> why it could not be installed.
    missing: dict[str, str] = made(default_factory=dict)
    local: dict[str, program.LocalFigures] = made(default_factory=dict)  # scenario -> its figures
    lockstep: dict[str, Lockstep] = made(default_factory=dict)
    start: dict[str, program.RunProfile] = made(default_factory=dict)
    physics_megabytes: float = 0.0
    realtime: program.RealtimeFigures = made(
        default_factory=lambda: program.RealtimeFigures(0.0, 1, 0, 0.0, 0.0)
    )
    # One-minute load averages of the machine, before and after.
    load: tuple[float, float] = (0.0, 0.0)

    def goals(self) -> list[Goal]:
        """Return all goals with the measured values."""
        return [*self._core_goals(), *self._program_goals(), *self._size_goals()]

    def of(self, peer: str, robots: int) -> float:
        """Return the rate of a peer; the quoted rate if it was not measured."""
        measured = self.peers.get(peer, {}).get(robots)
        return measured or peer_simulators.QUOTED[peer][ROBOTS.index(robots)]

    def _core_goals(self) -> list[Goal]:
        """Return the goals of the core: beside peers, by itself, and as the field grows."""
        goals: list[Goal] = []
        for name, robots, least in (
            ("navground", 30, 150),
            ("IR-SIM", 30, 250),
            ("IR-SIM", 1000, 100),
        ):
            ratio = self.core[robots] / self.of(name, robots)
            goal = f"core: rate / {name} at N = {robots}"
            goals.append((goal, f">= {least}", f"{ratio:.0f}", ratio >= least))
        for robots, least in ((10, 75_000), (30, 33_000)):
            goals.append(_at_least(f"core, N = {robots}, steps/s", least, self.core[robots]))
        growth = self.growing[1000] / self.growing[30]
        goals.append(
            _at_most_twice(
                "core, time of one robot's step: N = 1000 / N = 30, growing field", growth
            )
        )
        return goals

    def _program_goals(self) -> list[Goal]:
        """Return the goals of local mode and of lockstep."""
        goals: list[Goal] = []
        for name, most in (("default", 0.12), ("20x20", 0.15)):
            figures = self.local[name]
            is_met = figures.asked <= most
            goals.append((f"agents asked, {name}", f"<= {most}", f"{figures.asked:.3f}", is_met))
            ratio = figures.rate / figures.ignored
            goals.append(_times(f"local mode, {name}: rate with holds / holds ignored", 2.5, ratio))
        small = self.local["3x2"]
        large = self.local["20x20"]
        growth = (small.agents * small.rate) / (large.agents * large.rate)
        goals.append(_at_most_twice("local mode, time of one agent's tick: 20x20 / 3x2", growth))
        goals += self._lockstep_goals("default, 2", times=1.7, least=1300)
        goals += self._lockstep_goals("20x20, 2", times=1.7, least=600)
        goals += self._lockstep_goals("default, each", times=4.0, least=450)
        best, peer = max((self.of(name, 30), name) for name in peer_simulators.QUOTED)
        plain = self.lockstep["default, 2"].plain
        goal = f"lockstep, ticks/s, above all peers at N = 30 ({peer})"
        goals.append((goal, f"> {best:.0f}", f"{plain:.0f}", plain > best))
        return goals

    def _lockstep_goals(self, name: str, times: float, least: float) -> list[Goal]:
        """Return the goals of a lockstep run.

        `times`: by which factor holds must pay. `least`: ticks/s.
        """
        run = self.lockstep[name]
        holds = f"lockstep, {name}: rate with holds / holds ignored"
        recording = f"lockstep, {name}: rate with / without recording"
        return [
            _times(holds, times, run.plain / run.ignored),
            _at_least(f"lockstep, {name}, ticks/s", least, run.plain),
            _times(f"lockstep, {name}: rate / attainable", 0.6, run.plain / run.attainable),
            _times(recording, 0.8, run.recorded / run.plain),
        ]

    def _size_goals(self) -> list[Goal]:
        """Return the goals of start, memory and real time."""
        goals: list[Goal] = []
        for name, most in (("default", 2.5), ("20x20", 6.0)):
            seconds = self.start[name].first_tick
            goals.append((f"start, {name}, s", f"< {most}", f"{seconds:.1f}", seconds < most))
        physics = self.physics_megabytes
        goals.append(("physics with 1000 robots, MB", "< 200", f"{physics:.0f}", physics < 200))
        sizes = [profile.megabytes["orchard.processes.agents"] for profile in self.start.values()]
        agents = max(sizes)
        goals.append(("an agent process, MB", "< 80", f"{agents:.0f}", agents < 80))
        cores = self.realtime.cores
        share = "real time, one process for each agent: share of a core"
        goals.append((share, "< 40 %", f"{cores:.0%}", cores < 0.4))
        missed = self.realtime.missed / self.realtime.answers
        goals.append(("real time: missed deadlines", "< 0.1 %", f"{missed:.3%}", missed < 0.001))
        return goals


def _at_least(goal: str, least: float, value: float) -> Goal:
    """Return the goal of a rate."""
    return goal, f">= {least:,}", f"{value:,.0f}", value >= least


def _times(goal: str, least: float, ratio: float) -> Goal:
    """Return the goal of a ratio that should be large."""
    return goal, f">= {least:g}", f"{ratio:.2f}", ratio >= least


def _at_most_twice(goal: str, ratio: float) -> Goal:
    """Return the goal of a ratio that should not be above 2."""
    return goal, "<= 2", f"{ratio:.2f}", ratio <= 2


def _core(results: Results, say: Say) -> None:
    for n in ROBOTS:
        say(f"our core, {n} robots")
        results.core[n] = core.steps_per_second(field(n), SECONDS)
        results.growing[n] = 1e6 / core.steps_per_second(growing(n), SECONDS) / n


def _peers(results: Results, say: Say) -> None:
    for name in peer_simulators.PACKAGES:
        say(f"installing {name}")
        why_not = peer_simulators.install(name)
        if why_not:
            results.missing[name] = why_not
            continue
        results.peers[name] = {}
        for n in ROBOTS:
            say(f"{name}, {n} robots")
            try:
                results.peers[name][n] = peer_simulators.steps_per_second(name, n, SECONDS)
            except (RuntimeError, subprocess.TimeoutExpired) as error:
                say(str(error))


def _local(results: Results, say: Say) -> None:
    for name, options in {"3x2": SMALL, **OPTIONS}.items():
        say(f"local mode, {name}")
        results.local[name] = program.local_figures(options, TICKS[name])


def _start(results: Results, say: Say) -> None:
    say("physics with 1000 robots")
    results.physics_megabytes = program.physics_megabytes(1000)
    for name, options in OPTIONS.items():
        say(f"start, {name}")
        program.profile_run(options, "2", 1)  # compiles the kernels, which are then cached
        results.start[name] = program.profile_run(options, "2", PROFILE_TICKS)


def _lockstep(results: Results, say: Say) -> None:
    for name, (scenario, hosts, ticks) in LOCKSTEP_RUNS.items():
        say(f"lockstep, {name}: what is attainable")
        options = OPTIONS[scenario]
        profile = results.start[scenario]
        if hosts == "each":
            profile = program.profile_run(options, hosts, PROFILE_TICKS)
        trace = program.trace_of(options, hosts, ticks, profile.sizes)
        messages = 1.0 / median(floor.ticks_per_second(trace) for _ in range(ROUNDS))
        chain = program.chain_seconds(options, hosts, ticks)
        rate = partial(program.lockstep_ticks_per_second, options, hosts)
        plain = []
        ignored = []
        recorded = []
        for number in range(1, ROUNDS + 1):
            say(f"lockstep, {name}: with holds, holds ignored, recording, {number} of {ROUNDS}")
            plain.append(rate(ticks))
            # Half as many ticks: they take at least twice as long.
            ignored.append(rate(ticks // 2, "--ignore-holds"))
            recorded.append(rate(ticks, record=True))
        results.lockstep[name] = Lockstep(
            hosts=hosts,
            asked=trace.asked,
            requests=trace.requests,
            messages=messages,
            chain=chain,
            plain=median(plain),
            ignored=median(ignored),
            recorded=median(recorded),
        )


def _realtime(results: Results, say: Say) -> None:
    say("real time, one process for each agent")
    results.realtime = program.realtime_figures(REALTIME_SECONDS)


SECTIONS = (_core, _peers, _local, _start, _lockstep, _realtime)
# Calls of `say` in each section, if nothing fails.
_STEPS_OF_PEERS = len(peer_simulators.PACKAGES) * (1 + len(ROBOTS))
_STEPS_OF_LOCAL = 1 + len(OPTIONS)
_STEPS_OF_START = 1 + len(OPTIONS)
_STEPS_OF_LOCKSTEP = (1 + ROUNDS) * len(LOCKSTEP_RUNS)
STEPS = len(ROBOTS) + _STEPS_OF_PEERS + _STEPS_OF_LOCAL + _STEPS_OF_START + _STEPS_OF_LOCKSTEP + 1


def measure(say: Say) -> Results:
    """Run all benchmarks. `say` gets a line before each."""
    results = Results()
    before = os.getloadavg()[0]
    for section in SECTIONS:
        section(results, say)
    results.load = (before, os.getloadavg()[0])
    return results
