"""Services that pause, step, reset and end a run, as simulation_interfaces names them.

A Trigger has no argument: the state is in the name, the steps are a parameter of the node.
"""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from time import monotonic, sleep
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from orchard_ros2.client import Client, Refused
from orchard_ros2.physics import BEGIN_SECONDS, LOOK_SECONDS, PhysicsWatch
from orchard_ros2.role import Role
from orchard_ros2.services import Services

STATES = ("playing", "paused", "quitting")


class RunControl:
    """The services of one run.

    A query waits while the run begins again. `is_resetting`: while this bridge resets it.
    """

    def __init__(
        self,
        node: Node,
        services: Services,
        client: Client,
        *,
        run: str,
        physics: PhysicsWatch,
        role: Role | None,
        begin: Callable[[], None],
    ) -> None:
        """`begin`: called when the run has begun again, unless it has gone on since."""
        self._node = node
        self._services = services
        self._client = client
        self._run = run
        self._physics = physics
        self._role = role
        self._begin = begin
        self.is_resetting = False

    def offer(self) -> None:
        """Offer the services."""
        self._services.offer("get_simulation_state", self._get_state)
        self._services.offer("reset_simulation", self._reset)
        self._services.offer("step_simulation", self._step)
        for state in STATES:
            self._services.offer(f"set_simulation_state/{state}", partial(self._set_state, state))

    # -- the services

    async def _get_state(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return await self._answer(response, partial(self._ask, "simulation_state", None))

    async def _set_state(
        self, state: str, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        wish = {"run": self._run, "state": state}
        return await self._answer_operator(
            response, partial(self._ask, "set_simulation_state", wish)
        )

    async def _step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        wish = {"run": self._run, "steps": self._node.get_parameter("steps").value}
        return await self._answer_operator(response, partial(self._ask, "step_simulation", wish))

    async def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return await self._answer_operator(response, self._begin_again)

    async def _answer_operator(
        self, response: Trigger.Response, work: Callable[[], dict[str, Any]]
    ) -> Trigger.Response:
        """Answer with the state that `work` returns, if the role may control the run."""
        if self._role is None or self._role.may_operate:
            return await self._answer(response, work)
        response.message = (
            f"the role {self._role.name} may not control the run; `orchard secure --bridge"
            " NAME=simulation` makes one that may"
        )
        return response

    async def _answer(
        self, response: Trigger.Response, work: Callable[[], dict[str, Any]]
    ) -> Trigger.Response:
        """Answer with the state that `work` returns, or with the words of its refusal."""
        try:
            state = await self._services.in_background(work)
        except Refused as why:
            response.message = str(why)
        else:
            response.success = True
            response.message = f"{state['state']}, tick {state['tick']}"
        return response

    # -- what they do, in a thread of its own each

    def _ask(self, key: str, wish: dict[str, Any] | None) -> dict[str, Any]:
        """Return the run's answer to a query. Raises Refused."""
        self._physics.await_newest_run()
        return self._client.ask(key, wish)

    def _begin_again(self) -> dict[str, Any]:
        """Reset the run. Return the state of the run that begins then. Raises Refused.

        The driven robots stand for the new run only after that: so it is still at tick 0.
        """
        self._physics.await_newest_run()
        self._physics.note_request()
        self.is_resetting = True
        try:
            self._client.ask("reset_simulation", {"run": self._run})
            return self._state_of_new_run()
        finally:
            self.is_resetting = False
            self._begin()

    def _state_of_new_run(self) -> dict[str, Any]:
        """Return the state of the run that begins after a reset. Raises Refused."""
        end = monotonic() + BEGIN_SECONDS
        self._physics.await_requested_run()
        # A query just after physics has come back can find no session.
        while self._physics.has_begun_again and monotonic() < end:
            with suppress(Refused):
                return self._client.ask("simulation_state")
            sleep(LOOK_SECONDS)
        raise Refused(f"the run has been reset, and has not begun again in {BEGIN_SECONDS:g} s")
