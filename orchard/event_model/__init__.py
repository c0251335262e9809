"""The event model as data: a harvest is arrays, and small compiled functions carry it on.

Terms: an "op" is one thing that a robot does, such as a drive or a turn. A "program" is the ops of
all plans of an orchard. A "model" is all arrays of a harvest: the program, and the state. The
"machine" is the compiled code in `kernel` that carries a model on from event to event. The "desk"
is the one row with what belongs to no robot: the time, the dispatcher, the bay. `columns` lists all
arrays and their columns, `codes` the numbers in them.

`program` translates the step lists that robots follow into ops. `machine` explains how a harvest
goes from event to event. Nothing here knows a duration, a place or a rule that `orchard.plans` or
`orchard.field` has: the translation reads them there.
"""
