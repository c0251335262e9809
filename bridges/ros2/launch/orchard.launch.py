"""The bridge, and RViz if it is wanted: `ros2 launch orchard.launch.py driven:=[picker_01]
rviz:=true`.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration

RVIZ = Path(__file__).resolve().parents[1] / "rviz" / "orchard.rviz"
ARGUMENTS = {
    "endpoint": ("tcp/127.0.0.1:7447", "where the Orchard listens"),
    "prefix": ("orchard", "the prefix of its keys"),
    "secure": ("''", "for a secured run: the directory of the bridge's role"),
    "robots": ("['']", "bodies or kinds that ROS sees; ['']: all robots"),
    "driven": (
        "['']",
        "robots that ROS drives, and that no agent holds: those of `orchard --without`",
    ),
    "advised": ("['']", "robots with agents that go on while ROS gives the velocity"),
    "enable_stamped_cmd_vel": ("true", "cmd_vel is a TwistStamped; false: a Twist"),
    "ground_truth": ("false", "NAME/ground_truth is published"),
}


def generate_launch_description() -> LaunchDescription:
    """Return what is started.

    The bridge is not a package of ament, so it is run as the command that pip installs.
    """
    words = [
        word for name in ARGUMENTS for word in ("-p", [f"{name}:=", LaunchConfiguration(name)])
    ]
    rviz = ["rviz2", "-d", str(RVIZ), "--ros-args", "-p", "use_sim_time:=true"]
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value, description=text)
                for name, (value, text) in ARGUMENTS.items()
            ),
            DeclareLaunchArgument("rviz", default_value="false", description="open RViz"),
            ExecuteProcess(cmd=["orchard-ros2", "--ros-args", *words], output="screen"),
            ExecuteProcess(cmd=rviz, condition=IfCondition(LaunchConfiguration("rviz"))),
        ]
    )
