"""The discrete-event model: the same plans, places and policies without ticks and lasers; people
and animals are random delays.

A copy of a duration, a place or a rule may not live here: the model reads them from `orchard.plans`
and `orchard.field`.
"""
