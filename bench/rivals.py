"""The simulators that one could use instead: their versions, their own environment, and how fast each is."""

import json
import subprocess
import venv
from pathlib import Path

HERE = Path(__file__).parent
ENVIRONMENTS = HERE.parent / ".bench"  # one environment each, because IR-SIM and irsim-x both call themselves irsim
DRIVERS = {"IR-SIM": "irsim_driver.py", "irsim-x": "irsim_driver.py", "navground": "navground_driver.py"}
PACKAGES = {"IR-SIM": "ir-sim==2.12.0", "irsim-x": "irsim-x==1.1.4", "navground": "navground==0.7.0"}
ALSO = ("numpy==2.4.6", "pyyaml==6.0.3")  # for the drivers
START_SECONDS = 90.0  # a thousand robots take a while to be made

# Steps/s as issue 6 quotes them for 10, 30, 100, 300 and 1000 robots: of another run; of Stage, which no registry has, there is no other.
QUOTED: dict[str, tuple[float, ...]] = {
    "Stage 4.3 at 0.02 m": (411, 94, 24, 7.0, 2.8),
    "Stage 4.3 at 0.1 m": (2111, 649, 120, 40, 16),
    "IR-SIM": (254, 90, 24, 6.3, 1.1),
    "irsim-x": (775, 430, 154, 55, 14),
    "navground": (434, 152, 42, 14, 3.7),
}


def install(name: str) -> str:
    """Make a rival's environment, if it is not there; '' or why that failed."""
    home = ENVIRONMENTS / name
    if (home / "ready").exists() and (home / "ready").read_text() == PACKAGES[name]:
        return ""
    venv.create(home, clear=True, with_pip=True)
    command = [str(home / "bin" / "python"), "-m", "pip", "install", "--quiet", PACKAGES[name], *ALSO]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        return (done.stderr.strip().splitlines() or ["pip failed"])[-1]
    (home / "ready").write_text(PACKAGES[name])
    return ""


def steps_per_second(name: str, robots: int, seconds: float) -> float:
    """Measure a rival for so many seconds, in a process of its own."""
    python = ENVIRONMENTS / name / "bin" / "python"
    command = [str(python), str(HERE / "peers" / DRIVERS[name]), str(robots), str(seconds)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=START_SECONDS + 10 * seconds)
    if done.returncode:
        raise RuntimeError(f"{name}: {done.stderr.strip().splitlines()[-1]}")
    return float(json.loads(done.stdout.strip().splitlines()[-1])["steps_per_second"])
