"""The part of docs/reference.md from which a carrier can be written in any language: its job on
one-way roads, and its letters.
"""

from orchard.behaviour import bin as bin_agent
from orchard.behaviour import carrier as carrier_agent
from orchard.behaviour import traffic
from orchard.field import layout
from orchard.field.kinds import KINDS
from orchard.field.queue import BAY_STOP, ONE_WAY, PITCH, TOP_ROAD
from orchard.field.scenario import Scenario
from orchard.plans import driving, forecast, handling, steps
from orchard.plans.robot import LOOK_AGAIN, PATIENCE, Step
from orchard.plans.route import OneWay

_ROUTE = OneWay(layout.lay_out(Scenario(route=ONE_WAY)))
_EAST = _ROUTE.east
_WEST = _ROUTE.west
_QUEUE = _ROUTE.queue
_LOOK = driving.MOST_AHEAD


def _freed(plan: list[Step], place: str) -> float:
    """Return the x or y, m, at which a plan gives a place back."""
    for step in plan:
        if isinstance(step, steps.DriveTo):
            for gate in step.frees:
                if place in gate.places:
                    return gate.at
    raise ValueError(f"no step gives {place} back")


def chapter() -> str:
    """Return the chapter."""
    off_d = _freed(_ROUTE.loop_to_full_bin(1, _EAST), _EAST.place("D", 1))
    off_east = _freed(_ROUTE.go_to_bay(1, _EAST), "corner/south-east")
    to_bay = _ROUTE.go_to_bay(1, _EAST)
    # Metres north of F's bottom road.
    off_west = _freed(to_bay, "corner/south-west") - _ROUTE.inner_bottom
    off_turn = _freed(to_bay, "turn/south-west") - _ROUTE.inner_bottom
    return f"""## The job of a carrier, letter by letter

`examples/foreign_carrier.py` does all this on one-way roads (`--route one-way`) with rows of 70 m
that are {_ROUTE.ZONES["D"]:g} m apart or more, with zenoh, msgpack and the standard library of
Python. In closer rows an exchange needs places of the next lane too, see [traffic.md](traffic.md).

1. It waits in the queue with an empty bin. With the default dispatch policy, `rolling`, the agent
   `dispatch` asks all carriers by `carrierquery`, and sends one to a bin. Answer `carrierstatus`;
   `is_next` is true if you have no job and your x is less than 0.1 m short of {_QUEUE.head:g}, or
   you are moving forward and less than {PITCH + 0.2:g} m short of it. `metres` is how far x is
   short of the head of your own line.
2. With `nearest` full bins ask by `call` instead. If you are next, answer `offer` with your place
   and the metres by road to the stop of step 5, else `no`. Offer only to the oldest of the calls of
   the last {carrier_agent.REMEMBERED} ticks (least `since`, ties by name); a bin without `come`
   {carrier_agent.CHOOSING} ticks after your offer comes after the others.
3. `come` from a bin: answer `yes` without a job, and to the bin that you agreed to already; else,
   and for a lane that is none, `no`.
4. Ask the bin by `confirm`: at `yes` leave, at `no` you have no job.
5. Drive east to D, turn south, drive to {_ROUTE.STOP:g} m past the lane. To the west: past all
   lanes of the east to D's bottom road, west on it, and north past the lanes from the last one up.
   Ask for D's place at the lane itself only when the full bin is left there (`state`: `full`,
   `coupled_to` ''); ask the bin {_LOOK:g} m before the hold.
6. Uncouple. Say `here` to the picker until `yes`: it has coupled your bin, and shares your place on
   D until then.
7. Wait for the lane's place on F. Turn west, drive to the x at which you couple, turn north, drive
   to the lane's centre line, turn east; on the west side headings are turned about. The full bin is
   now {KINDS["carrier"].tows:g} m behind your centre. Up to the turn onto F, the full bin, the
   empty bin and the picker are no obstacles.
8. Couple the full bin, drive to F, and along it to y = {TOP_ROAD:g}; turn east, stop at x =
   {BAY_STOP:g}. Ask the bin by `state` until `full` is false.
9. Drive to x = {_QUEUE.turn_off:g}, turn to your line, and drive to its head, behind what is ahead.

**A claim** to `traffic` has in `keep` the places that the carrier holds, and in `want` those that
it waits for: it gets all or none. Names: `east/D/3`, `west/F/1`, `corner/south-east`,
`corner/south-west`, `turn/south-west`, and `top` if there are more than {_QUEUE.places} carriers.
The answer `places` names what it holds. Claim when a place is given back, and every {PATIENCE}
ticks while one is wanted; a wish that is not repeated for {traffic.FORGET} ticks is dropped.

Give back D at the lane of the delivery at x = {off_d:g} ({_WEST.x(off_d):g} in the west). On F,
give back `corner/south-east` at x = {off_east:g}. Its turn north needs both places of the
south-west: give them back {off_west:g} m and {off_turn:g} m north of F's bottom road. On D, you
need `corner/south-east` from {_ROUTE.HOLD:g} m north of F's bottom road on. Give back each corner
on D after the turn.

**The letters**, with the ticks after which they are repeated:

- `call`, full bin to all carriers: {bin_agent.CALL_AGAIN}, while it has no carrier. Answer: `offer`
  or `no`.
- `come`, full bin to the chosen carrier: {bin_agent.CALL_AGAIN} until `yes`, then
  {bin_agent.ASK_AGAIN} until a carrier has coupled the bin. After any other answer, or
  {bin_agent.GIVE_UP} without one, it asks anew.
- `confirm`, carrier to its full bin: {PATIENCE}, until it is answered.
- `emptybin`, picker to its full bin: {handling.SELDOM}, while it waits. Answer: `carrier`.
- `here`, carrier to the picker: {PATIENCE}, until `yes`.
- `state`, carrier to its full bin: {LOOK_AGAIN}, before D's place; {PATIENCE} in the bay. Answer:
  `binstate`.
- `claim`, picker or carrier to `traffic`. Answer: `places`, 2 ticks later.
- `where`, robot to a person or an animal near its turn. Answer: `position`.
- `fetch`, bin to `dispatch` in place of `call`, unless the policy is `nearest`:
  {bin_agent.CALL_AGAIN}, while it has no carrier; to an early policy from {forecast.EARLIER:g} s
  before a carrier must leave for the farthest lane. Answer: `carrier`, '' while none is chosen.
- `carrierquery`, `dispatch` to all carriers, while a bin waits. Answer: `carrierstatus`.

Answer every other request with `no`. A question whose answer is nil is asked again."""
