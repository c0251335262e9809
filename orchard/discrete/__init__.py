"""The discrete-event model: the same plans, places and policies without ticks and lasers. It answers in a fraction of a second.

People and animals are random delays (`bystanders.py`).

A copy of a duration, a place or a rule may not live here: the model reads them from `orchard.agents` and `orchard.field`.
"""
