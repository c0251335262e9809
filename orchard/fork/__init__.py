"""A run that goes on from a snapshot with something changed.

`forked` makes the snapshot with the changes. `changes` has what may change under way, `names` which
robots go and come, `world` moves their state over, and `memories` what they remember.
"""
