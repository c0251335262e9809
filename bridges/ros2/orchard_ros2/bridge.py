"""The bridge, a ROS 2 node between a run of the Orchard and the programs of ROS.

It publishes what the Orchard sends, and sends the Orchard what ROS wants of its robots. Of a driven
robot the bridge is the agent: ROS alone gives its velocity. An advised robot has an agent of its
own, which goes on with all but the velocity while ROS gives that. All other robots are only seen.

Two threads. The executor's takes velocities and service calls. `listen` takes what the Orchard
sends, in the order in which it comes. A service that asks the run has a thread of its own while it
waits.
"""

from collections.abc import Sequence
from functools import partial
from math import isfinite
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future

from orchard_ros2 import wire
from orchard_ros2.client import PREFIX, Client, Heard
from orchard_ros2.control import RunControl
from orchard_ros2.coupling import Coupling
from orchard_ros2.physics import PhysicsWatch
from orchard_ros2.plain import bodies, field, messages, topics
from orchard_ros2.plain.messages import Message
from orchard_ros2.publishers import Publishers, profile, type_of
from orchard_ros2.role import MADE_BY, role_in
from orchard_ros2.services import Services


def _within(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


class Bridge:
    """One run of the Orchard, and the node for it.

    Parameters: docs/ros2.md. `ended` is done when the run is over; its result says why.
    """

    def __init__(self) -> None:
        """Raises ValueError for a directory without the role of a bridge."""
        self.node = Node("orchard")
        self.log = self.node.get_logger()
        self.ended: Future = Future()
        self.endpoint = self._text("endpoint", "tcp/127.0.0.1:7447")
        self.prefix = self._text("prefix", PREFIX)
        secure = self._text("secure", "")
        self.role = role_in(secure) if secure else None
        self._robots = self._texts("robots")
        self._driven = self._texts("driven")
        self._advised = self._texts("advised")
        self._is_stamped = bool(self.node.declare_parameter("enable_stamped_cmd_vel", True).value)
        self._shows_truth = bool(self.node.declare_parameter("ground_truth", False).value)
        self.node.declare_parameter("steps", 1)
        self._publishers = Publishers(self.node)
        self._services = Services(self.node)

    def _text(self, name: str, default: str) -> str:
        return str(self.node.declare_parameter(name, default).value)

    def _texts(self, name: str) -> list[str]:
        """Return a list. '' in it stands for nothing: ROS 2 has no empty list of texts."""
        self.node.declare_parameter(name, Parameter.Type.STRING_ARRAY)
        default = Parameter(name, Parameter.Type.STRING_ARRAY, [])
        words = self.node.get_parameter_or(name, default).value
        return [word for word in words if word]

    # -- the beginning

    def join(self, client: Client, layout: dict[str, Any], scenario: dict[str, Any]) -> None:
        """Announce all topics and services of a run.

        `layout`, `scenario`: as in the replies to these queries.

        Raises ValueError for an unknown robot, or one that the role may not drive.
        """
        self.client = client
        self.run = str(layout["run"])
        self.tick = int(layout["tick"])
        self._select_robots(layout)
        self._has_errors = wire.has_errors(scenario)
        carriers = {body["name"] for body in layout["bodies"] if body["kind"] == "carrier"}
        has_batteries = wire.has_batteries(scenario)
        self._powered = carriers.intersection(self._names) if has_batteries else set()
        self._views = wire.views_of(self._has_errors, self._shows_truth)
        # Key -> body -> its newest message.
        self._newest: dict[str, dict[str, dict[str, Any]]] = {key: {} for key in self._views}
        self._physics = PhysicsWatch(are_names_reused=self.role is not None)
        self._coupling = Coupling(
            self._services, self._newest["pose"], lambda: self.tick, self._stand
        )
        self._control = RunControl(
            self.node,
            self._services,
            client,
            run=self.run,
            physics=self._physics,
            role=self.role,
            begin=self._begin_at_tick_0,
        )
        self._has_tf = self._publishers.can_publish_tf()
        self._announce(layout["walls"])
        self._offer_services()
        self._subscribe()
        self._begin()

    def _select_robots(self, layout: dict[str, Any]) -> None:
        """Find which bodies ROS sees, drives and advises. Raises ValueError."""
        kinds = layout["kinds"]
        self._kinds = {body["name"]: kinds[body["kind"]] for body in layout["bodies"]}
        robots = self._robots or [name for name, kind in kinds.items() if kind["robot"]]
        all_names = tuple(self._kinds)
        self._names = bodies.selected(robots, all_names, kinds)
        self._driven = bodies.selected(self._driven, all_names, kinds)
        self._advised = bodies.selected(self._advised, all_names, kinds)
        both = sorted(set(self._driven).intersection(self._advised))
        if both:
            raise ValueError(
                f"driven and advised: {', '.join(both)}: a robot is driven, or its agent is advised"
            )
        self._check_rights()

    def _check_rights(self) -> None:
        """Raise ValueError for robots that the role may not drive.

        The router drops in silence what a role may not send.
        """
        if self.role is None:
            return
        robots = self.role.robots
        forbidden = [name for name in (*self._driven, *self._advised) if name not in robots]
        if forbidden:
            may = ", ".join(robots) or "none"
            raise ValueError(
                f"{', '.join(forbidden)}: the role {self.role.name} may drive {may}; {MADE_BY}"
            )

    def _begin_at_tick_0(self) -> None:
        """Begin if the run has not: physics waits at tick 0 for a velocity of each driven robot."""
        if self.tick == 0:
            self._begin()

    def _begin(self) -> None:
        """Send all driven robots a velocity of 0: physics waits for it before its first step."""
        for name in self._driven:
            self._stand(name, [])

    def _announce(self, walls: Sequence[Sequence[float]]) -> None:
        """Announce all topics, and publish what does not change."""
        publish = self._publishers.publish
        for name in self._names:
            description = partial(self._description, name)
            publish(topics.ROBOT_DESCRIPTION, description, name)
            for topic, _ in self._views.values():
                self._publishers.announce(topic, name)
        for name in self._powered:
            self._publishers.announce(topics.BATTERY_STATE, name)
        publish(topics.GRID, partial(field.grid_of, walls))
        if self._has_tf:
            lasers = [(name, self._kinds[name]["laser"]["x"]) for name in self._names]
            drifting = self._names if self._has_errors else ()
            publish(topics.TF_STATIC, partial(messages.static_transforms, lasers, drifting))

    def _description(self, name: str) -> Message:
        """Return the message `robot_description` of a body."""
        kind = self._kinds[name]
        size = (kind["length"], kind["width"], kind["height"])
        return messages.text(bodies.description(name, size, kind["colour"], kind["laser"]["x"]))

    def _offer_services(self) -> None:
        """Take velocities and service calls."""
        for name in (*self._driven, *self._advised):
            topic = topics.CMD_VEL if self._is_stamped else topics.CMD_VEL_UNSTAMPED
            self.node.create_subscription(
                type_of(topic.type),
                topic.of(name),
                partial(self._take_velocity, name),
                profile(topic.qos),
            )
        for name in self._driven:
            if self._kinds[name]["tows"]:
                self._coupling.offer(name, self._kinds[name]["tows"])
        self._control.offer()

    def _subscribe(self) -> None:
        """Subscribe to what the Orchard sends."""
        self.client.watch(f"alive/physics/{self.run}/*")
        for key in self._views:
            self.client.hear(f"*/{key}", quietly=True)
        for key in ("clock", "events", "end"):
            self.client.hear(key)
        for name in self._advised:
            self.client.hear(f"{name}/velocity")

    # -- from the Orchard to ROS

    def listen(self) -> None:
        """Publish what arrives until the run is over.

        Then `ended` is done, with the error if there is one.
        """
        try:
            for heard in self.client.arrivals():
                self._check(heard)
                why = self._why_over(heard)
                if why:
                    self.ended.set_result(why)
                    return
        except Exception as error:
            # After Ctrl-C has shut ROS down, an error of a call to it says nothing.
            if self.node.context.ok():
                self.ended.set_exception(error)

    def _why_over(self, heard: Heard) -> str:
        """Return why the run is over; '' while it is not."""
        if heard.key == ("clock",) and heard.message.get("run", self.run) != self.run:
            return "another run is under way"
        return self._physics.why_over

    def _check(self, heard: Heard) -> None:
        """Hear a message. A malformed one is logged, and passed over.

        In an open run, one without certificates, any client may publish anything.
        """
        try:
            self._hear(heard)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            self.log.warning(
                f"{'/'.join(heard.key)}: a malformed message is passed over: {error!r}",
                throttle_duration_sec=5.0,
            )

    def _hear(self, heard: Heard) -> None:
        """Do what a message asks for. Raises an error of `_check` for a malformed one."""
        match heard:
            case Heard(("alive", *token), {"up": up}):
                self._hear_token("/".join(token), up)
            case Heard(_, {"run": run}) if run != self.run:
                # It is of a run before this one, or of another one with the same keys.
                pass
            case Heard((name, key), message) if key in self._views:
                self._hear_of(name, key, message)
            case Heard((name, "velocity"), message):
                velocity = partial(wire.velocity_of, name, message)
                self._publishers.publish(topics.CMD_VEL_AGENT, velocity, name)
            case Heard(("clock",), message):
                self._hear_clock(message["tick"])
            case Heard(("events",), message):
                self._hear_events(message["events"])
            case Heard(("end",), {"why": "reset"}):
                self._forget()
            case Heard(("end",), message):
                self._physics.note_end(message["why"])

    def _hear_token(self, token: str, is_up: bool) -> None:
        """Note that a token of physics has come, or is gone."""
        was_up = self._physics.is_up
        self._physics.note_token(token, is_up)
        if self._physics.is_up != was_up:
            self.log.info("physics is away" if was_up else "physics is back")
        # After a reset by this bridge the control begins, once it has its answer.
        if self._physics.is_up and not self._control.is_resetting:
            self._begin_at_tick_0()

    def _forget(self) -> None:
        """Forget the bodies: the run begins again at tick 0."""
        self.tick = 0
        self._physics.note_reset()
        for newest in self._newest.values():
            newest.clear()
        self._coupling.forget()

    def _hear_of(self, name: str, key: str, message: dict[str, Any]) -> None:
        """Publish what a body is seen to do."""
        self._newest[key][name] = message
        if name in self._names:
            topic, message_of = self._views[key]
            self._publishers.publish(topic, partial(message_of, name, message), name)
        if key != "pose":
            return
        if name in self._powered:
            battery_state = partial(wire.battery_state_of, name, message)
            self._publishers.publish(topics.BATTERY_STATE, battery_state, name)
        self._coupling.note_pose(name, message)

    def _hear_clock(self, tick: int) -> None:
        """Publish the time. It comes after all that is sent of the bodies at its tick."""
        self.tick = tick
        self._publishers.publish(topics.CLOCK, partial(messages.clock, tick))
        if self._has_tf:
            self._publishers.publish(topics.TF, partial(self._transforms, tick))

    def _transforms(self, tick: int) -> Message:
        """Return the message `tf` of a tick."""
        odometry = self._newest["odometry" if self._has_errors else "pose"]
        states = {name: wire.state_of(odometry[name]) for name in self._names if name in odometry}
        return messages.transforms(tick, states, self._measured() if self._has_errors else {})

    def _measured(self) -> dict[str, wire.State]:
        """Return the states in `map` of the bodies of which pose and odometry are of one tick.

        In real time one of them may be missing.
        """
        poses = self._newest["pose"]
        odometry = self._newest["odometry"]
        states = {}
        for name in self._names:
            is_known = name in poses and name in odometry
            if is_known and poses[name]["tick"] == odometry[name]["tick"]:
                states[name] = wire.state_of(poses[name])
        return states

    def _hear_events(self, events: list[dict[str, Any]]) -> None:
        for event in events:
            if event["what"] == "deed refused":
                self._coupling.note_refusal(event["who"], event["detail"])

    # -- from ROS to the Orchard

    def _take_velocity(self, name: str, message: Any) -> None:
        """Send a robot a velocity from ROS.

        It counts for 0.5 s at most: then a driven robot stands, and an advised one does what its
        agent wants.
        """
        twist = message.twist if self._is_stamped else message
        forward = float(twist.linear.x)
        turn = float(twist.angular.z)
        if not (isfinite(forward) and isfinite(turn)):
            self.log.warning(f"{name}: cmd_vel is not finite: ignored", throttle_duration_sec=5.0)
            return
        kind = self._kinds[name]
        velocity = self._velocity(
            _within(forward, kind["max_linear"]), _within(turn, kind["max_angular"])
        )
        if name in self._advised:
            self.client.put(f"{name}/advice", velocity)
        elif not self._coupling.is_busy(name):
            self.client.put(f"{name}/velocity", velocity)

    def _velocity(self, forward: float, turn: float) -> dict[str, Any]:
        """Return a velocity as the Orchard takes it. `forward`: m/s. `turn`: rad/s."""
        return {
            "run": self.run,
            "tick": self.tick,
            "linear": {"x": forward},
            "angular": {"z": turn},
        }

    def _stand(self, name: str, wanted: list[dict[str, str]]) -> None:
        """Send a driven robot a velocity of 0, and deeds."""
        self.client.put(f"{name}/velocity", self._velocity(0.0, 0.0) | {"deeds": wanted})
