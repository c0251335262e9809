"""Measures IR-SIM or irsim-x, which both import as `irsim`, in the field of bench/field.py.

No window; velocities are given at each step.

    python irsim_driver.py ROBOTS SECONDS   ->  one line of JSON: {"steps_per_second": ...}

Fences, trunks and posts are static rectangles, robots are rectangles of the same size as ours. A
robot that collides stops: the default.
"""

import math
import sys
import tempfile
from pathlib import Path
from typing import Any

import irsim
import yaml

sys.path.insert(0, str(Path(__file__).parents[1]))
import field
from timing import MOST_STEPS, run


def world(area: field.Field) -> dict[str, Any]:
    """Return the content of IR-SIM's world file.

    Its origin is a corner, at (-60 %, -60 %) of the field.
    """
    walls = [
        _rectangle(x, y, 2 * half_x, 2 * half_y) for x, y, half_x, half_y in area.walls.tolist()
    ]
    return {
        "world": {
            "width": 1.2 * area.length,
            "height": 1.2 * area.width,
            "offset": [-0.6 * area.length, -0.6 * area.width],
            "step_time": field.STEP,
            "sample_time": field.STEP,
            "collision_mode": "stop",
        },
        "robot": [_robot(*pose) for pose in area.starts.tolist()],
        "obstacle": walls,
    }


def _rectangle(x: float, y: float, length: float, width: float) -> dict[str, Any]:
    return {"shape": {"name": "rectangle", "length": length, "width": width}, "state": [x, y, 0]}


def _robot(x: float, y: float, yaw: float) -> dict[str, Any]:
    laser = {
        "name": "lidar2d",
        "range_min": 0,
        "range_max": field.RANGE,
        "angle_range": math.pi,
        "number": field.BEAMS,
        "offset": [field.ROBOT_LENGTH / 2, 0, 0],
    }
    return {
        "kinematics": {"name": "diff"},
        "shape": {"name": "rectangle", "length": field.ROBOT_LENGTH, "width": field.ROBOT_WIDTH},
        "state": [x, y, yaw],
        # Far away: a robot at its goal would stop.
        "goal": [1000, 1000, 0],
        "vel_max": [field.SPEED, field.TURN],
        "vel_min": [-field.SPEED, -field.TURN],
        "sensors": [laser],
    }


def main(robots: int, seconds: float) -> None:
    """Print how many steps a second IR-SIM makes with so many robots."""
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        yaml.safe_dump(world(field.field(robots)), file)
        file.flush()
        simulator = irsim.make(file.name, display=False, disable_all_plot=True, log_level="ERROR")
    # For each step and robot an array (2, 1), m/s and rad/s.
    wanted = [list(step) for step in field.velocities(robots, MOST_STEPS)[:, :, :, None]]
    ids = list(range(robots))
    run(lambda k: simulator.step(wanted[k], ids), seconds)


main(int(sys.argv[1]), float(sys.argv[2]))
