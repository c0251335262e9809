"""The ops of a program, for many looks at single columns."""

import numpy as np

from orchard.event_model.program import Program


class Ops:
    """The ops of a program, column by column, as `program_columns.OP` has them.

    The columns are looked up once, because each look-up in a recarray costs a microsecond.
    """

    def __init__(self, program: Program) -> None:
        rows = program.ops.array.view(np.ndarray)
        self.kind = rows["kind"]
        self.target = rows["target"]
        self.unloads_from = rows["unloads_from"]
        self.metres = rows["metres"]
        self.speed = rows["speed"]
        self.seconds = rows["seconds"]
        self.line = rows["line"]
        self.first_need = rows["first_need"]
        self.last_need = rows["last_need"]
        self.first_free = rows["first_free"]
        self.ticks = rows["ticks"]
        self.handles = rows["handles"]
        self.handles_at_rest = rows["handles_at_rest"]
        self.swings = rows["swings"]
        self.places = rows["places"]
        self.arg = rows["arg"]
        self.is_seen = rows["is_seen"]
        self.tells_to = rows["tells_to"]
        self.tells_on_drive = rows["tells_on_drive"]
