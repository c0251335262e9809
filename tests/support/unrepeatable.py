"""Agents whose actions do not follow from what they are given, each for another reason; and two
that are repeatable although they look as if they were not.

tests/contract/test_check_agents.py uses them: the check asks an agent twice, and compares.
"""

import random
import time
from functools import cached_property

import numpy as np

from orchard.behaviour.picker import Picker
from orchard.contract.agent import Action
from orchard.field.geometry import Twist

# What agents of this module share, as a module variable of a user's own.
SHARED = {"count": 0}


class Driver:
    """Drives ahead at `speed`, m/s, which the classes below replace."""

    Memory = dict

    def __init__(self, layout, name):
        self.layout = layout
        self.count = 0

    def tick(self, observation, mail, memory):
        return Action(Twist(x=self.speed(observation)), memory={"n": (memory or {"n": 0})["n"] + 1})

    def speed(self, observation):
        return 0.25


def drives(speed) -> type[Driver]:
    """Return a class of drivers. `speed`: its method, which returns m/s."""
    return type("Drives", (Driver,), {"speed": speed})


Clockwork = drives(lambda self, observation: time.perf_counter_ns() % 1_000_000 * 1e-7)
Chancy = drives(lambda self, observation: random.uniform(0.1, 0.3))
Unseeded = drives(lambda self, observation: float(np.random.default_rng().uniform(0.1, 0.3)))


class Counting(Driver):
    """Counts in an attribute, which is lost when the agent is made anew."""

    def speed(self, observation):
        self.count += 1
        return 0.01 * self.count


class Latch(Driver):
    """Sets an attribute that it did not have, on which a later tick depends."""

    def speed(self, observation):
        if observation.tick == 3:
            self.latched = True
        return 0.0 if hasattr(self, "latched") else 0.25


class Shared(Driver):
    """Counts in a variable of its module."""

    def speed(self, observation):
        SHARED["count"] += 1
        return 0.01 * SHARED["count"]


class Diary(Driver):
    """Writes into its memory how often it was asked."""

    def tick(self, observation, mail, memory):
        self.count += 1
        return Action(memory={"asked": [self.count]})


class Tired(Driver):
    """Raises an error each second time that it is asked."""

    def speed(self, observation):
        SHARED["count"] += 1
        if SHARED["count"] % 2 == 0:
            raise RuntimeError("asked again")
        return 0.25


class Tidy(Driver):
    """Repeatable: it computes something from its arguments once, and draws from the seed."""

    @cached_property
    def rows(self):
        return len(self.layout.lanes)

    def speed(self, observation):
        return 0.05 * self.rows + 0.01 * random.Random(observation.tick).random()


class OwnPicker(Picker):
    """Repeatable: the built-in picker."""
