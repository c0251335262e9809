"""Where people, animals and weeds stand at the beginning: the given place where it is free, else the nearest free one."""

import numpy as np

from orchard.config import Scenario
from orchard.geometry import Rect


class Crowd:
    """Places guests one after another, each clear of everything before it."""

    def __init__(self, walls: np.ndarray, inside: Rect, rows: Rect) -> None:
        self.walls, self.inside, self.rows = walls, inside, rows

    def guests(self, scenario: Scenario, machines: list) -> list:
        return []
