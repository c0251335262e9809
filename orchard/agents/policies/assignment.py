"""The dispatch policy `assignment`."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from orchard.agents.dispatch import Assignment, BinReport, CarrierReport
from orchard.agents.policies.ranking import Ranking, free_carriers

try:
    from scipy.optimize import linear_sum_assignment
except ImportError as error:
    raise ImportError(f"it needs scipy ({error}); install it with pip install 'orchard-sim[study]'") from None


class GlobalAssignment(Ranking):
    """All full bins and all free carriers are matched at once, so that the sum of the ways by road is least.

    All carriers pass the queue's head, so the least sum serves near bins first; which of the carriers goes hardly matters.
    """

    def assign(self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport], memory: Any) -> list[Assignment]:
        calling, free = sorted(bins, key=lambda report: (report.since, report.name)), free_carriers(carriers)
        metres = np.array([[carrier.metres + report.metres for carrier in free] for report in calling]).reshape(len(calling), len(free))
        return [Assignment(calling[i].name, free[j].name) for i, j in zip(*linear_sum_assignment(metres), strict=True)]
