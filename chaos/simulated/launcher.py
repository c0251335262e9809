"""run.py as a process of the simulation: its own code starts and follows the others."""

import io
from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Any

from rich.console import Console

from chaos.simulated.network import Network
from chaos.simulated.plan import RUN_PY
from chaos.simulated.processes import SimulatedProcess, SimulatedSupervisor, World
from orchard.launch.distributed import LaunchedRun
from orchard.launch.request import Credentials, RunRequest
from orchard.launch.supervisor import ProcessSpec
from orchard.net.bus import Bus, Inbox
from orchard.report.progress import Progress
from orchard.security.identity import Identity


class Launcher(SimulatedProcess):
    """The process of run.py."""

    def __init__(self, world: World, request: RunRequest) -> None:
        super().__init__(world, ProcessSpec(RUN_PY, "run", ()), request, 0, start_seconds=0.0)
        self.supervisor = SimulatedSupervisor(world)
        # What it returns: the summary, None without one, and why the run has ended.
        self.result: tuple[dict[str, Any] | None, str] = (None, "")
        # s, virtual: when it knew that the run was over; None: it does not know yet.
        self.over_at: float | None = None

    def body(self) -> int:
        with self.supervisor:
            self.result = FollowedRun(self).carry_out(self.inbox)
        return 0

    def kill(self) -> None:
        """Kill it. It ends none of its processes; but their lines close, and so they end."""
        if self.code is None:
            # The supervisor would end them in its `finally` block, which still runs.
            running = self.supervisor.running
            self.supervisor.running = {}
            super().kill()
            for process in running.values():
                process.line.let_go()


class FollowedRun(LaunchedRun):
    """What run.py does, by its own code. It notes when the run was over."""

    def __init__(self, launcher: Launcher) -> None:
        request = launcher.order
        self._launcher = launcher
        shown = SimulatedProgress(launcher.world)
        super().__init__(
            request,
            Credentials(request.options),
            listen=Network.ENDPOINT,
            supervisor=launcher.supervisor,
            progress=shown,
            connect=self._connect_to,
        )

    def _connect_to(
        self, endpoint: str, inbox: Inbox, seconds: float, identity: Identity | None
    ) -> AbstractContextManager[Bus]:
        return self._launcher.connected(seconds)

    def follow(self, inbox: Inbox) -> tuple[dict[str, Any] | None, str]:
        result = super().follow(inbox)
        self._launcher.over_at = self._launcher.world.scheduler.now
        return result


class SimulatedProgress(Progress):
    """What run.py shows: its lines are kept, its table is not."""

    def __init__(self, world: World) -> None:
        super().__init__(Console(file=io.StringIO()))
        self._world = world

    def show(self, figures: Mapping[str, Any], *_: Any) -> None:
        if self._world.observer is not None:
            self._world.observer.course.hear_figures(figures)

    def say(self, words: str) -> None:
        self._world.say(words)
