"""Commands of `orchard` in this process, for tests of what they say."""

import io
from contextlib import redirect_stderr, redirect_stdout
from typing import NamedTuple

from orchard.commands.main import app


class Called(NamedTuple):
    """The exit code of a command, and what it has printed."""

    exit_code: int
    stdout: str
    stderr: str


def called(*words: object) -> Called:
    """Run `orchard` with these words. Return its exit code, and what it has printed."""
    with redirect_stdout(io.StringIO()) as stdout, redirect_stderr(io.StringIO()) as stderr:
        try:
            app(list(map(str, words)))
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
    return Called(code, stdout.getvalue(), stderr.getvalue())
