"""What travels arrives as it was, to the last bit; what is nonsense is refused with its reason."""

import math

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orchard import wire
from orchard.agent import Action, Hitch, Observation
from orchard.geometry import Twist
from orchard.kinds import AROUND, KINDS
from orchard.lockstep import Refused, understood
from orchard.messages import Call, Couple, Offer, Uncouple, pack

RUN = "run1"

names = st.sampled_from(["picker_01", "bin_02", "carrier_11"])
metres = st.floats(-1e3, 1e3)
speeds = st.floats(-100, 100)
units = st.floats(-1, 1)
twists = st.builds(Twist, speeds, speeds, speeds)
ranges = st.one_of(st.floats(0, 10, width=32), st.just(math.inf))


def scans(beams):
    return st.lists(ranges, min_size=beams, max_size=beams).map(lambda values: np.array(values, dtype=np.float32))


hitches = st.builds(Hitch, names, metres, metres, st.tuples(units, units), twists, st.none() | scans(60))
seen = st.builds(
    Observation, st.just("picker_01"), st.integers(0, 2**40), metres, metres, st.tuples(units, units), twists, scans(180),
    st.none() | hitches, st.floats(0, 70), st.booleans(),
)  # fmt: skip


def same_scan(one, other):
    return (one is None and other is None) or one.tobytes() == other.tobytes()


@given(seen)
@settings(max_examples=60, deadline=None)
def test_an_observation_arrives_to_the_last_bit(observation):
    odometry = wire.read(pack(wire.odometry_of(RUN, observation)), wire.Odometry)
    scan = wire.read(pack(wire.scan_of(RUN, observation, KINDS["picker"].laser, AROUND)), wire.LaserScan)
    heard = wire.observation_of("picker_01", odometry, scan)
    for field in ("name", "tick", "x", "y", "orientation", "twist", "fill", "full"):
        assert repr(getattr(heard, field)) == repr(getattr(observation, field))  # repr tells -0.0 from 0.0
    assert same_scan(heard.scan, observation.scan)
    assert (heard.hitch is None) == (observation.hitch is None)
    if heard.hitch is not None:
        assert repr(heard.hitch[:5]) == repr(observation.hitch[:5])
        assert same_scan(heard.hitch.scan, observation.hitch.scan)


@given(twists, st.lists(st.sampled_from([Couple("bin_01"), Uncouple()]), max_size=3), st.binary(max_size=64), st.none() | st.binary())
@settings(max_examples=60, deadline=None)
def test_an_action_arrives_to_the_last_bit(twist, deeds, mail, memory):
    action = Action(twist, deeds, doing="picking row 1", waits_for="bin_01", steps_done=7)
    velocity = wire.read(pack(wire.velocity_of(RUN, 3, "a1", action, mail, memory)), wire.Velocity)
    assert wire.action_of(velocity) == action
    assert (velocity.run, velocity.tick, velocity.holder) == (RUN, 3, "a1")
    assert (velocity.report.mail, velocity.report.memory) == (mail, memory)


@pytest.mark.parametrize("body", [Call(3, "east"), Offer(1.0, 2.0, 3.5)])
def test_letters_arrive_as_they_were(body):
    message = wire.Letter(RUN, 1, "bin_01", 0, body) if isinstance(body, Call) else wire.Answered(RUN, 1, body)
    assert wire.read(pack(message), type(message)) == message


GOOD = {"run": RUN, "tick": 1, "linear": {"x": 1}, "angular": {"z": 0}}


def test_a_whole_number_is_a_velocity_and_what_is_optional_may_be_left_out():
    assert wire.action_of(wire.read(msgpack.packb(GOOD), wire.Velocity)).twist == Twist(1.0)


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
    "a strange deed": {"report": {"deeds": [{"type": "fly"}]}},
    "a long tale": {"report": {"doing": "x" * 201}},
}


@pytest.mark.parametrize("change", BAD.values(), ids=BAD.keys())
def test_a_bad_velocity_is_refused(change):
    with pytest.raises(Refused) as refusal:
        understood(msgpack.packb(GOOD | change), wire.Velocity, RUN)
    assert refusal.value.reason == "malformed"


@pytest.mark.parametrize("missing", GOOD)
def test_a_velocity_without_a_field_is_refused(missing):
    with pytest.raises(Refused, match=missing):
        understood(msgpack.packb({key: value for key, value in GOOD.items() if key != missing}), wire.Velocity, RUN)


def test_another_run_is_refused_by_name():
    with pytest.raises(Refused, match="'run2' is not 'run1'"):
        understood(msgpack.packb(GOOD | {"run": "run2"}), wire.Velocity, RUN)


def test_what_is_too_big_is_not_even_read():
    with pytest.raises(Refused, match="at most"):
        understood(bytes(wire.MAX_PAYLOAD + 1), wire.Velocity, RUN)


MESSAGES = (wire.Velocity, wire.Odometry, wire.LaserScan, wire.Letter, wire.Join, wire.Command, wire.Received | wire.Answered)


@given(st.binary(max_size=200), st.sampled_from(MESSAGES))
@settings(max_examples=300, deadline=None)
def test_random_bytes_are_refused(payload, type_):
    with pytest.raises(Refused):
        understood(payload, type_, RUN)


@given(st.data())
@settings(max_examples=300, deadline=None)
def test_a_damaged_velocity_is_refused_or_still_one(data):
    payload = bytearray(msgpack.packb(GOOD | {"report": {"doing": "picking", "memory": b"abc"}}))
    place = data.draw(st.integers(0, len(payload) - 1))
    payload[place] = data.draw(st.integers(0, 255))
    try:
        velocity = understood(bytes(payload), wire.Velocity, RUN)
    except Refused:
        return
    assert all(abs(part) <= wire.FASTEST for part in wire.action_of(velocity).twist)
