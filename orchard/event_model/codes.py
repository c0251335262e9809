"""The numbers that stand for something in the arrays of the event model: kinds of ops, states of
robots, kinds of events, policies, reasons to stop.

A tick is a whole number; a time is in quarters of a tick, because letters arrive between two ticks.
An index of NONE stands for nothing.
"""

NONE = -1
# As a time or a tick: it does not happen.
NEVER = 2**60
# Times in a tick.
QUARTERS = 4

# -- kinds of ops. A comment names the steps of which each is made. Those that couple or uncouple a
# bin stand together, from DELIVER to LEAVE_BIN.

# The end of a plan: the robot has nothing to do until it gets another one.
END = 0
# DriveTo.
DRIVE = 1
# Face, Realign.
TURN = 2
# Wait, Announce, Confirmed.
PAUSE = 3
# Need.
NEED = 4
# Free.
FREE = 5
# Alone.
ALONE_IN = 6
# Deliver.
DELIVER = 7
# FetchEmpty.
FETCH_EMPTY = 8
# TakeBin.
TAKE_BIN = 9
# LeaveBin.
LEAVE_BIN = 10
# Unload.
UNLOAD = 11
# Home.
HOME = 12
# A DriveTo that leads a picker to fruit, or the Say after it: the picker's bin sees it.
BEGIN_ROW = 13
# A Say after which a picker no longer picks.
END_ROW = 14
# MayCharge.
MAY_CHARGE = 15
# Charge.
CHARGE = 16
# Charged.
CHARGED = 17
# Haul.
HAUL = 18

# -- what a robot is doing. The table in `machine` says what leads from one to another. States that
# turn or last stand together, from SWINGING_BIN to LASTING, and those that handle bins, from
# LEAVING_BIN to TAKING_BIN.

IDLE = 0
DRIVING = 1
STANDING = 2
SWINGING_BIN = 3
SWINGING_OFF = 4
LASTING = 5
WAITING_FOR_PLACES = 6
WAITING_FOR_PARTNER = 7
LEAVING_BIN = 8
DROPPING_BIN = 9
HANDING_OVER = 10
WAITING_FOR_BIN = 11
COUPLING = 12
TAKING_PLACE = 13
TAKING_BIN = 14
REPAIRED = 15
WAITING_FOR_CHARGE = 16
FLAT = 17
MEETING = 18
LOOKING_AROUND = 19

# -- sets of places of a robot, as bits

# That it has, as it knows.
OWN = 0
# That its last claim named as kept.
TOLD = 1
# That traffic's table has for it.
RESERVED = 2
# Of the table, as it last heard of it: its places, and those that no other robot shares.
ANSWERED = 3
ALONE = 4
# The same of an answer that is on its way.
COMING = 5
COMING_ALONE = 6
SETS = 7

# Rows of `scratch`.
WAITED_FOR = 0
MISSING = 1

# Kinds of events, in the order in which those of one time happen. A timer has a robot. What
# asks whether a carrier can leave sees it as it was in the last tick, so robots wake after that.
GRANT = 0
DISPATCH = 1
CALL_HEARD = 2
PARK = 3
WAKE = 4
REPORT = 5
COME = 6
ORDER = 7
CLAIM = 8
BROUGHT = 9
FULLY_CHARGED = 10
EVENTS = 11

# -- the dispatcher's states

RESTING = 0
ABOUT_TO_ASK = 1
ABOUT_TO_DECIDE = 2
# A policy in Python has decided.
DECIDED = 3

# -- policies

BY_CALLS = 0
LONGEST_WAITING = 1
FARTHEST_FIRST = 2
PREDICTIVE = 3
PREDICTIVE_FARTHEST = 4
GLOBAL_ASSIGNMENT = 5
# In Python. Bins report to an early one before they are full.
IN_PYTHON = 6
IN_PYTHON_EARLY = 7
# An early one that is asked only if a carrier can leave for a bin that is due.
IN_PYTHON_WHEN_DUE = 8

# Why the machine stopped.
PAUSED = 0
ENDED = 1
LACKS_JOB = 2
LOG_IS_FULL = 3
LACKS_DRAWS = 4
ASKS_POLICY = 5
ASKS_WAYS = 6
