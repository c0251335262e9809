"""An agent that does not come to an end is named, with its place: the others of its process are not to blame."""

import logging
import re
import threading
from types import SimpleNamespace

import pytest

from orchard.contract.agent import Action, Mail, without_body
from orchard.contract.guard import Guard
from orchard.net import process


@pytest.fixture
def told():
    """What is logged, as it comes; `there` is set with it."""
    ear = SimpleNamespace(words=[], there=threading.Event())

    class Handler(logging.Handler):
        def emit(self, record):
            ear.words.append(record.getMessage())
            ear.there.set()

    handler = Handler()
    logging.getLogger("orchard").addHandler(handler)
    yield ear
    logging.getLogger("orchard").removeHandler(handler)


def test_who_thinks_for_too_long_is_named_with_the_place(told):
    class Brooding:
        def tick(self, observation, mail, memory):
            assert told.there.wait(30.0)
            return Action(memory=memory)

    host = SimpleNamespace(thinking="picker_01", latest=SimpleNamespace(tick=7), runners=["bin_02", "picker_01"])
    process.monitor(host, seconds=0.05)
    Guard("picker_01", Brooding(), ["picker_01"]).tick(without_body("picker_01", 7), Mail(), None)
    host.thinking = ""
    assert re.fullmatch(rf"picker_01 still thinks about tick 7, in {re.escape(__file__)}, line \d+; until .* stand: bin_02", told.words[0])
