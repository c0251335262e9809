"""Agents that are not repeatable, each in one way, and some that are although they look as if they
were not.
"""

import random
import time
from functools import cached_property

import numpy as np

from orchard.behaviour.picker import Picker
from orchard.contract.agent import Action
from orchard.field.geometry import Twist

SHARED = {"count": 0}


class Driver:
    Memory = dict

    def __init__(self, layout, name):
        self.layout = layout
        self.count = 0

    def tick(self, observation, mail, memory):
        return Action(Twist(x=self.speed(observation)), memory={"n": (memory or {"n": 0})["n"] + 1})

    def speed(self, observation):
        return 0.25


def drives(speed) -> type[Driver]:
    return type("Drives", (Driver,), {"speed": speed})


Clockwork = drives(lambda self, observation: time.perf_counter_ns() % 1_000_000 * 1e-7)
Chancy = drives(lambda self, observation: random.uniform(0.1, 0.3))
Unseeded = drives(lambda self, observation: float(np.random.default_rng().uniform(0.1, 0.3)))


class Counting(Driver):
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
    def speed(self, observation):
        SHARED["count"] += 1
        return 0.01 * SHARED["count"]


class Diary(Driver):
    """Writes into its memory how often it was asked."""

    def tick(self, observation, mail, memory):
        self.count += 1
        return Action(memory={"asked": [self.count]})


class Tired(Driver):
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
