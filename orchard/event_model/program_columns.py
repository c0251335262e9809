"""The columns of a program: its ops, and the gates, lines, passes and ends of lanes to which they
lead.

`orchard.event_model.columns` has the rest, and says how to read all of them.
"""

import numpy as np

OP = np.dtype(
    [
        ("kind", np.int64),
        # Of a drive: where it ends, along its line's direction.
        ("target", np.float64),
        # Of a drive on free roads; of BEGIN_ROW: how far the picker drives before it picks.
        ("metres", np.float64),
        # Of a drive, m/s; 0: the speed at which its fruit is picked.
        ("speed", np.float64),
        # Of BEGIN_ROW: from the last fruit to a full bin at the furthest row's end, s.
        ("seconds", np.float64),
        # Of a drive: its line, and its gates. They are the rows of `needs` from the first to before
        # the last one, where it needs places, and those of `frees`, where it gives places back.
        ("line", np.int64),
        ("first_need", np.int64),
        ("last_need", np.int64),
        ("first_free", np.int64),
        ("last_free", np.int64),
        # Ticks for which it lasts on free roads; 0 of a drive. Of HAUL: while the drive after it
        # lasts.
        ("ticks", np.int64),
        # How many of these it takes to couple or uncouple a bin.
        ("handles", np.int64),
        # The same of a robot that has stood for a tick or more.
        ("handles_at_rest", np.int64),
        # Of a turn: ticks after which the bin on the bar is clear of what is behind.
        ("swings", np.int64),
        # Of a quarter turn for which others may be in the way: the unit vector to which the robot
        # faces before it, and after it. Else 0.
        ("faced_x", np.float64),
        ("faced_y", np.float64),
        ("faces_x", np.float64),
        ("faces_y", np.float64),
        # The list of places that it needs or frees; 0: none.
        ("places", np.int64),
        # Of BEGIN_ROW, END_ROW, LEAVE_BIN and a drive that picks: the pass. Of any other drive:
        # NONE. Of HOME and CHARGE: the line of the queue. Of MAY_CHARGE: the op to go on with.
        ("arg", np.int64),
        # Of a drive: to stand behind other robots is normal here, and a call ends it.
        ("is_queueing", np.bool_),
        # Of a drive to the bay: from where on its carrier, if it is held up, unloads; else
        # infinity.
        ("unloads_from", np.float64),
        # Of a drive: its robot said that it picks.
        ("picks", np.bool_),
        # Of a picker's drive along the row in which it will leave its bin, seen by that bin: it
        # reports up to here, along the line; and, as of BEGIN_ROW, only while the picker drives.
        ("is_seen", np.bool_),
        ("tells_to", np.float64),
        ("tells_on_drive", np.bool_),
        # Of a drive on which its robot may fail, s: mean times of work up to that, and of the
        # repair. 0: it does not fail.
        ("mean_between", np.float64),
        ("mean_repair", np.float64),
        # Of a drive: its robot may leave on it.
        ("may_leave", np.bool_),
        # Of MAY_CHARGE: the charge, 0 to 1, at which the carrier must charge.
        ("reserve", np.float64),
    ],
    align=True,
)

GATE = np.dtype(
    [
        # Along the direction of the drive's line.
        ("at", np.float64),
        ("places", np.int64),
        # Whether the full bin of the job must have been left before.
        ("after_bin", np.bool_),
    ],
    align=True,
)

LINE = np.dtype(
    [
        # 0: along x, 1: along y.
        ("axis", np.int64),
        # Its other coordinate: y of a line along x.
        ("other", np.float64),
        # 1 or -1: along it, positions are counted by the sign times the coordinate, so that they
        # grow.
        ("sign", np.float64),
    ],
    align=True,
)

PASS = np.dtype(
    [
        # From 0.
        ("row", np.int64),
        # The lane's end at which the picker leaves the row.
        ("end", np.int64),
        ("metres", np.float64),
        ("is_full", np.bool_),
        ("leaves_bin", np.bool_),
        # Whether it fills the bin of its picker's pass before, which is part full.
        ("fills_on", np.bool_),
    ],
    align=True,
)

LANE_END = np.dtype(
    [
        # The way by road from the queue's first head, m, and how long that takes, s.
        ("metres", np.float64),
        ("seconds", np.float64),
    ],
    align=True,
)
