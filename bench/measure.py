"""Runs all benchmarks one after another, and compares the results with the goals."""

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
ROUNDS = (
    3  # of lockstep; each has a run with holds, one with holds ignored, and one with a recording
)
TICKS = {
    "3x2": 600,
    "default": 1000,
    "20x20": 600,
}  # of each of the five measurements in local mode
PROFILE_TICKS = 600  # of which the messages are recorded
OPTIONS = {"default": [], "20x20": ["--rows", "20", "--pickers", "20"]}
SMALL = ["--rows", "3", "--pickers", "2"]
LOCKSTEP_RUNS = {  # name -> (scenario, hosts, ticks)
    "default, 2": ("default", "2", 4000),
    "default, each": ("default", "each", 2000),
    "20x20, 2": ("20x20", "2", 2000),
}

Say = Callable[[str], None]
Goal = tuple[str, str, str, bool]  # goal, wanted, measured, whether it is met


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
    missing: dict[str, str] = made(
        default_factory=dict
    )  # simulator -> why it could not be installed
    local: dict[str, program.LocalFigures] = made(default_factory=dict)  # scenario -> its figures
    lockstep: dict[str, Lockstep] = made(default_factory=dict)
    start: dict[str, program.RunProfile] = made(default_factory=dict)
    physics_megabytes: float = 0.0
    realtime: program.RealtimeFigures = made(
        default_factory=lambda: program.RealtimeFigures(0.0, 1, 0, 0.0, 0.0)
    )
    load: tuple[float, float] = (
        0.0,
        0.0,
    )  # one-minute load averages of the machine, before and after

    def goals(self) -> list[Goal]:
        """Return all goals with the measured values."""
        return [*self._core_goals(), *self._program_goals(), *self._size_goals()]

    def of(self, peer: str, robots: int) -> float:
        """Return the rate of a peer; the quoted rate if it was not measured."""
        return (
            self.peers.get(peer, {}).get(robots)
            or peer_simulators.QUOTED[peer][ROBOTS.index(robots)]
        )

    def _core_goals(self) -> list[Goal]:
        wanted = [("navground", 30, 150), ("IR-SIM", 30, 250), ("IR-SIM", 1000, 100)]
        ratios = [(name, n, least, self.core[n] / self.of(name, n)) for name, n, least in wanted]
        goals = [
            (f"core: rate / {name} at N = {n}", f">= {least}", f"{ratio:.0f}", ratio >= least)
            for name, n, least, ratio in ratios
        ]
        growth = self.growing[1000] / self.growing[30]
        goals += [
            _at_least(f"core, N = {n}, steps/s", least, self.core[n])
            for n, least in ((10, 75_000), (30, 33_000))
        ]
        return [
            *goals,
            (
                "core, time of one robot's step: N = 1000 / N = 30, growing field",
                "<= 2",
                f"{growth:.2f}",
                growth <= 2,
            ),
        ]

    def _program_goals(self) -> list[Goal]:
        goals: list[Goal] = []
        for name, most in (("default", 0.12), ("20x20", 0.15)):
            figures = self.local[name]
            goals.append(
                (
                    f"agents asked, {name}",
                    f"<= {most}",
                    f"{figures.asked:.3f}",
                    figures.asked <= most,
                )
            )
            goals.append(
                _times(
                    f"local mode, {name}: rate with holds / holds ignored",
                    2.5,
                    figures.rate / figures.ignored,
                )
            )
        small, large = self.local["3x2"], self.local["20x20"]
        growth = (small.agents * small.rate) / (large.agents * large.rate)
        goals.append(
            (
                "local mode, time of one agent's tick: 20x20 / 3x2",
                "<= 2",
                f"{growth:.2f}",
                growth <= 2,
            )
        )
        for name, times, least in (
            ("default, 2", 1.7, 1300),
            ("20x20, 2", 1.7, 600),
            ("default, each", 4.0, 450),
        ):
            run = self.lockstep[name]
            goals.append(
                _times(
                    f"lockstep, {name}: rate with holds / holds ignored",
                    times,
                    run.plain / run.ignored,
                )
            )
            goals.append(_at_least(f"lockstep, {name}, ticks/s", least, run.plain))
            goals.append(
                _times(f"lockstep, {name}: rate / attainable", 0.6, run.plain / run.attainable)
            )
            goals.append(
                _times(
                    f"lockstep, {name}: rate with / without recording",
                    0.8,
                    run.recorded / run.plain,
                )
            )
        best = max((self.of(name, 30), name) for name in peer_simulators.QUOTED)
        plain = self.lockstep["default, 2"].plain
        return [
            *goals,
            (
                f"lockstep, ticks/s, above all peers at N = 30 ({best[1]})",
                f"> {best[0]:.0f}",
                f"{plain:.0f}",
                plain > best[0],
            ),
        ]

    def _size_goals(self) -> list[Goal]:
        starts = [
            (name, most, self.start[name].first_tick)
            for name, most in (("default", 2.5), ("20x20", 6.0))
        ]
        goals = [
            (f"start, {name}, s", f"< {most}", f"{seconds:.1f}", seconds < most)
            for name, most, seconds in starts
        ]
        megabytes = max(
            profile.megabytes["orchard.processes.agents"] for profile in self.start.values()
        )
        goals.append(
            (
                "physics with 1000 robots, MB",
                "< 200",
                f"{self.physics_megabytes:.0f}",
                self.physics_megabytes < 200,
            )
        )
        goals.append(("an agent process, MB", "< 80", f"{megabytes:.0f}", megabytes < 80))
        real, missed = self.realtime, self.realtime.missed / self.realtime.answers
        goals.append(
            (
                "real time, one process for each agent: share of a core",
                "< 40 %",
                f"{real.cores:.0%}",
                real.cores < 0.4,
            )
        )
        return [*goals, ("real time: missed deadlines", "< 0.1 %", f"{missed:.3%}", missed < 0.001)]


def _at_least(goal: str, least: float, value: float) -> Goal:
    return goal, f">= {least:,}", f"{value:,.0f}", value >= least


def _times(goal: str, least: float, ratio: float) -> Goal:
    return goal, f">= {least:g}", f"{ratio:.2f}", ratio >= least


def _core(results: Results, say: Say) -> None:
    for n in ROBOTS:
        say(f"our core, {n} robots")
        results.core[n] = core.steps_per_second(field(n), SECONDS)
        results.growing[n] = 1e6 / core.steps_per_second(growing(n), SECONDS) / n


def _peers(results: Results, say: Say) -> None:
    for name in peer_simulators.PACKAGES:
        say(f"installing {name}")
        if why := peer_simulators.install(name):
            results.missing[name] = why
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
        options, profile = OPTIONS[scenario], results.start[scenario]
        if hosts == "each":
            profile = program.profile_run(options, hosts, PROFILE_TICKS)
        trace = program.trace_of(options, hosts, ticks, profile.sizes)
        messages = 1.0 / median(floor.ticks_per_second(trace) for _ in range(ROUNDS))
        chain = program.chain_seconds(options, hosts, ticks)
        rounds, rate = [], partial(program.lockstep_ticks_per_second, options, hosts)
        for number in range(1, ROUNDS + 1):
            say(f"lockstep, {name}: with holds, holds ignored, recording, {number} of {ROUNDS}")
            rounds.append(
                [rate(ticks), rate(ticks // 2, "--ignore-holds"), rate(ticks, record=True)]
            )
        results.lockstep[name] = Lockstep(
            hosts,
            trace.asked,
            trace.requests,
            messages,
            chain,
            *map(median, zip(*rounds, strict=True)),
        )


def _realtime(results: Results, say: Say) -> None:
    say("real time, one process for each agent")
    results.realtime = program.realtime_figures(REALTIME_SECONDS)


SECTIONS = (_core, _peers, _local, _start, _lockstep, _realtime)
STEPS = (
    1 * len(ROBOTS) + 3 * (len(ROBOTS) + 1) + 3 + 3 + (1 + ROUNDS) * len(LOCKSTEP_RUNS) + 1
)  # calls of `say` if nothing fails


def measure(say: Say) -> Results:
    """Run all benchmarks. `say` gets a line before each."""
    results, before = Results(), os.getloadavg()[0]
    for section in SECTIONS:
        section(results, say)
    results.load = (before, os.getloadavg()[0])
    return results
