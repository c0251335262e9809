"""Agents as users write them, correct and faulty, for scenarios that name them."""

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
    Memory = dict

    def __init__(self, layout, name):
        self.name = name

    def tick(self, observation, mail, memory):
        return Action(twist=Twist(x=0.25), memory=memory, doing="driving on")


class Listing(Eastward):
    Memory = list

    def tick(self, observation, mail, memory):
        return Action(memory=["waits"])


class Forgetful:
    def __init__(self, layout, name):
        pass


class Nameless:
    def tick(self, observation, mail, memory): ...


class Unmakeable:
    def __init__(self, layout, name):
        raise LookupError("no map")


class Wrong(Eastward):
    def tick(self, observation, mail, memory):
        good = super().tick(observation, mail, memory)
        return Action(twist=Twist(x=math.nan), memory=memory) if observation.tick >= 3 else good


class Hostile(Eastward):
    """Raises an error whose text would be an element of a page, and a command to a terminal."""

    words = "<img src=x onerror=\"document.title='mine'\">"

    def tick(self, observation, mail, memory):
        raise RuntimeError(f"\x1b[31m{self.words}")


class Quitter(Eastward):
    def tick(self, observation, mail, memory):
        raise SystemExit(3)


class Refuser(Eastward):
    def __init__(self, layout, name):
        raise SystemExit("no licence")


class Stillborn(Eastward):
    def __init__(self, layout, name):
        os._exit(7)


class Mortal(Eastward):
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
    """Catches whatever is raised meanwhile."""

    def think(self):
        with suppress(BaseException):
            while True:
                time.sleep(0.01)


def lost(layout, names):
    raise LookupError("no map")


def nobody(layout, names):
    return {}


class Speechless(Eastward):
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


ESCAPE = "Injected\x1b[2J\x1b]0;owned\x07\u202e\r\nphysics: all is well"


class Injector(Eastward):
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
    def tick(self, observation, mail, memory):
        observation.scan[np.isinf(observation.scan)] = 30
        return super().tick(observation, mail, memory)


class Collector(Eastward):
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
