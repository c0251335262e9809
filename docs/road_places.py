"""The places and roads in docs/reference.md, for both routes: they follow from the constants of the
routes.
"""

from docs.markdown import points_of, section, table
from orchard.field.kinds import KINDS
from orchard.field.queue import BAY_STOP, PITCH, TOP_ROAD
from orchard.plans import driving
from orchard.plans.route import OneWay
from orchard.plans.two_way import TwoWay


def one_way(route: OneWay) -> str:
    """Return the chapter on one-way roads."""
    front = KINDS["picker"].length / 2
    # Name, x in the east, note.
    xs = [
        (
            "full bin",
            route.FULL_BIN,
            (
                "clear of the trunks; in the west the picker drives 2 m past the row's end to leave"
                " it there"
            ),
        ),
        (
            "picker waits to cross",
            route.PICKER_HOLD,
            f"""until it holds both roads' places; its front is {front:g} m further; x =
            {route.INNER_HOLD:g} if the row before is nearer than {route.LOOP_ZONE:g} m""",
        ),
        ("carrier couples", route.COUPLING, "with the full bin right behind it"),
        ("full-bin road F", route.F_ROAD, "from there to the bay"),
        ("delivery road D", route.D_ROAD, "from the queue; the picker's coupling point lies on it"),
        ("picker waits", route.WAITING, "for an empty bin; its way to the next row, too"),
        ("picker parked", route.PARKED, "after its last row"),
    ]
    along = [
        ("stop of a delivering carrier", f"{route.STOP:g} m past the lane"),
        (
            "carrier waits for a lane's place",
            (
                f"{route.HOLD:g} m before the lane; it asks for the place {driving.LOOK_AHEAD:g} s"
                " before that"
            ),
        ),
        ("carrier's tail has left a lane's place", f"{route.CLEAR:g} m past the lane"),
        (
            "roads along the bottom",
            f"""F {route.F_BOTTOM:g} m and D {route.D_BOTTOM:g} m south of the last tree line, or of
            {route.LAST_LANE:g} m south of the last lane, whichever lies further south""",
        ),
        ("wait for the south-west corner, on D", f"x = {route.CORNER_HOLD_X:g}"),
        (
            "top road",
            (
                f"y = {TOP_ROAD:g}, through the bay to the queue; a carrier that unloads stops at x"
                f" = {BAY_STOP:g}"
            ),
        ),
        ("turn to a queue line", f"x = {route.queue.turn_off:g} on the top road"),
        (
            "queue lines, in the order in which they fill",
            f"y = {', '.join(f'{y:g}' for y in route.queue.lines)}",
        ),
        (
            "places of a line",
            f"{route.queue.places}, every {PITCH:g} m westward from x = {route.queue.head:g}",
        ),
        (
            "carrier has left the place `top`",
            f"{route.TOP_CLEAR:g} m south of the southernmost line in use",
        ),
    ]
    text = """The west side is the east side turned by half a turn about x = -1.5: x becomes -3 - x,
and south becomes north. Carriers drive south on the east side and north on the west side; distances
before and past a lane are along that direction, from the lane's centre line to the robot's centre.
[traffic.md](traffic.md) has the plan, its reasons, and why robots cannot block each other for
ever."""
    columns = [(name, f"{x:g}", f"{route.west.x(x):g}", note) for name, x, note in xs]
    at_a_lane = table("place at a lane | x, east | x, west | note", columns)
    return section("Places and roads: `one-way`", text, at_a_lane, points_of(along))


def two_way(route: TwoWay) -> str:
    """Return the chapter on two-way roads."""
    rows = [
        ("top road of full bins", f"y = {route.F_TOP:g}"),
        ("top road of deliveries to the west", f"y = {route.D_TOP:g}"),
        ("connector", f"{route.TO_CONNECTOR:g} m east of the queue's heads"),
        (
            "carrier waits before a line's place",
            f"""at the connector: at the head, or
            {route.LINE_HOLD:g} m north of the line; at the delivery road: at x =
            {route.ENTRY_HOLD:g}, or {route.LINE_HOLD:g} m north of the line""",
        ),
        (
            "carrier has left a line's place",
            f"""{route.TOP_CLEAR:g} m south of the line; at the
            connector, straight on, {route.EXIT_CLEAR:g} m east of it""",
        ),
        (
            "delivery waits for a lane's place",
            f"{route.HOLD:g} m north of the lane; of the first lane at y = {route.CORNER_HOLD:g}",
        ),
        ("delivery's tail has left a lane's place", f"{route.CLEAR:g} m south of the lane"),
        ("full bin waits for a lane's place", f"{route.F_HOLD:g} m south of the lane"),
        ("full bin has left a lane's place", f"{route.F_CLEAR:g} m north of the lane"),
        (
            "north-east corner",
            f"""a delivery waits at y = {route.CORNER_HOLD:g} and has left it at y
            = {route.CORNER_CLEAR:g}; a full bin waits where it turns, and has left it at x =
            {route.BIN_CLEAR:g}""",
        ),
        (
            "merge in the north-west",
            f"""from the top road a full bin waits at x =
            {route.WEST_HOLD:g}, from the south at y = {route.MERGE_HOLD:g}; it has left it at y =
            {route.MERGE_CLEAR:g}""",
        ),
        (
            "crossing in the north-west",
            f"""a full bin waits at y = {route.CROSSING_HOLD:g}, and has
            left it at y = {route.CROSSING_CLEAR:g}; a delivery waits at x = {route.WEST_HOLD:g}
            until it faces south""",
        ),
    ]
    text = """The lanes, and the places at a lane, are those of `one-way`; the west side is the east
side mirrored. The code is `orchard/plans/two_way.py` and `orchard/field/queue.py`."""
    return section("Places and roads: `two-way`", text, points_of(rows))
