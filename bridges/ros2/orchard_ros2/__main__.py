"""`orchard-ros2`, or `python -m orchard_ros2`: the bridge, until the run is over.

Parameters: docs/ros2.md.
"""

import sys
import time
from threading import Thread

import rclpy
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from orchard_ros2.bridge import Bridge
from orchard_ros2.client import Refused, connected

# Between two queries for a run that has not begun.
AGAIN_SECONDS = 1.0
# Between two looks at whether the run is over.
LOOK_SECONDS = 1.0


def main() -> int:
    """Serve a run, once there is one. Return the exit code: 0, or 2 for a user's mistake."""
    rclpy.init()
    try:
        bridge = Bridge()
        code = attempt(bridge)
        while code is None:
            time.sleep(AGAIN_SECONDS)
            code = attempt(bridge)
        return code
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except RuntimeError:
        if rclpy.ok():
            raise
        # A signal has shut rclpy down, and what was under way in it fails.
        return 0
    except ValueError as error:
        print(f"orchard-ros2: {error}", file=sys.stderr)
        return 2
    except InvalidParameterTypeException as error:
        print(
            f"orchard-ros2: {error}; a list of robots is as [picker_01, carrier]", file=sys.stderr
        )
        return 2
    finally:
        rclpy.try_shutdown()


def attempt(bridge: Bridge) -> int | None:
    """Serve one run.

    Return the exit code, or None if there is no run yet: then it is to be tried again.
    """
    if not rclpy.ok():
        raise ExternalShutdownException
    try:
        with connected(bridge.endpoint, bridge.prefix, bridge.role) as client:
            bridge.join(client, client.ask("layout"), client.ask("scenario")["scenario"])
            Thread(target=bridge.listen, daemon=True).start()
            executor = SingleThreadedExecutor()
            executor.add_node(bridge.node)
            while not bridge.ended.done():
                executor.spin_once(LOOK_SECONDS)
            bridge.log.info(str(bridge.ended.result()))
        return 0
    except Refused as why:
        bridge.log.info(f"waiting for a run: {why}")
        return None
    except ValueError as why:
        bridge.log.error(str(why))
        return 2


if __name__ == "__main__":
    sys.exit(main())
