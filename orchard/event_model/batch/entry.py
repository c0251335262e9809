"""The door to a batch: what Python calls. The first call compiles it, in some seconds, and the
machine if that is not compiled.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from orchard.event_model.batch import episodes
from orchard.event_model.kernel import entry
from orchard.sim.kernels.addresses import address_of


def addresses(arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return where the arrays of a batch are, for `step`."""
    return episodes.BATCH.addresses(arrays)


def step(batch: np.ndarray, first: int) -> int:
    """Let harvests go on to their next decisions, as `episodes.step` does."""
    done: int = _ready()(batch, _machine(), first)
    return done


@cache
def _ready() -> Any:
    episodes.step.compile(episodes.SIGNATURE)
    return episodes.step


@cache
def _machine() -> int:
    """Return the address of the compiled machine."""
    return address_of(entry.get_ready(), entry.SIGNATURE)
