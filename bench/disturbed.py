"""How random harvests end whose robots are disturbed: `python -m bench.disturbed drive 0 100` runs
harvests 0 to 99 of a kind.

Advice is a velocity that drives a robot in place of that of its agent, as a person at a joystick
would. The kinds: with `drive` advice drives robots at three moments, for up to 2 s; with `turn` it
turns them, for up to 1 s; with `limits` sensors have the largest errors that a scenario may have.
"""

import sys
import time
from random import Random
from typing import Any

from msgspec.structs import replace

from orchard.field.geometry import Twist
from orchard.field.kinds import EIGHTH
from orchard.field.layout import lay_out
from orchard.field.scenario import DISPATCH_POLICIES, MOST_BIAS, MOST_WHITE, Scenario
from orchard.local import Local
from orchard.report.metrics import collisions
from orchard.server.figures import RunFigures

LONGEST = 80_000  # ticks; a harvest that takes longer counts as jammed
MOMENTS = 3  # at which advice begins
# Ticks of an advice, at most: 2 s if it drives, 1 s if it turns only.
LONGEST_DRIVE = 20
LONGEST_TURN = 10
NOBODY: dict[str, Any] = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "weeds": 0,
}
Advice = list[tuple[int, str, Twist, int]]  # tick, robot, velocity, ticks


def orchard(
    chance: Random,
    most: int = 8,
    lengths: tuple[float, ...] = (30.0, 40.0, 50.0, 70.0),
    **changes: Any,
) -> Scenario:
    """Return a random orchard of 3 to `most` rows."""
    rows = chance.randint(3, most)
    values: dict[str, Any] = {
        "rows": rows,
        "pickers": chance.randint(2, min(rows, 4)),
        "carriers": chance.randint(1, 3),
    }
    values |= {"row_length": chance.choice(lengths), "route": chance.choice(["one-way", "two-way"])}
    values |= {
        "dispatch": chance.choice(DISPATCH_POLICIES),
        "seed": chance.randint(1, 10**6),
        "tractor": chance.random() < 0.8,
    }
    if chance.random() < 0.5:
        values |= NOBODY
    return Scenario(**values, **changes)


def limits(chance: Random) -> tuple[Scenario, Advice]:
    """Return an orchard of short rows with sensors at their limits, and no advice."""
    both = (MOST_WHITE, MOST_BIAS)
    # Both errors of positions, in half of the orchards, or one of them.
    white, bias = chance.choice([both, both, (MOST_WHITE, 0.0), (0.0, MOST_BIAS)])
    gnss = {"white": white, "bias": bias, "bias_time": chance.choice([300.0, 300.0, 60.0, 1000.0])}
    return orchard(
        chance,
        4,
        (20.0, 30.0),
        sensors={"gnss": gnss, "odometry": {"distance": 0.1, "heading": 0.05}},
    ), []


def advised(chance: Random, drives: bool) -> tuple[Scenario, Advice]:
    """Return an orchard, and advice that turns robots or, if it `drives`, drives them too."""
    scenario = orchard(chance)
    layout = lay_out(scenario)
    names = [*layout.names_of("picker"), *layout.names_of("carrier"), *layout.names_of("tractor")]
    longest = LONGEST_DRIVE if drives else LONGEST_TURN
    advice = []
    for _ in range(MOMENTS):
        tick = chance.randint(5, 6000)
        name = chance.choice(names)
        speed = 0.0
        if drives and chance.random() < 0.6:
            speed = chance.uniform(-0.5, 1.0)
        twist = Twist(x=speed, yaw=chance.uniform(-EIGHTH, EIGHTH))
        advice.append((tick, name, twist, chance.randint(1, longest)))
    return scenario, sorted(advice)


def harvest(scenario: Scenario, advice: Advice) -> tuple[bool, int]:
    """Return whether a harvest finishes, and the collisions that robots began."""
    local = Local(scenario, is_hashed=False)
    engine = local.engine
    figures = RunFigures(engine, time.monotonic)
    while not engine.over and not figures.jam and engine.tick < LONGEST:
        answers = local.ask()
        for tick, name, twist, ticks in advice:
            if tick <= engine.tick < tick + ticks:
                # The agent's own action of this tick; if it is not asked, that which stands.
                own = answers.get(name) or replace(engine.actions[name], requests=[], answers=[])
                # It is asked in the next tick, because it has not driven as it wanted.
                engine.wake([name])
                answers = {**answers, name: replace(own, twist=twist, hold=None, deeds=[])}
        figures.update(local.act(answers))
    return engine.over, collisions(engine.world)


def main() -> None:
    """Print how each of some disturbed harvests ends: `KIND FIRST END`."""
    kind, *numbers = sys.argv[1:]
    first, end = map(int, numbers)
    for number in range(first, end):
        chance = Random(f"{kind} {number}")
        if kind == "limits":
            scenario, advice = limits(chance)
        else:
            scenario, advice = advised(chance, drives=kind == "drive")
        finishes, hits = harvest(scenario, advice)
        print(number, "finished" if finishes else "JAMMED", f"{hits} collisions", flush=True)


if __name__ == "__main__":
    main()
