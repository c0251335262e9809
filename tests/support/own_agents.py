"""Agents as users write them: classes that a scenario names as `own_agents.Eastward`.

Some are right; most have one fault, and tests look at what is said of it. They stand in a module of
their own because each process of a run imports them by this name.
"""

import math
import os
import signal
import time
from asyncio import CancelledError
from contextlib import suppress
from threading import Event, Thread

import numpy as np

from orchard.contract.agent import Action
from orchard.contract.messages import Couple, CustomMessage, Here, No, Where
from orchard.field.geometry import Twist


class Eastward:
    """Drives on at 0.25 m/s. It has no fault; the others are made of it."""

    Memory = dict

    def __init__(self, layout, name):
        self.name = name

    def tick(self, observation, mail, memory):
        return Action(twist=Twist(x=0.25), memory=memory, doing="driving on")


class Listing(Eastward):
    """Remembers a list where most agents have a map."""

    Memory = list

    def tick(self, observation, mail, memory):
        return Action(memory=["waits"])


class Forgetful:
    """Has neither `Memory` nor `tick`."""

    def __init__(self, layout, name):
        pass


class Nameless:
    """Has no `__init__`, which takes the layout and a name."""

    def tick(self, observation, mail, memory): ...


class Unmakeable:
    """Raises an error when it is made."""

    def __init__(self, layout, name):
        raise LookupError("no map")


class Wrong(Eastward):
    """From tick 3 on its velocity is no number."""

    def tick(self, observation, mail, memory):
        good = super().tick(observation, mail, memory)
        return Action(twist=Twist(x=math.nan), memory=memory) if observation.tick >= 3 else good


class Hostile(Eastward):
    """Raises an error whose text would be an element of a page, and a command to a terminal."""

    words = "<img src=x onerror=\"document.title='mine'\">"

    def tick(self, observation, mail, memory):
        raise RuntimeError(f"\x1b[31m{self.words}")


class Quitter(Eastward):
    """Calls for the end of Python at its first tick."""

    def tick(self, observation, mail, memory):
        raise SystemExit(3)


class Refuser(Eastward):
    """Calls for the end of Python when it is made."""

    def __init__(self, layout, name):
        raise SystemExit("no licence")


class Stillborn(Eastward):
    """Ends its process at once when it is made, as a crash in C code would."""

    def __init__(self, layout, name):
        os._exit(7)


class Mortal(Eastward):
    """Ends its process at tick 20, as a crash in C code would."""

    def tick(self, observation, mail, memory):
        if observation.tick >= 20:
            os._exit(7)
        return super().tick(observation, mail, memory)


class Endless(Eastward):
    """Never ends tick 3, in which Ctrl-C is pressed."""

    def tick(self, observation, mail, memory):
        if observation.tick == 3:
            signal.raise_signal(signal.SIGINT)
            while True:
                self.think()
        return super().tick(observation, mail, memory)

    def think(self):
        pass


class Stubborn(Endless):
    """Never ends tick 3 either, and catches the first thing that is raised meanwhile."""

    def think(self):
        with suppress(BaseException):
            while True:
                time.sleep(0.01)


def lost(layout, names):
    """Make the agents of a host: it raises an error."""
    raise LookupError("no map")


def nobody(layout, names):
    """Make the agents of a host: there are none."""
    return {}


class Speechless(Eastward):
    """Names a built-in message as its own messages, which must be structs of the user."""

    Messages = Here


class Mischief(Eastward):
    """Drives on, and in every second tick makes a mistake, each time another one."""

    def tick(self, observation, mail, memory):
        if observation.tick % 2:
            return super().tick(observation, mail, memory)
        mistake = MISCHIEF[observation.tick // 2 % len(MISCHIEF)]
        if isinstance(mistake, BaseException):
            raise mistake
        return Action(twist=Twist(x=0.25), **mistake)


# What is raised, or the arguments of a faulty Action.
MISCHIEF = [
    KeyboardInterrupt(),
    CancelledError(),
    GeneratorExit(),
    {"steps_done": True},
    {"steps_done": 2**60},
    {"requests": [("carrier_01", Where())] * 60_000},
    {"requests": [("carrier_01", CustomMessage("letter", {"text": "x" * 2_000_000}))]},
    {"requests": [("*", Where())]},
    {"requests": [("worker_0$*", Where())]},
    {"requests": [("worker_01/mail", Where())]},
    {"requests": [("nobody", Where())]},
    {"doing": "\x1b[2J\ud800", "waits_for": "\x07"},
    {"memory": "\ud800"},
    {"answers": [(None, No(""))]},
]


# Would clear a terminal, change its title, turn the direction of writing, and begin a line that
# looks like one of physics.
ESCAPE = "Injected\x1b[2J\x1b]0;owned\x07\u202e\r\nphysics: all is well"


class Injector(Eastward):
    """Puts control characters for terminals into each text that it can send."""

    def tick(self, observation, mail, memory):
        if observation.tick == 5:
            raise ValueError(ESCAPE)
        requests = [("picker_02", Here(ESCAPE[:64]))] if observation.tick % 3 == 0 else []
        answers = [(heard, No(ESCAPE)) for heard in mail.requests]
        doing = f"{ESCAPE} {observation.tick}"
        return Action(
            deeds=[Couple(ESCAPE[:64])],
            requests=requests,
            answers=answers,
            memory=memory,
            doing=doing,
            waits_for=ESCAPE,
        )


class Scribbler(Eastward):
    """Changes the scan that it is given: it puts 30 m where the laser has no return."""

    def tick(self, observation, mail, memory):
        observation.scan[np.isinf(observation.scan)] = 30
        return super().tick(observation, mail, memory)


class Collector(Eastward):
    """Remembers a set, which no message can carry."""

    def tick(self, observation, mail, memory):
        return Action(twist=Twist(x=0.25), memory={"seen": {self.name}})


class Noisy(Eastward):
    """Prints much, with escape sequences, also as C code does, and leaves a thread."""

    def __init__(self, layout, name):
        Thread(target=self.poll).start()

    def poll(self):
        Event().wait()

    def tick(self, observation, mail, memory):
        print(f"{ESCAPE}\n" * 1000)
        for number in (1, 2):
            os.write(number, f"Written {ESCAPE}\n".encode() * 1000)
        return super().tick(observation, mail, memory)
