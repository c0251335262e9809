"""Crews of 25 people who pick strawberries, with robots that carry their trays: what was published
of them, and the same crews here. `docs/validation.py` measures and shows them.

Without robots a picker carries its trays itself. The efficiency of a crew is the share of its time
for which it picks; "alone" is that without robots.
"""

from dataclasses import dataclass

from orchard.field.layout import lay_out
from orchard.field.scenario import NEAREST, Animals, People, Scenario
from orchard.report.bounds import Bounds
from orchard.report.limits import limit_of_question
from orchard.report.long_run import long_run

# The crew of the publications, and rows as in a slide of theirs (ASABE 2019, Boston).
PICKERS = 25
ROWS = 25
ROW_LENGTH = 100.0  # m
COUNTS = (4, 5, 6, 8, 10, 14)  # carriers
CV = 0.28  # of the time to fill a tray, see config/hand_picking.yaml
PERSON_SPEED = 1.0  # m/s, who carries
ROBOT_SPEED = 2.0  # m/s: fitted to one published figure

# The efficiency of pickers who carry their bins themselves, and the dispatch policy of the
# carriers.
Curve = tuple[float, str]


@dataclass(frozen=True)
class Point:
    """A published figure: of a quantity, at a number of carriers for the crew of 25."""

    curve: Curve
    carriers: int
    quantity: str  # a key of QUANTITIES
    published: float  # %
    why: str = ""  # it differs
    is_fitted: bool = False  # and does not count


@dataclass(frozen=True)
class Finding:
    """A publication, what it found, and the picture of the quantity that it is about."""

    name: str
    text: str
    quantity: str
    curves: tuple[Curve, ...]
    points: tuple[Point, ...]


def gain(efficiency: float, alone: float) -> float:
    """Return by how much the efficiency has grown, %."""
    return 100.0 * (efficiency / alone - 1.0)


def non_productive(efficiency: float, alone: float) -> float:
    """Return by how much the time has changed that a bin takes beside its picking, %."""
    return 100.0 * ((1.0 / efficiency - 1.0) / (1.0 / alone - 1.0) - 1.0)


# Name -> its value, by the efficiency with robots and alone; and its name for the axis of a
# picture.
QUANTITIES = {
    "non-productive time": (non_productive, "non-productive time of a bin, change in %"),
    "gain": (gain, "efficiency, change in %"),
    "efficiency": (lambda efficiency, alone: 100.0 * efficiency, "efficiency, %"),
}
FIT = "the speed of robots, {speed:g} m/s"
SAME = "it is of the same run"
FEW = "each round leads past all rows here: 6 have {six:.1f} %, 8 {eight:.1f} %"
FOUR = (
    "four are no better than none there; robots of 1 m/s would be worse than none here, so no speed"
    " fits both four and ten"
)
SURE = "their robots guess from a tray's weight when it is full; a bin here knows"
MOST = (
    "-92.2 % at most here: an exchange and the way to the next row take 27 of the 353 s in which a"
    " person carries"
)
# The curves, by the efficiencies without robots that the publications have.
CREW = ((0.80, NEAREST), (0.80, "predictive"))
MORNING = (0.818, NEAREST)
AFTERNOON = (0.782, NEAREST)
FIELD = (0.857, "predictive")
FINDINGS = (
    Finding(
        "crew",
        "C. Peng and S. Vougioukas, Deterministic predictive dynamic scheduling for crop-transport"
        " co-robots acting as harvesting aids, Computers and Electronics in Agriculture, 2020. For"
        " 25 pickers, four robots are no better than none, ten are enough, and more gain nothing."
        " Both gains together follow from an efficiency of 80 % without robots.",
        "non-productive time",
        CREW,
        (
            Point(CREW[0], 10, "non-productive time", -64.6, FIT, is_fitted=True),
            Point(CREW[1], 10, "non-productive time", -93.7, MOST),
            Point(CREW[0], 4, "non-productive time", 0.0, FOUR),
            Point(CREW[1], 4, "non-productive time", 0.0, FOUR),
            Point(CREW[0], 10, "gain", 15.0, SAME, is_fitted=True),
            Point(CREW[1], 10, "gain", 24.0),
        ),
    ),
    Finding(
        "five",
        "H. Seyyedhasani, C. Peng, W. Jang and S. Vougioukas, Collaboration of human pickers and"
        " crop-transporting robots during harvesting, part II, Computers and Electronics in"
        " Agriculture, 2020: five robots for 25 pickers, by a simulator that field data confirm."
        " With more, nothing is gained.",
        "efficiency",
        (MORNING, AFTERNOON),
        (
            Point(MORNING, 5, "efficiency", 92.0, FEW),
            Point(AFTERNOON, 5, "efficiency", 86.5, FEW),
        ),
    ),
    Finding(
        "field",
        "C. Peng and others, A strawberry harvest-aiding system with crop-transport co-robots,"
        " arXiv 2107.13063: measured in the field with one robot for three pickers. Both figures"
        " follow from an efficiency of 85.7 % without robots.",
        "non-productive time",
        (FIELD,),
        (Point(FIELD, 8, "non-productive time", -60.0, SURE), Point(FIELD, 8, "gain", 10.0)),
    ),
)


def crew(curve: Curve, carriers: int, seed: int = 1, robot_speed: float = ROBOT_SPEED) -> Scenario:
    """Return an orchard whose pickers, if they carried their bins themselves, would pick for that
    share of their time. `robot_speed`: of the carriers, m/s; a person walks 1 m/s.

    Such a picker drives a carrier's round with each bin, so the time to fill one follows from the
    length of that round.
    """
    alone, policy = curve
    plain = Scenario(
        rows=ROWS,
        pickers=PICKERS,
        row_length=ROW_LENGTH,
        carriers=carriers,
        route="two-way",
        dispatch=policy,
        seed=seed,
        people=People(workers=0, visitors=0),
        animals=Animals(dogs=0, cats=0),
        weeds=0,
        tractor=False,
    )
    bounds = Bounds(lay_out(plain.model_copy(update={"carriers": 1})))
    # Of the time of a bin the share `alone` is picking, and the rest is the round.
    filling = (bounds.crossing_seconds + bounds.cycle_seconds) * alone / (1.0 - alone)
    changes = {
        "picking_rate": 3600.0 / filling,
        "picking": {"spread": {"distribution": "lognormal", "cv": CV}},
        "carrying": {"speed": robot_speed},
    }
    return Scenario(**plain.model_dump() | changes)


def efficiency(scenario: Scenario) -> float:
    """Return the share of its time for which a picker picks, in the long run, in rows that take
    their mean times: the rest is its wait, and its way to the next row.
    """
    hours_a_bin = 1.0 / scenario.chosen["picking_rate"]
    figures = long_run(lay_out(scenario), limit=limit_of_question(scenario))
    return hours_a_bin * figures.bins_per_hour / scenario.pickers
