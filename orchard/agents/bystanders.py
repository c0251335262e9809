"""Who might be in the way of a turn, unseen: people and animals, as a robot knows them by their own words.

A laser looks forward, and a turn sweeps what is beside and behind as well. So a robot that turns asks those who could be near where they
are, and stands while somebody is, or may be by now, within the circle that it sweeps. Somebody far away is asked again only when there
was time enough to come near.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

from orchard.field.kinds import ANIMALS, KINDS, PEOPLE, Kind
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP

SILENT_TICKS = 50  # for which one that does not answer is left to the lasers
MARGIN = 0.1  # m
ASK_AHEAD = 0.3  # s before somebody may have come near: an answer takes two ticks


class Bystander(NamedTuple):
    """Somebody who walks about."""

    name: str
    speed: float  # m/s, at most
    radius: float  # m, of the circle around its box


class Sighting(NamedTuple):
    """Where somebody said that it was; infinitely far for one that does not answer."""

    tick: int
    x: float
    y: float


def bystanders_of(layout: Layout) -> tuple[Bystander, ...]:
    """All people and animals of an orchard."""
    return tuple(Bystander(s.name, KINDS[s.kind].speed, _radius(KINDS[s.kind])) for s in layout.starts if s.kind in PEOPLE + ANIMALS)


def _radius(kind: Kind) -> float:
    return 0.5 * math.sqrt(kind.length * kind.length + kind.width * kind.width)


def sweep_radius(kind: Kind, towing: bool) -> float:
    """m, from a robot's centre to the furthest corner of itself, or of its bin."""
    half = KINDS["bin"].length / 2
    return math.sqrt((kind.tows + half) ** 2 + half * half) if towing else _radius(kind)


def time_to_reach(who: Bystander, sighting: Sighting, tick: int, x: float, y: float, radius: float) -> float:
    """s from now until somebody may touch a circle; negative where it may already."""
    if math.isinf(sighting.x):
        return math.inf if tick - sighting.tick < SILENT_TICKS else -math.inf
    dx, dy = sighting.x - x, sighting.y - y
    room = math.sqrt(dx * dx + dy * dy) - radius - who.radius - MARGIN
    return room / who.speed - (tick - sighting.tick) * TIME_STEP


def doubts(
    everybody: tuple[Bystander, ...], sighted: Mapping[str, Sighting], tick: int, x: float, y: float, radius: float
) -> tuple[list[str], list[str]]:
    """(who is or may be within a circle now, whom to ask because that is so or will be soon)."""
    near, to_ask = [], []
    for who in everybody:
        left = time_to_reach(who, sighted[who.name], tick, x, y, radius) if who.name in sighted else -math.inf
        if left < TIME_STEP:
            near.append(who.name)
        if left < ASK_AHEAD:
            to_ask.append(who.name)
    return near, to_ask
