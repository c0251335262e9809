"""An example of each message on the wire: keyspace.md shows them in bytes, and tests check them."""

import numpy as np

from orchard.contract.agent import Observation, Observations
from orchard.contract.events import Event
from orchard.contract.messages import Call, Offer, Written
from orchard.field.geometry import Twist
from orchard.field.kinds import KINDS
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.wire.codec import odometry_of, orchard_of, scan_of, seen_of
from orchard.wire.messages import (
    Advice,
    Angular,
    Answered,
    AskedOf,
    BinStatus,
    BodyStart,
    Bundle,
    Clock,
    Departure,
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
    Point,
    PoseMessage,
    Quaternion,
    Recall,
    Recalled,
    Received,
    Refusal,
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
    SubMessage,
    TickStateMessage,
    Velocities,
    Velocity,
)

# The run, the session and the tick of all examples.
RUN = "5f0c2a9e4b7d4c11"
SESSION = "a1b2c3d4"
TICK = 120


def _seen(name: str, beams: int) -> Observation:
    """Return what a body sees: it drives east at 1 m/s, and only its first beam returns."""
    ranges = np.full(beams, np.inf, dtype="<f4")
    ranges[0] = 2.5
    return Observation(name, TICK, -23.5, 10.75, (0.0, 1.0), Twist(1.0), ranges)


def _sights() -> Observations:
    """Return what all bodies see, of which there is one."""
    seen = _seen("bin_01", 60)
    return Observations(
        TICK,
        {"bin_01": 0},
        np.array([[seen.x, seen.y, *seen.orientation, *seen.twist]]),
        [seen.scan],
        {},
        {"bin_01": 12.5},
        set(),
    )


WRITTEN = Written([("carrier_01", Call(3, "east", TICK - 20))], [])


def _velocity() -> Velocity:
    return Velocity(RUN, TICK, Linear(1.0), Angular(0.0))


def _figures() -> Figures:
    return Figures(RUN, TICK, {"rows_picked": 0}, {"picker_01": "picking row 1"}, {}, {})


_PICKER = BodyStart(
    name="picker_01",
    kind="picker",
    pose=PoseMessage(Point(-35.5, 10.75), Quaternion(0.0, 1.0)),
    bin="bin_01",
    rows=[1, 2],
)
_KIND = orchard_of(RUN, TICK, lay_out(Scenario())).kinds["picker"]
# Message type -> its example.
EXAMPLES: dict[type, SubMessage] = {
    type(message): message
    for message in (
        _velocity(),
        odometry_of(RUN, _seen("picker_01", 180)),
        scan_of(RUN, _seen("weed_01", 60), KINDS["weed"].laser, KINDS["bin"].laser),
        seen_of(RUN, _sights(), ["bin_01"], [AskedOf("bin_01", "picker_01", 0)]),
        Velocities(
            RUN,
            TICK,
            SESSION,
            {"picker_01": Report(Twist(1.0), doing="picking row 1", state="picking", once=True)},
        ),
        Clock(RUN, TICK, Stamp(12, 0)),
        Letter(RUN, TICK, "bin_01", 0, Call(3, "east", TICK - 20)),
        Received(RUN, TICK),
        Answered(RUN, TICK + 1, Offer(35.4, 24.5, 51.0)),
        Letters(RUN, TICK, {"bin_01": WRITTEN}),
        Recall(RUN, TICK),
        Recalled(RUN, TICK, [(TICK - 1, {"bin_01": WRITTEN})]),
        BinStatus(RUN, TICK, True, 70.0, ""),
        Events(RUN, TICK, [Event(TICK, "row picked", "picker_01", "bin_01", "row 1")]),
        TickStateMessage(
            RUN,
            TICK,
            np.array([[-23.5, 10.75, 0.0]]).tobytes(),
            None,
            {},
            None,
            None,
            None,
            [(12.0, 0.0, 0.0, 0.0)],
            0,
        ),
        Bundle(RUN, TICK, [], [Letters(RUN, TICK, {"bin_01": WRITTEN})], []),
        _figures(),
        RefusedThere(RUN, {"malformed": 3}),
        Refusal(
            RUN, TICK, "orchard/picker_01/velocity", "past tick", "100; it is 120 now", SESSION
        ),
        Departure(RUN),
        Orchard(
            RUN,
            TICK,
            [(0.0, 34.0, 50.5, 0.5)],
            [(-35.5, 10.75, 34.5, 10.75)],
            [_PICKER],
            {"picker": _KIND},
        ),
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
        End(RUN, TICK, True, "harvested", "9f86d081", {"rows_picked": 3}),
    )
}
