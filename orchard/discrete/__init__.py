"""The discrete-event model: the same plans, places and policies without ticks, lasers and people. It answers in a tenth of a second.

A copy of a duration, a place or a rule may not live here: the model reads them from `orchard.agents` and `orchard.field`.
"""
