"""The results of the benchmarks as Markdown: bench/results.md."""

import os
import platform
from importlib.metadata import version
from pathlib import Path

from bench.learning_report import with_learning
from bench.measure import ROBOTS, Lockstep, Results
from bench.peer_simulators import PACKAGES, QUOTED

HEAD = """\
# Benchmarks

For people who ask how fast the Orchard is. After this page you know its rates beside those of other
simulators, and can measure them again."""
METHOD = """\
## Method

All measurements run on one machine, one after another. Each of our rates is the median of five. The
cores are timed in processor time, and all else in wall time. A machine that shares its processor is
slower at times, by up to a factor of three: compare ratios, within one run.

**Core.** A field of 100 x 64 m, fenced, with 5 lines of 12 trees and 11 posts, and N robots of 1.0
x 0.8 m. Each has a laser of 180 beams over half a turn, up to 10 m. A step of 0.1 s is a scan of
each robot, exact to 1e-9 m, and its movement with collisions, in one thread, without drawing
(`bench/field.py`). All simulators get the same places and velocities.

**Attainable** is a rate without any loss. *Messages*: bare Zenoh sends the messages of the run
again, and nothing else (`bench/floor.py`).
*Chain*: the longest chain of computing in local mode. A lockstep run is `run.py` with real agents.
Its rates are medians of three runs.

**Start** is the time from the start of `run.py` to the first tick on the bus. **Memory** is
resident.

## Differences between the simulators

- In IR-SIM a robot that has collided stays where it is; that makes it faster. The lidar of irsim-x
  does not see other robots.
- In navground robots are discs, a tree is four walls, and numbers have single precision. Its lasers
  are called from Python one by one.
- Stage is not in the package registry: its figures are quoted, from another run on a similar
  machine. Its mean error on hits is 3 cm at
  0.02 m and 12 cm at 0.1 m.
- Gazebo was not measured.

`make bench` measures all of this again in less than ten minutes, except *Learning*. It installs the
other simulators into `.bench/`.
"""


def markdown(results: Results) -> str:
    """Return the text of bench/results.md."""
    parts = [HEAD, _machine(results), _core(results), _goals(results), _program(results), METHOD]
    return with_learning("\n\n".join(part.strip() for part in parts) + "\n")


def table(head: list[str], rows: list[list[str]]) -> str:
    """Return a Markdown table."""
    top, *body = (f"| {' | '.join(line)} |" for line in (head, *rows))
    return "\n".join([top, f"|{'---|' * len(head)}", *body])


def rate(value: float | None) -> str:
    """Return a rate as text: whole from 100 on, below with three significant digits; '-'
    for None.
    """
    if value is None:
        return "-"
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def _machine(results: Results) -> str:
    ours = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "eclipse-zenoh"))
    others = ", ".join(PACKAGES.values())
    before, after = results.load
    return (
        f"Measured by `make bench` with Python {platform.python_version()}, {ours}; {others}; on"
        f" {os.cpu_count()} cores of {_processor()} (load before {before:.1f}, after {after:.1f})."
        " All figures are from that run, except those marked *quoted* and those of *Learning*,"
        " which have a run of their own."
    )


def _processor() -> str:
    """Return the name of the processor."""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown"


def _core(results: Results) -> str:
    head = ["steps/s with N robots", *map(str, ROBOTS)]
    rows = [["**our core**", *(f"**{rate(results.core[n])}**" for n in ROBOTS)]]
    for name, figures in results.peers.items():
        rows.append([PACKAGES[name].replace("==", " "), *(rate(figures.get(n)) for n in ROBOTS)])
    quoted = [name for name in QUOTED if name not in results.peers]
    rows += [[f"{name}, *quoted*", *map(rate, QUOTED[name])] for name in quoted]
    notes = ""
    for name, why in results.missing.items():
        notes += f"\n\n{name} could not be installed ({why}): its figures are quoted."
    growth = ["time of one robot's step, us, in a field that grows with N"]
    growth += [f"{results.growing[n]:.2f}" for n in ROBOTS]
    growing = table(["", *map(str, ROBOTS)], [growth])
    return f"## The core\n\n{table(head, rows)}{notes}\n\n{growing}"


def _goals(results: Results) -> str:
    """Return how many goals are met, and which are not."""
    goals = results.goals()
    missed = []
    for goal, wanted, measured, is_met in goals:
        if not is_met:
            missed.append(f"{goal}, {measured} where {wanted} is wanted")
    return (
        f"Of {len(goals)} goals (`bench/measure.py`) {len(goals) - len(missed)} are met; not met:"
        f" {'; '.join(missed) or 'none'}."
    )


def _program(results: Results) -> str:
    local = [
        [
            name,
            str(run.agents),
            f"{run.asked:.3f}",
            rate(run.rate),
            rate(run.ignored),
            f"{run.rate / run.ignored:.2f}",
        ]
        for name, run in results.local.items()
    ]
    lockstep = [[name, *_rates(run)] for name, run in results.lockstep.items()]
    start = [
        [
            name,
            f"{profile.first_tick:.1f}",
            f"{profile.megabytes['orchard.processes.physics']:.0f}",
            f"{profile.megabytes['orchard.processes.agents']:.0f}",
        ]
        for name, profile in results.start.items()
    ]
    heads = (
        [
            "local mode",
            "agents",
            "share of them asked",
            "ticks/s",
            "holds ignored",
            "with / ignored",
        ],
        [
            "lockstep",
            "hosts",
            "asked in a tick",
            "requests in a tick",
            "messages, us",
            "chain, us",
            "attainable, ticks/s",
            "ticks/s",
            "/ attainable",
            "holds ignored",
            "with / ignored",
            "recording",
            "/ without",
        ],
        ["start, two agent processes", "first tick, s", "physics, MB", "an agent process, MB"],
    )
    tables = "\n\n".join(
        table(head, rows) for head, rows in zip(heads, (local, lockstep, start), strict=True)
    )
    return (
        f"## The program\n\n{tables}\n\nPhysics with 1000 robots uses"
        f" {results.physics_megabytes:.0f} MB.\n\n{_realtime(results)}"
    )


def _rates(run: Lockstep) -> list[str]:
    costs = [
        f"{run.asked:.2f}",
        f"{run.requests:.2f}",
        f"{1e6 * run.messages:.0f}",
        f"{1e6 * run.chain:.0f}",
        rate(run.attainable),
    ]
    return [
        run.hosts,
        *costs,
        rate(run.plain),
        f"{run.plain / run.attainable:.2f}",
        rate(run.ignored),
        f"{run.plain / run.ignored:.2f}",
        rate(run.recorded),
        f"{run.recorded / run.plain:.2f}",
    ]


def _realtime(results: Results) -> str:
    run = results.realtime
    return (
        "Real time, default scenario at speed 1, one process for each agent: all processes"
        f" together use {run.cores:.0%} of a core; {run.missed} of {run.answers:,} answers came too"
        " late for their tick; the time from the observation to the arrival of the velocity is"
        f" {run.p50:g} ms (p50) and {run.p99:g} ms (p99)."
    )
