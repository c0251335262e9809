"""The machine that carries a harvest on, compiled by numba.

`machine` explains it; read that first. Functions take `m`, the model, whose arrays are its
attributes: `m.robots[robot]` is the row of a robot, by its number. `m.desk[0]` has what belongs to
no robot. A function that begins an op, or goes on with one, returns whether the op is done.
"""
