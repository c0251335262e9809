"""A call of a user's code that takes long is told, with its place, while the program waits."""

import re
from threading import Event

from patience import PATIENCE

from orchard.field.plugins import contained
from orchard.terminal.long_calls import tell_long_calls

LOOKS = 5


class Looks(Event):
    """Stands for the end of the program: it comes after LOOKS looks, which begin with the call."""

    def __init__(self):
        super().__init__()
        self.begun = Event()
        self.count = 0

    def wait(self, timeout=None):
        """Let the watcher look again, without any time between. Return whether it was the last."""
        assert self.begun.wait(PATIENCE)
        if self.count == LOOKS:
            self.set()
        self.count += 1
        return self.is_set()


def thinks(looks):
    """Go on until the last look, as a policy that never decides would."""
    looks.begun.set()
    while not looks.is_set():
        pass


def told_of(call, looks):
    """Return what is told of a call in this thread."""
    lines = []
    tell_long_calls(lines.append, 10.0, looks)
    call(looks)
    return lines


def test_a_long_call_of_a_users_code_is_told_once():
    (line,) = told_of(lambda looks: contained(thinks, looks), Looks())
    told = r"your own code has run for 10 s, and still runs, in .*test_long_calls\.py, line \d+"
    assert re.fullmatch(told, line)


def test_the_programs_own_work_is_not_told():
    assert told_of(thinks, Looks()) == []
