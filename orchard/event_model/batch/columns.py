"""The arrays of a batch of harvests and their columns.

n harvests, r robots, b bins, k carriers. Times and lengths are as in `orchard.event_model.columns`.
An observation is what the learning agent gets at a decision, a mask tells which actions it may
take.
"""

from typing import Any

import numpy as np

from orchard.event_model import columns

# -- what a harvest is to do in a step: its command

NOTHING = 0
# Do its action, and go on to the next decision.
ACT = 1
# Begin a new episode.
BEGIN = 2

# -- stages of an episode

# Nothing more can be decided.
OVER = 0
# A decision waits for an action.
DECIDING = 1
# The machine goes on to the next decision.
GOING_ON = 2
# All bins are unloaded, and the last robots drive home.
DRIVING_HOME = 3

EPISODE = np.dtype(
    [
        ("seed", np.int64),
        ("stage", np.int64),
        # The tick up to which the machine was to go on.
        ("until", np.int64),
        # The steps of all robots, and the tick at which it was seen that one moved on.
        ("done", np.int64),
        ("moved", np.float64),
        # While robots drive home: the tick up to which they do, and the steps of all before that.
        ("home_until", np.int64),
        ("home_done", np.int64),
        # Whether the machine has stopped before that tick, because it lacks draws.
        ("is_midway", np.bool_),
        # So far, s: since the start, and in which pickers had no bin to fill. Bins unloaded.
        ("seconds", np.float64),
        ("waited", np.float64),
        ("delivered", np.int64),
        # Whether all bins were unloaded, and no battery is flat.
        ("is_finished", np.bool_),
        # How many draws each robot has.
        ("failures", np.int64),
        ("encounters", np.int64),
        ("looks", np.int64),
    ],
    align=True,
)

RULES = np.dtype(
    [
        # Ticks after which an episode ends.
        ("longest", np.int64),
        # Bins of a harvest.
        ("bins", np.int64),
        # Whether robots may fail, and whether people or animals are about.
        ("has_failures", np.bool_),
        ("has_people", np.bool_),
        # Mean metres from one meeting to the next.
        ("metres", np.float64),
    ],
    align=True,
)

# -- what is drawn for a robot, by its name

FAILING = 0
WAY = 1
STANDING = 2
LOOKING = 3
DRAWN = 4

# Columns of a bin in an observation: 1 if it waits for a decision, else all are 0; its row, from 1;
# s since it called, s until it is full, s and m of a carrier's way to it.
IS_WAITING, ROW, SINCE_CALL, UNTIL_FULL, TO_REACH, METRES = range(6)
OF_BIN = 6
# Columns of a carrier in an observation: 1 if it can leave now; m from the head of its line.
CAN_LEAVE, TO_HEAD = range(2)
OF_CARRIER = 2
# Columns of what happened in a step: s that passed, s for which pickers waited, bins unloaded.
SECONDS, WAITED, DELIVERED = range(3)

# Of each array of a batch what its items are, and its number of dimensions.
ARRAYS: dict[str, tuple[Any, int]] = {
    # (n, words): where the arrays of each harvest are, as `ArrayRecord.addresses` has them.
    "addresses": (np.int64, 2),
    # (bytes,) of a state at the start, and (n, bytes) of the present ones.
    "initial": (np.uint8, 1),
    "states": (np.uint8, 2),
    "episodes": (EPISODE, 1),
    # (1,)
    "rules": (RULES, 1),
    # (n,)
    "commands": (np.int64, 1),
    "actions": (np.int64, 1),
    # (n, r): the carrier that is chosen for each picker's bin at this decision; NONE: none yet.
    "chosen": (np.int64, 2),
    # (DRAWN, r, bytes): what stands in a draw for a robot, and (DRAWN, r) how long it is.
    "names": (np.uint8, 3),
    "lengths": (np.int64, 2),
    # (r, 2): the chance that a person or an animal is near a turn, without a bin and with one.
    "nearness": (np.float64, 2),
    # (n, r * room): of each robot, one after the other, as many as an episode has drawn.
    "failures": (columns.FAILURE, 2),
    "encounters": (columns.ENCOUNTER, 2),
    "looks": (columns.LOOK, 2),
    # (bins,): of each bin's number its place in an observation. (k,): the robots that are carriers.
    "bin_places": (np.int64, 1),
    "carriers": (np.int64, 1),
    # -- observations: (n, 1), (n, b, OF_BIN) and (n, k, OF_CARRIER); and the masks, (n, actions).
    # Action 0 decides nothing more; action 1 + k * bin + carrier sends a carrier to a bin.
    "seconds_seen": (np.float32, 2),
    "bins_seen": (np.float32, 3),
    "carriers_seen": (np.float32, 3),
    "masks": (np.int8, 2),
    # (n, 3): in the last step.
    "happened": (np.float64, 2),
    # -- of a draw: 128 bytes of text, 32 words, and two numbers, uniform in [0, 1)
    "text": (np.uint8, 1),
    "words": (np.uint64, 1),
    "chances": (np.float64, 1),
}
