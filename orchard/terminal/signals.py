"""What a command does on Ctrl-C and other signals."""

import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import FrameType
from typing import Any

import typer

from orchard.terminal.exits import FAILED

CTRL_C = "Ctrl-C ends the run"
Handler = Callable[[int, FrameType | None], Any]


@contextmanager
def handled(handlers: Mapping[int, Handler]) -> Iterator[None]:
    """In this context, signals have these handlers. `handlers`: number of a signal -> handler."""
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def stoppable() -> Iterator[Callable[[], bool]]:
    """Yield a function that tells whether to stop.

    The first SIGINT or SIGTERM asks for it. The second one ends all: it raises typer.Exit.
    """
    signals: list[int] = []

    def ask(number: int, frame: FrameType | None) -> None:
        if signals:
            raise typer.Exit(FAILED)
        signals.append(number)

    with handled({signal.SIGINT: ask, signal.SIGTERM: ask}):
        yield lambda: bool(signals)
