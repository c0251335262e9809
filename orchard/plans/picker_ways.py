"""The ways of pickers on a route: in and out of rows, over both roads, and to the next row.

Each method returns steps of a plan (orchard/plans/steps.py). `PickerWays.harvest` puts them
together. A picker comes out of a row on one side, leaves its full bin in the lane's mouth, drives
over the full-bin road F and the delivery road D, and waits beyond them for an empty bin.
"""

from itertools import zip_longest
from math import inf

from orchard.field.kinds import KINDS
from orchard.field.passes import Pass
from orchard.field.picking import absences_of
from orchard.field.rows import Block
from orchard.plans import steps as st
from orchard.plans.course import SURE
from orchard.plans.road_places import RoadPlaces
from orchard.plans.robot import Gate, Step
from orchard.plans.sense import STOP_DISTANCE
from orchard.plans.sides import Side


class PickerWays(RoadPlaces):
    """The ways of pickers. Figures are as in `RoadPlaces`."""

    #: x at which a picker stays after its last row.
    PARKED = 44.0
    #: x at which a picker turns, in close rows, to come back to its row: its bin swings 0.3 m off
    #: the west fence, and off a picker that turns at `WAITING` at the next row.
    ASIDE = 43.4
    #: Distance north of a row, where rows are so close that `TURN_ZONE` reaches to the next one, at
    #: which a picker waits to turn into it.
    TURN_HOLD = 4.15
    #: x at which a picker that drives into a row, and its bin, have left road D and road F.
    PICKER_CLEAR_D = 34.4
    PICKER_CLEAR_F = 32.4
    #: x at which a picker that parks, and its bin, have left the delivery road.
    PARKING_CLEAR = 42.5
    #: x at which a picker waits to cross the roads. Its front is 1.25 m further, at 34.95.
    PICKER_HOLD = 33.7
    #: Distance between two rows below which the exchange at one of them sweeps over a picker that
    #: waits at `PICKER_HOLD` in the other one.
    LOOP_ZONE = 3.95
    #: In place of `PICKER_HOLD` and `PICKER_CLEAR_F` in such a row.
    INNER_HOLD = 32.1
    INNER_CLEAR_F = 32.0

    def harvest(self, block: Block) -> list[Step]:
        """Return a picker's whole work: pass after pass through its rows.

        Where its bin is full the picker leaves it, and fetches an empty bin.
        """
        passes = self.layout.passes(block)
        steps = self.foresee(passes[0]) + self.come_in(block)
        # A picker that starts in the west starts in its row: it has not come over the roads.
        came_over = block.start == "east"
        for current, after in zip_longest(passes, passes[1:]):
            steps += self.pick(current, came_over=came_over)
            steps += self.go_on(current, after)
            came_over = True
        return steps

    def go_on(self, current: Pass, after: Pass | None) -> list[Step]:
        """Return a picker's way from the end of one pass to the head of the next.

        `after`: the next pass; None: the way leads to where the picker parks.
        """
        side = self.sides[current.end]
        if current.leaves_bin:
            steps = self.swap_bins(current.row, side)
        else:
            steps = self.drive_out(current.row, side)
        if after is None:
            return steps + self.park(current.row, side)
        return steps + self.foresee(after) + self.go_to_next_row(current.row, after.row, side)

    def foresee(self, current: Pass) -> list[Step]:
        """Return the steps in which a picker prepares a pass.

        Unless each row fills one bin, the picker announces to its bin where it will leave it. If
        the pass begins inside the row, the picker sets x from where on it picks.
        """
        steps: list[Step] = []
        if self.layout.scenario.bin_metres and current.leaves_bin:
            steps.append(st.Announce(current.row, current.end, current.fill))
        if current.is_inside:
            steps.append(st.BeginPickingAt(current.begin))
        return steps

    def come_in(self, block: Block) -> list[Step]:
        """Return a picker's way from its start to the head of its first row.

        A picker that starts in the west stands there already. It takes its place on road F if the
        exchange at the row before could sweep over it. A picker that starts in the east drives over
        the roads.
        """
        row = block.rows[0]
        if block.start == "west" and self._is_swept(row, self.west):
            return [st.Need([self.west.place("F", row)])]
        if block.start == "west":
            return []
        return [st.Say(f"driving to row {row}", "driving"), *self.turn_in(row, self.east)]

    def pick(self, current: Pass, came_over: bool) -> list[Step]:
        """Return the drive through a row in one pass, on which the picker picks a part of it.

        If the pass ends with a full bin, or with the last one, the picker leaves it in the lane's
        mouth. `came_over`: whether the picker has come over the roads, so that it has places to
        give back.
        """
        row = current.row
        side = self.sides[current.end]
        opposite = self.opposite(side)
        end = self.end(row, side)
        speed = self.layout.speed_on(current)
        frees: list[Gate] = []
        if came_over or self._is_swept(row, opposite):
            frees = self.cleared(row, opposite)
        cross = self.cross(side, row, self.hold(row, side))
        through = st.Say(f"driving through row {row}", "driving")
        steps: list[Step] = []
        if current.begin != self.end(row, opposite):
            steps += [through, st.DriveTo(x=current.begin, needs=cross, frees=frees)]
        steps.append(st.Say(f"picking row {row}", "picking"))
        scenario = self.layout.scenario
        absences = absences_of(scenario, self.layout.picker_of(row))
        steps += self.may_fail(scenario.picking.failure, absences)
        steps.append(st.DriveTo(x=current.stop, speed=speed, needs=cross, frees=frees))
        if current.stop != end:
            steps += [through, st.DriveTo(x=end, needs=cross, frees=frees)]
        if current.leaves_bin:
            steps += self.leave(current, side, cross)
        return steps

    def leave(self, current: Pass, side: Side, cross: list[Gate]) -> list[Step]:
        """Return the drive to the lane's mouth, where the picker leaves its bin.

        `cross`: the gates before the roads, of `cross`.
        """
        if current.is_full:
            word = "full"
            metres = self.layout.metres_per_bin
        else:
            word = "last"
            metres = current.fill
        return [
            st.Say(f"leaving the {word} bin of row {current.row}", "handling a bin"),
            st.DriveTo(x=side.x(self.FULL_BIN + KINDS["picker"].tows), needs=cross),
            *self.fill(metres),
            st.LeaveBin(),
        ]

    def fill(self, metres: float) -> list[Step]:
        """Return the step in which a picker that is not sure of its position fills its bin up.

        It may have stopped before the row's end. If sensors are exact there is no such step.
        `metres`: what the bin shall hold, metres of row.
        """
        sensors = self.layout.scenario.sensors
        deviation = sensors.gnss.white + sensors.gnss.bias
        if not deviation:
            return []
        return [st.Fill(SURE * deviation, metres)]

    def drive_out(self, row: int, side: Side) -> list[Step]:
        """Return the drive out of the lane and over the roads, with a bin that is not full yet."""
        out = st.DriveTo(x=side.x(self.WAITING), needs=self.cross(side, row, self.hold(row, side)))
        return [
            st.Say(f"driving out of row {row}", "driving"),
            out,
            st.Free([side.place("F", row)]),
        ]

    def swap_bins(self, row: int, side: Side) -> list[Step]:
        """Return the drive over the roads without a bin, and the wait for an empty bin there.

        The picker has left its full bin in the lane's mouth, and has both roads' places.
        """
        return [
            st.DriveTo(x=side.x(self.WAITING)),
            st.Free(side.crossing(row)),
            st.Say("waiting for an empty bin", "waiting"),
            st.FetchEmpty(side.place("D", row)),
        ]

    def go_to_next_row(self, row: int, next_row: int, side: Side) -> list[Step]:
        """Return the way to the next row: turn, drive over to it, and turn in once both roads are
        free there.

        Where carriers drive north the turn swings the bin over the place of the carrier that
        delivered it, so that carrier must have left it. Before a picker comes back to the same row,
        that carrier must have left too: then it has road F, and takes the full bin out of the
        lane's mouth first.
        """
        wait: list[Step] = []
        swings_over_place = side.south < 0 or next_row == row
        if swings_over_place:
            wait.append(st.Alone(side.place("D", row)))
        heading = "NORTH"
        if next_row >= row:
            heading = "SOUTH"
        turn: list[Step] = [st.Face(heading), st.Free([side.place("D", row)])]
        over = st.DriveTo(y=self.layout.lane(next_row).y)
        if next_row == row and self._turn_zone(row):
            turn = self._turn_aside(row, side)
        elif next_row > row and self.has_zones:
            # The drive itself gives the place back, later.
            turn = [st.Face(heading)]
            over = self._over_to(next_row, side)
        return [
            st.Say(f"driving to row {next_row}", "driving"),
            *wait,
            *turn,
            over,
            *self.turn_in(next_row, side),
        ]

    def _over_to(self, row: int, side: Side) -> st.DriveTo:
        """Return the drive south to the head of a row from that of the row before, in close rows.

        The picker keeps the place of the row before until a picker that turns in north of it cannot
        meet it. It waits for the places that its own turn needs at a point where a picker that
        turns out of the row south of it cannot meet it.
        """
        y = self.layout.lane(row).y
        y_before = self.layout.lane(row - 1).y
        leaves = y_before - max(0.0, self.TURN_ZONE - self._to_the_south(row - 2))
        waits = y + max(0.0, self.TURN_HOLD - self._to_the_south(row))
        needs = [Gate(need.places, waits) for need in self._need_to_turn(row, side)]
        frees = [Gate([side.place("D", row - 1)], leaves)]
        return st.DriveTo(y=y, needs=needs, frees=frees)

    def _turn_aside(self, row: int, side: Side) -> list[Step]:
        """Return the drive away from the roads and the turn there, to come back to the same row.

        At the usual place this picker would meet a picker that drives out of the row to the south.
        """
        place = [side.place("D", row)]
        aside = st.DriveTo(x=side.x(self.ASIDE), frees=[Gate(place, side.x(self.PARKING_CLEAR))])
        needs = self._need_to_turn(row, side)
        return [st.Face(side.heading("EAST")), aside, st.Free(place), *needs, st.Face("SOUTH")]

    def turn_in(self, row: int, side: Side) -> list[Step]:
        """Return the turn to the head of a row and the drive there, once both roads are free."""
        turn: list[Step] = [st.Face(side.heading("WEST"))]
        for lane in self._turn_zone(row):
            turn.append(st.Free([side.place("D", lane)]))
        drive = st.DriveTo(x=self.end(row, side), frees=self.cleared(row, side))
        if self.takes_both:
            return [st.Need(side.crossing(row)), *turn, drive]
        needs = self._need_to_turn(row, side)
        return [*needs, st.Need([side.place("F", row)]), *turn, drive]

    def park(self, row: int, side: Side) -> list[Step]:
        """Return the drive off the roads with the empty bin after the last row, to stay there."""
        place = [side.place("D", row)]
        drive = st.DriveTo(x=side.x(self.PARKED), frees=[Gate(place, side.x(self.PARKING_CLEAR))])
        return [st.Say("parking", "driving"), drive, st.Free(place), st.Say("finished", "resting")]

    def hold(self, row: int, side: Side) -> float:
        """Return x at which a picker waits to cross the roads, m.

        It is the end of its row, if that lies just before `PICKER_HOLD`: a picker that went on
        would stop again at once.
        """
        usual = side.x(self.PICKER_HOLD)
        if self._is_swept(row, side):
            usual = side.x(self.INNER_HOLD)
        end = self.end(row, side)
        is_just_before = 0.0 < side.sign * (usual - end) < STOP_DISTANCE
        if is_just_before:
            return end
        return usual

    def _is_swept(self, row: int, side: Side) -> bool:
        """Whether the exchange at the row before sweeps over pickers in the mouth of a row."""
        return bool(self._within(row, self.LOOP_ZONE, past=-side.south))

    def cross(self, side: Side, lane: int, at: float) -> list[Gate]:
        """Return the gates at x = `at` for the places that a picker needs to cross both roads."""
        if self.takes_both:
            return [Gate(side.crossing(lane), at)]
        return [Gate([side.place("D", lane)], at), Gate([side.place("F", lane)], at)]

    def cleared(self, row: int, side: Side) -> list[Gate]:
        """Return the gates at which a picker that drives into a row gives both places back."""
        clear_f = self.PICKER_CLEAR_F
        if self._is_swept(row, side):
            clear_f = self.INNER_CLEAR_F
        return [
            Gate([side.place("D", row)], side.x(self.PICKER_CLEAR_D)),
            Gate([side.place("F", row)], side.x(clear_f)),
        ]

    def _need_to_turn(self, row: int, side: Side) -> list[st.Need]:
        """Return the steps that ask for the places on road D that a turn into a row needs.

        They are asked for in the direction in which carriers drive on D. Robots that all ask in
        this order never wait for each other in a circle.
        """
        lanes = [row, *self._turn_zone(row)]
        if side.south < 0:
            lanes.reverse()
        return [st.Need([side.place("D", lane)]) for lane in lanes]

    def _turn_zone(self, row: int) -> list[int]:
        """Return the lanes south of a row from which a picker that drives out and turns would meet
        a picker that turns into the row. There is at most one.
        """
        return self._within(row, self.TURN_ZONE, past=1)

    def _to_the_south(self, row: int) -> float:
        """Return the distance from a lane to the next one in the south, m.

        It is infinite if one of both does not exist.
        """
        lanes = self.layout.lanes
        if not 0 < row < len(lanes):
            return inf
        return lanes[row - 1].y - lanes[row].y
