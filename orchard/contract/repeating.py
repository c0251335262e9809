"""A check on request: does an agent do the same if it is asked the same again?"""

import logging
from collections.abc import Callable
from copy import deepcopy
from typing import Any

from orchard.contract.agent import Action, Agent
from orchard.contract.difference import difference
from orchard.field.plugins import MISTAKES, reraise_ctrl_c

log = logging.getLogger("orchard")


class Repetition:
    """Asks a copy of an agent, as it was made, what the agent was asked, and compares the two answers."""

    def __init__(self, name: str, agent: Agent) -> None:
        self._name, self._made, self._is_logged = name, _copy_of(agent), False

    def compare(self, tick: int, action: Any, ask: Callable[[Agent], Any]) -> None:
        """Let `ask` ask a fresh copy. If it answers otherwise, log the first difference, once, and let the action's state be `broken`."""
        try:
            other = ask(_copy_of(self._made))
        except MISTAKES as error:
            reraise_ctrl_c(error)
            words = f"its answer: an action, then, asked again, {type(error).__name__}: {error}"
        else:
            words = difference(action, other, "its answer")
        if words and isinstance(action, Action):  # the guard refuses what is no action
            if not self._is_logged:
                log.error("%s is not repeatable, tick %d: %s", self._name, tick, words)
            self._is_logged, action.state = True, "broken"


def _copy_of(agent: Any) -> Any:
    try:
        return deepcopy(agent)
    except MISTAKES as error:
        reraise_ctrl_c(error)
        return agent
