"""A check on request: does an agent do the same whenever it is asked the same?"""

import hashlib
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import fields
from types import FrameType
from typing import Any

import numpy as np

from orchard.contract.agent import Action, Agent, Mail, Observation, with_own_arrays
from orchard.contract.difference import difference
from orchard.contract.messages import pack, unpack
from orchard.contract.outer_state import OuterState, describe
from orchard.field.plugins import MISTAKES

log = logging.getLogger("orchard")

CLOCKS = {"time": {"sleep", "mktime", "strptime", "get_clock_info"}}  # module -> its functions that read no clock
DATES = {"now", "utcnow", "today"}
CHANCE = {"urandom", "getrandom"}


class Checked:
    """Asks an agent twice in each tick: itself, and a copy of it as it was made, each with a memory made from the same bytes.

    It tells which answers differ, which state outside the memory has changed, and where the agent read a clock or drew a random number that
    does not come from the seed: each once, with the agent and the tick. The first answer counts; its state is then `broken`.
    """

    def __init__(self, name: str, agent: Agent, memory_type: Any) -> None:
        self._name, self._agent, self._memory_type = name, agent, memory_type
        self._made = _copy_of(agent)
        self._outer = OuterState(agent)
        self._told: set[str] = set()

    @property
    def Memory(self) -> type:
        return self._agent.Memory

    def tick(self, observation: Observation, mail: Mail, memory: Any) -> Action:
        given = [(with_own_arrays(observation), deepcopy(mail), self._again(memory)) for _ in range(2)]
        before, used = self._outer.described() | _chance_of_numpy(), dict[str, str]()
        with _watching(used):
            action = self._agent.tick(*given[0])
        after = self._outer.described() | _chance_of_numpy()
        changes = {place: difference(before.get(place), after.get(place), place) for place in sorted({*before, *after})}
        self._tell(observation.tick, action, used | _without_new_attributes(changes, before) | self._other_answer(action, given[1]))
        return action

    def _again(self, memory: Any) -> Any:
        return None if memory is None else unpack(pack(memory), self._memory_type)

    def _other_answer(self, action: Any, given: tuple[Observation, Mail, Any]) -> dict[str, str]:
        """What a copy of the agent, as it was made, answers in another way: field -> the difference."""
        try:
            other = _copy_of(self._made).tick(*given)
        except MISTAKES as error:
            return {"its answer": f"its answer: an action, then, asked again, {type(error).__name__}: {error}"}
        if not isinstance(action, Action) or not isinstance(other, Action):
            return {}  # the guard tells that
        names = [field.name for field in fields(Action)]
        return {name: difference(getattr(action, name), getattr(other, name), f"its answer's {name}") for name in names}

    def _tell(self, tick: int, action: Any, faults: dict[str, str]) -> None:
        """Log the faults that are new, and mark the action."""
        found = {place: words for place, words in faults.items() if words}
        if new := {place: words for place, words in found.items() if place not in self._told}:
            log.error("%s is not repeatable, tick %d: %s", self._name, tick, "; ".join(new.values()))
        self._told |= {*new}
        if found and isinstance(action, Action):
            action.state = "broken"


def _copy_of(agent: Any) -> Any:
    """A copy of an agent; an agent that cannot be copied is asked itself."""
    try:
        return deepcopy(agent)
    except MISTAKES:
        return agent


def _without_new_attributes(changes: dict[str, str], before: dict[str, Any]) -> dict[str, str]:
    """Without attributes that are set for the first time, such as a `cached_property`: the answer of a copy shows whether they matter."""
    return {place: words for place, words in changes.items() if place in before or not place.startswith("its attribute")}


def _chance_of_numpy() -> dict[str, Any]:
    state = repr(describe(np.random.get_state())).encode()
    return {"the global state of numpy.random": hashlib.blake2b(state, digest_size=4).hexdigest()}


# -- clocks and chance


@contextmanager
def _watching(used: dict[str, str]) -> Iterator[None]:
    """In this context collect the calls of clocks and of chance that Python's own modules offer: their place -> what is called there."""

    def profile(frame: FrameType, event: str, called: Any) -> None:
        if event == "c_call" and (name := _forbidden(called)) and (at := _place_in_users_code(frame)):
            used[at] = f"it calls {name} ({at})"

    before = sys.getprofile()
    sys.setprofile(profile)
    try:
        yield
    finally:
        sys.setprofile(before)


def _forbidden(called: Any) -> str:
    """The name of a C function that reads a clock or draws a random number; '' if it does neither."""
    name, module, owner = getattr(called, "__name__", ""), getattr(called, "__module__", None), getattr(called, "__self__", None)
    if module in CLOCKS and name not in CLOCKS[module]:
        return f"{module}.{name}"
    if isinstance(owner, type) and owner.__module__ == "datetime" and name in DATES:
        return f"{owner.__name__}.{name}"
    if name in CHANCE or (owner is not None and owner is getattr(sys.modules.get("random"), "_inst", None)):
        return f"random numbers without the seed, {name}"
    return ""


def _place_in_users_code(frame: FrameType | None) -> str:
    """The file and line of the user's code that leads to a call; '' if it is a call of logging or of an installed package."""
    while frame is not None:
        top = frame.f_globals.get("__name__", "").partition(".")[0]
        if top == "logging" or "site-packages" in frame.f_code.co_filename:
            return ""
        if top not in sys.stdlib_module_names:
            return f"{frame.f_code.co_filename}, line {frame.f_lineno}"
        frame = frame.f_back
    return ""
