"""What was measured, as Markdown."""

import os
import platform
from importlib.metadata import version
from pathlib import Path

from bench.measure import ROBOTS, Lockstep, Results
from bench.rivals import PACKAGES, QUOTED

METHOD = """\
## Method

One machine, one run, one thing at a time. Of our own rates the median of five stretches. The core, ours and the others', is timed
in processor time: each is one thread, so on an idle machine that is wall time. All else is wall time.
A machine whose processor others share is slower at times: trees that hardly differ gave rates a third apart within three hours; compare
the ratios, and rates of one run with each other.

**Core.** A field of 100 x 64 m, fenced, with 5 lines of 12 trees and 11 posts, and N robots of 1.0 x 0.8 m at random places, each
with a laser of 180 beams over half a turn that reaches 10 m; steps of 0.1 s; a new velocity for each robot every 2 s; one process,
one thread, nothing drawn (`bench/field.py`). All simulators get the same places and velocities. A step is a scan of every robot,
exact to 1e-9 m, and the movement of every robot with its collisions.

**Floor.** Bare Zenoh, with as many messages of the same sizes as were counted in a real run, between as many processes; nothing
is packed, checked or computed, and no agent asks another anything; its processes are set as `run.py` sets its own
(`bench/floor.py`). *Apart* is the floor with the same bytes in a message for each body's pose, scan and velocity: what a program
reaches at most that does not send all of a process' bodies in one. Lockstep runs are `run.py` with real agents, from the last agent's
joining to the end; of three without and three with a recording, in turns, the medians.

**Start** is from starting `run.py` to the first tick on the bus. **Memory** is what the operating system calls resident.

## What is not like for like

- IR-SIM stops a robot for good once it has collided, its default; ours and navground's go on. That makes IR-SIM faster, not slower.
- irsim-x's lidar does not see other robots.
- In navground robots are discs (of the same area), trees are four walls each, and numbers have single precision. Its lasers are called
  from Python, one by one, since no behaviour of its own reads a laser; that costs a microsecond or two of some two hundred.
- Stage is not in the package registry: its figures are those of issue 6, from another run on such a machine. At 0.02 m it is wrong by
  3 cm on hits on average, at 0.1 m by 12 cm; ours and IR-SIM are exact.
- The lockstep runs of the default scenario have 15 bodies with a laser of 180 beams and 14 with one of 60, and all their agents, mail
  and messages; the peers' N = 30 have 30 lasers of 180 beams and nobody who looks at what they measure.

## To measure again

    make bench

takes less than ten minutes, installs the others into `.bench/`, and writes this file. On a busy machine compare only ratios.
"""


def markdown(results: Results) -> str:
    """The whole of docs/benchmarks.md."""
    parts = ["# How fast it is", _machine(results), _core(results), _goals(results), _program(results), METHOD]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def rate(value: float | None) -> str:
    """Steps a second, to three digits."""
    if value is None:
        return "-"
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def _machine(results: Results) -> str:
    ours = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "eclipse-zenoh"))
    others = ", ".join(PACKAGES.values())
    before, after = results.load
    return (
        f"Measured by `make bench` with Python {platform.python_version()}, {ours}; {others}; on {os.cpu_count()} cores of "
        f"{_processor()} (load before {before:.1f}, after {after:.1f}). Every figure is of that run, but those marked *quoted*."
    )


def _processor() -> str:
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.processor() or "unknown")


def _core(results: Results) -> str:
    head = ["steps/s with N robots", *map(str, ROBOTS)]
    rows = [["**our core**", *(f"**{rate(results.core[n])}**" for n in ROBOTS)]]
    for name, figures in results.rivals.items():
        rows.append([PACKAGES[name].replace("==", " "), *(rate(figures.get(n)) for n in ROBOTS)])
    quoted = [name for name in QUOTED if name not in results.rivals]
    rows += [[f"{name}, *quoted*", *map(rate, QUOTED[name])] for name in quoted]
    note = "".join(f"\n\n{name} could not be installed ({why}): its figures are quoted." for name, why in results.missing.items())
    growth = [["one robot's step, us, in a field that grows with N", *(f"{results.growing[n]:.2f}" for n in ROBOTS)]]
    return f"## The core\n\n{table(head, rows)}{note}\n\n{table(['', *map(str, ROBOTS)], growth)}"


def _goals(results: Results) -> str:
    rows = [[goal, wanted, got, "yes" if met else "**no**"] for goal, wanted, got, met in results.goals()]
    return f"## Goals\n\n{table(['goal', 'wanted', 'measured', 'met'], rows)}"


def _program(results: Results) -> str:
    local = [[name, str(agents), rate(ticks), f"{1e6 / ticks / agents:.1f}"] for name, (ticks, agents) in results.local.items()]
    lockstep = [[name, *_rates(run)] for name, run in results.lockstep.items()]
    start = [
        [name, f"{look.first_tick:.1f}", f"{look.megabytes['processes.physics']:.0f}", f"{look.megabytes['processes.agents']:.0f}"]
        for name, look in results.start.items()
    ]
    heads = (
        ["local mode", "agents", "ticks/s", "us per agent and tick"],
        ["lockstep", "processes", "floor, ticks/s", "apart", "ticks/s", "of the floor", "of it apart", "recording", "of without"],
        ["start, two agent processes", "s to the first tick", "physics, MB", "agents, MB"],
    )
    tables = "\n\n".join(table(head, rows) for head, rows in zip(heads, (local, lockstep, start), strict=True))
    return f"## The program\n\n{tables}\n\nPhysics with 1000 robots holds {results.physics_megabytes:.0f} MB.\n\n{_realtime(results)}"


def _rates(run: Lockstep) -> list[str]:
    shares = [f"{run.plain / floor:.2f}" for floor in (run.floor, run.apart)]
    return [run.hosts, rate(run.floor), rate(run.apart), rate(run.plain), *shares, rate(run.recorded), f"{run.recorded / run.plain:.2f}"]


def _realtime(results: Results) -> str:
    run = results.realtime
    return (
        f"Real time, default scenario at speed 1, one process per agent: {run.cores:.0%} of a core for all processes together; "
        f"{run.missed} of {run.answers:,} answers came too late for their tick; from what was seen to the velocity's arrival "
        f"{run.p50:g} ms (p50) and {run.p99:g} ms (p99)."
    )
