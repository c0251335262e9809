"""Topics and frames: their names, types and qualities of service, in one place.

Frames are those of REP-105.

    map -> NAME/odom -> NAME/base_link -> NAME/laser

NAME/odom lies on `map`, unless the sensors of the scenario have errors: then odometry drifts, and
NAME/odom moves in `map`.
"""

from dataclasses import dataclass

MAP = "map"
# Height of the plane in which lasers scan, m above the ground (docs/reference.md).
LASER_HEIGHT = 0.2


@dataclass(frozen=True)
class QoS:
    """A quality of service.

    The last `depth` messages are kept; a `latched` topic (transient local) gives them to late
    subscribers.
    """

    depth: int
    reliable: bool = True
    latched: bool = False


@dataclass(frozen=True)
class Topic:
    """A topic.

    `name`: {robot} in it stands for the name of a robot. `type`: of its messages.
    """

    name: str
    type: str
    qos: QoS

    def of(self, robot: str = "") -> str:
        """Return the name of the topic for a robot."""
        return self.name.format(robot=robot)


# As rmw_qos_profile_sensor_data.
SENSOR_DATA = QoS(5, reliable=False)
LATCHED = QoS(1, latched=True)

ODOM = Topic("{robot}/odom", "nav_msgs/msg/Odometry", QoS(10))
# As it is measured, if sensors have errors.
POSE = Topic("{robot}/pose", "geometry_msgs/msg/PoseWithCovarianceStamped", QoS(10))
GROUND_TRUTH = Topic("{robot}/ground_truth", "nav_msgs/msg/Odometry", QoS(10))
SCAN = Topic("{robot}/scan", "sensor_msgs/msg/LaserScan", SENSOR_DATA)
# Of carriers, if they have batteries.
BATTERY_STATE = Topic("{robot}/battery_state", "sensor_msgs/msg/BatteryState", QoS(10))
CMD_VEL = Topic("{robot}/cmd_vel", "geometry_msgs/msg/TwistStamped", QoS(1))
CMD_VEL_UNSTAMPED = Topic("{robot}/cmd_vel", "geometry_msgs/msg/Twist", QoS(1))
# What the agent of an advised robot wants.
CMD_VEL_AGENT = Topic("{robot}/cmd_vel_agent", "geometry_msgs/msg/TwistStamped", QoS(1))
ROBOT_DESCRIPTION = Topic("{robot}/robot_description", "std_msgs/msg/String", LATCHED)
GRID = Topic("map", "nav_msgs/msg/OccupancyGrid", LATCHED)
# Reliable: that suits subscribers of both kinds.
CLOCK = Topic("/clock", "rosgraph_msgs/msg/Clock", QoS(1))
TF = Topic("/tf", "tf2_msgs/msg/TFMessage", QoS(100))
TF_STATIC = Topic("/tf_static", "tf2_msgs/msg/TFMessage", LATCHED)


def odom(robot: str) -> str:
    """Return the frame in which a robot's odometry is."""
    return f"{robot}/odom"


def base_link(robot: str) -> str:
    """Return the frame of a robot's body: its centre, on the ground, x forward, y to the left."""
    return f"{robot}/base_link"


def laser(robot: str) -> str:
    """Return the frame of a robot's laser."""
    return f"{robot}/laser"
