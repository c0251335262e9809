"""The part of keyspace.md from which a carrier can be written in any language: bodies, field, towing, places, the job, its letters."""

from math import degrees

from orchard.agents import bin as bin_agent
from orchard.agents import carrier as carrier_agent
from orchard.agents import forecast, sense, steps, traffic
from orchard.agents.robot import EXACT, LOOK_AGAIN, PATIENCE, RECOVERY, Gate, Step
from orchard.agents.route import TOP, OneWay
from orchard.agents.two_way import TwoWay
from orchard.field import layout
from orchard.field.kinds import EIGHTH, KINDS, LASER_RANGE, PEOPLE, Kind
from orchard.field.queue import BAY_STOP, ONE_WAY, PITCH, TOP_ROAD, TWO_WAY, USUAL_ROW
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.field.survey import TRUNK
from orchard.report.metrics import JAM_SECONDS
from orchard.sim import deeds
from orchard.sim.kernels import move

_CARRIER, _PICKER, _BIN = KINDS["carrier"], KINDS["picker"], KINDS["bin"]
_ROUTE = OneWay(layout.lay_out(Scenario()))
_EAST, _WEST, _QUEUE = _ROUTE.east, _ROUTE.west, _ROUTE.queue


def _freed(plan: list[Step], place: str) -> float:
    """Where a plan gives a place back, m: x or y."""
    return next(gate.at for step in plan if isinstance(step, steps.DriveTo) for gate in step.frees if place in gate.places)


_OFF_D = _freed(_ROUTE.loop_to_full_bin(1, _EAST), _EAST.place("D", 1))
_OFF_EAST_CORNER = _freed(_ROUTE.go_to_bay(1, _EAST), "corner/south-east")
_OFF_WEST_CORNER = _freed(_ROUTE.go_to_bay(1, _EAST), "corner/south-west") - _ROUTE.inner_bottom


def bodies() -> str:
    """Return the table of the kinds of bodies."""
    return "\n".join(_body(name, kind) for name, kind in KINDS.items())


def _body(name: str, kind: Kind) -> str:
    size, limits = f"{kind.length:g} x {kind.width:g}", f"{kind.speed:g} | {kind.turn:.6g}"
    laser = f"{kind.laser.beams} | {kind.laser.ahead:g}"
    return f"| {name} | {size} | {limits} | {laser} | {kind.tows or '-'} | {'yes' if kind.solid else 'no'} |"


def _x(east: float) -> str:
    """A figure of the east side, for both sides."""
    return f"{east:g} | {_WEST.x(east):g}"


def chapter() -> str:
    """Return the chapter."""
    return "\n".join([_FIELD, _TOWING, _PLACES, _JOB, _two_way(), _LETTERS])


def _two_way() -> str:
    """The chapter on the other built-in route. Its drives are shown for one lane, as the route's own steps have them."""
    orchard = layout.lay_out(Scenario(route=TWO_WAY, rows=3, carriers=10))
    route, queue, lane = TwoWay(orchard), orchard.queue, 2
    tables = []
    for side in (route.east, route.west):
        drives = [*route.approach(lane, side), *route.loop_to_full_bin(lane, side), *route.go_to_bay(lane, side)]
        tables += [f"To lane {lane} in the {side.name}, and with the full bin to the bay:\n", *_drives(drives)]
    return f"""## The job on the route `{TWO_WAY}`

All is as above, but for the roads. On both sides deliveries go south on D, and full bins north on F. The west side is the east side mirrored about x = -1.5: x becomes -3 - x, and
east and west are exchanged. Ask for **one place after the other**, in the order of the way, and never for two in one claim. `distance` is along the drives below.

With {orchard.scenario.carrier_count} carriers the queue has lines at y = {", ".join(f"{y:g}" for y in queue.lines)}, each with {queue.places} places, the first at x = {queue.head:g}. Carriers 1 to {queue.places} belong to the first line, and so on.
`exit/<line>` and `entry/<line>` are the places at which a line's road meets the connector to the west and the delivery road in the east. A carrier needs those of its line and of the lines south of it.

The tables show carrier 1 in an orchard with {orchard.scenario.rows} rows, whose lanes are at y = {", ".join(f"{at.y:g}" for at in orchard.lanes)}. They say at which x or y the carrier's centre is; without a number: before the turn begins.
A delivery waits for a lane's place {route.HOLD:g} m north of the lane, and gives it back {route.CLEAR:g} m south of it. A full bin waits {route.F_HOLD:g} m south of the lane, and gives the place back {route.F_CLEAR:g} m north of it.

""" + "\n".join(tables)  # noqa: E501


def _drives(steps_: list[Step]) -> list[str]:
    """The lines of a table of drives and turns, with the places that each waits for and gives back."""
    lines, before = ["| drive or turn | wait for | give back |", "| --- | --- | --- |"], ""
    for step in steps_:
        match step:
            case steps.Need(places):
                before = ", ".join(f"`{place}`" for place in places)
            case steps.Face(heading):
                lines.append(f"| turn {heading} | {before} | |")
                before = ""
            case steps.Free(places):
                lines[-1] = lines[-1].removesuffix(" |") + f" {', '.join(f'`{place}`' for place in places)}, after it |"
            case steps.DriveTo():
                axis, target = ("x", step.x) if step.x is not None else ("y", step.y)
                lines.append(f"| drive to {axis} = {target:g} | {_gates(axis, step.needs)} | {_gates(axis, step.frees)} |")
    return [*lines, ""]


def _gates(axis: str, gates: list[Gate]) -> str:
    return ", ".join(f"`{place}` at {axis} = {gate.at:g}" for gate in gates for place in gate.places)


_FIELD = f"""## The field

The reply to the scenario query has in `scenario`: `rows` and `row_width` (m), `carriers` (their number;
nil: 7 for every 10 `pickers`, rounded up), `row_length`, `bay`, `dispatch` and `route`. What follows holds for the route `{ONE_WAY}` (the other one: see `{TWO_WAY}` below), rows of
{USUAL_ROW:g} m and `bay` 0. With longer or shorter rows, the x of everything in the east, and of the heads of the queue, changes by `row_length` - {USUAL_ROW:g}; with another `bay`,
the x of the bay and of the stop in it by `bay`. Then a line of the queue may have fewer places, and the turn to it lies at another x.
If there is a `survey`, the distances of its rows decide y of the lanes, and no pitch.

- **Lanes.** A lane is a row, between two lines of trees. Lanes count from 1 at the north. The centre line of lane n is y = {layout.TREE_TOP_LINE:g} - (n - 0.5) * pitch, where pitch =
  `row_width` + {TRUNK:g}. The last line of trees is y = {layout.TREE_TOP_LINE:g} - `rows` * pitch. Trunks and posts are {TRUNK:g} m square.
- **Sides.** `side` is `east` or `west`: the end of the lane at which the full bin stands, east or west of x = -1.5. The west side is the east side turned by half a turn about
  x = -1.5: each x of the east side becomes -3 - x, and all headings turn about. Carriers drive south on the east side and north on the west side. "Past the lane" and "before the
  lane" are metres along that direction, from the lane's centre line to the carrier's centre. So `p` metres past lane n is y = lane - p in the east, lane + p in the west.
- **The bay** is x = {layout.BAY.west:g} to {layout.BAY.east:g}, y = {layout.BAY.south:g} to {layout.BAY.north:g}. A full bin on a carrier is empty after {layout.UNLOADING_SECONDS:g} s in which its centre is in the bay and both are at rest.
  The bay works on one bin at a time. A carrier that unloads stops at x = {BAY_STOP:g}, y = {TOP_ROAD:g}, facing east.
- **The queue** has lines at y = {", ".join(f"{y:g}" for y in _QUEUE.lines)}. Carriers 1 to {_QUEUE.places} belong to the first line, the next {_QUEUE.places} to the second, and so on. They wait facing east,
  the first of a line at x = {_QUEUE.head:g}, the others behind it, {PITCH:g} m apart at the start. The harvest is over when all rows are picked, no bin is full, each carrier stands in the queue
  (x = {_QUEUE.area.west:g} to {_QUEUE.area.east:g}, y = {_QUEUE.area.south:g} to {_QUEUE.area.north:g}) with a bin, facing east to within 1e-6 rad, and the pickers stand.
"""  # noqa: E501

_TOWING = f"""## Motion, towing, obstacles

- **A step** lasts {TIME_STEP:g} s. A velocity holds for the whole step and is reached at once; the body moves on an arc. A body whose step would end in something solid stands in this step:
  its twist at the next tick is 0. The first of such steps in a row is a collision. Nothing else stops a robot: it must look by itself.
- **A coupled bin** is driven by its own agent, and keeps its place behind its robot: bin's centre to robot's centre is what the robot tows (the table above). A robot changes its velocity
  by at most its maximum at once, so the bin can be 0.15 m off its place for a moment. A step that would leave the bin more than {move.BAR:g} m off its place is not done.
- **To couple** (a deed in `report.deeds`): robot and bin both stand, neither is coupled, the bin's centre is within {deeds.COUPLING_REACH:g} m of the coupling point behind the robot, and the sides of both
  are parallel to within {degrees(deeds.COUPLING_ANGLE):g} degrees (any quarter turn fits). **To uncouple:** both stand. "Both stand" means: in the last step the twists of both were 0, and in this one they want 0.
  So command a velocity of 0 together with the deed, and send the deed only when your twist and that of your `hitch` are 0. Deeds come before motion. They are done if `hitch` at the next
  tick says so; otherwise the reason is in an event `deed refused`. Send the deed again then.
- **Lasers** see fences, trunks, posts and solid bodies up to {LASER_RANGE:g} m, but no weeds. The lasers at the front edge see what is ahead of it; the bin's laser, at its centre, also sees its own carrier.
- **Ahead**: the orchard's own robots stand in each step in which something returns from the corridor ahead: {sense.STOP_DISTANCE:g} m deep from the front edge, and on each side {sense.SIDE_MARGIN:g} m wider than the robot.
- **A turn on the spot** sweeps more than the front laser sees: a circle of {sense.sweep_radius(_CARRIER, False):.2f} m radius for a carrier, {sense.sweep_radius(_CARRIER, True):.2f} m with its bin. They stand while a return of their own laser or of their bin's
  is in what the rest of the turn sweeps, with a margin of {sense.TURN_MARGIN:g} m, and while a person or an animal ({", ".join(PEOPLE)}, dog, cat) is or may be within the circle. They ask these by `where`
  before and during the turn: one that was at distance d (centre to centre) in the tick of its answer cannot be in the circle for (d - radius - half its diagonal - {sense.MARGIN:g} m) / its maximum speed after it. One that does not answer is
  left to the lasers for {sense.SILENT_TICKS * TIME_STEP:g} s, and then asked again.
- After a step that was not done they stand for {RECOVERY * TIME_STEP:g} s.
- **Turns** are at most {EIGHTH:.6g} rad/s, drives at most {steps.CRUISE:g} m/s. In the last step a robot is slower, so that it ends at its target: nearer than {EXACT:g} (m or rad) counts as there.
  In realtime it must send this last step with `once`.
"""  # noqa: E501

_PLACES = f"""## Roads and places

Road D takes carriers from the queue to the lanes, road F from the lanes to the bay. Places on both make sure that a robot has its way free of other robots. The agent `traffic` grants them.

| what | x in the east | x in the west |
| --- | --- | --- |
| full bin | {_x(_ROUTE.FULL_BIN)} |
| carrier couples the full bin | {_x(_ROUTE.COUPLING)} |
| road F | {_x(_ROUTE.F_ROAD)} |
| road D, and the coupling point of the waiting picker | {_x(_ROUTE.D_ROAD)} |
| picker that waits for an empty bin | {_x(_ROUTE.WAITING)} |

Along the bottom, D is {_ROUTE.D_BOTTOM:g} m and F is {_ROUTE.F_BOTTOM:g} m south of the last line of trees. Along the top, both sides meet in the road y = {TOP_ROAD:g}, which leads east through the bay to the queue.

**Names of places**: `<side>/<road>/<lane>`, such as `east/D/3`, for each lane on each road; `corner/south-east` and `corner/south-west`, of both roads; and `{TOP}`, where the queue's lines meet D.

**The rule**: a robot drives into a place only while it holds it, and holds it until its tail, or its bin's, has left it. Carrier's centre, always with a bin:

| place | wait for it at | give it back at |
| --- | --- | --- |
| of a lane that the carrier passes, or at which it stops, on D and F | {_ROUTE.HOLD:g} m before the lane | {_ROUTE.CLEAR:g} m past the lane |
| D at the lane where it has delivered | held already | on the way to the full bin: x = {_OFF_D:g} in the east, {_WEST.x(_OFF_D):g} in the west |
| F at that lane | where it has delivered, before it turns | {_ROUTE.CLEAR:g} m past the lane |
| `corner/south-east`, on D | {_ROUTE.HOLD:g} m north of F's bottom road | after its turn to the west |
| `corner/south-west`, on D | x = {_ROUTE.CORNER_HOLD_X:g} | after its turn to the north |
| `corner/south-east`, on F | on F's bottom road, before it turns | x = {_OFF_EAST_CORNER:g} |
| `corner/south-west`, on F | x = {_WEST.x(_ROUTE.F_ROAD):g}, before it turns | {_OFF_WEST_CORNER:g} m north of F's bottom road |
| `{TOP}`, only if there are more than {_QUEUE.places} carriers | x = {_QUEUE.head:g} | {_ROUTE.TOP_CLEAR:g} m south of the southernmost line in which a carrier has started |

**A claim** goes to `traffic`: `keep`, all places that the carrier still holds, and `want`, the places that it waits for ([] for none). It gets all that it wants or none. The answer `places` has all that
it holds now in `held`; `blockers` are the robots in the way, `alone` the places that it shares with no robot. A place is held when an answer has named it. `traffic` forgets no place until a
claim of its holder leaves it out of both lists. So: send a claim when a place is given back, and every {PATIENCE} ticks while one is wanted (a wish that is not repeated for {traffic.FORGET} ticks is
dropped). Send no claim before the last one is answered, 2 ticks later. Ask for a place {steps.LOOK_AHEAD * steps.CRUISE:g} m before you must stop for it. `beside` is for pickers: it names the carrier
whose place they share; carriers send ''.
"""  # noqa: E501

_JOB = f"""## The job of a carrier

It waits in the queue with an empty bin. It accepts one full bin at a time. `tests/foreign_carrier.py` does all this with zenoh, msgpack and the standard library of Python.

1. `call` from a full bin: answer `offer` if you have no job and are next in your line: your x is less than 0.1 m short of {_QUEUE.head:g}, or you are moving forward and less than {PITCH + 0.2:g} m short of it.
   `x` and `y` are your position; `distance` is in metres by road to the stop of step 4. Otherwise answer `no`. An offer binds neither side.
   Offer only to the oldest call, so that bins are served in order: the least `since` (ties by name) of the calls that you heard in the last {carrier_agent.REMEMBERED} ticks, also while you had a job. A bin that
   has not sent `come` {carrier_agent.CHOOSING} ticks after your first offer to it comes after the others.
2. `come` from a full bin, or from one that soon will be: answer `yes`, and remember bin, `lane`, `side` and `picker`, if you have no job. Answer `yes` too if the bin is the one that you have already agreed to: it asks again and again.
   Otherwise answer `no`. Refuse a lane that is not 1 to `rows`.
3. Ask the bin by `confirm`. At `yes` leave; at `no` you have no job.
4. Drive east to road D, turn south, and drive to {_ROUTE.STOP:g} m past the lane, holding places as above. To a lane in the west: on D past all lanes of the east to D's bottom road, turn west, on it to the west
   side's D, turn north, and past the lanes from the last one up. Ask for D's place at the lane itself only after the full bin is left there: the bin says so by `state` (`full`, and `coupled_to` is '').
   Ask it {steps.LOOK_AHEAD * steps.CRUISE:g} m before the hold. With an early dispatch policy a carrier may come while the picker still picks. If it took the place, the picker could not come out. Your bin stands now on the lane's centre line, on the coupling point of the picker.
5. Uncouple. Say `here` to the picker, with the name of the bin that you left, until it answers `yes`: then it has coupled the bin and shares your place on D, which you must hold until then. It answers `no`
   before that.
   In steps 6 and 7, up to road F, headings are those of the east side; on the west side they are turned about.
6. Wait for the lane's place on F. Turn to the west, drive to the x at which you couple, turn north, drive to the lane's centre line, turn east.
   All are turns to the right. The full bin is now {_CARRIER.tows:g} m behind your centre. On these drives and turns, and in step 7 up to the end of the turn onto F, do not take for obstacles: the full bin and the empty bin
   on D (each {_BIN.length:g} m square) and the picker ({_PICKER.length:g} x {_PICKER.width:g} m), at the x of the table and on the centre line, each 0.1 m larger on every side.
7. Couple the full bin. Drive to road F and turn south. From the east: drive to F's bottom road, wait for the corner, turn west, drive to the west's F, wait for the corner, turn north. Go north
   on the west's F past all lanes that are left to y = {TOP_ROAD:g}, turn east, and stop at x = {BAY_STOP:g}.
8. Ask the bin by `state` until `full` is false.
9. Drive on to x = {_QUEUE.turn_off:g}. If your line is another one than y = {TOP_ROAD:g}, turn, drive to its y and turn east. Now you have no job. Drive to x = {_QUEUE.head:g}; stand behind what is ahead.

`distance`, from (x, y) to a lane in the east: (D - x) + y - stop, where D is the east's road D and stop the y of step 4. To a lane in the west, along the bottom at y = b:
(D - x) + (y - b) + (D - west's D) + (stop - b).

Count finished steps in `report.steps_done`: a run in which no robot picks a metre or finishes a step for {JAM_SECONDS / 60:g} minutes ends as `jammed`.
"""  # noqa: E501

_LETTERS = f"""## When each letter is sent

"Again after n ticks" is counted from the tick of the last one. An answer is given in the tick in which the request is heard; so a repetition comes also to one that has answered, and must be answered again.

| request | from, to | first | again | answer |
| --- | --- | --- | --- | --- |
| `call` | full bin to all carriers | when the bin stands full and uncoupled | after {bin_agent.CALL_AGAIN} ticks, while it has no carrier | `offer` or `no` |
| `come` | full bin to the chosen carrier | in the tick in which the bin hears the offers | after {bin_agent.CALL_AGAIN} ticks until the first `yes`, then after {bin_agent.ASK_AGAIN} ticks, until a carrier has coupled the bin | `yes`; any other answer, or {bin_agent.GIVE_UP} in a row without one, and the bin calls anew |
| `confirm` | carrier to its full bin | when it has agreed to come, before it leaves the queue | after {PATIENCE} ticks until it is answered | `yes`; `no`: another carrier comes |
| `emptybin` | picker to its full bin | when it waits for an empty bin | after {steps.SELDOM} ticks | `carrier` |
| `here` | carrier to the picker | when its bin is uncoupled | after {PATIENCE} ticks until `yes` | `yes`; `no`: not coupled yet, or the place is not shared yet |
| `state` | carrier to its full bin | {steps.LOOK_AHEAD * steps.CRUISE:g} m before it must hold for D's place at the lane | after {LOOK_AGAIN} ticks until the bin is full and not coupled | `binstate` |
| `state` | carrier to its bin in the bay; any agent to any bin | when it stands in the bay | after {PATIENCE} ticks until `full` is false | `binstate` |
| `claim` | picker or carrier to `traffic` | see above | see above | `places` |
| `where` | robot to a person or an animal | before it turns | while it turns | `position` |
| `fetch` | bin to `dispatch`, in place of `call`, if `dispatch` in the scenario is not `nearest` | when the bin stands full and uncoupled. To an early policy (`predictive`, `predictive-farthest`): already while its picker drives along the row, from {forecast.EARLIER:g} s before a carrier would have to leave for the farthest lane | after {bin_agent.CALL_AGAIN} ticks, while it has no carrier | `carrier`: the one that comes, '' while none is chosen |
| `carrierquery` | `dispatch` to all carriers, if `dispatch` in the scenario is not `nearest` | while a bin waits | | `carrierstatus`: `job` ('' or the full bin), `is_next` as in step 1, `metres` to the queue's head |

Answer every other request with `no`. A request can only be sent by an agent of the run, to an agent; a client that is no agent queries the key `state` of a bin instead of the request `state`.
A question whose answer does not come (nil) is asked again, as if it were answered otherwise than hoped.
"""  # noqa: E501
