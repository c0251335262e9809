"""Places at a moment: which a robot has, which it waits for, and what it is about to hear.

The model has sets of places as bits (`sets`, see "sets of places" in codes.py), and for each robot
its wish, its last claim, and the times at which it claims and hears next.
"""

import numpy as np

from orchard.contract.messages import Places
from orchard.event_model import codes as c
from orchard.event_model.begun.claims import Claims
from orchard.event_model.begun.doing import Doing
from orchard.event_model.begun.ops import Ops
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.kernel.places import ANSWERED, BEFORE_ACTING, HEARD
from orchard.plans.robot import GIVEN_BACK, PATIENCE


class PlacesOfRobots:
    """Takes over what robots and traffic know of places."""

    def __init__(self, harvest: EventHarvest, ops: Ops, claims: Claims, tick: int) -> None:
        self._model = harvest.model
        self._program = harvest.program
        self._numbers = {name: number for number, name in enumerate(harvest.names)}
        needs = harvest.program.needs
        self._needs = needs.array.view(np.ndarray)["places"]
        self._ops = ops
        self._claims = claims
        self._tick = tick

    def take_over(self, me: Doing) -> None:
        """Set the places of a robot, what it waits for, and when it claims and hears next."""
        memory = me.memory
        answer = self._claims.answer(me.name)
        self._set(c.OWN, me, memory.reserved)
        self._set(c.RESERVED, me, self._claims.reserved(me.name))
        self._set(c.ANSWERED, me, memory.agreed)
        self._set(c.ALONE, me, memory.alone)
        self._set(c.TOLD, me, self._told(me))
        if answer is not None:
            self._set(c.COMING, me, answer.held)
            self._set(c.COMING_ALONE, me, answer.alone)
            me.more["answered"] = self._next_answer
        self._take_over_wish(me)
        wanted = self._take_over_wanted(me)
        self._plan_claim(me, answer, wanted)
        self._plan_grant(me, answer, wanted)

    @property
    def _next_answer(self) -> int:
        """The time at which robots hear what is answered by now."""
        return c.QUARTERS * self._tick - BEFORE_ACTING

    def _set(self, kind: int, me: Doing, places: list[str]) -> None:
        """Set one of the sets of places of a robot."""
        # A view of the robot's row, (words,), of 64 bits each.
        bits = self._model.sets[kind, me.number]
        for place in places:
            word, bit = divmod(self._program.places.bits[place], 64)
            bits[word] |= np.uint64(1 << bit)

    def _told(self, me: Doing) -> list[str]:
        """Return the places that a robot's last claim named as kept."""
        newest = self._claims.newest(me.name)
        if newest is not None:
            return newest.keep
        if set(me.memory.agreed) == set(me.memory.reserved):
            return list(me.memory.reserved)
        return list(me.memory.agreed)

    def _take_over_wish(self, me: Doing) -> None:
        """Set for what traffic has a robot wait."""
        wish = self._claims.wish(me.name)
        if wish is not None:
            me.more["wish"] = self._program.places.number_of(wish.places)
            me.more["wish_since"] = wish.since
            me.more["wish_beside"] = self._numbers.get(wish.beside, c.NONE)

    def _take_over_wanted(self, me: Doing) -> list[str]:
        """Set what a robot claims by now, and return it."""
        wanted, beside = self._wanted(me)
        if set(wanted) <= set(me.memory.reserved):
            wanted = []
        me.more["wanted"] = me.more["told_wanted"] = self._program.places.number_of(wanted)
        me.more["beside"] = me.more["told_beside"] = self._numbers.get(beside, c.NONE)
        me.more["claimed"] = me.memory.claimed
        return wanted

    def _wanted(self, me: Doing) -> tuple[list[str], str]:
        """Return the places that a robot claims, and the partner that may have them."""
        newest = self._claims.newest(me.name)
        if newest is not None:
            return newest.want, newest.beside
        wish = self._claims.wish(me.name)
        if wish is not None:
            return wish.places, wish.beside
        return self._granted_unheard(me), ""

    def _granted_unheard(self, me: Doing) -> list[str]:
        """Return the places of an op that were granted to a robot which has not heard of that."""
        reserved = self._claims.reserved(me.name)
        granted = set(reserved) - set(me.memory.reserved)
        if not granted:
            return []
        # The lists of places that it may have asked for: that of its op, or those of a drive's
        # gates.
        lists = [int(self._ops.places[me.op])]
        if me.kind == c.DRIVE:
            first, last = int(self._ops.first_need[me.op]), int(self._ops.last_need[me.op])
            lists = self._needs[first:last].tolist()
        for number in lists:
            names = self._program.places.names_of(number)
            if granted.intersection(names):
                return list(names)
        return []

    # -- what comes

    def _plan_claim(self, me: Doing, answer: Places | None, wanted: list[str]) -> None:
        """Set when traffic hears a robot's next claim that says anything new."""
        if self._claims.sent(me.name) is not None:
            self._claim_at(me, self._tick - 1)
            return
        agreed = set(me.memory.agreed if answer is None else answer.held)
        own = set(me.memory.reserved) | agreed.intersection(wanted)
        is_under_way = answer is None and self._claims.sent(me.name, age=2) is not None
        if agreed != own and not is_under_way:
            self._claim_at(me, max(self._tick, me.memory.claimed + GIVEN_BACK))

    def _claim_at(self, me: Doing, tick: int) -> None:
        """Let traffic hear a claim that is sent at a tick."""
        me.more["due"] = tick
        self._model.timers[c.CLAIM, me.number] = c.QUARTERS * tick + HEARD

    def _plan_grant(self, me: Doing, answer: Places | None, wanted: list[str]) -> None:
        """Set when a robot hears that it was granted what it waits for, if it was.

        It claims again and again, and hears that as the answer to its next claim.
        """
        missing = set(wanted) - set(me.memory.reserved)
        granted = set(self._claims.reserved(me.name))
        if not missing:
            return
        me.more["granted"] = me.more["wanted"]
        if answer is not None and missing <= set(answer.held):
            self._model.timers[c.GRANT, me.number] = self._next_answer
        elif missing <= granted and self._claims.sent(me.name) is None:
            # The first tick from this one on at which its claims, one each PATIENCE ticks, fall.
            next_claim = self._tick + (me.memory.claimed - self._tick) % PATIENCE
            heard = c.QUARTERS * (next_claim + ANSWERED) - BEFORE_ACTING
            self._model.timers[c.GRANT, me.number] = heard
