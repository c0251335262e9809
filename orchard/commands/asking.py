"""The commands `stop`, `reset`, `pause`, `resume` and `step`: ask physics of a run.

They print what it answers. `stop` asks all runs, because in an emergency there is no time to
choose. The others ask one, because its robots may begin to move.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import Queue
from threading import Thread
from typing import Annotated, Any, Generic, Literal, TypeVar

import typer
from typer import Argument, Option

from orchard.contract.agent import MOST_STEPS
from orchard.contract.messages import pack
from orchard.field.scenario import TIME_STEP
from orchard.folders import runs_folder
from orchard.launch.run_notes import (
    RunNote,
    end_orphaned_processes,
    find_run,
    find_runs,
    running_here,
)
from orchard.net.bus import Bus
from orchard.net.endpoints import BusError
from orchard.net.requests import ask
from orchard.security.identity import Identity, Keyring
from orchard.security.roles import EMERGENCY_OPERATOR
from orchard.terminal.exits import BAD_INPUT, FINISHED, exit_on_errors
from orchard.terminal.options import whole
from orchard.terminal.output import print_error, print_line
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
ANSWER_SECONDS = 20.0  # in which physics must answer; if it has died, it is started again
# Without an answer, after which the user gets a line; more than snapshots.KEPT_SECONDS.
QUIET_SECONDS = 3.0


def _steps(text: str) -> int:
    """Return a number of steps. Raises BadParameter."""
    return whole(text, MOST_STEPS, "neither a number of steps, from 1 on, nor an option")


_ROBOTS = "picker_01, carrier; default: all robots."
_THERE = "A run elsewhere: tcp/192.168.1.10:7447. Default: here."
_SECURED = "For a secured run: the directory with the role emergency-operator."
Robots = Annotated[list[str] | None, Argument(metavar="ROBOT|KIND", help=_ROBOTS)]
There = Annotated[str | None, Option(metavar="ENDPOINT", help=_THERE)]
Steps = Annotated[int, Argument(metavar="N", parser=_steps, help="Number of steps.")]
EmergencyOperator = Annotated[Path | None, Option("--secure", metavar="DIR", help=_SECURED)]


@dataclass(frozen=True)
class RunQuery(Generic[M]):
    """What physics of a run is asked, and what is printed of its answer."""

    key: str  # in `wire.keys.TABLE`
    message: Callable[[str], RunMessage]  # made of the run's id
    reply: type[M]
    show: Callable[[str, M], None]  # prints a reply; its first argument is the title of the run
    extra_seconds: float = 0.0  # that physics may take longer than ANSWER_SECONDS


# -- the commands


def stop(robots: Robots = None, connect: There = None, secure: EmergencyOperator = None) -> None:
    """Stop robots, each with its bin, of all active runs here. They stand until they are reset."""
    if connect is None:
        has_ended_some = end_orphaned_processes(runs_folder(), print_error)
        if has_ended_some and not running_here(runs_folder()):
            # Their robots stand now. Without a run to ask, the question would end with an error.
            return
    _ask_runs(find_runs, connect, secure, of_robots(robots or [], is_stop=True))


def reset(robots: Robots = None, connect: There = None, secure: EmergencyOperator = None) -> None:
    """Let stopped robots of a run go on."""
    if connect is None:
        end_orphaned_processes(runs_folder(), print_error)
    _ask_runs(find_run, connect, secure, of_robots(robots or [], is_stop=False))


def pause(connect: There = None, secure: EmergencyOperator = None) -> None:
    """Pause a run: simulated time stands, and no agent is late."""
    _ask_runs(find_run, connect, secure, _state("paused"))


def resume(connect: There = None, secure: EmergencyOperator = None) -> None:
    """Let a paused run go on."""
    _ask_runs(find_run, connect, secure, _state("playing"))


def step(
    steps: Steps = "1",  # type: ignore[assignment]  # Typer parses defaults too
    connect: There = None,
    secure: EmergencyOperator = None,
) -> None:
    """Do some steps of a paused run, 0.1 s each."""
    query = RunQuery(
        "step_simulation",
        partial(StepSimulation, steps=steps),
        SimulationState,
        _show_state,
        extra_seconds=steps * TIME_STEP,
    )
    _ask_runs(find_run, connect, secure, query)


def of_robots(robots: list[str], is_stop: bool) -> RunQuery[Stopped]:
    """Return the query that stops or resets robots, by names or kinds; empty: all of them."""
    return RunQuery(
        "stop",
        partial(Stop, stop=is_stop, names=robots),
        Stopped,
        _show_stop if is_stop else _show_reset,
    )


def _state(wanted: Literal["playing", "paused"]) -> RunQuery[SimulationState]:
    """Return the query that pauses a run, or lets it go on."""
    return RunQuery(
        "set_simulation_state",
        partial(SetSimulationState, state=wanted),
        SimulationState,
        _show_state,
    )


def _show_state(title: str, answer: SimulationState) -> None:
    """Print whether a run plays, and where it is."""
    print_line(f"{title}{answer.state}: tick {answer.tick}, {answer.tick * TIME_STEP:.1f} s")


def _show_stop(title: str, answer: Stopped) -> None:
    """Print which robots were stopped now, and which before."""
    _show_robots(title, answer, "stopped", "stopped before")


def _show_reset(title: str, answer: Stopped) -> None:
    """Print which robots were reset, and which are still stopped."""
    _show_robots(title, answer, "reset", "still stopped")


def _show_robots(title: str, answer: Stopped, of_changed: str, of_others: str) -> None:
    """Print which robots have changed, and which are stopped besides. `of_...`: words for them."""
    others = [name for name in answer.stopped if name not in answer.changed]
    print_line(f"{title}{of_changed}: {', '.join(answer.changed) or 'no further robot'}")
    if others:
        print_line(f"{title}{of_others}: {', '.join(others)}")
    if not answer.kept:
        print_error(
            f"{title}This holds, but is not on the disk yet: it would be lost if physics died now. "
            "Repeat the command to check."
        )


# -- the question and its answers


def _ask_runs(
    find: Callable[[Path, str | None], list[RunNote]],
    connect: str | None,
    secure: Path | None,
    query: RunQuery[Any],
) -> None:
    """Ask runs, and print their answers. `find`: returns the runs. Raises typer.Exit."""
    with exit_on_errors(BusError, ValueError):
        notes = find(runs_folder(), connect)
        identity = None if secure is None else Keyring.load(secure).of(EMERGENCY_OPERATOR)
    code = FINISHED
    for note, answer in _answers(notes, partial(control, query=query, identity=identity)):
        title = f"{note.title}: " if len(notes) > 1 else ""
        if isinstance(answer, BusError | ValueError):
            print_error(f"{title}{answer}")
            code = BAD_INPUT
        elif isinstance(answer, Exception):
            raise answer
        else:
            query.show(title, answer)
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
        # Ctrl-C does not wait for a daemon.
        Thread(target=put_answer, args=(note,), daemon=True).start()
    for _ in notes:
        yield answers.get()


def control(note: RunNote, query: RunQuery[M], identity: Identity | None = None) -> M:
    """Ask physics of a run. Return its reply. Raises BusError if it does not answer or refuses."""
    # Most commands need no network.
    from orchard.net.zenoh_bus import client

    keys = Keys()
    # The note of a run that was found here has its id. With --connect the id is asked for below.
    is_here = bool(note.run)
    is_secured = note.endpoint.startswith("tls/")
    role = identity
    if is_here and not is_secured:
        # Such a run asks for no certificate, and `stop` asks secured and other runs in one call.
        role = None
    with client(note.endpoint, seconds=LOOK_SECONDS, identity=role) as bus:
        run = note.run
        if not is_here:
            run = _ask(bus, keys.of("scenario"), b"", RunInfo, ANSWER_SECONDS).run
        return _ask(
            bus,
            keys.of(query.key),
            pack(query.message(run)),
            query.reply,
            ANSWER_SECONDS + query.extra_seconds,
        )


def _ask(bus: Bus, key: str, payload: bytes, type_: type[M], seconds: float) -> M:
    """Ask, and wait for a reply. Say once that it takes long. Raises BusError after `seconds`."""
    begin = time.monotonic()
    has_warned = False

    def check_time() -> None:
        nonlocal has_warned
        waited = time.monotonic() - begin
        if waited >= seconds:
            raise BusError(
                f"{bus.endpoint}: physics did not answer within {seconds:g} s; "
                "the command may have arrived: try again"
            )
        if waited >= QUIET_SECONDS and not has_warned:
            has_warned = True
            print_error(
                f"{bus.endpoint}: physics has not answered yet; waiting for up to {seconds:,.0f} s"
            )

    return ask(
        bus,
        key,
        payload,
        lambda reply: read(reply, type_),
        seconds=seconds,
        meanwhile=check_time,
    )
