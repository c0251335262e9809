"""The sections of a scenario for sensors: lasers, and what robots measure of their own motion."""

from typing import Annotated

from pydantic import Field

from orchard.field.problems import Section


class LaserSettings(Section):
    """Settings of all lasers."""

    noise: Annotated[
        float, Field(ge=0.0, le=0.02, description="standard deviation of a measured range, m")
    ] = 0.0


BIAS_TIME = "time in which the correlation of the slow error falls to 1/e, s"
# With larger errors, a carrier may take a picker that waits 0.25 m beside its road for one ahead of
# it.
MOST_WHITE = 0.1  # m
MOST_BIAS = 0.03  # m


class Gnss(Section):
    """Errors of GNSS receivers in x and in y, each the sum of two.

    One is white noise, new at each tick. The other is slow: a Gauss-Markov process of the first
    order. See docs/reference.md.
    """

    white: Annotated[
        float,
        Field(
            ge=0.0, le=MOST_WHITE, description="standard deviation of the error new at each tick, m"
        ),
    ] = 0.0
    bias: Annotated[
        float, Field(ge=0.0, le=MOST_BIAS, description="standard deviation of the slow error, m")
    ] = 0.0
    bias_time: Annotated[float, Field(ge=1.0, le=86400.0, description=BIAS_TIME)] = 300.0


class OdometrySettings(Section):
    """Errors of the odometry of pickers, carriers and the tractor: constants, drawn for
    each robot.
    """

    distance: Annotated[
        float,
        Field(
            ge=0.0, le=0.1, description="standard deviation of the error of distances, as a share"
        ),
    ] = 0.0
    heading: Annotated[
        float,
        Field(
            ge=0.0,
            le=0.05,
            description="standard deviation of the drift of the heading, rad/m driven",
        ),
    ] = 0.0


class SensorSettings(Section):
    """Errors of what robots measure of their own motion.

    Without them what they measure is the truth.
    """

    gnss: Annotated[Gnss, Field(description="the receivers that measure where robots are")] = Gnss()
    odometry: Annotated[
        OdometrySettings, Field(description="what robots measure of their motion by their wheels")
    ] = OdometrySettings()

    @property
    def are_exact(self) -> bool:
        """Whether robots measure the truth."""
        return not any(
            (self.gnss.white, self.gnss.bias, self.odometry.distance, self.odometry.heading)
        )
