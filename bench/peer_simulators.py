"""Comparable simulators: their versions, their virtual environments, and their measured and quoted
rates.
"""

import json
import subprocess
import venv
from pathlib import Path

HERE = Path(__file__).parent
# Each simulator has a virtual environment of its own there: IR-SIM and irsim-x both install a
# package `irsim`.
ENVIRONMENTS = HERE.parent / ".bench"
DRIVERS = {
    "IR-SIM": "irsim_driver.py",
    "irsim-x": "irsim_driver.py",
    "navground": "navground_driver.py",
}
PACKAGES = {
    "IR-SIM": "ir-sim==2.12.0",
    "irsim-x": "irsim-x==1.1.4",
    "navground": "navground==0.7.0",
}
# Measured by bench.learning only.
RWARE = "rware"
JUMANJI = "jumanji"
LEARNING_PACKAGES = {RWARE: "rware==2.0.0", JUMANJI: "jumanji==1.1.2"}
ALSO = ("numpy==2.4.6", "pyyaml==6.0.3")  # for the drivers
START_SECONDS = 90.0  # time for the start; creating a thousand robots takes long

# Steps/s for 10, 30, 100, 300 and 1000 robots as quoted in issue 6, from another run. No package
# registry has Stage, so only quotes exist.
QUOTED: dict[str, tuple[float, ...]] = {
    "Stage 4.3 at 0.02 m": (411, 94, 24, 7.0, 2.8),
    "Stage 4.3 at 0.1 m": (2111, 649, 120, 40, 16),
    "IR-SIM": (254, 90, 24, 6.3, 1.1),
    "irsim-x": (775, 430, 154, 55, 14),
    "navground": (434, 152, 42, 14, 3.7),
}


def install(name: str) -> str:
    """Create the environment of a simulator unless it exists. Return '', or why that failed."""
    home = ENVIRONMENTS / name
    package = (PACKAGES | LEARNING_PACKAGES)[name]
    # This file is written last, and names the version.
    ready = home / "ready"
    if ready.exists() and ready.read_text() == package:
        return ""
    venv.create(home, clear=True, with_pip=True)
    command = [
        str(home / "bin" / "python"),
        "-m",
        "pip",
        "install",
        "--quiet",
        package,
        *ALSO,
    ]
    process = subprocess.run(command, capture_output=True, check=False, text=True)
    if process.returncode:
        return (process.stderr.strip().splitlines() or ["pip failed"])[-1]
    ready.write_text(package)
    return ""


def steps_per_second(name: str, robots: int, seconds: float) -> float:
    """Measure a simulator for `seconds` in a separate process.

    Raises RuntimeError where the process fails, and subprocess.TimeoutExpired.
    """
    python = ENVIRONMENTS / name / "bin" / "python"
    command = [str(python), str(HERE / "peers" / DRIVERS[name]), str(robots), str(seconds)]
    process = subprocess.run(
        command,
        capture_output=True,
        check=False,
        text=True,
        # `seconds` are of processor time, so they may take much longer.
        timeout=START_SECONDS + 10 * seconds,
    )
    if process.returncode:
        raise RuntimeError(f"{name}: {process.stderr.strip().splitlines()[-1]}")
    return float(json.loads(process.stdout.strip().splitlines()[-1])["steps_per_second"])


def agent_steps(name: str, *words: str) -> list[float]:
    """Return the agent steps a second of processor time of a simulator for learning, of several
    measurements. `words`: the arguments of its driver.

    Raises RuntimeError where it cannot be installed, or fails.
    """
    if fault := install(name):
        raise RuntimeError(fault)
    python = ENVIRONMENTS / name / "bin" / "python"
    command = [str(python), str(HERE / "peers" / f"{name}_driver.py"), *words]
    process = subprocess.run(command, capture_output=True, check=False, text=True)
    if process.returncode:
        raise RuntimeError(process.stderr.strip().splitlines()[-1])
    rates: list[float] = json.loads(process.stdout)["agent_steps_per_second"]
    return rates
