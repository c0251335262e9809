"""docs/reference.md: scenario, results, figures and geometry of the orchard.

Prose, and tables made from the constants of the code. `python -m docs.generate` writes the file.
The chapters on the scenario, on a carrier's job and on roads stand in scenario.py, carrier.py and
road_places.py.
"""

from collections.abc import Iterable, Iterator, Sequence
from math import degrees
from pathlib import Path

from docs import carrier, road_places, scenario
from docs.markdown import area, every, of_pi, points, points_of, seconds, section, table
from orchard.behaviour import tractor, walker, weed
from orchard.field import lanes, placement
from orchard.field import layout as field
from orchard.field.kinds import AROUND, EIGHTH, KINDS, LASER_RANGE, Kind, Laser
from orchard.field.layout import Layout, lay_out
from orchard.field.queue import CLOSED_UP, ONE_WAY, USUAL_ROW
from orchard.field.repeatable import QUARTER
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.field.survey import TRUNK
from orchard.field.walls import FENCE_HEIGHT, FENCE_THICKNESS
from orchard.plans import course, robot_memory, sense
from orchard.plans.route import OneWay
from orchard.plans.two_way import TwoWay
from orchard.sim import deeds
from orchard.sim.kernels import move, picking

HEAD = """<!-- Made by docs/reference.py and docs/templates/results.md.in from the constants of the
code: `make docs`. -->
# Reference: scenario, results and the orchard in figures

For people who look up a value. After this page you know every setting of a scenario, every figure
that a run leaves, and every size, speed and rule of the orchard.

Units are SI: m, s, rad. In the frame `map`, x points east, y north and z up; a yaw of 0 faces east,
and yaw grows counter-clockwise (REP-103, REP-105). The figures of the orchard come from
measurements, and from [the student system](design.md#what-it-is-built-on) of 2015 that this one
continues."""
RESULTS = Path(__file__).with_name("templates") / "results.md.in"


def document() -> str:
    """Return the whole of docs/reference.md."""
    layout = lay_out(Scenario())
    route = OneWay(lay_out(Scenario(route=ONE_WAY)))
    other = TwoWay(lay_out(Scenario(carriers=10)))
    results = RESULTS.read_text().rstrip()
    sections = (
        _field(layout),
        _things(layout),
        _towing(),
        _laser(),
        _behaviours(),
        _work(),
        road_places.one_way(route),
        carrier.chapter(),
        road_places.two_way(other),
    )
    return "\n\n".join([HEAD, scenario.section(), results, *sections]) + "\n"


def _field(layout: Layout) -> str:
    last = layout.tree_lines[-1]
    rows = [
        (
            "fences",
            f"on all four sides, {FENCE_THICKNESS:g} m thick, {FENCE_HEIGHT:g} m high",
        ),
        (
            "centre lines of the fences",
            f"x = {field.X_WEST:g} and {field.X_EAST:g}; top fence y = {field.TOP:g}",
        ),
        (
            "bottom fence",
            (
                f"{last - layout.bottom:g} m south of the last tree line; y = {layout.bottom:g} in"
                " the default scenario"
            ),
        ),
        (
            "tree lines",
            f"""one more than rows, and in a survey two where rows are missing; the first at
            y = {lanes.TREE_TOP_LINE:g}, or so far south that the first lane lies at
            y = {lanes.FIRST_LANE:g}; each next one row_width + {TRUNK:g} m further south""",
        ),
        ("trees in a line", every(layout.lines[0].trees_x)),
        ("posts in a line", f"{every(layout.lines[0].posts_x)}: halfway between trees"),
        ("trunks and posts", f"{TRUNK:g} x {TRUNK:g} m; trunks 1.8 m high, posts 2.8 m"),
        (
            "row, or lane",
            "between two tree lines, with its centre line halfway; rows count from 1 at the top",
        ),
        (
            "picked part of a row",
            f"x = {lanes.ROW_WEST:g} to {layout.row_east:g}, or back: {layout.row_length:g} m",
        ),
        (
            "driveway",
            f"{area(field.DRIVEWAY)}; no obstacle. Its west and north edges lie under the fences",
        ),
        ("bay", f"{area(field.BAY)}: the south edge of the driveway"),
        ("queue", area(layout.queue.area)),
    ]
    text = f"""Fruit is not modelled. The code is `orchard/field/layout.py`. The table is for rows
of {USUAL_ROW:g} m with the bay at its usual place. `row_length` moves the rows' east ends, and
everything east of them; a line of trees then has as many trees as fit up to {lanes.LAST_TREE:g} m
before the row's end. `bay` moves the bay east along the top road. Each further place of `bays`
makes it {CLOSED_UP:g} m longer in the west."""
    return section("The field", points_of(rows), text)


def _things(layout: Layout) -> str:
    head = "kind | length x width x height, m | colour, sRGB | most m/s | most rad/s | solid"
    notes = """All bodies are boxes. A speed changes within one step: there is no limit of
acceleration, which is a choice of the model. Bodies move by their own velocity only. Only a bin can
move sideways. A bin moves only while it is coupled. Weeds are not solid, and no laser sees them."""
    starts = f"""A start holds where the place is free; else the body starts at the nearest free
point of a grid of {placement.GRID:g} m. A place is free where the circle around the body is
{placement.CLEAR:g} m away from all solid things. People and animals do not start on the queue lines
in use, where the tractor drives ({area(placement.TRACK)}), or within {placement.AHEAD_OF_PICKER:g}
m ahead of a picker. More of them than have a place above start at random places, as weeds do."""
    return section(
        "The things in it",
        table(head, map(_kind_row, KINDS.items())),
        notes,
        points_of(_starts(layout)),
        starts,
    )


def _kind_row(item: tuple[str, Kind]) -> Sequence[str]:
    name, kind = item
    size = f"{kind.length:g} x {kind.width:g} x {kind.height:g}"
    return (
        name,
        size,
        ", ".join(map(str, kind.colour)),
        f"{kind.speed:g}",
        of_pi(kind.turn),
        "yes" if kind.solid else "no",
    )


def _starts(layout: Layout) -> Iterator[Sequence[str]]:
    first = layout.queue.place(0)
    tractors = [start.pose for start in layout.starts if start.kind == "tractor"]
    yield (
        "picker",
        (
            f"x = {lanes.ROW_WEST:g} on the centre line of its first row, facing east, a bin behind"
            f" it; every second one x = {field.EAST_START:g}, facing west"
        ),
    )
    yield (
        "carrier",
        f"in the queue, the first at {points([first])}, facing east, an empty bin behind it",
    )
    yield "tractor", f"{points(tractors)}, facing east"
    for kind, given in placement.GIVEN.items():
        yield (
            kind,
            points(given) or "at random: odd numbers north of the rows, even numbers south of them",
        )


def _towing() -> str:
    head = "robot | centre to centre, m | gap, m | a turn with bin sweeps, m | without bin, m"
    text = f"""A coupled bin keeps its place behind its robot, square to it; a bar joins them. The
bin's agent does that: it observes the robot's pose and velocity, and chooses the velocity that
brings the bin to its place at the end of the step if the robot keeps its velocity. When the robot
changes its velocity, the bin is for a moment off its place: up to 0.15 m at the default speeds, and
up to 0.35 m where the robot drives 2.5 m/s and turns 60 degrees/s (`tests/plans/test_steps.py`). At
rest it is exact. A bin that is more than {move.BAR:g} m off its
place holds its robot.

A robot couples a bin only while both stand still, with the bin's centre within
{deeds.COUPLING_REACH:g} m of the coupling point and its sides within
{degrees(deeds.COUPLING_ANGLE):g} degrees. A bin is square, so any quarter turn fits. Coupling and
uncoupling move nothing."""
    return section(
        "Towing",
        text,
        table(head, [_tow_row(name, kind) for name, kind in KINDS.items() if kind.tows]),
    )


def _tow_row(name: str, kind: Kind) -> Sequence[str]:
    gap = kind.tows - kind.length / 2 - KINDS["bin"].length / 2
    swept = [f"{sense.sweep_radius(kind, towing):.2f}" for towing in (True, False)]
    return name, f"{kind.tows:g}", f"{gap:g}", *swept


def _laser() -> str:
    head = "bodies | beams | first beam, rad | from beam to beam, rad | mounted"
    forward = [name for name, kind in KINDS.items() if kind.laser is not AROUND]
    round_ = [name for name, kind in KINDS.items() if kind.laser is AROUND]
    rows = [
        _laser_row(KINDS["picker"].laser, forward, "at the middle of the front edge"),
        _laser_row(AROUND, round_, "at the centre"),
    ]
    text = f"""Every laser measures at every tick, {1 / TIME_STEP:g} times a simulated second, up to
{LASER_RANGE:g} m. A beam without a return is +inf (REP-117). Angles are counter-clockwise, 0
straight ahead, as in ROS `sensor_msgs/LaserScan`. Ranges to the boxes are exact, and then rounded
to float32. A scenario may add Gaussian noise.

The scan plane is 0.2 m above the ground. Fences, trunks, posts and all solid bodies but the
scanning one return; weeds, crowns and the pergola do not. A robot that tows receives its bin's scan
too, and so what is behind it. A flattened weed measures nothing."""
    return section("The laser", table(head, rows), text)


def _laser_row(laser: Laser, names: Iterable[str], where: str) -> Sequence[str]:
    return ", ".join(names), str(laser.beams), of_pi(laser.first), f"{laser.increment:.6f}", where


def _behaviours() -> str:
    rows = [
        ("time step", f"{TIME_STEP:g} s"),
        (
            "turn (`Face`)",
            (
                f"at the machine's rate, by default {of_pi(EIGHTH)} rad/s: {QUARTER / EIGHTH:g} s"
                " for 90 degrees; it ends exactly at a heading"
            ),
        ),
        (
            "drive (`DriveTo`)",
            f"at the machine's speed to an absolute x or y, nearer than {course.EXACT:g} m counts"
            " as there",
        ),
        (
            "move to a point (`MoveTo`)",
            "first along the axis that the robot faces, then along the other",
        ),
        ("realign (`Realign`)", "rotate to the nearest of NORTH, SOUTH, EAST and WEST until exact"),
        (
            "back to the course",
            f"""a robot that something has moved or turned comes back before it
            goes on: to its heading, and aslant to its line from {course.LITTLE:g} m off it""",
        ),
        (
            "obstacle ahead (pickers, carriers, tractor)",
            f"""the robot stands while something returns
            from the corridor ahead: {sense.STOP_DISTANCE:g} m deep, and on each side
            {sense.SIDE_MARGIN:g} m wider than robot or bin""",
        ),
        (
            "obstacle in a turn",
            f"""the robot stands while something returns from what the turn still
            sweeps, with a margin of {sense.TURN_MARGIN:g} m, or a person or an animal may be in its
            circle""",
        ),
        (
            "people and animals near a turn",
            f"""a robot asks them for their places
            {sense.ASK_AHEAD:g} s before they may be near; after {seconds(sense.SILENT_TICKS)}
            without an answer the lasers decide""",
        ),
        (
            "carrier at its work",
            """on its loop it ignores the full bin, the empty bin at the picker
            and the waiting picker, boxes widened by
            0.1 m; it still stops for a person""",
        ),
        (
            "after a collision",
            f"""a robot stands for {seconds(robot_memory.RECOVERY)}; a person or an
            animal backs off or turns for {seconds(walker.RECOVERY)}""",
        ),
        ("person", "walks straight on at its full speed, and turns only for what is in its path"),
        (
            "animal",
            f"""every {seconds(walker.MIND_CHANGES)} a new speed and turn (up to 1 s), at
            random; at most 1 m/s while it turns away from something""",
        ),
        (
            "turning away (people, animals)",
            f"""something in the path nearer than
            {walker.STEER_WITHIN:g} m: steer to the freer side at {of_pi(walker.STEER)} rad/s;
            nearer than {walker.TURN_WITHIN:g} m: stop and turn left until
            {2 * walker.TURN_WITHIN:g} m are free""",
        ),
        (
            "lingering (people, animals)",
            f"""one that got no farther than {walker.LINGER:g} m in
            {seconds(walker.LINGER_TICKS)} walks off in a free direction. None stays within a
            circle of 3 m for 60 s (`tests/behaviour/test_walkers.py`)""",
        ),
        (
            "tractor",
            f"""drives between x = {tractor.WEST_END:g} and x = {tractor.EAST_END:g}; at
            each end it waits {tractor.WORK:g} s and then turns about""",
        ),
        (
            "weed",
            f"""flattened by what moved in the last step within {deeds.WEED_REACH:g} m of it;
            it asks when what it sees within {weed.NEAR:g} m changes""",
        ),
    ]
    return section("The behaviours", points_of(rows))


def _work() -> str:
    way_out = OneWay.WAITING - OneWay.FULL_BIN - KINDS["picker"].tows
    text = f"""These are the built-in rules; a scenario may name others.

1. Each picker takes neighbouring rows; no picker takes two rows more than another. The first picker
   begins at the west end of its first row, the second one at the east end, and so on
   (`rows_to_pickers`). Each picks its rows eastward and westward in turn.
2. The bin fills with the metres that its picker drives in the unpicked part of a row, within
   {picking.LANE_REACH:g} m of the lane's centre line. Picking begins at an end of the row and
   goes on where it ended, give or take {picking.PICK_REACH:g} m; after `pickfrom` it begins at
   that x. There physics limits the picker's speed to the row's picking speed: the scenario's
   picking speed, or what `picking.spread` draws. A row fills one bin, or `metres_per_bin` do
   ([several bins a row](bounds.md#several-bins-a-row)).
3. The picker leaves the full bin in the lane's mouth, drives {way_out:g} m out of the lane, and
   asks for an empty bin. After its last row it drives {OneWay.PARKED - OneWay.WAITING:g} m further
   with its empty bin, and stays there.
4. The full bin gets a carrier, by the [dispatch policy](bounds.md#dispatch-policies) and the
   letters below. The carrier [exchanges the bins](traffic.md#an-exchange-on-the-east-side), and
   takes the full one to the bay.
5. Carrier and bin stand, with the bin's centre in the bay. After `handling.unloading` the
   bin is empty, and counts as delivered. The bay works on as many bins at a time as `bays` says
   ([several places](traffic.md#several-places-at-the-bay)). The carrier takes the empty bin back to
   its line of the queue. With a `load_out` it is away from there: it stands for itself in its line,
   takes no calls, and uses its battery as on the ways. With trailers it is not: the bay takes a bin
   only while one of them stands there with room for it. With `load_out.empty_bins` it takes one
   only while one of these stands there: full bins wait for the truck, or are on trailers.
6. The harvest is over when every row is picked, no bin is full, the carriers stand in the queue
   with their bins and face east, carriers and trailers are back from the load-out, and the
   pickers stand. Full bins may wait for the truck.

Physics alone decides what counts: motion, coupling, picking, unloading, and the end of a weed."""
    return section("The work", text)
