"""The commands `stop`, `reset`, `pause`, `resume` and `step`: ask physics of a run, and print what it answers.

`stop` asks all runs, because in an emergency there is no time to choose. The others ask one, because its robots may begin to move.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import Queue
from threading import Thread
from typing import Any, Generic, Literal, TypeVar

import typer

from orchard.contract.messages import pack
from orchard.field.scenario import TIME_STEP
from orchard.folders import runs_folder
from orchard.launch import options
from orchard.launch.run_notes import RunNote, end_left_over, find_run, find_runs, running_here
from orchard.launch.terminal import BAD_INPUT, FINISHED, exit_on_errors, print_error, print_line
from orchard.net.bus import Bus
from orchard.net.endpoints import BusError
from orchard.net.requests import ask
from orchard.security.identity import Identity, Keyring
from orchard.security.roles import EMERGENCY_OPERATOR
from orchard.wire.keys import Keys
from orchard.wire.messages import (
    RunInfo,
    RunMessage,
    SetSimulationState,
    SimulationState,
    StepSimulation,
    Stop,
    Stopped,
    read,
)

M = TypeVar("M")
LOOK_SECONDS = 5.0  # in which a router must answer at the endpoint
ANSWER_SECONDS = 20.0  # in which physics must answer; if it has died, run.py starts it again
QUIET_SECONDS = (
    3.0  # without an answer, after which the user gets a line; more than snapshots.KEPT_SECONDS
)


@dataclass(frozen=True)
class Command(Generic[M]):
    """What physics of a run is asked, and what is printed of its answer."""

    what: str  # a key in `wire.keys.TABLE`
    message: Callable[[str], RunMessage]  # made of the run's id
    reply: type[M]
    show: Callable[[str, M], None]  # prints a reply; its first argument is the title of the run
    extra_seconds: float = 0.0  # that physics may take longer than ANSWER_SECONDS


# -- the commands


def stop(
    robots: options.Robots = None,
    connect: options.There = None,
    secure: options.EmergencyOperator = None,
) -> None:
    """Stop robots, each with its bin, of all active runs on this machine. They stand until they are reset."""
    if (
        connect is None
        and end_left_over(runs_folder(), print_error)
        and not running_here(runs_folder())
    ):
        return
    _ask_runs(find_runs, connect, secure, of_robots(robots or [], is_stop=True))


def reset(
    robots: options.Robots = None,
    connect: options.There = None,
    secure: options.EmergencyOperator = None,
) -> None:
    """Let stopped robots of a run go on."""
    if connect is None:
        end_left_over(runs_folder(), print_error)
    _ask_runs(find_run, connect, secure, of_robots(robots or [], is_stop=False))


def pause(connect: options.There = None, secure: options.EmergencyOperator = None) -> None:
    """Pause a run: simulated time stands, and no agent is late."""
    _ask_runs(find_run, connect, secure, _state("paused"))


def resume(connect: options.There = None, secure: options.EmergencyOperator = None) -> None:
    """Let a paused run go on."""
    _ask_runs(find_run, connect, secure, _state("playing"))


def step(
    steps: options.Steps = "1",  # type: ignore[assignment]  # Typer parses defaults too
    connect: options.There = None,
    secure: options.EmergencyOperator = None,
) -> None:
    """Do some steps of a paused run, 0.1 s each."""
    message = partial(StepSimulation, steps=steps)
    _ask_runs(
        find_run,
        connect,
        secure,
        Command("step_simulation", message, SimulationState, _show_state, steps * TIME_STEP),
    )


def of_robots(robots: list[str], is_stop: bool) -> Command[Stopped]:
    """Return the command that stops or resets robots, given by names or kinds; empty: all of them."""
    return Command(
        "stop", lambda run: Stop(run, is_stop, robots), Stopped, partial(_show_stopped, is_stop)
    )


def _state(wanted: Literal["playing", "paused"]) -> Command[SimulationState]:
    return Command(
        "set_simulation_state",
        lambda run: SetSimulationState(run, wanted),
        SimulationState,
        _show_state,
    )


def _show_state(title: str, answer: SimulationState) -> None:
    print_line(f"{title}{answer.state}: tick {answer.tick}, {answer.tick * TIME_STEP:.1f} s")


def _show_stopped(is_stop: bool, title: str, answer: Stopped) -> None:
    before = [name for name in answer.stopped if name not in answer.changed]
    print_line(
        f"{title}{'stopped' if is_stop else 'reset'}: {', '.join(answer.changed) or 'no further robot'}"
    )
    if before:
        print_line(
            f"{title}{'stopped before' if is_stop else 'still stopped'}: {', '.join(before)}"
        )
    if not answer.kept:
        print_error(
            f"{title}This holds, but is not on the disk yet: it would be lost if physics died now. Repeat the command to check."
        )


# -- the question and its answers


def _ask_runs(
    find: Callable[[Path, str | None], list[RunNote]],
    connect: str | None,
    secure: Path | None,
    command: Command[Any],
) -> None:
    with exit_on_errors(BusError, ValueError):
        notes = find(runs_folder(), connect)
        identity = None if secure is None else Keyring.load(secure).of(EMERGENCY_OPERATOR)
    code = FINISHED
    for note, answer in _answers(notes, lambda note: control(note, command, identity)):
        title = f"{note.title}: " if len(notes) > 1 else ""
        if isinstance(answer, BusError | ValueError):
            print_error(f"{title}{answer}")
            code = BAD_INPUT
        elif isinstance(answer, Exception):
            raise answer
        else:
            command.show(title, answer)
    raise typer.Exit(code)


def _answers(
    notes: list[RunNote], ask: Callable[[RunNote], M]
) -> Iterator[tuple[RunNote, M | Exception]]:
    """Ask all runs at the same time. Yield each answer, or error, as soon as it is there."""
    answers: Queue[tuple[RunNote, M | Exception]] = Queue()

    def put_answer(note: RunNote) -> None:
        try:
            answers.put((note, ask(note)))
        except Exception as error:
            answers.put((note, error))

    for note in notes:
        Thread(target=put_answer, args=(note,), daemon=True).start()  # Ctrl-C does not wait for it
    for _ in notes:
        yield answers.get()


def control(note: RunNote, command: Command[M], identity: Identity | None = None) -> M:
    """Ask physics of a run, and return its reply. Raises BusError if it does not answer or refuses."""
    from orchard.net.zenoh_bus import client  # not at the top: most commands need no network

    keys = Keys()
    if note.run and not note.endpoint.startswith(
        "tls/"
    ):  # an open run that was found here needs no role
        identity = None
    with client(note.endpoint, seconds=LOOK_SECONDS, identity=identity) as bus:
        run = note.run or _ask(bus, keys.of("scenario"), b"", RunInfo, ANSWER_SECONDS).run
        return _ask(
            bus,
            keys.of(command.what),
            pack(command.message(run)),
            command.reply,
            ANSWER_SECONDS + command.extra_seconds,
        )


def _ask(bus: Bus, key: str, payload: bytes, type_: type[M], seconds: float) -> M:
    begun, is_said = time.monotonic(), False

    def check_time() -> None:
        nonlocal is_said
        waited = time.monotonic() - begun
        if waited >= seconds:
            raise BusError(
                f"{bus.endpoint}: physics did not answer within {seconds:g} s; the command may have arrived: try again"
            )
        if waited >= QUIET_SECONDS and not is_said:
            is_said = True
            print_error(
                f"{bus.endpoint}: physics has not answered yet; waiting for up to {seconds:,.0f} s"
            )

    return ask(bus, key, payload, lambda reply: read(reply, type_), seconds, meanwhile=check_time)
