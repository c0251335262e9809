"""Robots that something has turned or moved realign, come back to their line, and go on.

Advice is a client's velocity for a robot, which counts in place of its agent's for some ticks: here
it takes robots off their lines. x points east and y north, m; a yaw of 0 faces east, rad.
"""

from dataclasses import astuple, dataclass, field
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from stage import Stage, empty_orchard

from orchard.field.geometry import Twist
from orchard.field.kinds import EIGHTH
from orchard.plans.robot import Gate
from orchard.plans.steps import DriveTo, Face, TakeBin, Wait
from orchard.report.metrics import collisions

ROBOTS = ("picker_01", "picker_02", "carrier_01", "carrier_02", "tractor_01")


# Simulated s within which each harvest of this file is over.
MOST_SECONDS = 3000
# Collisions of one piece of advice: a robot that it drives may hit something once.
COLLISIONS_OF_ADVICE = 1


@dataclass
class Advice:
    """Advice that drives a robot at a velocity, in place of its agent, from a tick on."""

    #: The tick at which it begins.
    tick: int
    robot: str
    #: m/s
    speed: float
    #: rad/s
    turn_rate: float
    #: For how many ticks it drives the robot.
    ticks: int


@dataclass
class AdvisedHarvest:
    """A harvest with advice."""

    #: What differs from an orchard without people and animals, by the keys of a scenario.
    changes: dict[str, Any]
    advice: list[Advice] = field(default_factory=list)

    def run(self) -> Stage:
        """Harvest to the end, and follow the advice on the way."""
        stage = Stage(empty_orchard(**self.changes))
        engine = stage.local.engine
        for advice in self.advice:
            while stage.world.tick < advice.tick and not engine.over:
                stage.tick()
            if not engine.over:
                advise(stage, advice.robot, Twist(advice.speed, yaw=advice.turn_rate), advice.ticks)
        stage.run_until(lambda: engine.over, MOST_SECONDS)
        return stage


def advise(stage: Stage, name: str, twist: Twist, ticks: int) -> None:
    """Drive a robot with this velocity in place of its agent's, as advice does.

    The letters that the agent writes are sent as ever. An agent that was not asked at this tick
    wrote its letters at an earlier one, so they are not sent again.
    """
    engine = stage.local.engine
    for _ in range(ticks):
        actions = stage.local.ask()
        of_agent = actions.get(name) or replace(engine.actions[name], requests=[], answers=[])
        # The robot is no longer where its agent expects it: so the agent is asked at the next tick.
        engine.wake([name])
        advised = replace(of_agent, twist=twist, hold=None, deeds=[])
        events = stage.local.act({**actions, name: advised})
        stage.account.update(events)


def displaced_carrier(y: float = 0.0, yaw: float = 0.0) -> Stage:
    """Return a stage with a carrier on open ground that drives east, and was moved and turned.

    The carrier drives from x = -35 m towards -5 m. After 1 s it is moved by `y`, m, together with
    its bin, and turned by `yaw`, rad, without its bin.
    """
    stage = Stage(empty_orchard())
    stage.put("carrier_01", -35.0, 29.0)
    stage.give("carrier_01", [DriveTo(x=-5.0), Wait(1.0), Face("WEST")])
    stage.run(1.0)
    carrier = stage.world.index["carrier_01"]
    bin_ = stage.world.coupled[carrier]
    stage.world.pose[carrier] += (0.0, y, yaw)
    stage.world.pose[bin_] += (0.0, y, 0.0)
    stage.local.engine.wake(["carrier_01"])
    return stage


@pytest.mark.parametrize(
    ("y", "yaw"),
    [(0.0, 0.01), (0.0, -0.3), (0.3, 0.0), (-0.05, 0.2)],
    ids=["turned a little", "turned much", "beside its line", "turned and beside its line"],
)
def test_a_robot_off_its_heading_or_line_comes_back_to_it(y, yaw):
    """Long before its goal at x = -5 m it is back on its line, y = 29 m, to 2 cm."""
    stage = displaced_carrier(y, yaw)
    stage.run_until(lambda: stage.pose("carrier_01")[0] >= -10.0, 60)
    stage.assert_at("carrier_01", heading="EAST")
    assert stage.pose("carrier_01")[1] == pytest.approx(29.0, abs=0.02)
    stage.run_until(lambda: stage.pose("carrier_01")[0] == pytest.approx(-5.0, abs=1e-6), 20)


def test_a_robot_that_stands_is_back_at_its_place_before_it_acts():
    """Advice moves the carrier while it waits; it returns to x = -5 m before it turns around."""
    stage = displaced_carrier()
    stage.run_until(lambda: stage.pose("carrier_01")[0] == pytest.approx(-5.0, abs=1e-6), 60)
    advise(stage, "carrier_01", Twist(x=0.5, yaw=0.2), 8)

    # It faces west at a yaw of pi or -pi, so more than 3.0 rad either way.
    def has_turned_around() -> bool:
        return stage.doing("carrier_01") == "" and abs(stage.pose("carrier_01")[2]) > 3.0

    stage.run_until(has_turned_around, 60)
    assert stage.pose("carrier_01")[:2] == pytest.approx((-5.0, 29.0), abs=0.03)


def test_a_robot_driven_past_a_gate_comes_back_and_waits():
    """The robot once drove on without the gate's places, and two robots waited for each other.

    A gate is an x on a drive before which the robot must get places on the roads. Here it is at
    x = -25 m, 10 m and so 10 s after the start.
    """
    stage = Stage(empty_orchard())
    stage.put("carrier_01", -35.0, 29.0)
    # The gate opens when bin_01 is left, which never happens here.
    gate = Gate(["east/D/1"], -25.0, bin="bin_01")
    stage.give("carrier_01", [DriveTo(x=-5.0, needs=[gate])])
    stage.run(12.0)
    # 10 ticks of 0.5 m/s are 0.5 m past the gate.
    advise(stage, "carrier_01", Twist(x=0.5), 10)
    assert stage.pose("carrier_01")[0] == pytest.approx(-24.5)
    stage.run(10.0)
    stage.assert_at("carrier_01", x=-25.0)


@pytest.mark.parametrize("route", ["one-way", "two-way"])
@pytest.mark.parametrize(
    "twist",
    [Twist(x=0.93, yaw=-0.08), Twist(x=0.787, yaw=-0.33), Twist(x=-0.3, yaw=0.3)],
    ids=["ahead", "ahead and turned", "back and turned"],
)
def test_a_carrier_off_its_place_comes_back_and_takes_the_bin(route, twist):
    """The carrier once drove back into the bin again and again: no laser looks back."""
    stage = Stage(empty_orchard(route=route))
    stage.tick()

    def next_steps() -> list[type]:
        return [type(step) for step in stage.local.memories["carrier_01"].plan[:2]]

    # The carrier is about to turn its back to the full bin, and to couple it.
    stage.run_until(lambda: next_steps() == [Face, TakeBin], 600)
    advise(stage, "carrier_01", twist, 16)
    stage.run_until(lambda: TakeBin not in next_steps(), 200)
    # Advice may drive the carrier into the bin a few times. While the fault was there, the carrier
    # hit the bin far more often on its way back.
    assert collisions(stage.world) <= 4


# At a random moment of a harvest of some 3,000 ticks, any robot is driven for up to 2 s, as fast as
# it can at most: EIGHTH is its greatest rate of turning.
ADVICE = st.builds(
    Advice,
    tick=st.integers(5, 2500),
    robot=st.sampled_from(ROBOTS),
    speed=st.just(0.0) | st.floats(-0.5, 1.0),
    turn_rate=st.floats(-EIGHTH, EIGHTH),
    ticks=st.integers(1, 20),
)


@settings(max_examples=10)
@given(st.sampled_from(["one-way", "two-way"]), st.lists(ADVICE, min_size=1, max_size=3))
def test_a_harvest_with_robots_turned_by_advice_finishes(route, advice):
    changes = {
        "rows": 4,
        "pickers": 2,
        "carriers": 2,
        "row_length": 30.0,
        "route": route,
        "tractor": True,
    }
    AdvisedHarvest(changes, sorted(advice, key=astuple)).run()


# Where a robot was when its harvest jammed, and that harvest. Random advice has found them: the
# figures are those of that advice, and mean nothing else.
JAMMED = {
    "in a turn, its bin askew before the next carrier": AdvisedHarvest(
        {
            "rows": 4,
            "pickers": 2,
            "carriers": 2,
            "row_length": 30.0,
            "tractor": True,
            "route": "two-way",
        },
        [
            Advice(258, "carrier_01", 0.085, 0.2959803560605614, 20),
        ],
    ),
    "in a turn, 1.2 m off the next line, beside a full bin": AdvisedHarvest(
        {
            "rows": 5,
            "row_length": 50.0,
            "seed": 14460,
            "dispatch": "predictive-farthest",
            "route": "two-way",
        },
        [
            Advice(1645, "picker_02", 0.949166901372354, -0.34200036362679015, 3),
            Advice(2374, "picker_02", 0.0, -0.3155027663612042, 5),
            Advice(4515, "carrier_01", 0.6866357807898149, 0.1942637528050758, 20),
        ],
    ),
    "aslant in the queue, behind another one": AdvisedHarvest(
        {
            "rows": 4,
            "row_length": 40.0,
            "carriers": 4,
            "seed": 82031,
            "tractor": True,
            "route": "two-way",
        },
        [
            Advice(181, "picker_02", 0.37631310680089003, 0.26098980563623364, 2),
            Advice(2235, "carrier_01", 0.42636171792004385, -0.04665318254538581, 16),
            Advice(5202, "carrier_03", 0.0, -0.026005985185407365, 19),
        ],
    ),
    "far back to a line, past the place of the empty bin": AdvisedHarvest(
        {"rows": 5, "carriers": 1, "seed": 502694, "tractor": True, "dispatch": "assignment"},
        [
            Advice(590, "carrier_01", 0.0, 0.07719545572934472, 7),
            Advice(2012, "picker_01", 0.17111112491881508, -0.1607517764608366, 19),
            Advice(2299, "picker_01", -0.297743710622897, 0.0647417695607021, 12),
        ],
    ),
    "behind its place, before a fence": AdvisedHarvest(
        {
            "rows": 6,
            "pickers": 4,
            "row_length": 30.0,
            "carriers": 3,
            "seed": 251196,
            "tractor": True,
            "dispatch": "assignment",
        },
        [
            Advice(2589, "tractor_01", 0.9806336947484193, -0.20920873895287542, 18),
        ],
    ),
    "aslant beside a picker that waits for the next one": AdvisedHarvest(
        {
            "rows": 5,
            "pickers": 4,
            "carriers": 2,
            "seed": 485947,
            "tractor": True,
            "route": "two-way",
        },
        [
            Advice(2640, "picker_01", 0.0, 0.012313167436511119, 15),
            Advice(3196, "picker_01", 0.0, 0.30920989680203304, 5),
            Advice(3433, "carrier_02", 0.8504667721745955, -0.07967350334625789, 14),
        ],
    ),
    "aslant before a picker that waits for it": AdvisedHarvest(
        {
            "rows": 8,
            "pickers": 4,
            "row_length": 40.0,
            "carriers": 1,
            "seed": 991736,
            "dispatch": "nearest",
            "route": "two-way",
        },
        [
            Advice(856, "carrier_01", 0.8510380779924174, -0.273452245012485, 15),
            Advice(3358, "picker_03", 0.27384450007697103, -0.2010655864776212, 6),
            Advice(5258, "picker_02", 0.0, 0.07363394434795179, 9),
        ],
    ),
    "aslant beside its full bin, where it can turn neither ahead nor back": AdvisedHarvest(
        {
            "rows": 4,
            "pickers": 2,
            "carriers": 2,
            "row_length": 30.0,
            "route": "two-way",
            "tractor": True,
        },
        [
            Advice(213, "carrier_01", 0.0, 1.07e-51, 19),
            Advice(746, "carrier_01", -0.44255244420795103, 0.17461320145950499, 17),
        ],
    ),
    "past the place where it leaves the empty bin": AdvisedHarvest(
        {
            "rows": 4,
            "pickers": 3,
            "row_length": 40.0,
            "carriers": 3,
            "seed": 26015,
            "tractor": True,
            "dispatch": "nearest",
        },
        [
            Advice(820, "carrier_02", 0.7297432713987164, -0.06999531398102604, 20),
            Advice(2480, "picker_02", 0.916847694408812, -0.3126112065199836, 13),
            Advice(3385, "picker_01", 0.614761371903781, -0.12484377430627414, 20),
        ],
    ),
    "past the place where it turns, with another one behind": AdvisedHarvest(
        {
            "rows": 4,
            "pickers": 2,
            "carriers": 2,
            "row_length": 30.0,
            "route": "two-way",
            "tractor": True,
        },
        [
            Advice(1801, "carrier_02", 1.0, 0.25, 12),
        ],
    ),
    "past the head of the queue, with another one behind": AdvisedHarvest(
        {
            "rows": 4,
            "pickers": 2,
            "carriers": 4,
            "row_length": 30.0,
            "route": "two-way",
            "tractor": True,
        },
        [
            Advice(1879, "carrier_01", 1.0, 0.17337756876858523, 16),
            Advice(2215, "carrier_02", 1.0, -0.2899141750246008, 18),
        ],
    ),
}


@pytest.mark.parametrize("harvest", JAMMED.values(), ids=JAMMED)
def test_a_harvest_with_robots_driven_off_their_lines_finishes(harvest):
    """Each of these harvests once jammed, or a robot hit the same thing again and again."""
    stage = harvest.run()
    most = COLLISIONS_OF_ADVICE * len(harvest.advice)
    assert collisions(stage.world) <= most, stage.happened("collision")[-5:]
