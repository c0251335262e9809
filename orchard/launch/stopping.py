"""`orchard stop` and `orchard reset`: ask the runs, all at the same time, and print what each of them answers."""

from collections.abc import Callable, Iterator
from pathlib import Path
from queue import Queue
from threading import Thread

from orchard.launch.emergency_stop import RunNote, find_run, find_runs, running_here, switch
from orchard.launch.left_over import end_left_over
from orchard.launch.terminal import BAD_INPUT, FINISHED, exit_on_errors, print_error, print_line
from orchard.net.endpoints import BusError
from orchard.security.identity import Keyring
from orchard.security.roles import EMERGENCY_OPERATOR
from orchard.wire.messages import Stopped


def stop_or_reset(folder: Path, robots: list[str], connect: str | None, secure: Path | None, stop: bool) -> int:
    """Stop robots of all runs that are noted in `folder`, or of the run at `connect`; or reset robots of one run. Return the exit code.

    `stop` takes all runs, because in an emergency there is no time to choose. `reset` takes one, because its robots begin to move.
    """
    if connect is None and end_left_over(folder, print_error) and stop and not running_here(folder):
        return FINISHED
    with exit_on_errors(BusError, ValueError):
        notes = find_runs(folder, connect) if stop else [find_run(folder, connect)]
        identity = None if secure is None else Keyring.load(secure).of(EMERGENCY_OPERATOR)
    code = FINISHED
    for note, answer in _answers(notes, lambda note: switch(note, robots, stop, identity, print_error)):
        title = f"{note.title}: " if len(notes) > 1 else ""
        if isinstance(answer, Stopped):
            _print(title, answer, stop)
        elif isinstance(answer, BusError | ValueError):
            print_error(f"{title}{answer}")
            code = BAD_INPUT
        else:
            raise answer
    return code


def _answers(notes: list[RunNote], ask: Callable[[RunNote], Stopped]) -> Iterator[tuple[RunNote, Stopped | Exception]]:
    """Ask all runs at the same time: none waits for another one that is slow. Yield each answer, or error, as soon as it is there."""
    answers: Queue[tuple[RunNote, Stopped | Exception]] = Queue()

    def put_answer(note: RunNote) -> None:
        try:
            answers.put((note, ask(note)))
        except Exception as error:
            answers.put((note, error))

    for note in notes:
        Thread(target=put_answer, args=(note,), daemon=True).start()  # Ctrl-C does not wait for it
    for _ in notes:
        yield answers.get()


def _print(title: str, answer: Stopped, stop: bool) -> None:
    before = [name for name in answer.stopped if name not in answer.changed]
    print_line(f"{title}{'stopped' if stop else 'reset'}: {', '.join(answer.changed) or 'no further robot'}")
    if before:
        print_line(f"{title}{'stopped before' if stop else 'still stopped'}: {', '.join(before)}")
    if not answer.kept:
        print_error(f"{title}This holds, but is not on the disk yet: it would be lost if physics died now. Repeat the command to check.")
