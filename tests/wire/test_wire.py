"""What travels arrives as it was, to the last bit; what is nonsense is refused with its reason.

orchard/wire/codec.py makes messages of what physics and agents have, and the other way round. The
strategies of hypothesis below draw anything that may be seen or said: m, m/s, rad/s, and ranges of
a laser in m, at most 10 or infinite.
"""

import math

import msgpack
import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from local_runs import SMALL
from msgspec.structs import replace

from orchard.contract.agent import LARGEST_MEMORY, Action, Hitch, Observation, Observations
from orchard.contract.messages import FASTEST, MAX_PAYLOAD, Call, Couple, Offer, Uncouple, pack
from orchard.field.geometry import Twist, angle_between, yaw_of
from orchard.field.kinds import AROUND, KINDS
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.net.refusals import Refused, read_message
from orchard.wire import codec
from orchard.wire import messages as wire
from orchard.wire.codec import odometry_of, orchard_of, report_of, scan_of, seen_of, twist_of
from orchard.wire.messages import Velocity, read

RUN = "run1"

names = st.sampled_from(["picker_01", "bin_02", "carrier_11"])
metres = st.floats(-1e3, 1e3)
speeds = st.floats(-100, 100)
units = st.floats(-1, 1)
twists = st.builds(Twist, speeds, speeds, speeds)
ranges = st.one_of(st.floats(0, 10, width=32), st.just(math.inf))


def scans(beams):
    """Draw scans of some beams."""
    return st.lists(ranges, min_size=beams, max_size=beams).map(
        lambda values: np.array(values, dtype=np.float32)
    )


hitches = st.builds(
    Hitch,
    name=names,
    x=metres,
    y=metres,
    orientation=st.tuples(units, units),
    twist=twists,
    scan=st.none() | scans(60),
)
observations = st.builds(
    Observation,
    name=st.just("picker_01"),
    tick=st.integers(0, 2**35),
    x=metres,
    y=metres,
    orientation=st.tuples(units, units),
    twist=twists,
    scan=scans(180),
    hitch=st.none() | hitches,
    fill=st.floats(0, 70),
    full=st.booleans(),
    accuracy=st.just(0.0) | st.floats(0.001, 0.71),
    charge=st.floats(0, 1),
)


def is_same_scan(arrived, sent):
    """Whether two scans have the same bits, or neither is there."""
    if arrived is None or sent is None:
        return arrived is sent
    return arrived.tobytes() == sent.tobytes()


def sights_of(observations):
    """Return what several bodies see at tick 7, as physics puts it together in arrays.

    A row of `states`: x, y, z and w of the orientation, and the velocity forward, left and turning.
    """
    states = np.array([(seen.x, seen.y, *seen.orientation, *seen.twist) for seen in observations])
    hitches = {seen.name: seen.hitch for seen in observations if seen.hitch}
    fills = {seen.name: seen.fill for seen in observations if seen.fill}
    full = {seen.name for seen in observations if seen.fill and seen.full}
    names = {seen.name: row for row, seen in enumerate(observations)}
    accuracies = {seen.name: seen.accuracy for seen in observations if seen.accuracy}
    charges = {seen.name: seen.charge for seen in observations}
    return Observations(
        7,
        names,
        states,
        [seen.scan for seen in observations],
        hitches,
        fills,
        full,
        accuracies,
        charges,
    )


@given(st.lists(observations, min_size=1, max_size=4))
@settings(max_examples=60)
def test_what_is_seen_arrives_to_the_last_bit(drawn):
    """Physics puts together what all bodies see, and sends it for those that are asked."""
    seen = []
    for number, observation in enumerate(drawn):
        is_full = observation.full and observation.fill > 0.0
        name = f"picker_{number:02d}"
        seen.append(replace(observation, name=name, tick=7, full=is_full))
    asked = seen[::2]
    names_asked = [observation.name for observation in asked]
    payload = pack(seen_of(RUN, sights_of(seen), names_asked, []))
    arrived = codec.observations_of(read(payload, wire.Seen))
    assert list(arrived) == names_asked
    for observation in asked:
        assert_same(arrived[observation.name], observation)


# The fields of an observation but its scan and its hitch.
FIELDS = (
    "name",
    "tick",
    "x",
    "y",
    "orientation",
    "twist",
    "fill",
    "full",
    "accuracy",
    "charge",
)


def assert_same(arrived, sent):
    """Assert that two observations are equal to the last bit. `repr` tells -0.0 from 0.0."""
    for field in FIELDS:
        assert repr(getattr(arrived, field)) == repr(getattr(sent, field)), field
    assert is_same_scan(arrived.scan, sent.scan)
    assert (arrived.hitch is None) == (sent.hitch is None)
    if arrived.hitch is not None:
        assert repr(arrived.hitch[:5]) == repr(sent.hitch[:5])
        assert is_same_scan(arrived.hitch.scan, sent.hitch.scan)


def seen_message():
    """Return a message to picker_01 of what it sees at tick 7."""
    observation = Observation(
        "picker_01", 7, 1.0, 2.0, (0.0, 1.0), Twist(), np.zeros(180, dtype=np.float32)
    )
    return seen_of(RUN, sights_of([observation]), [observation.name], [])


@pytest.mark.parametrize(
    "change",
    [
        # A state is seven float 64, 56 bytes.
        {"states": bytes(55)},
        {"states": np.full(7, np.nan).tobytes()},
        {"ranges": bytes(4 * 179)},
        {"names": []},
        {"names": ["pear_01"]},
    ],
    ids=["short", "no numbers", "a beam too few", "nobody's", "no such kind"],
)
def test_arrays_that_do_not_fit_are_refused(change):
    with pytest.raises(ValueError, match=r"fit|number|kind|multiple"):
        codec.observations_of(msgspec.structs.replace(seen_message(), **change))


def test_a_beam_too_many_does_not_make_up_for_one_too_few():
    """The robot's laser has 180 beams and that of its bin 60. Here they have 179 and 61."""
    behind = {
        "picker_01": wire.OtherSeen("bin_01", (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), bytes(4 * 61))
    }
    with pytest.raises(ValueError, match="fit"):
        codec.observations_of(
            msgspec.structs.replace(seen_message(), ranges=bytes(4 * 179), hitches=behind)
        )


@given(observations)
def test_pose_and_scan_of_one_robot_say_the_same(observation):
    pose = msgpack.unpackb(pack(odometry_of(RUN, observation)))
    scan = msgpack.unpackb(pack(scan_of(RUN, observation, KINDS["picker"].laser, AROUND)))
    position = pose["pose"]["position"]
    orientation = pose["pose"]["orientation"]
    assert position["x"] == observation.x
    assert position["y"] == observation.y
    assert position["z"] == 0.0
    assert (orientation["z"], orientation["w"]) == observation.orientation
    assert pose["twist"]["linear"]["x"] == observation.twist.x
    assert pose["accuracy"] == observation.accuracy
    assert scan["ranges"] == observation.scan.tobytes()
    assert (pose["hitch"] is None) == (observation.hitch is None)
    if observation.hitch is not None:
        assert pose["hitch"]["name"] == observation.hitch.name
        if observation.hitch.scan is None:
            assert scan["rear"] is None
        else:
            assert scan["rear"]["ranges"] == observation.hitch.scan.tobytes()


@given(
    twists,
    st.lists(st.sampled_from([Couple("bin_01"), Uncouple()]), max_size=3),
    st.binary(max_size=64),
    st.none() | st.binary(),
)
def test_an_action_arrives_to_the_last_bit(twist, deeds, mail, memory):
    action = Action(twist, deeds, doing="picking row 1", waits_for="bin_01", steps_done=7)
    sent = wire.Velocities(RUN, 3, "a1", {"picker_01": report_of(action, mail, memory)})
    arrived = read(pack(sent), wire.Velocities)
    assert arrived == sent
    report = arrived.velocities["picker_01"]
    assert report.twist == twist
    assert report.deeds == deeds
    assert report.doing == "picking row 1"
    assert report.waits_for == "bin_01"
    assert report.steps_done == 7
    assert report.mail == mail
    assert report.memory == memory


@pytest.mark.parametrize("body", [Call(3, "east", 7), Offer(1.0, 2.0, 3.5)])
def test_letters_arrive_as_they_were(body):
    message = (
        wire.Letter(RUN, 1, "bin_01", 0, body)
        if isinstance(body, Call)
        else wire.Answered(RUN, 1, body)
    )
    assert read(pack(message), type(message)) == message


# A velocity with whole numbers, and without the fields that are optional.
GOOD = {"run": RUN, "tick": 1, "linear": {"x": 1}, "angular": {"z": 0}}


def test_a_whole_number_is_a_velocity():
    assert twist_of(read(msgpack.packb(GOOD), Velocity)) == Twist(1.0)


# What makes a velocity bad, and the fields that are then other than in GOOD.
BAD = {
    "no number": {"linear": {"x": math.nan}},
    "infinite": {"angular": {"z": math.inf}},
    "too fast": {"linear": {"x": 101.0}},
    "a text": {"linear": {"x": "1"}},
    "a truth": {"linear": {"x": True}},
    "upward": {"linear": {"x": 1.0, "z": 0.1}},
    "rolling": {"angular": {"z": 0.0, "x": 0.1}},
    "misspelt": {"linaer": {"x": 1.0}},
    "before the beginning": {"tick": -1},
    "half a tick": {"tick": 1.5},
    "a huge tick": {"tick": 2**63},
    "no run": {"run": None},
    "a strange deed": {"deeds": [{"type": "fly"}]},
}


@pytest.mark.parametrize("change", BAD.values(), ids=BAD.keys())
def test_a_bad_velocity_is_refused(change):
    with pytest.raises(Refused) as refusal:
        read_message(msgpack.packb(GOOD | change), Velocity, RUN)
    assert refusal.value.reason == "malformed"


@pytest.mark.parametrize("missing", GOOD)
def test_a_velocity_without_a_field_is_refused(missing):
    with pytest.raises(Refused, match=missing):
        read_message(
            msgpack.packb({key: value for key, value in GOOD.items() if key != missing}),
            Velocity,
            RUN,
        )


def test_another_run_is_refused_by_name():
    with pytest.raises(Refused, match="'run2' is not 'run1'"):
        read_message(msgpack.packb(GOOD | {"run": "run2"}), Velocity, RUN)


def test_what_is_too_big_is_not_even_read():
    with pytest.raises(Refused, match="at most"):
        read_message(bytes(MAX_PAYLOAD + 1), Velocity, RUN)


def test_a_session_gets_the_memories_of_all_its_agents():
    joined = wire.Joined(RUN, 3, {f"bin_{i:03d}": bytes(LARGEST_MEMORY) for i in range(500)}, {})
    assert read_message(pack(joined), wire.Joined, RUN) == joined


MESSAGES = (
    Velocity,
    wire.Velocities,
    wire.Seen,
    wire.Recall,
    wire.Recalled,
    wire.Letter,
    wire.Join,
    wire.Stop,
)


@given(st.data())
def test_a_damaged_velocity_is_refused_or_still_one(data):
    payload = bytearray(msgpack.packb(GOOD | {"deeds": [{"type": "uncouple"}]}))
    place = data.draw(st.integers(0, len(payload) - 1))
    payload[place] = data.draw(st.integers(0, 255))
    try:
        velocity = read_message(bytes(payload), Velocity, RUN)
    except Refused:
        return
    assert all(abs(part) <= FASTEST for part in twist_of(velocity))


@pytest.mark.parametrize(
    "scenario", [SMALL, Scenario(rows=20, pickers=16, carriers=36)], ids=["small", "large"]
)
def test_the_layout_arrives_as_it_is(scenario):
    layout = lay_out(scenario)
    payload = pack(orchard_of("a", 0, layout))
    arrived = read(payload, wire.Orchard)
    assert len(payload) < MAX_PAYLOAD
    assert [list(wall) for wall in arrived.walls] == layout.walls.tolist()

    for body, start in zip(arrived.bodies, layout.starts, strict=True):
        assert body.name == start.name
        assert body.kind == start.kind
        assert body.bin == start.bin
        position = body.pose.position
        orientation = body.pose.orientation
        assert (position.x, position.y) == start.pose[:2]
        yaw = yaw_of(orientation.z, orientation.w)
        assert abs(angle_between(yaw, start.pose.yaw)) < 1e-9

    # A row is x and y of its west end, then of its east end.
    for (west, west_y, east, east_y), lane in zip(arrived.rows, layout.lanes, strict=True):
        assert west_y == lane.y
        assert east_y == lane.y
        assert east - west == layout.row_length

    carrier = arrived.kinds["carrier"]
    # docs/reference.md has these figures, m; the laser is at the carrier's front.
    assert carrier.length == 1.8
    assert carrier.tows == 1.9
    assert carrier.laser.x == 0.9
    assert carrier.laser.range_min == 0.0


def test_a_kind_of_body_tells_how_it_drives_and_sees():
    layout = lay_out(SMALL)
    kind = KINDS["picker"]
    sent = orchard_of(RUN, 0, layout).kinds["picker"]
    machine = layout.machines["picker"]
    assert machine.speed != machine.turn, "else one could stand for the other"
    assert sent.max_linear == machine.speed
    assert sent.max_angular == machine.turn
    assert sent.length == kind.length
    assert sent.width == kind.width
    assert sent.height == kind.height
    assert sent.tows == kind.tows
    assert sent.solid == kind.solid
    assert sent.robot == kind.robot
    laser = sent.laser
    assert laser.x == kind.laser.ahead
    assert laser.beams == kind.laser.beams
    assert laser.angle_min == kind.laser.first
    assert laser.angle_increment == kind.laser.increment


@settings(max_examples=1)
@given(observations)
def test_a_scan_tells_the_angle_of_its_last_beam(observation):
    laser = KINDS["picker"].laser
    sent = scan_of(RUN, observation, laser, AROUND)
    assert sent.angle_min == laser.first
    assert sent.angle_max == pytest.approx(laser.first + 179 * laser.increment)
