"""keyspace.md: the table of keys and the messages' own words about themselves, with an example of each in bytes."""

from collections.abc import Iterator
from typing import Any, get_args

import msgspec
import numpy as np
from msgspec import inspect

from orchard.contract.agent import Observation
from orchard.contract.events import Event
from orchard.contract.messages import MAX_PAYLOAD, Answer, Call, Deed, Offer, Request, Written, pack
from orchard.contract.observations import Observations
from orchard.field.geometry import Twist
from orchard.field.kinds import KINDS
from orchard.net.lockstep import AGAIN_SECONDS
from orchard.net.mailbox import DOUBT_SECONDS, STALE_TICKS
from orchard.net.realtime import SLACK
from orchard.net.roster import MOST_TOKENS
from orchard.net.unheld import WATCHDOG, WATCHDOG_TICKS
from orchard.wire.codec import odometry_of, scan_of, seen_of
from orchard.wire.keys import QUERY, TABLE, Key, Keys
from orchard.wire.messages import (
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
    Picture,
    Recall,
    Recalled,
    Received,
    RefusedThere,
    Report,
    RunInfo,
    Stamp,
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
        TICK, ["bin_01"], np.array([[seen.x, seen.y, *seen.orientation, *seen.twist]]), [seen.scan], {}, {"bin_01": 12.5}, set()
    )


WRITTEN = Written([("carrier_01", Call(3, "east"))], [])


def _velocity() -> Velocity:
    return Velocity(RUN, TICK, Linear(1.0), Angular(0.0))


def _figures() -> Figures:
    return Figures(RUN, TICK, {"rows_picked": 0}, {"picker_01": "picking row 1"}, {}, {})


EXAMPLES: dict[type, SubMessage] = {
    type(message): message
    for message in (
        _velocity(),
        odometry_of(RUN, _seen("picker_01", 180)),
        scan_of(RUN, _seen("weed_01", 60), KINDS["weed"].laser, KINDS["bin"].laser),
        seen_of(RUN, _sights(), [0], [AskedOf("bin_01", "picker_01", 0)]),
        Velocities(RUN, TICK, SESSION, {"picker_01": Drive(Linear(1.0), Angular(0.0), True, Report())}),
        Clock(RUN, TICK, Stamp(12, 0)),
        Letter(RUN, TICK, "bin_01", 0, Call(3, "east")),
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
        RunInfo(RUN, TICK, "lockstep", ["picker_01"], {"rows": 3}),
        Join(RUN, SESSION, ["picker_01"]),
        Joined(RUN, TICK, {"picker_01": None}, {}),
        Stop(RUN, True, ["picker_01"]),
        Stopped(RUN, TICK, ["bin_01", "picker_01"], ["bin_01", "picker_01"], kept=True),
        Lost(RUN, TICK, ["picker_01"], SESSION),
        Command(RUN, "stop"),
        Done(RUN, TICK),
        End(RUN, TICK, True, "harvested", "9f86d081", {"rows_picked": 3}),
    )
}

# -- what a message says about its fields


def _map(type_: type) -> inspect.StructType:
    info = inspect.type_info(type_)
    assert isinstance(info, inspect.StructType)
    return info


def _rows(struct: inspect.StructType, path: str = "") -> Iterator[tuple[str, str, str]]:
    """(path, type, meaning) of a map's fields, those of the maps in it included."""
    if struct.tag_field:
        yield struct.tag_field, f"'{struct.tag}'", "which message this is"
    for field in struct.fields:
        type_, note = _bare(field.type)
        maps = [part for part in _members(type_) if isinstance(part, inspect.StructType)]
        where = f"{path}{field.encode_name}"
        if maps != [type_]:
            yield where, _type_name(type_) + ("" if field.required else ", optional"), note
        if len(maps) == 1:
            yield from _rows(maps[0], where + ".")


def _bare(type_: inspect.Type) -> tuple[inspect.Type, str]:
    """A type and what is said about it."""
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
    """How a type is called in msgpack, with its bounds."""
    if isinstance(type_, inspect.Metadata):
        return _type_name(type_.type)
    if isinstance(type_, inspect.UnionType):
        names = [_type_name(part) for part in type_.types]
        return f"{_union_name(names)} or nil" if "nil" in names else _union_name(names)
    if isinstance(type_, inspect.ListType):
        return f"array of {_type_name(type_.item_type)}"
    if isinstance(type_, inspect.NamedTupleType):
        return f"array {type_.cls.__name__}: {', '.join(_type_name(field.type) for field in type_.fields)}"
    if isinstance(type_, inspect.TupleType):
        return f"array of {len(type_.item_types)}: {', '.join(map(_type_name, type_.item_types))}"
    if isinstance(type_, inspect.LiteralType):
        return " or ".join(f"'{value}'" for value in type_.values)
    if isinstance(type_, inspect.StructType):
        return f"map {type_.cls.__name__}"
    return _NAMES[type(type_)] + _bounds(type_)


def _union_name(names: list[str]) -> str:
    rest = [name for name in names if name != "nil"]
    for title, union in UNIONS.items():
        if set(rest) == {f"map {member.__name__}" for member in get_args(union)}:
            return f"map, one of the {title}"
    return " or ".join(rest)


def _bounds(type_: Any) -> str:
    low, high, most = getattr(type_, "ge", None), getattr(type_, "le", None), getattr(type_, "max_length", None)
    if low is not None and high is not None:
        return f", {low:g} to {high:g}" if low != high else f", {low:g}"
    unit = "bytes" if isinstance(type_, inspect.BytesType) else "letters"
    return f", at most {most} {unit}" if most is not None else ""


UNIONS: dict[str, Any] = {"deeds": Deed, "requests": Request, "answers": Answer}

# -- the document

HEAD = """# The keys

Generated from orchard/wire/keys.py by `make docs`; do not edit.

A process opens a Zenoh session (Zenoh 1.x, mode `client`, the endpoint on which physics or a router listens, multicast scouting off)
and puts, hears, asks and answers on the keys below. `{{prefix}}` is `orchard` unless the run was started with another.

- **Payloads** are msgpack: a map with text keys. `float` is float 64 (whole numbers are read as well), `bin` is msgpack's bin, not text.
  Fields called optional may be left out. Unknown fields are refused.
- **Every message carries `run`**, the run's id, **and `tick`**, the number of the time step: 0.1 s of simulated time each, from 0 (join, command and stop: the run only).
- **Frames** (REP-103, REP-105): `map` is x east, y north, z up, metres; yaw is 0 to the east, counter-clockwise positive. `base_link` is the body's:
  x forward, y to the left. Names and meanings of fields are ROS's.
- **Delivery**: "never lost" is put with congestion control BLOCK, "newest wins" with DROP; a query is a get with target ALL, consolidation NONE.

| key | message | sender | rate | delivery |
| --- | --- | --- | --- | --- |
{table}

In a secured run ([docs/security.md](docs/security.md)) a session may do what its role is for, and nothing else.

## How to drive a robot

Query `{{prefix}}/scenario` (no payload): the answer tells the run's id, and every name. It comes as soon as physics runs; ask again while nothing comes.

**A robot that no agent holds** (started so that its agent is absent, or its agent was lost) is driven by whoever puts a velocity on its key: subscribe to
`{{prefix}}/picker_01/pose`, and put a velocity with the `run` and the `tick` of the newest pose on `{{prefix}}/picker_01/velocity`. The newest one counts. It drives the robot until
a newer one comes, but at most for {watchdog} s and {ticks} ticks, whichever is later; then the robot stands. `linear.x` and `angular.z` beyond what the kind can do are cut to that.
Before tick 0 there are no poses: physics waits until every agent that was left to others is held or driven. A velocity for tick 0 is enough to begin.

**An agent in lockstep** is waited for: physics goes on to tick k + 1 only when each agent that is held has answered tick k. To hold one:

1. Choose a session id, letters and digits that nobody else uses.
2. Subscribe to the robot's `pose` and `scan` and to `clock` (or, which is cheaper for many, to `seen` of your session), to `lost` and `end`. Declare a queryable on its
   `mail` if it shall hear requests.
3. Declare the liveliness token `{{prefix}}/alive/picker_01/<session id>`. Keep it: when it goes, the robot is given to others.
4. Query `{{prefix}}/hosts/<session id>/join` with `run`, `holder` (the session id again) and `names`. The answer tells the present tick, or under `refused` why you cannot hold them:
   a name that is taken is never given twice.
5. For each tick there comes one `pose` and one `scan` of the robot, and then `clock`. Put exactly one velocity with that very `tick` and with `holder`. Until it comes, the whole run waits.
   Each subscriber of a program may hear in its own thread (in Python each callback does), and so `clock` before the `pose` of its tick: wait until the ticks agree.
   While it is missing, pose, scan and clock come again every {again} s: put the same velocity again, if you have put it before.
   In realtime (`mode` in the answer to the scenario query) nothing waits, and late answers count as well: see below.
   Who holds many puts one message for all on `velocities` of its session.
6. If `lost` names your session, physics has waited for longer than its patience (15 s unless set): the robot stands. Join again.
7. At `end` undeclare the token and close the session.

**In realtime** physics keeps to the wall clock. A tick's answers have until the next tick is due ({slack} s longer where the machine hiccups, which later ticks make good);
then physics goes on without those that are missing. Of each held robot the newest velocity counts: its `tick` may be the present one or an earlier one, newer than that of the last
one that counted, and no older than {watchdog} s and {ticks} ticks, whichever is later. It drives the robot until a newer one comes, and as long as it is no older than that; then the robot stands.
With `once` it drives for one step only, and only if the robot has not moved since the pose of its `tick`: that is for agents that end exactly where they want, and the orchard's
own use it. Deeds are done once. Ticks may be left out: answer the newest whose `clock` has come. Mail is heard at whatever tick comes next, up to {stale} ticks apart, and a velocity waits
for no mail. A robot whose token is gone stands at once.

**The scan** is raw bytes: `ranges` holds 4 bytes a beam, little-endian float32, metres; +inf where nothing returns within `range_max`. Beam i points to
`angle_min + i * angle_increment`, radians, counter-clockwise, 0 straight ahead. In Python: `numpy.frombuffer(scan["ranges"], "<f4")`.

**Requests**: a get on `{{prefix}}/<name>/mail`, stamped with the tick in which it is asked, numbered from 0 in each tick. The first reply, `received`, comes at once.
It is heard at the next tick, and answered in that tick or never: the answer is the second reply, stamped asked + 1, with nil where there is none. The asker acts on it at asked + 2.
Who answers must reply `received` at once, hold the query, and reply once more in the tick in which it is heard.
In lockstep nothing depends on a query's luck: a copy of each letter goes to physics with the velocity (`report.letters`), and physics tells with the next tick who was asked
(`asked` in `seen`): wait for those requests before that tick is answered. Who has just joined, who got no second reply, and to whom a request that it was told of has not come for
{doubt:g} s asks physics on `{{prefix}}/recall` for the mail of the tick and hears that instead. Who sends no copies must not send the velocity of a tick before each of
its gets has got its `received`, or has ended.

## What is refused

Refused means: not applied, counted (`messages_refused` in `figures` and in the summary, by reason, of physics, hosts
and logger together) and logged once for each key and reason. Queries get an error reply with the reason.

| reason | what |
| --- | --- |
| malformed | no msgpack, an unknown or missing field, a wrong type, NaN or infinity, a value out of the bounds below, more than {most} bytes |
| other run | `run` is not this run's id |
| past tick, future tick | of a held agent in lockstep: not the present tick; of others, and in realtime: older than {watchdog} s and {ticks} ticks, older than the last one that counted, or ahead of physics |
| not the holder | someone else holds this agent; or `holder` is not the session in the key of `velocities` or `join` |
| not held | `holder` is set, but nobody holds the agent: join first |
| answered already | a second velocity of a held agent for one tick |
| no such robot | nothing of that name has a body; of a stop: the name is no robot's or kind's |
| no such agent | of a letter's sender, or in a liveliness token: the name is no agent's of this run |
| no such key | a key expression with wildcards in it, which means no single key |
| not all | of `seen`: bodies of the session are missing in it |
| too many | more than anybody needs: {tokens} liveliness tokens, sessions that refused something, notes for the logger |
| out of bounds | `linear.y` other than 0 of what cannot move sideways, held or not; only a bin can |

## The robots

A name is a kind and a number: `picker_01`. `traffic` is an agent without a body: it has mail only.

| kind | most m/s, forward and back | most rad/s | beams of its laser |
| --- | --- | --- | --- |
{kinds}

## The messages
"""  # noqa: E501


def document() -> str:
    """keyspace.md."""
    table = "\n".join(map(_table_row, TABLE.values()))
    kinds = "\n".join(f"| {name} | {kind.speed:g} | {kind.turn:.6g} | {kind.laser.beams} |" for name, kind in KINDS.items())
    times = {"watchdog": WATCHDOG, "ticks": WATCHDOG_TICKS, "slack": SLACK, "stale": STALE_TICKS}
    times |= {"again": AGAIN_SECONDS, "doubt": DOUBT_SECONDS}
    head = HEAD.format(table=table, kinds=kinds, most=MAX_PAYLOAD, tokens=MOST_TOKENS, **times)
    return "\n".join([head, *(_section(what, key) for what, key in TABLE.items()), *(_union(*item) for item in UNIONS.items())])


def _table_row(key: Key) -> str:
    message = key.message.__name__ if key.message else "none"
    return f"| `{key.template}` | {message} | {key.sender} | {key.rate} | {key.delivery} |"


def _section(what: str, key: Key) -> str:
    example = Keys().of(what, "bin_01" if "{bin}" in key.template else "picker_01", SESSION)
    parts = [f"### {what}\n\n`{key.template}`, for instance `{example}`. {key.meaning}\n"]
    if key.message:
        parts.append(_message("Asked with" if key.delivery == QUERY else "", key.message))
    parts += [_message("Replied with", reply) for reply in key.replies if reply is not key.message]
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
    return f"For instance `{shown}`:\n\n```hex\n{lines}\n```"


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
