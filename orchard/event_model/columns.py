"""The arrays of the event model and their columns: a program, which is constant, and the state of a
harvest.

Lengths are in m, speeds in m/s, ticks and times as in `codes`, which has the numbers that stand for
something. Robots (pickers and carriers) and bins are numbered in the order of their names. An op, a
list of places, a line, a pass or an end of a lane is numbered by its row in its array. A lane has
two ends: 2 * (row - 1) is its east end, and the next number its west end. A comment stands above
the columns that it is about; "of a drive" means that only rows of drives have them.
"""

from typing import Any, NamedTuple

import numpy as np

from orchard.event_model.program_columns import GATE, LANE_END, LINE, OP, PASS

ROBOT = np.dtype(
    [
        ("op", np.int64),
        ("state", np.int64),
        # The op at which a new plan begins, until the robot takes it.
        ("next_op", np.int64),
        # Steps that are done.
        ("done", np.int64),
        ("x", np.float64),
        ("y", np.float64),
        # Of its kind, m: its size, and from its centre back to that of its bin.
        ("length", np.float64),
        ("width", np.float64),
        ("tows", np.float64),
        # The roads on which it drives. Only robots on the same roads are in each other's way.
        ("roads", np.int64),
        # Tick since which it stands.
        ("stood", np.int64),
        # -- bins: that on its bar. Of a picker: the empty one that it was brought, and the carrier
        # that has brought it. The bin that it has left: a picker its full one, a carrier the empty
        # one that it brought.
        ("bin", np.int64),
        ("offered", np.int64),
        ("bringer", np.int64),
        ("left_bin", np.int64),
        # Tick at which a picker's bin was full, until it has an empty one.
        ("full_since", np.int64),
        # Of a carrier: tick of its last question whether the picker has taken the empty bin; in the
        # bay the tick of its first question whether its bin is empty.
        ("asked", np.int64),
        # -- a carrier's job: its line in the queue (NONE: it is no carrier), the picker that it
        # goes to, and the full bin that it fetches
        ("queue_line", np.int64),
        ("customer", np.int64),
        ("job_bin", np.int64),
        # Tick at which it first asked that bin on this drive whether it is left; whether it is.
        ("bin_asked", np.int64),
        ("knows_left", np.bool_),
        # Whether it has no job, once it is back from the load-out: the tick at which it is or was.
        ("is_free", np.bool_),
        ("back", np.int64),
        # Whether the bay has taken its bin, and unloads it.
        ("is_taken", np.bool_),
        # Ticks by which it hears later that its bin is empty, because it waited in the bay.
        ("hears_later", np.int64),
        # Whether it could leave when the dispatcher last asked; whether the policy has sent it, and
        # it has not heard that.
        ("is_ready", np.bool_),
        ("is_booked", np.bool_),
        # How far it was from its line's head when the dispatcher last asked, for the compiled
        # policies and for one in Python.
        ("millimetres_to_head", np.int64),
        ("metres_to_head", np.float64),
        # What it told a policy in Python then: whether the dispatcher knows its job, and the bin
        # that it fetches.
        ("is_told", np.bool_),
        ("told_job", np.int64),
        # Tick of the report of its bin to which the dispatcher answered that it comes.
        ("bin_reported", np.int64),
        # Its x when bins last called, for a route of the user's own that measures the way.
        ("x_at_call", np.float64),
        # Tick since which it has been outside the queue.
        ("away", np.float64),
        # -- its battery: the charge, 0 to 1, at a tick; the ticks for which it has moved since then
        ("charge", np.float64),
        ("counted", np.int64),
        ("moved", np.int64),
        # Tick since which it has stood in a charging line.
        ("parked", np.int64),
        # Ticks for which it has stood in the queue since then; the tick up to which it moved last.
        ("rested", np.int64),
        ("moved_at", np.int64),
        ("waits_to_charge", np.bool_),
        ("is_charging", np.bool_),
        ("is_charged", np.bool_),
        # The charge with which it left the queue, and the exchange for which it did.
        ("charge_before", np.float64),
        ("exchange", np.int64),
        # -- its drive: how far it is along its line, and where it has left the line before
        ("here", np.float64),
        ("left_at", np.float64),
        ("has_arrived", np.bool_),
        ("next_need", np.int64),
        ("next_free", np.int64),
        # Where it ends, or the robot fails.
        ("stop", np.float64),
        ("fails", np.bool_),
        # -- failures: so far; work since the last repair, s; what remains of this repair after the
        # present part, s; the tick at which that part ends
        ("failures", np.int64),
        ("worked", np.float64),
        ("repair", np.float64),
        ("part_ends", np.int64),
        # Of a carrier that is repaired or held up in the bay: the time at which the bay goes on
        # with its bin; NEVER if it does not. Whether it has emptied the bin.
        ("emptied_next", np.int64),
        ("is_emptied", np.bool_),
        # -- people and animals: how many it has met and at how many turns it has looked for them;
        # the next meeting, along this drive, and after it, m
        ("meetings", np.int64),
        ("turns", np.int64),
        ("meeting", np.float64),
        ("clear", np.float64),
        # -- the present leg, a part of a drive: the tick at which it began, where it began, m in a
        # tick, up to where the robot means to drive, and the robot ahead then
        ("leg_begun", np.int64),
        ("leg_from", np.float64),
        ("leg_stride", np.float64),
        ("leg_goal", np.float64),
        ("leg_ahead", np.int64),
        # Tick at which the last leg ended.
        ("leg_ended", np.int64),
        # -- its line: the robots ahead and behind, and up to where it drives there; whether it has
        # turned, so that its bin stands across the line
        ("line", np.int64),
        ("ahead", np.int64),
        ("behind", np.int64),
        ("line_end", np.float64),
        ("is_across", np.bool_),
        # Tick since which it turns with its bin, if it is a carrier; whether it does so beside the
        # line.
        ("swings_since", np.int64),
        ("swings_aside", np.bool_),
        # -- what wakes it, beside its alarm: the robot ahead drives on (NONE: it waits for none),
        # or places are granted
        ("follows", np.int64),
        ("hears_grants", np.bool_),
        # -- its claim: the list of places that it wants (0: none), the partner that may have them;
        # and both as its last claim told them
        ("wanted", np.int64),
        ("beside", np.int64),
        ("told_wanted", np.int64),
        ("told_beside", np.int64),
        # Tick of its last claim, and of the next one.
        ("claimed", np.int64),
        ("due", np.int64),
        # Time at which it hears the answer to its last claim.
        ("answered", np.int64),
        # -- its wish in traffic's table: the list of places (0: none), since which tick, the
        # partner; the list that was granted last, and whether that was just now
        ("wish", np.int64),
        ("wish_since", np.int64),
        ("wish_beside", np.int64),
        ("granted", np.int64),
        ("was_served", np.bool_),
    ],
    align=True,
)

# Columns of a robot that are NONE at the start.
INDICES = (
    "next_op",
    "offered",
    "bringer",
    "left_bin",
    "full_since",
    "queue_line",
    "customer",
    "job_bin",
    "told_job",
    "leg_ahead",
    "line",
    "ahead",
    "behind",
    "follows",
    "bin_asked",
    "beside",
    "told_beside",
    "due",
    "wish_beside",
    "exchange",
    "back",
)

BIN = np.dtype(
    [
        # Whether it was left in its lane, full. That stays so, also when a carrier has taken it,
        # until a picker begins to fill it.
        ("is_left", np.bool_),
        # Tick at which it was.
        ("left_at", np.int64),
        # Tick at which its picker took it over from a carrier.
        ("taken", np.int64),
        # What a predictive policy remembers: the tick at which it is full.
        ("full", np.int64),
        # Of the manual's policy: since when it has called, and the tick of its last call.
        ("since", np.int64),
        ("called", np.int64),
    ],
    align=True,
)

CALL = np.dtype(
    [
        # The bin that the picker fills, or has left; NONE if there is none. The lane's end at which
        # it is left.
        ("bin", np.int64),
        ("end", np.int64),
        # Tick at which it begins to call, and at which it will be full.
        ("since", np.int64),
        ("full", np.float64),
        # The tick at which it will be full at the speed that it takes for true up to the tick at
        # which it has measured that of this pass.
        ("expected", np.float64),
        ("measured", np.int64),
        # Tick since which its picker has stood, or been repaired, where it picks; and the ticks
        # between which it stood before that.
        ("failed", np.int64),
        ("stood_since", np.int64),
        ("stood_until", np.int64),
        # A tick from which it reports each CALL_AGAIN ticks; one from which it does not, until it
        # sees its picker drive, or is left.
        ("reports_from", np.int64),
        ("silent_since", np.int64),
        # Whether it has been reported to the dispatcher; whether it still waits there, and since
        # which tick; whether a carrier was sent.
        ("is_reported", np.bool_),
        ("is_open", np.bool_),
        ("known_since", np.int64),
        ("is_served", np.bool_),
        # Whether the policy has a carrier for it, and whether it will not hear of that.
        ("is_booked", np.bool_),
        ("is_missed", np.bool_),
        # Whether the policy decides on it now. Once a policy in Python has decided: whether it gets
        # a carrier.
        ("is_asked", np.bool_),
        # s until it is full, for a policy in Python.
        ("seconds", np.float64),
        # The carrier that was chosen for it; NONE: none.
        ("carrier", np.int64),
    ],
    align=True,
)

DESK = np.dtype(
    [
        # The time of the present event.
        ("now", np.int64),
        ("policy", np.int64),
        ("state", np.int64),
        # Tick of the last question to the carriers.
        ("asked", np.int64),
        # s before it is full at which a bin begins to report; the mean speed of picking, m/s.
        ("horizon", np.float64),
        ("mean_speed", np.float64),
        # Of carriers: m/s; and the rate of turns, as a multiple of the usual one.
        ("carrier_speed", np.float64),
        ("carrier_turning", np.float64),
        # x at which carriers leave the queue, its east edge; and x of its heads.
        ("exit", np.float64),
        # x between which a bin is in the bay.
        ("bay_west", np.float64),
        ("bay_east", np.float64),
        ("head", np.float64),
        # Of batteries: how long they last, h, infinity if they are endless; how long they take to
        # charge, s; the share of the power that a carrier uses while it stands on its way.
        ("battery_hours", np.float64),
        ("seconds_to_charge", np.float64),
        ("standing", np.float64),
        ("free_chargers", np.int64),
        # The share of a battery that the way to the load-out and back uses.
        ("haul_charge", np.float64),
        # The bins with which a trailer leaves the bay, and the ticks for which it is away then.
        ("trailer_bins", np.int64),
        ("trailer_ticks", np.int64),
        # The ticks from one truck at the bay to the next one, 0: none comes; the bins that it
        # takes; how many have come; the full bins that waited there when the last bin did.
        ("truck_ticks", np.int64),
        ("truck_bins", np.int64),
        ("trucks", np.int64),
        ("waiting_bins", np.int64),
        # The bins that it unloads at a time.
        ("bays", np.int64),
        # The bins that belong to the bay; NONE: there are always empty ones.
        ("bay_bins", np.int64),
        # m: the other sides of the queue.
        ("queue_west", np.float64),
        ("queue_south", np.float64),
        ("queue_north", np.float64),
        # How many of the results and of the log are filled.
        ("deliveries", np.int64),
        ("exchanges", np.int64),
        ("trips", np.int64),
        ("logged", np.int64),
        # Whether Python must tell how far carriers are from the bins that call: the route has a
        # measure of its own. Whether it has told so for the calls of this time.
        ("asks_ways", np.bool_),
        ("knows_ways", np.bool_),
        # A robot has used its last draw.
        ("lacks_draws", np.bool_),
        # The job that is not translated yet.
        ("missing_line", np.int64),
        ("missing_end", np.int64),
    ],
    align=True,
)

# Shares of the mean times up to a failure, and of its repair.
FAILURE = np.dtype([("until", np.float64), ("repair", np.float64)])

# When a robot is away: from and to, s since the harvest began.
ABSENCE = np.dtype([("begin", np.float64), ("end", np.float64)])

# A robot drives so many metres, and then stands so many ticks for a person or an animal.
ENCOUNTER = np.dtype([("metres", np.float64), ("ticks", np.int64)])
# For how many ticks it stands before a turn, without a bin on its bar and with one.
LOOK = np.dtype([("ticks", np.int64), ("ticks_towing", np.int64)])

# The bins on a trailer at the bay, the tick at which it is or was back, and the bins that it took
# then.
TRAILER = np.dtype([("bins", np.int64), ("back", np.int64), ("taken", np.int64)])

EXCHANGE = np.dtype(
    [
        ("tick", np.int64),
        ("picker", np.int64),
        # Ticks since the picker stood there, and since its bin was full.
        ("stood", np.int64),
        ("without", np.int64),
        # Ticks for which its carrier was busy, until it could leave the queue again; negative: it
        # is still out. What that used of its battery, as a share.
        ("carrier_ticks", np.float64),
        ("battery_used", np.float64),
    ]
)
# The ticks between which a carrier was outside the queue.
TRIP = np.dtype([("since", np.float64), ("until", np.float64)])
# What a robot began at a tick.
LOG = np.dtype([("tick", np.int64), ("robot", np.int64), ("op", np.int64), ("state", np.int64)])


# Of each array of a model what its items are, and its number of dimensions.
ARRAYS = {
    "ops": (OP, 1),
    "needs": (GATE, 1),
    "frees": (GATE, 1),
    "places": (np.uint64, 2),
    "lines": (LINE, 1),
    "passes": (PASS, 1),
    "ends": (LANE_END, 1),
    "jobs": (np.int64, 2),
    "ways": (np.float64, 2),
    "speeds": (np.float64, 1),
    "failures": (FAILURE, 2),
    "absences": (ABSENCE, 2),
    "encounters": (ENCOUNTER, 2),
    "looks": (LOOK, 2),
    "robots": (ROBOT, 1),
    "sets": (np.uint64, 3),
    "scratch": (np.uint64, 2),
    "rears": (np.int64, 2),
    "bins": (BIN, 1),
    "calls": (CALL, 1),
    "offers": (np.int64, 2),
    "distances": (np.float64, 2),
    "timers": (np.int64, 2),
    "desk": (DESK, 1),
    "trailers": (TRAILER, 1),
    "deliveries": (np.int64, 1),
    "exchanges": (EXCHANGE, 1),
    "trips": (TRIP, 1),
    "log": (LOG, 1),
}


class Model(NamedTuple):
    """The arrays of a harvest, as in ARRAYS. r robots, w words of bits for places, b bins."""

    # -- the program
    ops: Any
    needs: Any
    frees: Any
    # (lists of places, w) bits.
    places: Any
    lines: Any
    passes: Any
    ends: Any
    # (lines of the queue, lane's ends): the op at which a job begins; NONE: it is not translated.
    jobs: Any
    # The same shape: m by road from the line's head.
    ways: Any
    # (passes,) m/s at which pickers pick on each.
    speeds: Any
    # (r, draws) of each robot, its failures in order.
    failures: Any
    # (r, absences) of each robot; unused ones are 0 to 0.
    absences: Any
    # (r, draws) of people and animals, also `looks`; no draws in an orchard without them.
    encounters: Any
    looks: Any
    # -- the state
    robots: Any
    # (SETS, r, w) bits.
    sets: Any
    # (2, w) bits, for traffic while it grants.
    scratch: Any
    # (roads, lines): the last robot on each.
    rears: Any
    bins: Any
    # (r,): of a picker.
    calls: Any
    # (r, b) tick of a carrier's first offer to a bin.
    offers: Any
    # (r, lane's ends): m by road, as a route of the user's own measures it.
    distances: Any
    # (EVENTS, r) times.
    timers: Any
    # (1,)
    desk: Any
    # Those at the bay; none if carriers go to the load-out themselves.
    trailers: Any
    # -- the results
    deliveries: Any
    exchanges: Any
    trips: Any
    log: Any
    # Where all these arrays are, for compiled functions: see `kernel.entry`.
    addresses: Any = None
