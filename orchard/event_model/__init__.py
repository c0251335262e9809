"""The event model as data: a harvest is arrays, and small compiled functions carry it on.

`program` translates the step lists that robots follow into ops. `machine` explains how a harvest
goes from event to event. Nothing here knows a duration, a place or a rule that `orchard.plans` or
`orchard.field` has: the translation reads them there.
"""
