"""What robots measure of their own pose and motion: the truth, and the errors that the scenario sets. docs/reference.md gives the models.

Pickers, carriers and the tractor have a GNSS receiver and odometry. All errors follow from the seed, the robot's name and the tick; what
adds up from tick to tick is in the world, and so in a snapshot.
"""

import math
from dataclasses import replace
from typing import cast

import numpy as np

from orchard.contract.agent import Observations
from orchard.field.geometry import Pose, from_frame
from orchard.field.kinds import VEHICLES
from orchard.field.layout import Layout
from orchard.field.repeatable import draw, exp, normal, wrap
from orchard.field.scenario import TIME_STEP
from orchard.sim.kernels.move import quaternions
from orchard.sim.scan import Hitches
from orchard.sim.world import World

X_Y, MOTION = slice(0, 2), slice(4, 7)  # columns of a body's state: see Observations


def normals(seed: int, what: str, tick: int) -> tuple[float, float]:
    """Return two independent numbers, normally distributed with mean 0 and deviation 1."""
    u, v, w, z = draw(seed, what, tick, 4)
    return normal(u, v), normal(w, z)


def robots_of(layout: Layout) -> dict[str, int]:
    """Return the bodies with a receiver and odometry, name -> index: those that drive by themselves and are no people or animals."""
    return {start.name: i for i, start in enumerate(layout.starts) if start.kind in VEHICLES}


class Sensors:
    """The receivers and the odometry of the robots of one world. Of the world they change only `bias` and `reckoned`."""

    def __init__(self, world: World) -> None:
        scenario = world.layout.scenario
        gnss, odometry = scenario.sensors.gnss, scenario.sensors.odometry
        self._world, self._seed, self._gnss, self._robots = (
            world,
            scenario.seed,
            gnss,
            robots_of(world.layout),
        )
        self._kept = exp(-TIME_STEP / gnss.bias_time)  # of the slow error, from tick to tick
        self._fresh = gnss.bias * math.sqrt(
            1.0 - self._kept * self._kept
        )  # m, the deviation of what is added to it
        errors = {
            i: normals(self._seed, f"odometry of {name}", 0) for name, i in self._robots.items()
        }
        self._share = {
            i: 1.0 + odometry.distance * far for i, (far, _) in errors.items()
        }  # measured metres per metre
        self._bend = {
            i: odometry.heading * askew for i, (_, askew) in errors.items()
        }  # rad per metre
        self._drifts, accuracy = (
            odometry.distance > 0.0 or odometry.heading > 0.0,
            math.sqrt(gnss.white**2 + gnss.bias**2),
        )
        self._accuracies = dict.fromkeys(self._robots, accuracy) if accuracy else {}
        for (
            name,
            i,
        ) in self._robots.items():  # a slow error is as probable at first as at any other time
            if not world.bias[i].any():  # at tick 0, or added by a fork
                world.bias[i] = np.multiply(gnss.bias, normals(self._seed, f"bias of {name}", 0))

    def advance(self) -> None:
        """Go on by one tick, after each step of the world."""
        world, tick = self._world, self._world.tick
        for name, i in self._robots.items() if self._gnss.bias else ():
            world.bias[i] = self._kept * world.bias[i] + np.multiply(
                self._fresh, normals(self._seed, f"bias of {name}", tick)
            )
        for i in self._robots.values() if self._drifts else ():
            ahead, _, turn = self._motion(i)
            x, y, yaw = world.reckoned[i].tolist()
            half = Pose(x, y, yaw + 0.5 * turn * TIME_STEP)
            world.reckoned[i] = (
                *from_frame(half, ahead * TIME_STEP, 0.0),
                wrap(yaw + turn * TIME_STEP),
            )

    def measured(self, truth: Observations) -> Observations:
        """Return what the bodies observe, for what they would observe without errors."""
        if self.is_exact:
            return truth
        states, errors = self._with_motion(truth), self._errors(truth.tick)
        for i, error in errors.items():
            states[i, X_Y] += error
        shifts = {name: errors[i] for name, i in self._robots.items() if i in errors}
        return replace(
            truth,
            states=states,
            hitches=cast(Hitches, truth.hitches).shifted(shifts),
            accuracies=self._accuracies,
        )

    def reckoned(self, truth: Observations) -> Observations:
        """Return the observations of odometry alone, for those without errors. They know of no body at the other end of the bar."""
        states = self._with_motion(truth)
        for i in self._robots.values() if self._drifts else ():
            pose = self._world.reckoned[i]
            states[i, :4] = *pose[:2], *quaternions(pose[None])[0]
        return replace(truth, states=states, hitches={})

    @property
    def is_exact(self) -> bool:
        return not self._accuracies and not self._drifts

    def inexact(self) -> np.ndarray:
        """Return the poses that are measured with errors now, (bodies, 5), NaN if exact: x and y of the receiver; x, y, yaw of odometry."""
        poses = np.full((len(self._world.pose), 5), np.nan)
        for i, error in self._errors(self._world.tick).items():
            poses[i, :2] = self._world.pose[i, X_Y] + error
        for i in self._robots.values() if self._drifts else ():
            poses[i, 2:] = self._world.reckoned[i]
        return poses

    def _errors(self, tick: int) -> dict[int, np.ndarray]:
        white, bias = self._gnss.white, self._world.bias
        return {
            i: bias[i] + np.multiply(white, normals(self._seed, f"gnss of {name}", tick))
            if white
            else bias[i]
            for name, i in self._robots.items()
            if self._accuracies
        }

    def _with_motion(self, truth: Observations) -> np.ndarray:
        states = truth.states.copy()
        for i in self._robots.values() if self._drifts else ():
            states[i, MOTION] = self._motion(i)
        return states

    def _motion(self, i: int) -> tuple[float, float, float]:
        """The velocity of a robot in the last step as its odometry measures it. A robot that stands measures that it stands."""
        ahead, left, turn = self._world.twist[i].tolist()
        return self._share[i] * ahead, left, turn + self._bend[i] * ahead
