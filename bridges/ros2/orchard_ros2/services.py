"""The services of a node, all of type Trigger, and work for them that waits."""

from collections.abc import Callable
from contextlib import suppress
from threading import Thread
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger


class Services:
    """Offers services. One that waits holds up neither velocities nor other services."""

    def __init__(self, node: Node) -> None:
        """`node`: the one that offers them."""
        self._node = node
        self._group = ReentrantCallbackGroup()

    def offer(self, service: str, callback: Callable[..., Any]) -> None:
        """Offer a service. `callback`: a coroutine, which takes request and response."""
        self._node.create_service(Trigger, service, callback, callback_group=self._group)

    def future(self) -> Future:
        """Return a future on which a callback can wait. After it is done, call `wake`."""
        return Future(executor=self._node.executor)

    def wake(self) -> None:
        """Let the executor look at what callbacks wait for. A future does not wake it."""
        # There is no executor when the bridge ends.
        with suppress(AttributeError):
            self._node.executor.wake()

    async def in_background(self, work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Return what `work` returns, or raise its error. The executor goes on meanwhile."""
        future = self.future()

        def carry_out() -> None:
            try:
                future.set_result(work())
            except Exception as error:
                future.set_exception(error)
            self.wake()

        Thread(target=carry_out, daemon=True).start()
        return dict(await future)
