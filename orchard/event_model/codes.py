"""The numbers that stand for something in the arrays of the event model: kinds of ops, states of
robots, kinds of events, policies, reasons to stop.

A tick is a whole number; a time is in quarters of a tick, because letters arrive between two ticks:
tick 3 is time 12.
An index of NONE stands for nothing.
"""

NONE = -1
# As a time or a tick: it does not happen.
NEVER = 2**60
# Units of time in a tick.
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

# -- sets of places of a robot, as bits. Robots claim places on the roads from the agent `traffic`,
# which keeps a table of them (orchard/behaviour/traffic.py).

# Places that it has, as it knows.
OWN = 0
# Places that its last claim named as kept.
TOLD = 1
# Places that traffic's table has for it.
RESERVED = 2
# What traffic's last answer said: its places, and those that it shares with no other robot.
ANSWERED = 3
ALONE = 4
# The same of an answer that is on its way.
COMING = 5
COMING_ALONE = 6
SETS = 7

# Rows of `scratch`, sets of places with which traffic works while it grants: those for which a
# robot waits that asked earlier, and those that the robot in turn lacks.
WAITED_FOR = 0
MISSING = 1

# -- kinds of events, in the order in which those of one time happen. There is a timer for each kind
# and each robot. What asks whether a carrier can leave sees it as it was in the last tick, so
# robots wake after that.

# A robot hears that it was granted places.
GRANT = 0
# The dispatcher hears what carriers answer, or decides. It has the timer of robot 0.
DISPATCH = 1
# All carriers hear the call of a picker's bin.
CALL_HEARD = 2
# A carrier is looked at that wants a charger: whether it stands.
PARK = 3
# A robot goes on with its op: its alarm.
WAKE = 4
# The dispatcher hears the report of a picker's bin for the first time, or anew.
REPORT = 5
# A carrier hears that a picker's bin has chosen it, or, by way of the dispatcher, that it was sent.
COME = 6
ORDER = 7
# Traffic hears the claim of a robot.
CLAIM = 8
# A picker hears that a carrier has brought an empty bin.
BROUGHT = 9
# The battery of a carrier is full.
FULLY_CHARGED = 10
EVENTS = 11

# -- the dispatcher's states

RESTING = 0
# Carriers hear its question next, and answer.
ABOUT_TO_ASK = 1
# It hears their answers next, and decides.
ABOUT_TO_DECIDE = 2
# A policy in Python has decided.
DECIDED = 3

# -- policies

# There is no dispatcher: bins ask all carriers, as with `nearest`.
BY_CALLS = 0
LONGEST_WAITING = 1
FARTHEST_FIRST = 2
PREDICTIVE = 3
PREDICTIVE_FARTHEST = 4
GLOBAL_ASSIGNMENT = 5
# Python is asked. Bins report to an early policy before they are full.
IN_PYTHON = 6
IN_PYTHON_EARLY = 7
# An early one that is asked only if a carrier can leave for a bin that is due.
IN_PYTHON_WHEN_DUE = 8

# -- why the machine stopped

# It has come to the time up to which it was to go on.
PAUSED = 0
# No event is to come.
ENDED = 1
# Python must first translate a job (desk.missing_line, desk.missing_end).
LACKS_JOB = 2
# Python must first make the log longer.
LOG_IS_FULL = 3
# Python must first draw more of what happens at random.
LACKS_DRAWS = 4
# A policy in Python must decide.
ASKS_POLICY = 5
# Python must tell how far carriers are from the bins that call.
ASKS_WAYS = 6
