"""The columns of the tables, with their units. docs/reference.md lists them."""

from collections.abc import Iterator
from typing import get_args

import pyarrow as pa

from orchard.contract.agent import STATES
from orchard.contract.events import What
from orchard.field.kinds import KINDS, ROBOTS
from orchard.report.metrics import SAMPLED
from orchard.report.summary import UNITS

TICK = "ticks of 0.1 s since the start of the run"
MAP = "frame map: x east, y north"
WHOLE = pa.int32()
NUMBER = pa.float64()
TEXT = pa.string()


# A column has its unit and a description in its metadata; a description may say what null means.
def _column(name: str, kind: pa.DataType, unit: str, words: str) -> pa.Field:
    return pa.field(name, kind, metadata={"unit": unit, "description": words})


def _tick(name: str, words: str) -> pa.Field:
    return _column(name, WHOLE, TICK, words)


def _text(name: str, words: str) -> pa.Field:
    return _column(name, TEXT, "", words)


BODIES = pa.schema(
    [
        _tick(
            "tick",
            "end of the step: the pose is of this tick, velocities and state are of the step that "
            "ends then",
        ),
        _text("name", "the body"),
        _column("x", NUMBER, "m", MAP),
        _column("y", NUMBER, "m", MAP),
        _column("yaw", NUMBER, "rad", "counter-clockwise from east"),
        _column(
            "measured_x", NUMBER, "m", "as the agent observes it at this tick; null: it observes x"
        ),
        _column(
            "measured_y", NUMBER, "m", "as the agent observes it at this tick; null: it observes y"
        ),
        _column(
            "odometry_x",
            NUMBER,
            "m",
            "by odometry alone, in the body's frame odom; null: its odometry has no errors, or it "
            "has none",
        ),
        _column("odometry_y", NUMBER, "m", "by odometry alone, as odometry_x"),
        _column("odometry_yaw", NUMBER, "rad", "by odometry alone, as odometry_x"),
        _column(
            "linear_x", NUMBER, "m/s", "velocity in the step, forward; 0 if the step was refused"
        ),
        _column("linear_y", NUMBER, "m/s", "velocity in the step, to the left; of bins only"),
        _column("angular_z", NUMBER, "rad/s", "yaw rate in the step, counter-clockwise"),
        _column("cmd_linear_x", NUMBER, "m/s", "velocity that the agent wanted, forward"),
        _column("cmd_linear_y", NUMBER, "m/s", "velocity that the agent wanted, to the left"),
        _column("cmd_angular_z", NUMBER, "rad/s", "yaw rate that the agent wanted"),
        _text("coupled", "the body at the other end of its bar; null: none"),
        _column("fill", NUMBER, "m", "of a bin: metres of row in it; null for other bodies"),
        _text("state", "what it does, as one of the states of the summary's state_seconds"),
        _text("doing", "what it does, in words; null: its agent says nothing"),
        _text("waits_for", "the agent or thing that holds it up; null: none"),
    ]
)
EVENTS = pa.schema(
    [
        _tick("tick", "begin of the step in which it happened"),
        _text("what", ", ".join(get_args(What))),
        _text("who", "the body that did it"),
        _text("whom", "the other body; null: none"),
        _text("detail", "more of it, in words; null: nothing"),
    ]
)
MESSAGES = pa.schema(
    [
        _tick("tick", "at which it was sent; it is heard one tick later"),
        _text("sender", "the agent that sent it"),
        _text("recipient", "the agent to which it was sent"),
        _text("type", "as in messages.md: call, fetch, come, yes, ..."),
        _text("content", "the message as JSON"),
    ]
)
CALLS = pa.schema(
    [
        _text("bin", "that calls for a carrier"),
        _text("picker", "that fills the bin, or has left it; null: the call does not say"),
        _column("row", WHOLE, "", "the bin stands, or will stand, at an end of it"),
        _text("end", "of the row: east or west"),
        _tick("called", "first call"),
        _column("asked", WHOLE, "", "times that the bin called until a carrier was chosen"),
        _text("carrier", "that was sent last; null: none yet"),
        _tick("sent", "at which the bin first sent for this carrier; null: not yet"),
        _tick("agreed", "at which it first said yes; null: not yet"),
        _tick("fetched", "at which it coupled the bin; null: not yet"),
    ]
)
EXCHANGES = pa.schema(
    [
        _column("row", WHOLE, "", "in which the bin was filled"),
        _column("metres", NUMBER, "m", "of row in the bin"),
        _text("picker", "that filled it"),
        _text("full_bin", "that the picker left"),
        _text("empty_bin", "that the picker got; null: not yet"),
        _text("carrier", "that brought the empty bin; null: none yet"),
        _tick("full", "at which the bin was full, or left as the last one"),
        _tick("left", "at which the picker uncoupled the full bin"),
        _tick("brought", "at which the carrier uncoupled the empty bin"),
        _tick("supplied", "at which the picker coupled the empty bin"),
        _tick("fetched", "at which a carrier coupled the full bin"),
        _tick("unloaded", "at which the full bin was emptied in the bay"),
        _column("waited_seconds", NUMBER, "s", "from the full bin to the empty one"),
    ]
)


# -- the summary: one row, with the same columns whatever happened

COUNT = pa.int64()
# The keys of `lost_seconds` of a summary.
LOSSES = (
    "optimum",
    "schedule",
    "dispatch",
    "absences",
    "traffic",
    "charging",
    "load_out",
    "people_and_animals",
)
# Type -> the keys of a summary that are columns of this type. "a.b": key b in the dictionary at a.
_OF_SUMMARY: dict[pa.DataType, tuple[str, ...]] = {
    TEXT: (
        "hash",
        "mode",
        "bottleneck",
        "ended",
        "working_day",
        "scenario",
        "forked_from.run",
    ),
    pa.bool_(): ("finished",),
    COUNT: (
        "hosts",
        "seed",
        "ticks",
        "agents",
        "rows",
        "rows_picked",
        "bins",
        "bins_delivered",
        "collisions",
        "collisions_of_people_and_animals",
        "weeds_flattened",
        "orders_refused",
        "messages_dropped",
        "ticks_late",
        "velocities_missed",
    ),
    NUMBER: (
        "sim_seconds",
        "row_length",
        "metres_picked",
        "bins_per_hour",
        "limit_bins_per_hour",
        "schedule_sim_seconds",
        "row_end_seconds",
        "row_end_share",
        "picker_waiting_seconds",
        "carrier_utilisation",
        "charging_seconds",
        "flat_seconds",
        "bay_waiting_seconds",
        "asked_share",
        "wall_seconds",
        "times_real_time",
        "forked_from.seconds",
        "answer_milliseconds.p50",
        "answer_milliseconds.p99",
        *(f"lost_seconds.{part}" for part in LOSSES),
        *(f"distance_metres.{kind}" for kind in KINDS if kind != "weed"),
        *(f"state_seconds.{kind}.{state}" for kind in ROBOTS for state in STATES),
    ),
    pa.list_(NUMBER): tuple(f"history.{name}" for name in SAMPLED),
}
# Lists, and maps with keys that are not known before the run, as JSON.
AS_JSON = (
    "stopped_seconds",
    "broken_agents",
    "messages_refused",
    "violations",
    "jam",
    "recording_parts",
    "recording_gaps",
)


def _summary_columns() -> Iterator[pa.Field]:
    """Yield the columns of the table of summaries."""
    for kind, names in (*_OF_SUMMARY.items(), (TEXT, AS_JSON)):
        for name in names:
            yield _column(name, kind, UNITS.get(name.split(".")[0], ""), "")


SUMMARY = pa.schema(list(_summary_columns()))
