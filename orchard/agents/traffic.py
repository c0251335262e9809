"""Traffic: the agent without a body that grants places on the roads.

A robot names the places that it keeps and those that it wants. It gets all that it wants or none. Robots are served in the order in which
they asked (ties by name). A place belongs to one robot, or to two partners in an exchange of bins. Each claim is complete, so claims that
are lost or come twice do no harm.
"""

import msgspec

from orchard.contract.agent import Action, Heard, Hold, Mail, Observation
from orchard.contract.messages import LAST_TICK, Answer, Claim, Places
from orchard.field.layout import Layout

FORGET = 30  # ticks after which a claim that is not repeated is dropped


class PendingClaim(msgspec.Struct):
    """The places for which a robot waits."""

    places: list[str]
    beside: str  # the partner that may have some of them
    since: int  # tick at which it was first heard
    heard: int  # tick at which it was last heard


class ReservationTable(msgspec.Struct):
    """The places that are reserved for each robot, and the claims that wait, by robot."""

    reserved: dict[str, list[str]] = {}
    wishes: dict[str, PendingClaim] = {}


class Traffic:
    Memory = ReservationTable
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        pass

    def tick(self, seen: Observation, mail: Mail, memory: ReservationTable | None) -> Action:
        table = memory or self.Memory()
        claims = [(heard, heard.body) for heard in mail.requests if isinstance(heard.body, Claim)]
        for heard, claim in claims:
            note(table, heard.sender, claim, seen.tick)
        if claims:
            table.wishes = {
                name: wish
                for name, wish in table.wishes.items()
                if seen.tick - wish.heard <= FORGET
            }
            grant(table)
        answers: list[tuple[Heard, Answer]] = [
            (heard, answer(table, heard.sender)) for heard, _ in claims
        ]
        doing = f"{sum(map(len, table.reserved.values()))} places reserved"
        return Action(
            answers=answers, memory=table, doing=doing, state="resting", hold=Hold(LAST_TICK)
        )


def note(table: ReservationTable, name: str, claim: Claim, tick: int) -> None:
    """Enter a robot's claim: places that it neither keeps nor wants become free; it waits for those that it wants."""
    table.reserved[name] = [
        place
        for place in table.reserved.get(name, [])
        if place in claim.keep or place in claim.want
    ]
    if not claim.want:
        table.wishes.pop(name, None)
        return
    before = table.wishes.get(name)
    since = before.since if before and before.places == claim.want else tick
    table.wishes[name] = PendingClaim(claim.want, claim.beside, since, tick)


def owners_of(table: ReservationTable, place: str) -> list[str]:
    return [name for name, places in table.reserved.items() if place in places]


def grant(table: ReservationTable) -> None:
    """Grant the waiting claims that can be granted, in the order in which they were made."""
    waited_for: set[str] = set()
    taken = set().union(*table.reserved.values())
    for name, wish in sorted(table.wishes.items(), key=lambda item: (item[1].since, item[0])):
        missing = [place for place in wish.places if place not in table.reserved[name]]
        is_free = taken.isdisjoint(missing) or (
            wish.beside != "" and not blockers(table, name, wish)
        )
        # a robot that only joins its partner need not wait in line: the partner could not leave otherwise
        if is_free and (
            waited_for.isdisjoint(missing)
            or all(wish.beside in owners_of(table, place) for place in missing)
        ):
            table.reserved[name] = table.reserved[name] + missing
            taken.update(missing)
            del table.wishes[name]
        else:
            waited_for.update(missing)


def blockers(table: ReservationTable, name: str, wish: PendingClaim) -> list[str]:
    """Return the robots that have places for which a robot waits."""
    wanted = [owners_of(table, place) for place in wish.places]
    return sorted(
        {owner for names in wanted if name not in names for owner in names} - {wish.beside}
    )


def is_alone(table: ReservationTable, name: str, place: str) -> bool:
    return owners_of(table, place) == [name]


def answer(table: ReservationTable, name: str) -> Places:
    """Return the answer to a robot: its places, and the robots that are in the way of its claim."""
    reserved, wish = table.reserved[name], table.wishes.get(name)
    in_the_way = (blockers(table, name, wish) or sorted(set(table.wishes) - {name})) if wish else []
    return Places(
        held=reserved,
        blockers=in_the_way,
        alone=[place for place in reserved if is_alone(table, name, place)],
    )
