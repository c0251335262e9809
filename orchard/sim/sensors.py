"""What robots measure of their own pose and motion: the truth, and the errors of the scenario.

Pickers, carriers and the tractor have a GNSS receiver (satellite navigation) and odometry (what
wheels measure). The error of a receiver has two parts: a slow one, the bias, and a white one, which
is new in each tick. All errors follow from the seed, the robot's name and the tick; what adds up
from tick to tick is in the world (`bias`, `reckoned`), and so in a snapshot. docs/reference.md
gives the models. `orchard.sim.engine` uses this.
"""

import math
from collections.abc import Collection
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

# Columns of a body's state, as `Observations` has them: its position; z and w of its orientation;
# its velocity ahead, to the left, and of its turn.
X_Y = slice(0, 2)
ORIENTATION = slice(2, 4)
MOTION = slice(4, 7)


def normals(seed: int, what: str, tick: int) -> tuple[float, float]:
    """Return two independent numbers, normally distributed with mean 0 and deviation 1.

    They depend on the seed, the tick, and `what` they are for.
    """
    u, v, w, z = draw(seed, what, tick, 4)
    return normal(u, v), normal(w, z)


def robots_of(layout: Layout) -> dict[str, int]:
    """Return the bodies with a receiver and odometry, name -> index.

    They are those that drive by themselves and are no people or animals.
    """
    return {start.name: i for i, start in enumerate(layout.starts) if start.kind in VEHICLES}


class Sensors:
    """The receivers and the odometry of the robots of one world.

    Of the world they change only `bias` and `reckoned`.
    """

    def __init__(self, world: World) -> None:
        scenario = world.layout.scenario
        gnss = scenario.sensors.gnss
        odometry = scenario.sensors.odometry
        self._world = world
        self._seed = scenario.seed
        self._gnss = gnss
        self._robots = robots_of(world.layout)
        # Share of the slow error that is kept from tick to tick: it decays with `bias_time`, s.
        self._kept = exp(-TIME_STEP / gnss.bias_time)
        # m: the deviation of what is added to it in each tick, so that its deviation stays `bias`.
        self._fresh = gnss.bias * math.sqrt(1.0 - self._kept * self._kept)
        # Body -> measured metres per metre.
        self._share: dict[int, float] = {}
        # Body -> rad per metre, by which its odometry turns.
        self._bend: dict[int, float] = {}
        # The errors of a robot's odometry stay the same during a run.
        for name, i in self._robots.items():
            of_distance, of_heading = normals(self._seed, f"odometry of {name}", 0)
            self._share[i] = 1.0 + odometry.distance * of_distance
            self._bend[i] = odometry.heading * of_heading
        self._drifts = odometry.distance > 0.0 or odometry.heading > 0.0
        # m: the deviation of the receiver's error in x, and in y.
        accuracy = math.sqrt(gnss.white**2 + gnss.bias**2)
        self._accuracies: dict[str, float] = {}
        if accuracy:
            self._accuracies = dict.fromkeys(self._robots, accuracy)
        for name, i in self._robots.items():
            # There is no bias yet at tick 0, or if a fork has added the robot.
            if not world.bias[i].any():
                # A slow error is as probable at first as at any other time.
                world.bias[i] = np.multiply(gnss.bias, normals(self._seed, f"bias of {name}", 0))

    def advance(self) -> None:
        """Go on by one tick, after each step of the world."""
        if self._gnss.bias:
            for name, i in self._robots.items():
                self._advance_bias(name, i)
        if self._drifts:
            for i in self._robots.values():
                self._advance_reckoned(i)

    def _advance_bias(self, name: str, i: int) -> None:
        """Change the slow error of a receiver: a Gauss-Markov process of first order."""
        bias = self._world.bias
        fresh = normals(self._seed, f"bias of {name}", self._world.tick)
        bias[i] = self._kept * bias[i] + np.multiply(self._fresh, fresh)

    def _advance_reckoned(self, i: int) -> None:
        """Add the motion of the last step, by the chord of its arc, to the pose by odometry."""
        ahead, _, turn = self._motion(i)
        x, y, yaw = self._world.reckoned[i].tolist()
        half = Pose(x, y, yaw + 0.5 * turn * TIME_STEP)
        x, y = from_frame(half, ahead * TIME_STEP, 0.0)
        self._world.reckoned[i] = (x, y, wrap(yaw + turn * TIME_STEP))

    def measured(self, truth: Observations) -> Observations:
        """Return what the bodies observe. `truth`: what they would observe without errors."""
        if self.is_exact:
            return truth
        states = self._with_motion(truth)
        errors = self._errors(truth.tick)
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
        """Return the observations with the poses of odometry alone. `truth`: as for `measured`.

        They know of no body at the other end of the bar.
        """
        states = self._with_motion(truth)
        for i in self._drifting:
            pose = self._world.reckoned[i]
            states[i, X_Y] = pose[:2]
            states[i, ORIENTATION] = quaternions(pose[None])[0]
        return replace(truth, states=states, hitches={})

    @property
    def is_exact(self) -> bool:
        """Whether the scenario sets no errors."""
        return not self._accuracies and not self._drifts

    @property
    def _drifting(self) -> Collection[int]:
        """The bodies with errors in their odometry."""
        if not self._drifts:
            return ()
        return self._robots.values()

    def inexact(self) -> np.ndarray:
        """Return the poses that are measured with errors now, (bodies, 5), NaN where exact.

        The columns are x and y of the receiver, m; and x, y, m, and yaw, rad, of odometry.
        """
        poses = np.full((len(self._world.pose), 5), np.nan)
        for i, error in self._errors(self._world.tick).items():
            poses[i, :2] = self._world.pose[i, X_Y] + error
        for i in self._drifting:
            poses[i, 2:] = self._world.reckoned[i]
        return poses

    def _errors(self, tick: int) -> dict[int, np.ndarray]:
        """Return the errors of the receivers at a tick, body -> (2,) m; none if they are exact."""
        errors: dict[int, np.ndarray] = {}
        if not self._accuracies:
            return errors
        white = self._gnss.white
        for name, i in self._robots.items():
            errors[i] = self._world.bias[i]
            if white:
                noise = normals(self._seed, f"gnss of {name}", tick)
                errors[i] = errors[i] + np.multiply(white, noise)
        return errors

    def _with_motion(self, truth: Observations) -> np.ndarray:
        """Return the states of all bodies, as `Observations` has them, with measured velocities."""
        states = truth.states.copy()
        for i in self._drifting:
            states[i, MOTION] = self._motion(i)
        return states

    def _motion(self, i: int) -> tuple[float, float, float]:
        """Return the velocity of a robot in the last step as its odometry measures it.

        A robot that stands measures that it stands.
        """
        ahead, left, turn = self._world.twist[i].tolist()
        return self._share[i] * ahead, left, turn + self._bend[i] * ahead
