"""The text of keyspace.md: the table of keys, and for each message its docstring, its fields and an example in bytes."""

import re
from collections.abc import Iterator
from typing import Any, get_args

import msgspec
import numpy as np
from msgspec import inspect

from docs import carrier
from orchard.contract.agent import MOST_HOLD, MOST_REQUESTS, MOST_ZONES, Heard, Mail, Observation, Observations, Reply
from orchard.contract.events import Event
from orchard.contract.mail import digest_of
from orchard.contract.messages import MAX_PAYLOAD, Answer, Call, Claim, Deed, Offer, Places, Request, Written, pack
from orchard.contract.zone import ACROSS
from orchard.field.geometry import Twist
from orchard.field.kinds import AROUND, KINDS
from orchard.field.layout import lay_out
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.net.advice import ADVICE_TICKS
from orchard.net.bus import CONNECT_SECONDS, FULL_QUEUE_US, GET_SECONDS, LEASE_MS
from orchard.net.ending import GOES_SECONDS
from orchard.net.host import JOIN_TRIES
from orchard.net.lockstep import AGAIN_SECONDS
from orchard.net.mailbox import DOUBT_SECONDS, STALE_TICKS
from orchard.net.realtime import SLACK, WATCHDOG, WATCHDOG_TICKS
from orchard.net.requests import AGAIN_SECONDS as ASK_SECONDS
from orchard.net.roster import MOST_TOKENS, NO_TOKEN
from orchard.wire.codec import odometry_of, orchard_of, scan_of, seen_of
from orchard.wire.keys import QUERY, TABLE, Key, Keys
from orchard.wire.messages import (
    Advice,
    Angular,
    Answered,
    AskedOf,
    BinStatus,
    Clock,
    Command,
    Done,
    Drive,
    End,
    Events,
    Figures,
    Join,
    Joined,
    Letter,
    Letters,
    Linear,
    Lost,
    Orchard,
    Picture,
    Place,
    Point,
    PoseMessage,
    Quaternion,
    Recall,
    Recalled,
    Received,
    RefusedThere,
    Report,
    ResetSimulation,
    RunInfo,
    SetSimulationState,
    SimulationState,
    Stamp,
    StepSimulation,
    Stop,
    Stopped,
    Velocities,
    Velocity,
)
from orchard.wire.types import SubMessage

RUN = "5f0c2a9e4b7d4c11"
SESSION = "a1b2c3d4"
TICK = 120

# -- examples


def _seen(name: str, beams: int) -> Observation:
    ranges = np.full(beams, np.inf, dtype="<f4")
    ranges[0] = 2.5
    return Observation(name, TICK, -23.5, 10.75, (0.0, 1.0), Twist(1.0), ranges)


def _sights() -> Observations:
    seen = _seen("bin_01", 60)
    return Observations(
        TICK, {"bin_01": 0}, np.array([[seen.x, seen.y, *seen.orientation, *seen.twist]]), [seen.scan], {}, {"bin_01": 12.5}, set()
    )


WRITTEN = Written([("carrier_01", Call(3, "east", TICK - 20))], [])


def _velocity() -> Velocity:
    return Velocity(RUN, TICK, Linear(1.0), Angular(0.0))


def _figures() -> Figures:
    return Figures(RUN, TICK, {"rows_picked": 0}, {"picker_01": "picking row 1"}, {}, {})


_PICKER = Place("picker_01", "picker", PoseMessage(Point(-35.5, 10.75), Quaternion(0.0, 1.0)), "bin_01")
_KIND = orchard_of(RUN, TICK, lay_out(Scenario())).kinds["picker"]
EXAMPLES: dict[type, SubMessage] = {
    type(message): message
    for message in (
        _velocity(),
        odometry_of(RUN, _seen("picker_01", 180)),
        scan_of(RUN, _seen("weed_01", 60), KINDS["weed"].laser, KINDS["bin"].laser),
        seen_of(RUN, _sights(), ["bin_01"], [AskedOf("bin_01", "picker_01", 0)]),
        Velocities(RUN, TICK, SESSION, {"picker_01": Drive(Linear(1.0), Angular(0.0), True, Report())}),
        Clock(RUN, TICK, Stamp(12, 0)),
        Letter(RUN, TICK, "bin_01", 0, Call(3, "east", TICK - 20)),
        Received(RUN, TICK),
        Answered(RUN, TICK + 1, Offer(35.4, 24.5, 51.0)),
        Letters(RUN, TICK, {"bin_01": WRITTEN}),
        Recall(RUN, TICK),
        Recalled(RUN, TICK, [(TICK - 1, {"bin_01": WRITTEN})]),
        BinStatus(RUN, TICK, True, 70.0, ""),
        Events(RUN, TICK, [Event(TICK, "row picked", "picker_01", "bin_01", "row 1")]),
        Picture(RUN, TICK, np.array([[-23.5, 10.75, 0.0]]).tobytes(), None, {}, None, None, None, [12.0], 0),
        _figures(),
        RefusedThere(RUN, {"malformed": 3}),
        Orchard(RUN, TICK, [(0.0, 34.0, 50.5, 0.5)], [(-35.5, 10.75, 34.5, 10.75)], [_PICKER], {"picker": _KIND}),
        RunInfo(RUN, TICK, "lockstep", ["picker_01"], {"rows": 3}),
        Join(RUN, SESSION, ["picker_01"]),
        Joined(RUN, TICK, {"picker_01": None}, {}),
        Stop(RUN, True, ["picker_01"]),
        Stopped(RUN, TICK, ["bin_01", "picker_01"], ["bin_01", "picker_01"], kept=True),
        Advice(RUN, TICK, Linear(0.5), Angular(0.0)),
        SimulationState(RUN, TICK, "paused"),
        SetSimulationState(RUN, "paused"),
        StepSimulation(RUN, 10),
        ResetSimulation(RUN, 7),
        Lost(RUN, TICK, ["picker_01"], SESSION),
        Command(RUN, "stop"),
        Done(RUN, TICK),
        End(RUN, TICK, True, "harvested", "9f86d081", {"rows_picked": 3}),
    )
}

# -- the fields of a message


def _map(type_: type) -> inspect.StructType:
    info = inspect.type_info(type_)
    assert isinstance(info, inspect.StructType)
    return info


def _rows(struct: inspect.StructType, path: str = "") -> Iterator[tuple[str, str, str]]:
    """Yield (path, type, meaning) of the fields of a map, with those of the maps in it."""
    if struct.tag_field:
        yield struct.tag_field, f"'{struct.tag}'", "which message this is"
    for field in struct.fields:
        type_, note = _bare(field.type)
        entry, step = _entry(type_)
        maps = [part for part in _members(entry) if isinstance(part, inspect.StructType)]
        where = f"{path}{field.encode_name}"
        if maps != [type_]:
            yield where, _type_name(type_) + ("" if field.required else ", optional"), note
        if len(maps) == 1:
            yield from _rows(maps[0], where + step)


def _entry(type_: inspect.Type) -> tuple[inspect.Type, str]:
    """What a map from names or an array holds, or else the type itself; and how the path of a field in it goes on."""
    if isinstance(type_, inspect.DictType):
        return _bare(type_.value_type)[0], ".*."
    if isinstance(type_, inspect.ListType | inspect.VarTupleType):
        return _bare(type_.item_type)[0], ".*."
    return type_, "."


def _bare(type_: inspect.Type) -> tuple[inspect.Type, str]:
    """A type without its metadata, and its description."""
    if not isinstance(type_, inspect.Metadata):
        return type_, ""
    return type_.type, (type_.extra_json_schema or {}).get("description", "")


def _members(type_: inspect.Type) -> tuple[inspect.Type, ...]:
    return tuple(type_.types) if isinstance(type_, inspect.UnionType) else (type_,)


_NAMES: dict[type, str] = {
    inspect.IntType: "int",
    inspect.FloatType: "float",
    inspect.StrType: "str",
    inspect.BytesType: "bin",
    inspect.BoolType: "bool",
    inspect.NoneType: "nil",
    inspect.DictType: "map",
    inspect.AnyType: "any",
}


def _type_name(type_: inspect.Type) -> str:
    """The name of a type in msgpack, with its bounds."""
    if isinstance(type_, inspect.Metadata):
        return _type_name(type_.type)
    if isinstance(type_, inspect.UnionType):
        names = [_type_name(part) for part in type_.types]
        return f"{_union_name(names)} or nil" if "nil" in names else _union_name(names)
    if isinstance(type_, inspect.ListType | inspect.VarTupleType):
        return f"array of {_type_name(type_.item_type)}"
    if isinstance(type_, inspect.NamedTupleType):
        return f"array {type_.cls.__name__}: {', '.join(_type_name(field.type) for field in type_.fields)}"
    if isinstance(type_, inspect.TupleType):
        return f"array of {len(type_.item_types)}: {', '.join(map(_type_name, type_.item_types))}"
    if isinstance(type_, inspect.LiteralType):
        return " or ".join(f"'{value}'" for value in type_.values)
    if isinstance(type_, inspect.StructType):
        return f"map {type_.cls.__name__}"
    if isinstance(type_, inspect.DictType) and not isinstance(type_.value_type, inspect.AnyType):
        return f"map of {_type_name(type_.value_type)}"
    return _NAMES[type(type_)] + _bounds(type_)


def _union_name(names: list[str]) -> str:
    rest = [name for name in names if name != "nil"]
    for title, union in UNIONS.items():
        if set(rest) == {f"map {member.__name__}" for member in get_args(union)}:
            return f"map, one of the {title}"
    return " or ".join(rest)


def _bounds(type_: Any) -> str:
    low, high, most = getattr(type_, "ge", None), _highest(type_), getattr(type_, "max_length", None)
    if low is not None and high is not None:
        return f", {_figure(low)} to {_figure(high)}" if low != high else f", {_figure(low)}"
    if choice := re.fullmatch(r"\^\((\w+(?:\|\w+)*)\)\$", getattr(type_, "pattern", None) or ""):
        return ", " + " or ".join(f"'{word}'" for word in choice[1].split("|"))
    unit = "bytes" if isinstance(type_, inspect.BytesType) else "characters"
    return f", at most {most} {unit}" if most is not None else ""


def _highest(type_: Any) -> float | None:
    """The highest number of a type, if it has one."""
    if isinstance(type_, inspect.IntType) and type_.lt is not None:
        return type_.lt - 1
    return getattr(type_, "le", None)


def _figure(number: float) -> str:
    """A number in full if it is an int."""
    return str(number) if isinstance(number, int) else f"{number:g}"


UNIONS: dict[str, Any] = {"deeds": Deed, "requests": Request, "answers": Answer}

# -- the document

HEAD = """# The keys

Generated from orchard/wire/keys.py by `make docs`; do not edit.

A process opens a Zenoh session: Zenoh 1.x, mode `client`, the endpoint on which physics or a router listens, multicast scouting off. Without `connect/timeout_ms` a client
tries to connect only once; the orchard's own wait {connect} ms for a router. With `transport/link/tx/lease` at {lease} (ms), as theirs, a session that is cut off counts as gone after that time.
It publishes, subscribes, queries and replies on the keys below. `{{prefix}}` is `orchard` unless the run was started with another prefix.

- **Payloads** are msgpack: a map with text keys. `float` is float 64 (integers are accepted too). `bin` is msgpack's bin, not text. In the tables of fields, `*` stands for each name of a map, or for each place of an array.
  Optional fields may be left out. Unknown fields are refused. A client ignores fields that it does not know.
- **Every message carries `run`**, the run's id, **and `tick`**, the number of the time step, from 0. A step is 0.1 s of simulated time.
  The messages Join, Command, Stop, SetSimulationState, StepSimulation, ResetSimulation and RefusedThere carry only `run`.
- **Frames** (REP-103, REP-105): in `map`, x points east, y north and z up, in metres. A yaw of 0 faces east; yaw grows counter-clockwise.
  In the frame of a body, `base_link`, x points forward and y to the left. Names and meanings of fields are those of ROS.
- **Bodies** are the first names in `agents`, in the reply to the scenario query, in this order: robots by name, people and animals by name, weeds by name. All arrays "of each body" have this order.
  Agents without a body, such as `traffic`, come last.
- **Delivery**: "never lost" is published with congestion control BLOCK, "newest wins" with DROP. A query is a get with target ALL and consolidation NONE.
  A router closes the link to a session that receives nothing for {full_queue:g} s while messages wait for it. That session connects again, and has missed what was sent meanwhile.

| key | message | sender | rate | delivery |
| --- | --- | --- | --- | --- |
{table}

In a secured run ([docs/security.md](docs/security.md)) a session has only the rights of its role.

## How to drive a robot

Query `{{prefix}}/scenario` without a payload. The reply holds the run's id and the names of all agents. It comes as soon as physics runs; repeat the query until it comes.
`{{prefix}}/layout` tells the rest of what a map or a robot's description needs: all fences, trunks and posts, the rows, the kind, bin and start pose of each body, and the sizes, speeds and lasers of the kinds.
Which bin is on which bar is in `hitch` of each `pose` and in `state` of each bin.

**A robot whose agent no session holds** (the agent was absent from the start: `orchard --without picker_01`; or it was lost) is driven by any client that publishes velocities on its key. Subscribe to
`{{prefix}}/picker_01/pose`, and publish a velocity with the `run` and the `tick` of the newest pose on `{{prefix}}/picker_01/velocity`. The newest velocity counts. It drives the robot until
a newer one comes, but at most for {watchdog} s and {ticks} ticks, whichever is later; then the robot stands. A step that has begun by then is finished, so it may still move for one step more. `linear.x` and `angular.z` are limited to what the kind of robot can do.
Before tick 0 there are no poses: physics waits until each agent that is left to other sessions is held or driven. A velocity for tick 0 is enough to begin.

**To couple and uncouple a bin** with such a robot, put the deed into `report` of its velocity: `{{"report": {{"deeds": [{{"type": "couple", "bin": "bin_01"}}]}}}}`, or `{{"type": "uncouple"}}`. A deed is done once, in the step of the tick in which it
arrives, with a velocity of 0; 'To couple' below says when it is possible. `hitch` in the next `pose` says whether it was done: it holds the bin, or nil. If not, an event `deed refused` says why. The sessions that hold agents send their deeds in the same way.
Such a robot has no agent: nothing answers the calls of its bin or the offers of carriers, so a harvest waits for it. If that shall go on, leave the agent to the orchard, and send advice instead.

**To advise a robot**, drive it while its agent goes on: the agent keeps its plan, mail and deeds, and another client gives the velocity. Publish `Advice` with the `run` and the `tick` of the newest pose on
`{{prefix}}/picker_01/advice`. It replaces the velocity of the agent in the step of that tick, or of the present one if that is later, until newer advice comes, but at most in the {advice} steps from its `tick` on ({advice_seconds:g} s of simulated time, in lockstep and in realtime).
Then the robot moves as its agent wants, as with ROS's `twist_mux`. For a robot that shall stand, send advice of 0 again and again.
What the agent wants is on `{{prefix}}/picker_01/velocity` while a session subscribes to that: for the tick of the pose, some milliseconds after it. In lockstep an agent that holds publishes nothing: it wants what it wanted last; once advised, it is asked at every tick. The agent's steps end at absolute places: a drive ends as soon as the robot is at or beyond its target along the
drive, a turn when the robot faces exactly (to 1e-9 rad) where the agent wants. So advise what the agent wants, slower or later; or drive near the place, and leave the last turn and drive to the agent, by sending nothing.
Deeds are done while the robot stands: advise 0 while the agent wants 0. Physics limits advice as it limits every velocity; collisions, the emergency stop and the bar between robot and bin are as always. Only the agent's own velocities look for obstacles: advice must look by itself.
In a secured run only the roles that may drive a robot may advise it: that of its agent, and bridges that name it.

**Pause and step.** The states and queries are those of ROS's simulation_interfaces: query `{{prefix}}/simulation_state` (GetSimulationState), `{{prefix}}/set_simulation_state` (SetSimulationState) or `{{prefix}}/step_simulation` (StepSimulation); each reply is a
SimulationState, which is also published when it changes. A pause is in force before the next step. While the run is paused, the present tick stays: its poses and scans are published, answers, velocities and advice to it are taken, sessions may join and robots may be stopped. No agent is
missed or late, no velocity gets older, and pose, scan and `clock` of the tick are published again every {again} s. The reply to `step_simulation` comes when its steps are done, the next tick is published, and the agents have answered it (after {again} s without news also if one has not).
Another `set_simulation_state` or `step_simulation` ends the steps of a query before; then its reply comes at once. The hash of a run that was paused and stepped is that of the run without. A pause is not kept on the disk: physics that was killed plays when it is started again.
In a secured run the operator, the emergency operator and bridges whose role has `simulation` may pause, step, reset and end the run so.
**Reset.** A query `{{prefix}}/reset_simulation` (ResetSimulation) begins the run again at tick 0, with the same id and scenario or with another `seed`. Physics replies, publishes `end` with `why` 'reset', removes its liveliness token, and
waits until the sessions with agents have left. Then it opens its session again, at the same endpoint, and waits for the agents as at the start; a run that was paused is paused at tick 0. So to a client a reset is an end and a new begin: query `scenario` again when the token
of physics is back, forget all memory, mail and ticks, and join again. The run's hash is then that of a run that was never reset. A session whose tokens stay longer than physics' patience must not send any more: requests of its old ticks could be heard again.
Snapshots of the ticks before the reset are removed. While a logger is there, a reset is refused, because the recording would hold two runs: `orchard --record none`.

**To hold an agent in lockstep.** Physics waits for each held agent: it continues with tick k + 1 only when all held agents that are asked at tick k have answered.

1. Choose a session id of letters and digits that no other session uses.
2. Subscribe to the robot's `pose` and `scan` and to `clock`, or to the `seen` of your session, which is cheaper for many robots. Subscribe to `lost` and `end`.
   Declare a queryable on the robot's `mail` if its agent shall receive requests.
3. Declare the liveliness token `{{prefix}}/alive/picker_01/<session id>`. Keep it: without it, another session may take the agent.
4. Query `{{prefix}}/hosts/<session id>/join` with `run`, `holder` (again the session id) and `names`. The reply holds the present tick or, under `refused`, why you cannot hold the agents.
   An agent is never held by two sessions. Physics may learn of the token later than of the join: while the reason is "{no_token}", repeat the join for {join:g} s.
5. For each tick physics sends one `pose` and one `scan` of the robot, and then `clock`. Publish exactly one velocity with this `tick` and with `holder`. The whole run waits for it.
   An agent that holds its velocity leaves out the ticks at which it is not asked: see 'Holds' below.
   If each subscriber of your program has its own thread (in Python each callback has), `clock` may arrive before the `pose` of its tick: wait until the ticks agree.
   While the velocity is missing, physics sends pose, scan and clock again every {again} s: publish the same velocity again if you have already published it.
   In realtime (`mode` in the reply to the scenario query) physics does not wait, and late answers count too: see below.
   A session that holds many agents publishes one message for all of them on its `velocities`, or several messages with a part of them each
   if one would exceed {most} bytes. A velocity in it that is refused as malformed or out of bounds counts as a stop for this tick: its robot
   stands, and the other velocities count.
6. If `lost` names your session, physics has waited for longer than its patience (15 s by default), and the robot stands. Join again.
   Physics that was killed is started again from a snapshot, so it may go back by some ticks. Its token, `{{prefix}}/alive/physics/<run>`, goes and comes back: join again, and go on from the
   memory in the reply. It is what `report.memory` held before that tick; an agent that sends none begins anew.
7. At `end`, undeclare the token and close the session. In an open run any client may publish an `end`. To believe only physics, watch its liveliness token,
   `{{prefix}}/alive/physics/<run>`: physics removes it at the end. An `end` counts if it comes at most {goes:g} s before or after the token goes.

**Holds.** In lockstep an agent need not be asked at every tick. `report.hold` says until when: `until` is the tick at which it wants to be asked again at the latest ({hold} ticks ahead
count at most). Until then physics applies its velocity again, and does no deed of it again. Without `hold`, or with nil, the agent is asked at the next tick. It is asked before `until`, at
the first tick at which one of these is true:

- it hears mail: a request, or the outcome of a request of its own;
- `twist` in `pose` is not its velocity: physics refused or limited the last step, or the robot is stopped;
- another body, or none, is at the other end of its bar, or the `twist` of that body differs from the one when the agent answered; or it is a bin and `full` has changed;
- for a zone in `hold.watch`: whether a return lies in it differs from when the agent answered;
- for a zone in `hold.still`: a return in it has come, gone or changed since the tick before;
- a session joins with it.

A zone is [x_min, x_max, y_min, y_max], metres in the frame of the laser, x ahead, y to the left; at most {zones} in each list. A beam is in a zone at the ranges from where it enters the zone up to where it leaves it;
with cosine c and sine s of its angle it enters at the largest of 0, min(x_min / c, x_max / c) and min(y_min / s, y_max / s), and leaves at the smaller of the two maxima, as float64 (a c or s nearer to 0
than {across:g} sets no limit if 0 lies between the zone's two values, and else the beam misses the zone). A return lies in the zone if enter <= range < leave.
A session gets `seen` only at ticks at which it is asked: `due` names the agents that are, and the velocities of just these are its answer. So a client whose agents hold reads `seen`, not `pose` and `clock`.
A hold is a promise: asked in spite of it, the agent gives the same velocity, neither deed nor letter, and the same words about itself. `orchard --check-holds` asks all, and names an agent that breaks it; `--ignore-holds` asks all. Both give the hash
that the run has with holds, if all are right. In realtime all agents are asked at every tick.

**In realtime** physics keeps to the wall clock. The answers to a tick have until the next tick is due ({slack} s longer if the machine is delayed for a moment; later ticks make up for it).
Then physics continues without the missing answers. It steps when the next tick is due, also if all answers are in before: a velocity, advice or a stop that arrives within a tick counts in it. Of each held robot the newest velocity counts. Its `tick` must be the present one or an earlier one, newer than that of the last
velocity that counted, and no older than {watchdog} s and {ticks} ticks, whichever is later. It drives the robot until a newer one comes or it is older than that; then the robot stands, after
one step more at most, as above.
A velocity with `once` drives for one step only, and only if the robot has not moved since the pose of its `tick`. This is for agents that must end at an exact place; the orchard's own agents
use it. Each deed is done once. Ticks may be left out: answer the newest tick whose `clock` has come. Mail is heard at the next tick of the recipient; the ticks of sender and recipient
may be up to {stale} apart: hold each request within that, hear it at your next tick, and hear each reply at the next tick after it has come. A second reply is stamped with
the tick in which the request was heard. Do not wait for `asked`; nothing is recalled, and digests are not needed. A velocity does not wait for mail. If the token of a robot's holder is gone, the robot stands at once.

**The scan** is raw bytes: `ranges` holds 4 bytes per beam, little-endian float32, metres; +inf for a beam without a return within `range_max`. Beam i points to
`angle_min + i * angle_increment`, radians, counter-clockwise; 0 is straight ahead. In Python: `numpy.frombuffer(scan["ranges"], "<f4")`. `range_min` is 0: the simulator casts each ray from the laser's centre and
has no smallest range, so every range from 0 on is a return (a real laser has a blind zone of some centimetres). A laser is in the middle of its body's width, and as far ahead
of the body's centre as the table of bodies says. The {around} beams of bins and weeds begin straight ahead and go around, {around_step:.6g} rad apart; all others have {front} beams from -pi/2 (right) to pi/2 (left),
pi/{gaps} rad apart. `seen` has only the ranges. Those of a robot's bin are in `rear` and in `hitches`. They are in the frame of the bin, whose yaw is that of `hitch`:
it may differ from the robot's by quarter turns.

**Requests.** A request is a get on `{{prefix}}/<name>/mail`, stamped with the tick in which it is sent, and numbered from 0 for each sender and tick. The first reply, `received`, comes at once.
The request is heard at the next tick, and answered in that tick or never. The answer is the second reply, stamped with the tick of the request + 1; its body is nil if there is no answer.
The agent that asks acts on it at the tick of the request + 2.
The recipient's host must reply `received` at once, hold the query, and reply once more in the tick in which the request is heard.
In lockstep a lost query changes nothing. A copy of each letter goes to physics with the velocity (`report.letters`), and with the next tick physics lists the requests to your agents
(`asked` in `seen`): wait for these requests before you answer that tick. A host asks physics on `{{prefix}}/recall` for the mail of the tick, and uses that mail instead, in three cases:
it has just joined (the tick of the join and the next); a second reply is missing; or a listed request has not come for {doubt:g} s. A request without a copy is not heard while its recipient holds. A client that sends no copies must not send the velocity of a tick before each of its gets
has received its `received` or has ended. `asked` is in `seen` only: a client that hears requests subscribes to `seen`, not to `pose` and `scan`.

So tick k of a session with agents is:

1. Take `seen`. If it repeats your last tick, send the last answer again. It leaves out the ticks at which all your agents hold.
2. Wait until each request in `asked` has come and each get of tick k - 2 has ended; otherwise recall.
3. Decide from what is seen and heard. Publish the velocities of tick k, with copies of the letters.
4. Send the requests of tick k: one get for each, without wildcards, with a time-out of {get:g} s.
5. Answer the requests that were heard, and drop their queries.

At any time: hold a request that is stamped with the last tick that you answered, the next one or, if your agents hold, one of the next {hold}, and refuse others by an error reply. What comes twice (same sender, tick and number) is heard once.

**Heard mail** is, at tick k, the requests stamped k - 1 and the replies to one's own requests of k - 2. Requests are heard sorted by (`type` of the body, sender, tick, number), texts by their bytes; replies by number.
In a recall, `letters` is [[tick, {{sender: {{requests, answers}}}}]]: of tick k - 1 each request [to, body] to you is heard, numbered by its place in the list from 0, and each answer [to, tick, number, body] with `to` =
you and `tick` = k - 2 is the sender's answer to your request of that number. A request of yours without one is answered nil. Your own requests of k - 2 are there too: a session that has just joined has no other copy.

**The digest** of the heard mail, `report.mail`, is BLAKE2b with a digest of 16 bytes, without key, over the msgpack of [requests, replies]: requests are [sender, tick, number, body], replies are [the agent that was asked,
number, body or nil]. A body is the map with `type` first and then all fields in the order of the tables below; so it is enough to pack again what was unpacked, if that keeps the order and floats stay floats. Packed as usual: each
number, text, array and map in its shortest form, but each float as float 64. Without mail the digest is empty. For example, `{digest_of}` gives `{digest}`.

**The run's hash** covers, tick by tick, the state of all bodies, all scans, and these digests. It is the same in each run of a scenario if each client is repeatable: what it sends for tick k follows from what it
has seen and heard up to then, and never from a clock, the order of arrival, or random numbers without a fixed seed; it hears its mail as above; and it sends copies and digests. A client that leaves the digests out is
not in the hash with its mail. Sine, cosine and arctangent differ in their last bits between libraries, and so does the hash if velocities follow from them.

## What is refused

A refused message is not applied. It is counted by reason (`messages_refused` in `figures` and in the summary holds the sum over physics, hosts and logger), and logged once for each
key and reason. A refused query gets an error reply with the reason.

| reason | refused messages |
| --- | --- |
| malformed | not msgpack, an unknown or missing field, a wrong type, NaN or infinity, a value out of the bounds below, more than {most} bytes |
| other run | a message whose `run` is not this run's id |
| past tick, future tick | for a held agent in lockstep: any tick but the present one; else, and in realtime: a tick older than {watchdog} s and {ticks} ticks, older than the last one that counted, or ahead of physics |
| not the holder | a message for an agent that another session holds; a `holder` that is not the session in the key of `velocities` or `join` |
| not held | a velocity with `holder` for an agent that no session holds: join first |
| answered already | a second velocity of a held agent for one tick |
| no such robot | a name without a body; in a stop: a name that is not that of a robot or a kind of robot |
| no such agent | in the sender of a letter or in a liveliness token: a name that is not that of an agent of this run |
| no such key | a key expression with wildcards, which does not name a single key |
| not paused | steps for a run that plays |
| recorded | a reset while a logger records the run |
| not all | a `seen` without some bodies of the session |
| too many | more than any run needs: {tokens} liveliness tokens, sessions that refused messages, events that wait at the logger |
| out of bounds | `linear.y` other than 0 for a body that cannot move sideways, held or not; only a bin can. More than {requests} requests in the letters of one velocity |

## The robots

A name is a kind and a number: `picker_01`. An agent without a body, such as `traffic`, has only mail.

| kind | length x width, m | maximum m/s, forward and back | maximum rad/s | beams of its laser | laser ahead of the centre, m | tows: bin's centre behind its own, m | solid |
| --- | --- | --- | --- | --- | --- | --- | --- |
{kinds}

{carrier}
## The messages
"""  # noqa: E501


def document() -> str:
    """Return the text of keyspace.md."""
    table = "\n".join(map(_table_row, TABLE.values()))
    times = {
        "hold": MOST_HOLD,
        "zones": MOST_ZONES,
        "across": ACROSS,
        "watchdog": WATCHDOG,
        "ticks": WATCHDOG_TICKS,
        "slack": SLACK,
        "stale": STALE_TICKS,
        "advice": ADVICE_TICKS,
        "advice_seconds": ADVICE_TICKS * TIME_STEP,
    }
    times |= {"again": AGAIN_SECONDS, "doubt": DOUBT_SECONDS, "full_queue": FULL_QUEUE_US / 1e6, "goes": GOES_SECONDS}
    times |= {"connect": round(CONNECT_SECONDS * 1000), "lease": LEASE_MS, "get": GET_SECONDS, "join": JOIN_TRIES * ASK_SECONDS}
    front, shown = KINDS["carrier"].laser.beams, _digest_example()
    lasers = {"around": AROUND.beams, "around_step": AROUND.increment, "front": front, "gaps": front - 1}
    work = {"kinds": carrier.bodies(), "carrier": carrier.chapter(), "digest_of": shown[0], "digest": shown[1]}
    head = HEAD.format(
        table=table, most=MAX_PAYLOAD, requests=MOST_REQUESTS, tokens=MOST_TOKENS, no_token=NO_TOKEN, **times, **lasers, **work
    )
    return "\n".join([head, *(_section(what, key) for what, key in TABLE.items()), *(_union(*item) for item in UNIONS.items())])


def _digest_example() -> tuple[str, str]:
    """The mail of an example, and its digest in hexadecimal."""
    call = Heard("bin_01", TICK - 1, 0, WRITTEN.requests[0][1])
    answer = Reply("traffic", 0, Claim([], ["east/D/3"], ""), Places(["east/D/3"], [], []))
    packed = [[(call.sender, call.tick, call.number, call.body)], [(answer.sender, answer.number, answer.body)]]
    return msgspec.json.encode(packed).decode(), digest_of(Mail([call], [answer])).hex()


def _table_row(key: Key) -> str:
    message = key.message.__name__ if key.message else "none"
    return f"| `{key.template}` | {message} | {key.sender} | {key.rate} | {key.delivery} |"


def _section(what: str, key: Key) -> str:
    example = Keys().of(what, "bin_01" if "{bin}" in key.template else "picker_01", SESSION)
    parts = [f"### {what}\n\n`{key.template}`, for example `{example}`. {key.meaning}\n"]
    if key.message:
        parts.append(_message("Query" if key.delivery == QUERY else "", key.message))
    parts += [_message("Reply", reply) for reply in key.replies if reply is not key.message]
    return "\n".join(parts)


def _message(role: str, type_: type) -> str:
    rows = "\n".join(f"| `{path}` | {name} | {note} |" for path, name, note in _rows(_map(type_)))
    title = f"{role} **{type_.__name__}**".strip()
    example = EXAMPLES[type_]
    doc = " ".join((type_.__doc__ or "").split())
    return f"{title}: {doc}\n\n| field | type | meaning |\n| --- | --- | --- |\n{rows}\n\n{_example(example)}\n"


def _example(message: SubMessage) -> str:
    data = pack(message).hex()
    lines = "\n".join(data[i : i + 128] for i in range(0, len(data), 128))
    shown = msgspec.json.encode(_readable(msgspec.to_builtins(message, builtin_types=(bytes,)))).decode()
    return f"For example `{shown}`:\n\n```hex\n{lines}\n```"


def _readable(value: Any) -> Any:
    """Plain data with bytes as text, so that JSON can show it."""
    if isinstance(value, dict):
        return {key: _readable(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_readable(part) for part in value]
    return f"<{len(value)} bytes>" if isinstance(value, bytes) else value


def _union(title: str, union: Any) -> str:
    rows = []
    for member in get_args(union):
        info = _map(member)
        fields = ", ".join(f"`{field.encode_name}` {_type_name(field.type)}" for field in info.fields)
        rows.append(f"| `{info.tag}` | {fields or 'none'} | {' '.join(member.__doc__.split())} |")
    lines = "\n".join(rows)
    return f"### The {title}\n\nA map with `type` and these fields.\n\n| `type` | fields | meaning |\n| --- | --- | --- |\n{lines}\n"
