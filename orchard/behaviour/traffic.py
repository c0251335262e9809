"""Traffic: the agent without a body that grants places on the roads.

Places are parts of the roads, such as the crossing of a lane and the road D (docs/traffic.md); the
layout names them. A "claim" is the letter in which a robot names the places that it keeps and those
that it wants. A "wish" is a claim that waits. Partners are a picker and the carrier that brings it
a bin: both must be at the lane together, so `beside` names the partner that may share places.

Theory of operation. A robot names the places that it keeps and those that it wants. It gets all
that it wants or none. Robots are served in the order in which they asked (ties by name): a claim
that waits keeps its places from all that asked later. A place belongs to one robot, or to two
partners in an exchange of bins. Each claim is complete, so claims that are lost or come twice do no
harm.

    a claim of a robot   | what traffic does
    ---------------------+------------------------------------------------------------------------
    keeps fewer places   | the others are free at once
    wants places         | it waits from the tick at which it was first heard; another claim with
                         | the same places keeps that tick
    wants none           | what it waited for is forgotten
    is not repeated      | after FORGET ticks what it waited for is forgotten; what it has it keeps
"""

import msgspec

from orchard.contract.agent import Action, Heard, Hold, Mail, Observation
from orchard.contract.messages import LAST_TICK, Answer, Claim, Places
from orchard.field.layout import Layout

# Ticks after which a wish that is not repeated is dropped. A robot repeats it every 5 ticks.
FORGET = 30


class PendingClaim(msgspec.Struct):
    """The places for which a robot waits."""

    places: list[str]
    # The partner that may have some of them; '' for none.
    beside: str
    # Tick at which it was first heard.
    since: int
    # Tick at which it was last heard.
    heard: int


class ReservationTable(msgspec.Struct):
    """The places that are reserved for each robot, and the claims that wait, by robot."""

    reserved: dict[str, list[str]] = {}
    wishes: dict[str, PendingClaim] = {}


class Traffic:
    """Grants places to robots that claim them."""

    Memory = ReservationTable
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        pass

    def tick(self, seen: Observation, mail: Mail, memory: ReservationTable | None) -> Action:
        """Enter the claims that are heard, grant what can be granted, and answer."""
        table = memory or self.Memory()
        claims = [(heard, heard.body) for heard in mail.requests if isinstance(heard.body, Claim)]
        for heard, claim in claims:
            note(table, heard.sender, claim, seen.tick)
        if claims:
            forget(table, seen.tick)
            grant(table)
        answers: list[tuple[Heard, Answer]] = [
            (heard, answer(table, heard.sender)) for heard, _ in claims
        ]
        count = sum(len(places) for places in table.reserved.values())
        return Action(
            answers=answers,
            memory=table,
            doing=f"{count} places reserved",
            state="resting",
            hold=Hold(LAST_TICK),
        )


def note(table: ReservationTable, name: str, claim: Claim, tick: int) -> None:
    """Enter a robot's claim.

    Places that it neither keeps nor wants become free; it waits for those that it wants.
    """
    needed = {*claim.keep, *claim.want}
    reserved = table.reserved.get(name, [])
    table.reserved[name] = [place for place in reserved if place in needed]
    if not claim.want:
        table.wishes.pop(name, None)
        return
    since = tick
    before = table.wishes.get(name)
    if before and before.places == claim.want:
        since = before.since
    table.wishes[name] = PendingClaim(claim.want, claim.beside, since, tick)


def forget(table: ReservationTable, tick: int) -> None:
    """Drop the claims that wait and have long not been repeated."""
    for name, wish in list(table.wishes.items()):
        if tick - wish.heard > FORGET:
            del table.wishes[name]


def owners_of(table: ReservationTable, place: str) -> list[str]:
    """Return the robots for which a place is reserved: none, one, or two partners."""
    return [name for name, places in table.reserved.items() if place in places]


def grant(table: ReservationTable) -> None:
    """Grant the waiting claims that can be granted, in the order in which they were made."""
    taken = set().union(*table.reserved.values())
    # Places for which a robot waits that asked earlier.
    waited_for: set[str] = set()
    for _, name in sorted((wish.since, name) for name, wish in table.wishes.items()):
        wish = table.wishes[name]
        missing = [place for place in wish.places if place not in table.reserved[name]]
        # `taken` is a quick test. Of the places that are taken, the partner may have some.
        has_partner = wish.beside != ""
        is_free = taken.isdisjoint(missing) or (has_partner and not blockers(table, name, wish))
        if is_free and (waited_for.isdisjoint(missing) or _joins_partner(table, wish, missing)):
            table.reserved[name] = table.reserved[name] + missing
            taken.update(missing)
            del table.wishes[name]
        else:
            waited_for.update(missing)


def _joins_partner(table: ReservationTable, wish: PendingClaim, missing: list[str]) -> bool:
    """Whether a robot only joins its partner in places.

    It need not wait in line: the partner could not leave otherwise.
    """
    return all(wish.beside in owners_of(table, place) for place in missing)


def blockers(table: ReservationTable, name: str, wish: PendingClaim) -> list[str]:
    """Return the robots, other than its partner, that have places for which a robot waits."""
    others = set[str]()
    for place in wish.places:
        owners = owners_of(table, place)
        if name not in owners:
            others.update(owners)
    return sorted(others - {wish.beside})


def is_alone(table: ReservationTable, name: str, place: str) -> bool:
    """Whether a place is reserved for one robot only."""
    return owners_of(table, place) == [name]


def answer(table: ReservationTable, name: str) -> Places:
    """Return the answer to a robot: its places, and the robots that are in the way of its claim."""
    reserved = table.reserved[name]
    wish = table.wishes.get(name)
    in_the_way: list[str] = []
    if wish is not None:
        # If no robot has the places, it waits behind those that asked earlier.
        in_the_way = blockers(table, name, wish) or sorted(set(table.wishes) - {name})
    alone = [place for place in reserved if is_alone(table, name, place)]
    return Places(held=reserved, blockers=in_the_way, alone=alone)
