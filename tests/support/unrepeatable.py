"""Agents that are not repeatable, each in one way, and some that are although they look as if they were not."""

import random
import time
from datetime import datetime
from functools import cached_property

import numpy as np

from orchard.agents.picker import Picker
from orchard.contract.agent import Action
from orchard.field.geometry import Twist

COUNT = 0
BOARD: dict[str, float] = {}


class Driver:
    Memory = dict
    seen: list[int] = []  # noqa: RUF012 - the fault of `Shared`

    def __init__(self, layout, name):
        self.layout, self.name, self.count, self.last = layout, name, 0, None

    def tick(self, observation, mail, memory):
        return Action(Twist(x=self.speed(observation)), memory={"n": (memory or {"n": 0})["n"] + 1})

    def speed(self, observation):
        return 0.25


class Clockwork(Driver):
    """Reads a clock; both answers of a tick are the same."""

    def speed(self, observation):
        return 0.25 if time.monotonic() > 0 else 0.0


class Dated(Driver):
    def speed(self, observation):
        return 0.25 if datetime.now().year > 2000 else 0.0


class Chancy(Driver):
    def speed(self, observation):
        return random.uniform(0.1, 0.3)


class Dice(Driver):
    def speed(self, observation):
        return 0.25 if np.random.random() >= 0.0 else 0.0


class Unseeded(Driver):
    def speed(self, observation):
        return float(np.random.default_rng().uniform(0.1, 0.3))


class Counting(Driver):
    """Counts in an attribute, long before that matters."""

    def speed(self, observation):
        self.count += 1
        return 0.25 if self.count < 1000 else 0.0


class Latch(Driver):
    """Sets an attribute that it did not have, which matters later."""

    def speed(self, observation):
        if observation.tick == 3:
            self.latched = True
        return 0.0 if hasattr(self, "latched") else 0.25


class Global(Driver):
    def speed(self, observation):
        global COUNT
        COUNT += 1
        return 0.25


def post(name, x):
    BOARD[name] = x


class Poster(Driver):
    """Leaves notes for others by a function of its module."""

    def speed(self, observation):
        post(self.name, observation.x)
        return 0.25


class Shared(Driver):
    def speed(self, observation):
        self.seen.append(observation.tick)
        return 0.25


class Late(Driver):
    """Makes an attribute of its class."""

    def speed(self, observation):
        Late.count = getattr(Late, "count", 0) + 1
        return 0.25


def counter():
    count = 0

    def counted():
        nonlocal count
        count += 1
        return count

    return counted


COUNTED = counter()


class Enclosed(Driver):
    def speed(self, observation):
        COUNTED()
        return 0.25


class OwnDice(Driver):
    """A stream of random numbers in an attribute."""

    def __init__(self, layout, name):
        super().__init__(layout, name)
        self.chance = random.Random(5)

    def speed(self, observation):
        return 0.25 if self.chance.random() >= 0.0 else 0.0


class Tidy(Driver):
    """Repeatable: it computes what follows from its arguments when it first needs it, and draws from the seed."""

    @cached_property
    def rows(self):
        return len(self.layout.lanes)

    def speed(self, observation):
        return 0.05 * self.rows + 0.01 * random.Random(observation.tick).random()


class OwnPicker(Picker):
    """Repeatable: the built-in picker."""
