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

SECONDS = 30.0
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
        used, heard = sum(bridge.cpu_times()[:2]), len(control.heard)
        time.sleep(SECONDS)
        share, states = (
            (sum(bridge.cpu_times()[:2]) - used) / SECONDS,
            (len(control.heard) - heard) / SECONDS,
        )
        control.close()
        speeds = map(
            float, re.findall(r"([\d.]+) x real time", (Path(name) / "orchard.log").read_text())[1:]
        )
        return share, states, statistics.median(speeds)


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
