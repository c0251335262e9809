"""The bridge, a ROS 2 node: it publishes what the Orchard sends, and sends the Orchard what ROS
wants of its robots.

Two threads. The executor's takes velocities and service calls. `listen` takes what the Orchard
sends, in the order in which it comes. A service that asks the run has a thread of its own while it
waits.
"""

import importlib
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache, partial
from math import isfinite
from threading import Thread
from time import monotonic, sleep
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from std_srvs.srv import Trigger

from orchard_ros2 import deeds, wire
from orchard_ros2.client import PREFIX, Client, Heard, Refused
from orchard_ros2.plain import bodies, cdr, field, messages, topics
from orchard_ros2.plain.messages import Message
from orchard_ros2.plain.topics import QoS, Topic
from orchard_ros2.role import MADE_BY, role_in

GOES_SECONDS = 3.0  # an `end` counts if the token of physics goes within this time
BEGIN_SECONDS = 60.0  # that a run which is reset may take to begin again
LOOK_SECONDS = 0.02  # between two looks at whether it has
NO_TF2 = (
    "tf2_msgs cannot be imported: /tf and /tf_static are not published. Install ROS 2's package"
    " tf2_msgs, and source its setup"
)


@lru_cache
def type_of(name: str) -> Any:
    """Return the class of a message type. Raises ImportError if its package is not installed."""
    package, _, kind = name.partition("/msg/")
    return getattr(importlib.import_module(f"{package}.msg"), kind)


def profile(qos: QoS) -> QoSProfile:
    """Return a quality of service as rclpy knows it."""
    reliability = ReliabilityPolicy.RELIABLE if qos.reliable else ReliabilityPolicy.BEST_EFFORT
    durability = DurabilityPolicy.TRANSIENT_LOCAL if qos.latched else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=qos.depth, reliability=reliability, durability=durability)


def _within(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


class Bridge:
    """One run of the Orchard, and the node for it.

    Parameters: docs/ros2.md. `ended` is done when the run is over; its result says why.

    Raises ValueError for a directory without the role of a bridge.
    """

    def __init__(self) -> None:
        self.node = Node("orchard")
        self.log = self.node.get_logger()
        self.ended: Future = Future()
        self.endpoint = self._text("endpoint", "tcp/127.0.0.1:7447")
        self.prefix = self._text("prefix", PREFIX)
        secure = self._text("secure", "")
        self.role = role_in(secure) if secure else None
        self._robots = self._texts("robots", [])
        self._driven, self._advised = self._texts("driven", []), self._texts("advised", [])
        self._is_stamped = bool(self.node.declare_parameter("enable_stamped_cmd_vel", True).value)
        self._shows_truth = bool(self.node.declare_parameter("ground_truth", False).value)
        self.node.declare_parameter("steps", 1)
        self._out: dict[str, Publisher] = {}
        self._services = ReentrantCallbackGroup()

    def _text(self, name: str, default: str) -> str:
        return str(self.node.declare_parameter(name, default).value)

    def _texts(self, name: str, default: list[str]) -> list[str]:
        """A list; '' in it stands for nothing, because ROS 2 has no empty list of texts."""
        self.node.declare_parameter(name, Parameter.Type.STRING_ARRAY)
        given = self.node.get_parameter_or(
            name, Parameter(name, Parameter.Type.STRING_ARRAY, default)
        ).value
        return [word for word in given if word]

    # -- the beginning

    def join(self, client: Client, layout: dict[str, Any], scenario: dict[str, Any]) -> None:
        """Announce all topics and services of a run.

        `layout`, `scenario`: as in the replies to these queries.

        Raises ValueError for an unknown robot, or one that the role may not drive.
        """
        self.client, self.run, self.tick = client, str(layout["run"]), int(layout["tick"])
        kinds = layout["kinds"]
        self._kinds = {body["name"]: kinds[body["kind"]] for body in layout["bodies"]}
        robots = self._robots or [name for name, kind in kinds.items() if kind["robot"]]
        self._names, self._driven, self._advised = (
            bodies.selected(words, tuple(self._kinds), kinds)
            for words in (robots, self._driven, self._advised)
        )
        if both := set(self._driven) & set(self._advised):
            raise ValueError(
                f"driven and advised: {', '.join(sorted(both))}: a robot is driven, or its agent is"
                " advised"
            )
        self._check_rights()
        self._errs = wire.has_errors(scenario)
        carriers = {body["name"] for body in layout["bodies"] if body["kind"] == "carrier"}
        self._powered = carriers & set(self._names) if wire.has_batteries(scenario) else set()
        self._views = wire.views_of(self._errs, self._shows_truth)
        self._newest: dict[str, dict[str, dict[str, Any]]] = {
            key: {} for key in self._views
        }  # key -> body -> its newest message
        self._handling: dict[str, tuple[deeds.Handling, Future]] = {}
        self._over, self._over_since, self._is_up = "", 0.0, True
        # Of physics: two while the router has not noticed that a dead one's link is closed.
        self._tokens = frozenset[str]()
        # The tokens of physics before the newest reset. One that is not among them is of the new
        # run.
        self._reset_tokens = frozenset[str]()
        # The same of the reset that this bridge has asked for.
        self._tokens_before = frozenset[str]()
        self._is_resetting = False
        self._has_tf = self._can_publish_tf()
        for name in self._names:
            self._announce(name)
        for name in (*self._driven, *self._advised):
            self._take_orders(name)
        for name in self._driven:
            self._offer_deeds(name)
        self._offer_control()
        self._publish(topics.GRID, lambda: field.grid_of(layout["walls"]))
        if self._has_tf:
            lasers = [(name, self._kinds[name]["laser"]["x"]) for name in self._names]
            self._publish(
                topics.TF_STATIC,
                lambda: messages.static_transforms(lasers, self._names if self._errs else ()),
            )
        self.client.watch(f"alive/physics/{self.run}/*")
        for key in self._views:
            self.client.hear(f"*/{key}", quietly=True)
        for key in ("clock", "events", "end"):
            self.client.hear(key)
        for name in self._advised:
            self.client.hear(f"{name}/velocity")
        self._begin()

    def _check_rights(self) -> None:
        """The router drops in silence what a role may not send."""
        wanted = [
            name
            for name in (*self._driven, *self._advised)
            if self.role and name not in self.role.robots
        ]
        if self.role and wanted:
            may = ", ".join(self.role.robots) or "none"
            raise ValueError(
                f"{', '.join(wanted)}: the role {self.role.name} may drive {may}; {MADE_BY}"
            )

    def _begin(self) -> None:
        """Physics begins when all robots that are left to others are driven."""
        for name in self._driven:
            self._stand(name, [])

    def _announce(self, name: str) -> None:
        self._publish(
            topics.ROBOT_DESCRIPTION, lambda: messages.text(self._description(name)), name
        )
        for topic in (
            *(topic for topic, _ in self._views.values()),
            *([topics.BATTERY_STATE] if name in self._powered else []),
        ):
            self._publisher(topic, name)

    def _description(self, name: str) -> str:
        kind = self._kinds[name]
        return bodies.description(
            name,
            (kind["length"], kind["width"], kind["height"]),
            kind["colour"],
            kind["laser"]["x"],
        )

    def _can_publish_tf(self) -> bool:
        try:
            type_of(topics.TF.type)
        except ImportError:
            self.log.warning(NO_TF2)
            return False
        return True

    def _take_orders(self, name: str) -> None:
        topic = topics.CMD_VEL if self._is_stamped else topics.CMD_VEL_UNSTAMPED
        self.node.create_subscription(
            type_of(topic.type), topic.of(name), partial(self._order, name), profile(topic.qos)
        )

    def _offer_deeds(self, name: str) -> None:
        for what in (deeds.COUPLE, deeds.UNCOUPLE) if self._kinds[name]["tows"] else ():
            self._offer(f"{name}/{what}", partial(self._handle, name, what))

    def _offer_control(self) -> None:
        """Services as simulation_interfaces names them.

        A Trigger has no argument: the state is in the name, the steps are a parameter.
        """
        self._offer(
            "get_simulation_state", partial(self._control, "simulation_state", lambda: None)
        )
        self._offer("reset_simulation", partial(self._control, "reset_simulation", dict))
        self._offer("step_simulation", partial(self._control, "step_simulation", self._steps))
        for state in ("playing", "paused", "quitting"):
            wish = {"run": self.run, "state": state}
            self._offer(
                f"set_simulation_state/{state}",
                partial(self._control, "set_simulation_state", wish.copy),
            )

    def _offer(self, service: str, callback: Callable[..., Any]) -> None:
        """Offer a service. One that is waiting holds up neither velocities nor other services."""
        self.node.create_service(Trigger, service, callback, callback_group=self._services)

    def _steps(self) -> dict[str, Any]:
        return {"run": self.run, "steps": self.node.get_parameter("steps").value}

    # -- from the Orchard to ROS

    def listen(self) -> None:
        """Publish what arrives until the run is over.

        Then `ended` is done, with the error if there is one.
        """
        try:
            for heard in self.client.arrivals():
                self._check(heard)
                if why := self._why_over(heard):
                    self.ended.set_result(why)
                    return
        except Exception as error:
            if self.node.context.ok():  # else ROS has been shut down meanwhile, as by Ctrl-C
                self.ended.set_exception(error)

    def _check(self, heard: Heard) -> None:
        """In an open run any client may publish anything: a message that is not as it should be is
        told, and passed over.
        """
        try:
            self._hear(heard)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            self.log.warning(
                f"{'/'.join(heard.key)}: a malformed message is passed over: {error!r}",
                throttle_duration_sec=5.0,
            )

    def _hear(self, heard: Heard) -> None:
        match heard:
            case Heard(("alive", *token), {"up": up}):
                name = frozenset(["/".join(token)])
                if up:
                    self._tokens |= name
                else:
                    self._lose_token(name)
                self._note_physics(bool(self._tokens))
            case Heard(_, {"run": run}) if run != self.run:
                pass
            case Heard((name, key), message) if key in self._views:
                self._hear_of(name, key, message)
            case Heard((name, "velocity"), message):
                self._publish(topics.CMD_VEL_AGENT, partial(wire.velocity_of, name, message), name)
            case Heard(("clock",), message):
                self._hear_clock(message["tick"])
            case Heard(("events",), message):
                self._hear_events(message["events"])
            case Heard(("end",), {"why": "reset"}):
                self._forget()
            case Heard(("end",), message):
                self._over, self._over_since = message["why"], monotonic()

    def _lose_token(self, name: frozenset[str]) -> None:
        """Note that a token of physics is gone.

        In a secured run all sessions of physics have one id. So a token that comes back has the
        name of the one before, and is that of the new run.
        """
        self._tokens -= name
        if self.role is not None:
            self._reset_tokens -= name
            self._tokens_before -= name

    def _forget(self) -> None:
        """The run begins again at tick 0. What is known of its bodies is of the run before."""
        self.tick = 0
        self._reset_tokens = self._tokens
        for newest in self._newest.values():
            newest.clear()
        for robot in list(self._handling):
            self._finish(robot, f"{robot}: the run has been reset")

    def _hear_of(self, name: str, key: str, message: dict[str, Any]) -> None:
        self._newest[key][name] = message
        if name in self._names:
            topic, message_of = self._views[key]
            self._publish(topic, partial(message_of, name, message), name)
        if key == "pose" and name in self._powered:
            self._publish(topics.BATTERY_STATE, partial(wire.battery_state_of, name, message), name)
        if key == "pose" and name in self._handling:
            self._go_on(*self._handling[name], message)

    def _hear_clock(self, tick: int) -> None:
        """The clock comes after all that is told of the bodies at its tick."""
        self.tick = tick
        self._publish(topics.CLOCK, partial(messages.clock, tick))
        if self._has_tf:
            self._publish(topics.TF, partial(self._transforms, tick))

    def _transforms(self, tick: int) -> Message:
        odometry = self._newest["odometry" if self._errs else "pose"]
        states = {name: wire.state_of(odometry[name]) for name in self._names if name in odometry}
        return messages.transforms(tick, states, self._measured() if self._errs else {})

    def _measured(self) -> dict[str, wire.State]:
        """The states in `map` of the bodies of which pose and odometry are of the same tick: in
        real time one of them may be missing.
        """
        poses, odometry = self._newest["pose"], self._newest["odometry"]
        known = [name for name in self._names if name in poses and name in odometry]
        return {
            name: wire.state_of(poses[name])
            for name in known
            if poses[name]["tick"] == odometry[name]["tick"]
        }

    def _hear_events(self, events: list[dict[str, Any]]) -> None:
        for event in events:
            if event["what"] == "deed refused" and event["who"] in self._handling:
                self._finish(event["who"], f"{event['who']}: {event['detail']}")

    def _publish(self, topic: Topic, made: Callable[[], Message], robot: str = "") -> None:
        """Publish a message, as bytes: rclpy's objects cost five times as much.

        One that nothing subscribes to is not made.
        """
        publisher = self._publisher(topic, robot)
        if topic.qos.latched or publisher.get_subscription_count():
            publisher.publish(cdr.encoded(made()))

    def _publisher(self, topic: Topic, robot: str = "") -> Publisher:
        name = topic.of(robot)
        if name not in self._out:
            self._out[name] = self.node.create_publisher(
                type_of(topic.type), name, profile(topic.qos)
            )
        return self._out[name]

    # -- the end

    def _note_physics(self, up: bool) -> None:
        if up != self._is_up:
            self.log.info("physics is back" if up else "physics is away")
        self._is_up = up
        if up and self.tick == 0 and not self._is_resetting:
            self._begin()

    def _why_over(self, heard: Heard) -> str:
        """Why the run is over; '' while it is not.

        An `end` counts only with the token of physics, which only physics can take away.
        """
        if heard.key == ("clock",) and heard.message.get("run", self.run) != self.run:
            return "another run is under way"
        is_recent = self._over and monotonic() - self._over_since < GOES_SECONDS
        return f"the run is over: {self._over}" if is_recent and not self._is_up else ""

    # -- from ROS to the Orchard

    def _order(self, name: str, message: Any) -> None:
        """A velocity from ROS.

        It counts for 0.5 s at most: then a driven robot stands, and an advised one does what its
        agent wants.
        """
        twist = message.twist if self._is_stamped else message
        kind, wanted = self._kinds[name], (float(twist.linear.x), float(twist.angular.z))
        forward, turn = (
            _within(wanted[0], kind["max_linear"]),
            _within(wanted[1], kind["max_angular"]),
        )
        if not all(map(isfinite, wanted)):
            self.log.warning(f"{name}: cmd_vel is not finite: ignored", throttle_duration_sec=5.0)
        elif name in self._advised:
            self.client.put(f"{name}/advice", self._velocity(forward, turn))
        elif name not in self._handling:
            self.client.put(f"{name}/velocity", self._velocity(forward, turn))

    def _velocity(self, forward: float, turn: float) -> dict[str, Any]:
        return {
            "run": self.run,
            "tick": self.tick,
            "linear": {"x": forward},
            "angular": {"z": turn},
        }

    def _stand(self, name: str, wanted: list[dict[str, str]]) -> None:
        self.client.put(f"{name}/velocity", self._velocity(0.0, 0.0) | {"deeds": wanted})

    async def _control(
        self,
        key: str,
        wish: Callable[[], dict[str, Any] | None],
        _: Trigger.Request,
        response: Trigger.Response,
    ) -> Trigger.Response:
        try:
            if key != "simulation_state" and self.role and not self.role.may_operate:
                raise Refused(
                    f"the role {self.role.name} may not control the run; `orchard secure --bridge"
                    " NAME=simulation` makes one that may"
                )
            if key == "reset_simulation":
                state = await self._in_background(self._begin_again)
            else:
                state = await self._in_background(partial(self._ask, key, wish()))
            response.success, response.message = True, f"{state['state']}, tick {state['tick']}"
        except Refused as why:
            response.message = str(why)
        return response

    async def _in_background(self, work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Return what `work` returns, or raise its error. The executor goes on meanwhile."""
        future: Future = Future(executor=self.node.executor)

        def carry_out() -> None:
            try:
                future.set_result(work())
            except Exception as error:
                future.set_exception(error)
            self._wake()

        Thread(target=carry_out, daemon=True).start()
        return dict(await future)

    def _ask(self, key: str, wish: dict[str, Any] | None) -> dict[str, Any]:
        """Return the run's answer to a query.

        A run that begins again is waited for. Raises Refused.
        """
        self._await_physics(lambda: self._reset_tokens)
        return self.client.ask(key, wish)

    def _begin_again(self) -> dict[str, Any]:
        """Reset the run. Return the state of the run that begins then. Raises Refused.

        The driven robots stand for the new run only after that: so it is still at tick 0.
        """
        self._await_physics(lambda: self._reset_tokens)
        self._tokens_before = self._tokens
        self._is_resetting = True
        try:
            self.client.ask("reset_simulation", {"run": self.run})
            return self._state_of_new_run()
        finally:
            self._is_resetting = False
            if self.tick == 0:
                self._begin()

    def _state_of_new_run(self) -> dict[str, Any]:
        """Return the state of the run whose physics has a token that was not there before.

        Raises Refused.
        """
        end = monotonic() + BEGIN_SECONDS
        self._await_physics(lambda: self._tokens_before)
        # A query just after physics has come back can find no session.
        while self._tokens - self._tokens_before and monotonic() < end:
            with suppress(Refused):
                return self.client.ask("simulation_state")
            sleep(LOOK_SECONDS)
        raise Refused(f"the run has been reset, and has not begun again in {BEGIN_SECONDS:g} s")

    def _await_physics(self, before: Callable[[], frozenset[str]]) -> None:
        """Wait until physics has a token that is not among those `before`, or has had its time."""
        end = monotonic() + BEGIN_SECONDS
        while not self._tokens - before():
            if monotonic() > end:
                # No service waits again for what does not come.
                self._reset_tokens = frozenset()
                return
            sleep(LOOK_SECONDS)

    async def _handle(
        self, robot: str, what: str, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Couple or uncouple: answer when physics has done it, has refused it, or has had
        its time.
        """
        poses = self._newest["pose"]
        target = (
            deeds.bin_behind(robot, self._kinds[robot]["tows"], poses)
            if robot in poses and what == deeds.COUPLE
            else ""
        )
        if robot not in poses or robot in self._handling or (what == deeds.COUPLE and not target):
            response.message = (
                f"{robot}: busy with a service call, or its pose or a bin is not known yet"
            )
            return response
        future: Future = Future(executor=self.node.executor)
        self._handling[robot] = deeds.Handling(robot, what, target, self.tick), future
        why_not = await future
        response.success, response.message = (
            not why_not,
            why_not or f"{robot}: {what}d {target}".strip(),
        )
        return response

    def _go_on(self, handling: deeds.Handling, _: Future, pose: deeds.Pose) -> None:
        if (outcome := handling.outcome(pose)) is None:
            self._stand(handling.robot, handling.deeds(pose))
        else:
            self._finish(handling.robot, outcome)

    def _finish(self, robot: str, why_not: str) -> None:
        """End a couple or uncouple. `why_not`: '' if it is done."""
        _, future = self._handling.pop(robot)
        future.set_result(why_not)
        self._wake()

    def _wake(self) -> None:
        """Let the executor look at what coroutines await: a future that is done does not
        wake it.
        """
        with suppress(AttributeError):  # there is none when the bridge ends
            self.node.executor.wake()
