"""The door to a batch: what Python calls. The first call compiles it, and the machine if that is
not compiled; each is logged.
"""

import logging
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from orchard.event_model.batch import episodes
from orchard.event_model.kernel import entry
from orchard.sim.kernels.addresses import address_of
from orchard.sim.kernels.jit import is_kept

COMPILING = "compiling many harvests for this machine; this is done once and takes about 20 s"

log = logging.getLogger("orchard")


def addresses(arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return where the arrays of a batch are, for `step`."""
    return episodes.BATCH.addresses(arrays)


def step(batch: np.ndarray, first: int) -> int:
    """Let harvests, from the first one on, go on to their next decisions: see `episodes.step`."""
    done: int = _ready()(batch, _machine(), first)
    return done


@cache
def _ready() -> Any:
    """Return the compiled `episodes.step`."""
    if not is_kept(episodes.step, episodes.SIGNATURE):
        log.warning("%s", COMPILING)
    episodes.step.compile(episodes.SIGNATURE)
    return episodes.step


@cache
def _machine() -> int:
    """Return the address of the compiled machine."""
    return address_of(entry.get_ready(), entry.SIGNATURE)
