"""The examples of the recipes of CONTRIBUTING.md: what a person edits who follows them.

tests/docs/test_recipes.py makes these changes in a copy of the clone, and runs the tests that the
recipe names. So a recipe that lacks a file is found, and one whose code has moved. Each text must
stand in the code as it is written here: where a test fails after a change of the code, change both.
"""

from pathlib import Path
from typing import NamedTuple


class Edit(NamedTuple):
    """A change of one file: a text that stands there once, and what takes its place.

    Without `before` the file is a new one.
    """

    file: str
    before: str
    after: str

    def carry_out(self, clone: Path) -> None:
        """Change the file. Raises AssertionError if the text does not stand there once."""
        path = clone / self.file
        if not self.before:
            assert not path.exists(), self
            path.write_text(self.after)
            return
        text = path.read_text()
        assert text.count(self.before) == 1, self
        path.write_text(text.replace(self.before, self.after))


class Copy(NamedTuple):
    """A new file that is the copy of another one."""

    file: str
    source: str

    def carry_out(self, clone: Path) -> None:
        """Make the file in a clone."""
        (clone / self.file).write_bytes((clone / self.source).read_bytes())


TIPPED = '''def _tipped(world: World, collisions: list[Event]) -> list[Event]:
    """The events for bins into which something drove."""
    return [
        Event(world.tick, "bin tipped", event.whom, event.who)
        for event in collisions
        if kind_of(event.whom) == "bin"
    ]


def _left_part_full('''
TIPPED_TEST = """def test_a_bin_into_which_a_robot_drives_tips():
    spot = yard(("picker", Pose(0, 0, EAST)), ("bin", Pose(2, 0, EAST)))
    spot.drive(10, picker_01=Twist(0.5))
    assert [(event.who, event.whom) for event in spot.happened("bin tipped")] == [
        ("bin_02", "picker_01")
    ]


def test_only_weeds_are_flattened"""
AN_EVENT = [
    Edit("orchard/contract/events.py", '    "bin full",\n', '    "bin full",\n    "bin tipped",\n'),
    Edit(
        "orchard/sim/physics.py",
        "        events += _picked(world, world.space.picked_from)\n",
        "        events += _tipped(world, events)\n"
        "        events += _picked(world, world.space.picked_from)\n",
    ),
    Edit("orchard/sim/physics.py", "def _left_part_full(", TIPPED),
    Edit("tests/sim/test_deeds.py", "def test_only_weeds_are_flattened", TIPPED_TEST),
]

HURRY = '''class Hurry(AgentMessage):
    """From a picker to the bin that it left: so long does it wait already."""

    seconds: Seconds


class Here(AgentMessage):
'''
HURRY_TEST = '''"""A picker that waits tells its bin for how long."""

from orchard import Local, Scenario
from orchard.contract.messages import Hurry, Yes


def test_a_bin_hears_how_long_its_picker_waits():
    run = Local(Scenario(rows=3, carriers=1))
    said = []
    while not said:
        assert not run.ended
        run.tick()
        for action in run.actions.values():
            said += [answer for heard, answer in action.answers if isinstance(heard.body, Hurry)]
    assert said == [Yes()]
'''
A_MESSAGE = [
    Edit("orchard/contract/messages.py", "class Here(AgentMessage):\n", HURRY),
    Edit("orchard/contract/messages.py", "    | Here\n", "    | Here\n    | Hurry\n"),
    Edit("orchard/plans/handling.py", "    Here,\n", "    Here,\n    Hurry,\n"),
    Edit(
        "orchard/plans/handling.py",
        "            answer = robot.ask(memory.full_bin, EmptyBin(), every=SELDOM)\n",
        "            answer = robot.ask(memory.full_bin, EmptyBin(), every=SELDOM)\n"
        "            robot.ask(memory.full_bin, Hurry(0.0), every=SELDOM)\n",
    ),
    Edit(
        "orchard/behaviour/bin.py",
        "            case messages.Confirm() if memory.carrier == heard.sender:\n",
        "            case messages.Hurry():\n"
        "                return messages.Yes()\n"
        "            case messages.Confirm() if memory.carrier == heard.sender:\n",
    ),
    Edit(
        "orchard/contract/events.py",
        '    Here: "here is {0.bin}",\n',
        '    Here: "here is {0.bin}",\n    Hurry: "{0.seconds:.0f} s already",\n',
    ),
    Edit("orchard/contract/events.py", "    Here,\n", "    Here,\n    Hurry,\n"),
    Edit("tests/behaviour/test_hurry.py", "", HURRY_TEST),
]

WIND = """    wind: Annotated[
        float,
        Field(ge=0.0, le=20.0, description="wind, in which people walk slower, m/s"),
        CIRCUMSTANCE,
    ] = 0.0
    agents: Annotated[Classes, CHOICE] = {}
"""
PERSON = '''    """Walks about the orchard."""

    Memory = WalkerMemory
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
'''
IN_WIND = "        self.pace = KINDS[kind_of(name)].speed / (1.0 + layout.scenario.wind / 10.0)\n"
WIND_TEST = '''"""Wind slows people."""

from orchard import Local, Scenario


def metres_walked(wind):
    nobody = {"dogs": 0, "cats": 0}
    one = {"workers": 0, "visitors": 1}
    run = Local(Scenario(rows=3, wind=wind, people=one, animals=nobody))
    for _ in range(20):
        run.tick()
    return run.engine.world.distance[run.engine.layout.index["visitor_01"]]


def test_people_walk_slower_in_wind():
    assert 0.0 < metres_walked(10.0) < metres_walked(0.0)
'''
A_VALUE = [
    Edit("orchard/field/scenario/schema.py", "    agents: Annotated[Classes, CHOICE] = {}\n", WIND),
    Edit("orchard/behaviour/walker.py", PERSON, PERSON + IN_WIND),
    Edit(
        "orchard/behaviour/walker.py",
        "whim = Twist(x=self.kind.speed)",
        "whim = Twist(x=self.pace)",
    ),
    Edit(
        "config/orchard.yaml",
        "agents: {}           #",
        "wind: 0.0            # slows people, m/s, 0 to 20\n\nagents: {}           #",
    ),
    Edit("tests/behaviour/test_wind.py", "", WIND_TEST),
]

ENERGY = """        "weeds_flattened": figures.weeds_flattened,
        "energy_kwh": _distances(world).get("carrier", 0.0) * 1e-4,
"""
A_FIGURE = [
    Edit(
        "orchard/report/metrics.py",
        '        "weeds_flattened": figures.weeds_flattened,\n',
        ENERGY,
    ),
    Edit(
        "orchard/report/summary.py",
        '    "distance_metres": "m",\n',
        '    "distance_metres": "m",\n    "energy_kwh": "kWh, of all carriers together",\n',
    ),
    Edit(
        "orchard/tables/columns.py",
        '        "metres_picked",\n',
        '        "metres_picked",\n        "energy_kwh",\n',
    ),
    Edit(
        "docs/templates/results.md.in",
        "| `weeds_flattened` |",
        "| `energy_kwh` | energy that carriers used, kWh |\n| `weeds_flattened` |",
    ),
    Edit(
        "tests/report/test_metrics.py",
        '    assert 0.5 < figures["carrier_utilisation"] <= 1.0\n',
        '    assert 0.5 < figures["carrier_utilisation"] <= 1.0\n'
        '    assert figures["energy_kwh"] > 0.0\n',
    ),
]

DRONE = '''"""The drone: goes along the south fence and looks."""

from orchard.plans.robot import PlanExecutor
from orchard.plans.sense import bystanders_of
from orchard.plans.steps import DriveTo, Plan, Say
from orchard.contract.agent import Action, Mail, Observation
from orchard.field.layout import Layout


class Drone:
    """Goes east until it is at the end of the rows."""

    Memory = Plan
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        self.machine = layout.machines["drone"]
        self.bystanders = bystanders_of(layout)
        self.end = layout.row_east

    def tick(self, seen: Observation, mail: Mail, memory: Plan | None) -> Action:
        """Return its velocity towards the end of the rows."""
        plan = memory or self.Memory(plan=[Say("looking", "driving"), DriveTo(x=self.end)])
        robot = PlanExecutor(seen, mail, plan, self.machine, self.bystanders)
        robot.follow()
        return robot.finish()
'''
DRONE_TEST = '''"""The drone looks at the orchard from the south."""

from orchard import Local, Scenario


def test_a_drone_goes_east():
    run = Local(Scenario(rows=3, drones=2))
    before = run.engine.observe()["drone_02"].x
    for _ in range(30):
        run.tick()
    assert run.engine.observe()["drone_02"].x > before + 1.0
'''
A_ROBOT = [
    Edit(
        "orchard/field/kinds.py",
        '    "bin": Kind(',
        '    "drone": Kind(1.8, 1.5, 0.5, (0, 170, 255), 1.0, EIGHTH, _front(1.8), robot=True),\n'
        '    "bin": Kind(',
    ),
    Edit(
        "orchard/field/scenario/schema.py",
        "    tractor: Annotated[\n",
        '    drones: Annotated[int, Field(ge=0, le=4, description="all drones"), CHOICE] = 0\n'
        "    tractor: Annotated[\n",
    ),
    Edit(
        "config/orchard.yaml",
        "tractor: true        #",
        "drones: 0            # south of the rows, 0 to 4\ntractor: true        #",
    ),
    Edit(
        "orchard/field/layout.py",
        "    if layout.scenario.tractor:\n",
        "    for i in range(layout.scenario.drones):\n"
        "        pose = Pose(layout.middle - 8.0 * i, layout.bottom + 4.0, EAST)\n"
        '        starts.append(Start(name_of("drone", i + 1), "drone", pose))\n'
        "    if layout.scenario.tractor:\n",
    ),
    Edit("orchard/behaviour/drone.py", "", DRONE),
    Edit(
        "orchard/behaviour/catalogue.py",
        "from orchard.behaviour.picker import Picker\n",
        "from orchard.behaviour.drone import Drone\nfrom orchard.behaviour.picker import Picker\n",
    ),
    Edit(
        "orchard/behaviour/catalogue.py",
        '    "tractor": Tractor,\n',
        '    "tractor": Tractor,\n    "drone": Drone,\n',
    ),
    Copy("orchard/view/models/drone.glb", "orchard/view/models/carrier.glb"),
    Edit("tests/behaviour/test_drone.py", "", DRONE_TEST),
]

NEW_POLICY = '''class ByName(Ranking):
    """The bin whose name is first gets a carrier first."""

    def rank(self, report: BinReport, memory: Any) -> tuple[Any, ...]:
        return (report.name,)


class LongestWaiting(Ranking):
'''
A_POLICY = [
    Edit("orchard/dispatch/ranking.py", "class LongestWaiting(Ranking):\n", NEW_POLICY),
    Edit("orchard/dispatch/policies.py", "import (\n    Far", "import (\n    ByName,\n    Far"),
    Edit(
        "orchard/dispatch/policies.py",
        "    Nearest,\n    FarthestFirst,\n",
        "    Nearest,\n    ByName,\n    FarthestFirst,\n",
    ),
    Edit(
        "orchard/field/scenario/names.py",
        '    NEAREST,\n    "farthest-first",\n',
        '    NEAREST,\n    "by-name",\n    "farthest-first",\n',
    ),
    Edit(
        "docs/bounds.md",
        "| `nearest` | the bin that",
        "| `by-name` | the bin whose name is first | an example |\n| `nearest` | the bin that",
    ),
    Edit(
        "tests/dispatch/test_policies.py",
        "DECISIONS = {\n",
        'DECISIONS = {\n    "by-name": ["bin_01", "bin_02"],\n',
    ),
]

#: What each recipe changes, by its name.
EDITS: dict[str, list[Edit | Copy]] = {
    "A new event": AN_EVENT,
    "A new message between agents": A_MESSAGE,
    "A new value of a scenario": A_VALUE,
    "A new figure of the summary": A_FIGURE,
    "A new kind of robot": A_ROBOT,
    "A new dispatch policy": A_POLICY,
}
