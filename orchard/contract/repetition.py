"""Checks whether an agent is repeatable: whether it answers the same to the same.

A run relies on it: an agent that is restarted, here or in another process, must go on as if nothing
had happened. `--check-agents` turns the check on. Then the guard (orchard/contract/guard.py) makes
it at each tick.
"""

import logging
from collections.abc import Callable
from copy import deepcopy
from typing import Any

from orchard.contract.agent import Action, Agent
from orchard.contract.difference import difference
from orchard.field.plugins import MISTAKES, reraise_ctrl_c

log = logging.getLogger("orchard")


class Repetition:
    """Asks a copy of an agent what the agent was asked, and compares the two answers.

    Each time it is a fresh copy of the agent as it was before its first tick. So it answers
    otherwise if the agent keeps something outside its memory, or reads a clock or a random number.
    """

    def __init__(self, name: str, agent: Agent) -> None:
        """`agent`: one that has not been asked yet."""
        self._name = name
        self._made = _copy_of(agent)
        self._is_logged = False

    def compare(self, tick: int, action: Any, ask: Callable[[Agent], Any]) -> None:
        """Let `ask` ask a fresh copy, and compare its answer with the agent's action.

        If it answers otherwise, set the state of `action` to `broken`, and log the first difference
        of the run.
        """
        try:
            repeated = ask(_copy_of(self._made))
        except MISTAKES as error:
            reraise_ctrl_c(error)
            words = f"its answer: an action, then, asked again, {type(error).__name__}: {error}"
        else:
            words = difference(action, repeated, "its answer")
        # If `action` is no action, the guard itself refuses it, with words that help more.
        if words and isinstance(action, Action):
            if not self._is_logged:
                log.error("%s is not repeatable, tick %d: %s", self._name, tick, words)
            self._is_logged = True
            action.state = "broken"


def _copy_of(agent: Any) -> Any:
    """Return a deep copy of an agent, or the agent itself if it cannot be copied."""
    try:
        return deepcopy(agent)
    except MISTAKES as error:
        reraise_ctrl_c(error)
        return agent
