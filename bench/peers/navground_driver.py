"""Measures navground in the field of bench/field.py.

    python navground_driver.py ROBOTS SECONDS   ->  one line of JSON: {"steps_per_second": ...}

Fences, trunks and posts are walls (a box is four lines), robots are discs of the same area as our
boxes. Each robot drives with the velocity that it is given and ignores its scan (Dummy); navground
itself computes collisions. This driver calls each laser once a step, which costs a microsecond or
two, because none of navground's own behaviours reads a laser.
"""

import math
import sys
from pathlib import Path

from navground import core, sim

sys.path.insert(0, str(Path(__file__).parents[1]))
import field
from timing import MOST_STEPS, run

RADIUS = math.sqrt(field.ROBOT_LENGTH * field.ROBOT_WIDTH / math.pi)  # m


def world(area: field.Field) -> sim.World:
    """Return navground's world with the walls and robots of the field."""
    navground_world = sim.World()
    for x, y, half_x, half_y in area.walls.tolist():
        corners = [
            (x - half_x, y - half_y),
            (x + half_x, y - half_y),
            (x + half_x, y + half_y),
            (x - half_x, y + half_y),
        ]
        for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
            navground_world.add_wall(sim.Wall(start, end))
    for x, y, yaw in area.starts.tolist():
        kinematics = core.kinematics.TwoWheelsDifferentialDriveKinematics(
            field.SPEED, field.ROBOT_WIDTH, field.TURN
        )
        agent = sim.Agent(RADIUS, core.behaviors.DummyBehavior(kinematics, RADIUS), kinematics)
        agent.pose = core.Pose2((x, y), yaw)
        navground_world.add_agent(agent)
    return navground_world


def lasers(navground_world: sim.World) -> list[tuple]:
    """Return (laser, robot, state that receives the ranges) for each robot."""
    sensors = []
    for agent in navground_world.agents:
        laser = sim.state_estimations.LidarStateEstimation(
            field.RANGE, -math.pi / 2, math.pi, field.BEAMS, (field.ROBOT_LENGTH / 2, 0.0)
        )
        ranges = core.SensingState()
        laser.prepare_state(ranges)
        sensors.append((laser, agent, ranges))
    return sensors


def main(robots: int, seconds: float) -> None:
    """Print how many steps a second navground makes with so many robots."""
    navground_world = world(field.field(robots))
    wanted = field.velocities(robots, MOST_STEPS)
    agents = navground_world.agents
    sensors = lasers(navground_world)

    def step(k: int) -> None:
        # Velocities change only every KEEP steps.
        if k % field.KEEP == 0:
            for agent, (forward, turn) in zip(agents, wanted[k].tolist(), strict=True):
                agent.behavior.target = core.Target.Twist(
                    core.Twist2((forward, 0.0), turn, core.Frame.relative)
                )
        navground_world.update(field.STEP)
        for laser, agent, ranges in sensors:
            laser.update(agent, navground_world, ranges)

    run(step, seconds)


main(int(sys.argv[1]), float(sys.argv[2]))
