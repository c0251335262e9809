"""Many harvests of one orchard, each with a seed of its own, which stop for decisions.

`orchard.gym.dispatch_vec_env` uses them, for policies that learn. An "episode" is a harvest from
its start to its end, in which an agent decides which carrier fetches which bin. `HarvestBatch` of
`harvests` holds them as arrays. `episodes` carries them on, compiled: it calls the machine by its
address, fills observations and masks, and makes the random draws.
"""
