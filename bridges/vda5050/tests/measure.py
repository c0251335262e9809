"""What the bridge costs: its share of a core for 30 vehicles in real time, and how fast a run with
100 vehicles can be.

ORCHARD=$PWD/.venv/bin/orchard .venv-vda5050/bin/python bridges/vda5050/tests/measure.py
"""

import re
import statistics
import tempfile
import time
from pathlib import Path

import psutil

from processes import BEGIN_SECONDS, Control, broker, free_port, lif, scene

SECONDS = 30.0  # for which it measures, on the clock of this machine
# Scenarios: one that real time can carry, and one of many vehicles.
REALTIME = {"rows": 45, "pickers": 43, "carriers": 30}
MANY = {"rows": 40, "pickers": 20, "carriers": 100}


def measured(scenario, words):
    """Let a fleet control drive all carriers.

    Return the bridge's share of a core, the states a second, and the median speed of the run.
    """
    port = free_port()
    with (
        tempfile.TemporaryDirectory() as name,
        broker(Path(name), port),
        scene(Path(name), scenario, port, words) as run,
    ):
        control = Control(lif(Path(name)), port)
        control.until(lambda: len(control.states) == scenario["carriers"], BEGIN_SECONDS)
        bridge = psutil.Process(run.bridge.pid)
        used_before = cpu_seconds(bridge)
        heard_before = len(control.heard)
        time.sleep(SECONDS)
        share = (cpu_seconds(bridge) - used_before) / SECONDS
        states = (len(control.heard) - heard_before) / SECONDS
        control.close()
        log = (Path(name) / "orchard.log").read_text()
        speeds = [float(speed) for speed in re.findall(r"([\d.]+) x real time", log)]
        return share, states, statistics.median(speeds[1:])  # the first one is of the start


def cpu_seconds(process):
    """The time that a process has used on cores until now, in s."""
    times = process.cpu_times()
    return times.user + times.system


def main():
    for scenario, words in ((REALTIME, ["--mode", "realtime"]), (MANY, ["--speed", "max"])):
        share, states, speed = measured(scenario, words)
        print(
            f"{scenario['carriers']} vehicles, {speed:.1f} x real time: bridge {100 * share:.0f} %"
            f" of a core, {states:.0f} states a second"
        )
    print(f"load of this machine: {psutil.getloadavg()[0]:.1f} on {psutil.cpu_count()} cores")


if __name__ == "__main__":
    main()
