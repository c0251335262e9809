"""Many harvests of one orchard, each with a seed of its own, which stop for decisions.

`HarvestBatch` of `harvests` holds them as arrays. `episodes` carries them on, compiled: it calls
the machine by its address, fills observations and masks, and makes the random draws.
"""
