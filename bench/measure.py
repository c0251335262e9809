"""All measurements, one after another, and the goals that they are held against."""

import os
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import field as made
from statistics import median

from bench import core, floor, program, rivals
from bench.field import field, growing

CLOCKED_SECONDS = 60
ROBOTS = (10, 30, 100, 300, 1000)
SECONDS = 3.0  # for one figure
FLOOR_SECONDS = 4.0
ROUNDS = 3  # of lockstep, each without and with a recording
TICKS = {"default": 300, "20x20": 60}  # of one of the five stretches in local mode
WORDS = {"default": [], "20x20": ["--rows", "20", "--pickers", "20"]}
SMALL = ["--rows", "3", "--pickers", "2"]
HOSTS = {"default, 2": ("default", "2", 4000), "default, each": ("default", "each", 800), "20x20, 2": ("20x20", "2", 800)}

Say = Callable[[str], None]
Goal = tuple[str, str, str, bool]


@dataclass(frozen=True)
class Lockstep:
    """Ticks/s of one way to run it."""

    hosts: str
    floor: float
    apart: float  # the floor, with a message for each body's pose, scan and velocity
    plain: float
    recorded: float


@dataclass
class Results:
    """Steps/s, unless a name says otherwise."""

    core: dict[int, float] = made(default_factory=dict)  # robots ->
    growing: dict[int, float] = made(default_factory=dict)  # robots -> us for one robot's step
    rivals: dict[str, dict[int, float]] = made(default_factory=dict)
    missing: dict[str, str] = made(default_factory=dict)  # rival -> why it could not be installed
    local: dict[str, tuple[float, int]] = made(default_factory=dict)  # scenario -> ticks/s, agents
    lockstep: dict[str, Lockstep] = made(default_factory=dict)
    start: dict[str, program.Look] = made(default_factory=dict)
    physics_megabytes: float = 0.0
    realtime: program.Clocked = made(default_factory=lambda: program.Clocked(0.0, 1, 0, 0.0, 0.0))
    load: tuple[float, float] = (0.0, 0.0)  # of the machine, before and after

    def goals(self) -> list[Goal]:
        """(goal, wanted, measured, met)."""
        return [*self._core_goals(), *self._program_goals(), *self._size_goals()]

    def of(self, rival: str, robots: int) -> float:
        """A rival's steps/s, quoted if it was not measured."""
        return self.rivals.get(rival, {}).get(robots) or rivals.QUOTED[rival][ROBOTS.index(robots)]

    def _core_goals(self) -> list[Goal]:
        wanted = [("navground", 30, 150), ("IR-SIM", 30, 250), ("IR-SIM", 1000, 100)]
        ratios = [(name, n, least, self.core[n] / self.of(name, n)) for name, n, least in wanted]
        goals = [(f"core, times {name} at N = {n}", f">= {least}", f"{ratio:.0f}", ratio >= least) for name, n, least, ratio in ratios]
        growth = self.growing[1000] / self.growing[30]
        return [*goals, ("core, a robot's step at N = 1000 over N = 30, growing field", "<= 2", f"{growth:.2f}", growth <= 2)]

    def _program_goals(self) -> list[Goal]:
        wanted = (("default", 2000), ("20x20", 500))
        goals = [_at_least(f"local mode, {name}, ticks/s", least, self.local[name][0]) for name, least in wanted]
        (small, few), (large, many) = self.local["3x2"], self.local["20x20"]
        growth = (few * small) / (many * large)
        goals.append(("local mode, an agent's tick at 20x20 over 3x2", "<= 2", f"{growth:.2f}", growth <= 2))
        for name, run in self.lockstep.items():
            share, recorded = run.plain / run.floor, run.recorded / run.plain
            goals.append((f"lockstep, {name}: of the floor", ">= 0.6", f"{share:.2f}", share >= 0.6))
            goals.append((f"lockstep, {name}: recording, of without", ">= 0.7", f"{recorded:.2f}", recorded >= 0.7))
        for name, least in (("default, 2", 1000), ("default, each", 200), ("20x20, 2", 300)):
            goals.append(_at_least(f"lockstep, {name}, ticks/s", least, self.lockstep[name].plain))
        best = max((self.of(name, 30), name) for name in rivals.QUOTED)
        plain = self.lockstep["default, 2"].plain
        return [*goals, (f"lockstep ahead of all peers at N = 30 ({best[1]})", f"> {best[0]:.0f}", f"{plain:.0f}", plain > best[0])]

    def _size_goals(self) -> list[Goal]:
        starts = [(name, most, self.start[name].first_tick) for name, most in (("default", 2.5), ("20x20", 6.0))]
        goals = [(f"start, {name}, s", f"< {most}", f"{seconds:.1f}", seconds < most) for name, most, seconds in starts]
        agents = max(look.megabytes["processes.agents"] for look in self.start.values())
        goals.append(("physics with 1000 robots, MB", "< 200", f"{self.physics_megabytes:.0f}", self.physics_megabytes < 200))
        goals.append(("an agent process, MB", "< 80", f"{agents:.0f}", agents < 80))
        real, missed = self.realtime, self.realtime.missed / self.realtime.answers
        goals.append(("real time, one process each: of a core, all together", "< 40 %", f"{real.cores:.0%}", real.cores < 0.4))
        return [*goals, ("real time: missed deadlines", "< 0.1 %", f"{missed:.3%}", missed < 0.001)]


def _at_least(goal: str, least: float, value: float) -> Goal:
    return goal, f">= {least:,}", f"{value:,.0f}", value >= least


def _core(results: Results, say: Say) -> None:
    for n in ROBOTS:
        say(f"our core, {n} robots")
        results.core[n] = core.steps_per_second(field(n), SECONDS)
        results.growing[n] = 1e6 / core.steps_per_second(growing(n), SECONDS) / n


def _rivals(results: Results, say: Say) -> None:
    for name in rivals.PACKAGES:
        say(f"installing {name}")
        if why := rivals.install(name):
            results.missing[name] = why
            continue
        results.rivals[name] = {}
        for n in ROBOTS:
            say(f"{name}, {n} robots")
            try:
                results.rivals[name][n] = rivals.steps_per_second(name, n, SECONDS)
            except (RuntimeError, subprocess.TimeoutExpired) as error:
                say(str(error))


def _local(results: Results, say: Say) -> None:
    for name, words in {"3x2": SMALL, **WORDS}.items():
        say(f"local mode, {name}")
        results.local[name] = program.local_ticks_per_second(words, TICKS.get(name, 300))


def _start(results: Results, say: Say) -> None:
    say("physics with 1000 robots")
    results.physics_megabytes = program.physics_megabytes(1000)
    for name, words in WORDS.items():
        say(f"start, {name}")
        program.look_at(words, "2", 1, 2)  # what is compiled is kept
        results.start[name] = program.look_at(words, "2", 50, 2)


def _lockstep(results: Results, say: Say) -> None:
    for name, (which, hosts, ticks) in HOSTS.items():
        say(f"lockstep, {name}: the floor")
        words = WORDS[which]
        clients = results.local[which][1] if hosts == "each" else int(hosts)
        traffic = results.start[which].traffic if hosts != "each" else program.look_at(words, hosts, 50, clients).traffic
        bare = floor.ticks_per_second(traffic, FLOOR_SECONDS)
        apart = floor.ticks_per_second(traffic.apart(results.local[which][1]), FLOOR_SECONDS)
        rounds = []
        for number in range(1, ROUNDS + 1):
            say(f"lockstep, {name}, without and with recording, {number} of {ROUNDS}")
            rounds.append([program.lockstep_ticks_per_second(words, hosts, ticks, record) for record in (False, True)])
        plain, recorded = map(median, zip(*rounds, strict=True))
        results.lockstep[name] = Lockstep(hosts, bare, apart, plain, recorded)


def _realtime(results: Results, say: Say) -> None:
    say("real time, one process for each agent")
    results.realtime = program.clocked(CLOCKED_SECONDS)


SECTIONS = (_core, _rivals, _local, _start, _lockstep, _realtime)
STEPS = 1 * len(ROBOTS) + 3 * (len(ROBOTS) + 1) + 3 + 3 + (1 + ROUNDS) * len(HOSTS) + 1  # how often they say something


def measure(say: Say) -> Results:
    """Everything; `say` is told what comes next."""
    results, before = Results(), os.getloadavg()[0]
    for section in SECTIONS:
        section(results, say)
    results.load = (before, os.getloadavg()[0])
    return results
