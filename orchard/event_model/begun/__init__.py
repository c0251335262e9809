"""Harvests of the event model that go on from a moment of a run in the simulator.

Theory of operation. A moment lies between two ticks: the agents have acted at the last one, and
their letters are under way. The event model hears a letter half a tick after it was sent, so its
time begins right after the agents of the last tick have acted, and letters are events to come.
`orchard.begun_harvest` uses this for the futures of a fork and for the forecast of a run's end.

Each robot is in an op of its plan: the one of the step that comes first in its memory. Most ops
begin, or go on, at the next tick by what they find. Of the others this is what remains:

    in the simulator's step  | in the event model
    -------------------------+------------------------------------------------------------------
    drives, waits for places | it looks again at the next tick, from where it is
    turns                    | the rest of the turn, by the yaw
    lasts for a fixed time   | the rest, by the tick at which the step began
    asks every few ticks     | it asks when it would have asked
    hands a bin over         | by which of the two has the bin, and what the other one has heard
    charges                  | the rest, by the charge; a carrier without a charger waits for one

`begin` puts it together, from what each robot is `doing`: `robots` for the ops, `lines` for which
robot follows which, `places` for claims and what traffic has granted, `batteries` for which
carriers charge, `calls` for bins, carriers that were chosen, and the dispatcher.
"""
