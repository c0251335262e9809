"""`orchard pause`, `resume` and `step`: ask a run, and print what it answers."""

from collections.abc import Callable
from pathlib import Path

from orchard.field.scenario import TIME_STEP
from orchard.launch.emergency_stop import ANSWER_SECONDS, control, find_run
from orchard.launch.terminal import FINISHED, exit_on_errors, print_error, print_line
from orchard.net.endpoints import BusError
from orchard.security.identity import Keyring
from orchard.security.roles import EMERGENCY_OPERATOR
from orchard.wire.messages import SetSimulationState, SimulationState, StepSimulation
from orchard.wire.types import RunMessage


def pause(folder: Path, connect: str | None, secure: Path | None) -> int:
    """Pause the run that is noted in `folder`, or the one at `connect`. Return the exit code."""
    return _ask(folder, connect, secure, "set_simulation_state", lambda run: SetSimulationState(run, "paused"))


def resume(folder: Path, connect: str | None, secure: Path | None) -> int:
    """Let a paused run play. Return the exit code."""
    return _ask(folder, connect, secure, "set_simulation_state", lambda run: SetSimulationState(run, "playing"))


def step(folder: Path, connect: str | None, secure: Path | None, steps: int) -> int:
    """Do some steps of a paused run. Return the exit code."""
    return _ask(folder, connect, secure, "step_simulation", lambda run: StepSimulation(run, steps), ANSWER_SECONDS + steps * TIME_STEP)


def _ask(
    folder: Path,
    connect: str | None,
    secure: Path | None,
    what: str,
    message: Callable[[str], RunMessage],
    seconds: float = ANSWER_SECONDS,
) -> int:
    with exit_on_errors(BusError, ValueError):
        identity = None if secure is None else Keyring.load(secure).of(EMERGENCY_OPERATOR)
        answer = control(find_run(folder, connect), what, message, SimulationState, identity, print_error, seconds)
    print_line(f"{answer.state}: tick {answer.tick}, {answer.tick * TIME_STEP:.1f} s")
    return FINISHED
