"""The door to the machine: what Python calls. The first call of all compiles the machine."""

import logging
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from orchard.event_model.columns import ARRAYS, Model
from orchard.event_model.kernel import machine
from orchard.event_model.kernel.compiled import outer
from orchard.sim.kernels.arrays import ADDRESSES, ArrayRecord
from orchard.sim.kernels.jit import INTEGER, is_kept

COMPILING = "compiling the event model for this machine; this is done once and takes about 40 s"
SIGNATURE = (ADDRESSES, INTEGER)

log = logging.getLogger("orchard")

_RECORD = ArrayRecord(ARRAYS)
_opens = _RECORD.opens


def addressed(model: Model) -> Model:
    """Return a model with the addresses of its present arrays."""
    return model._replace(addresses=_RECORD.addresses(model._asdict()))


def with_arrays(model: Model, arrays: Mapping[str, np.ndarray]) -> Model:
    """Return a model in which some arrays are others. `model`: one with addresses."""
    # Only the addresses of these arrays are taken: to take that of an array takes 3 us.
    addresses = _RECORD.addresses(arrays, model.addresses)
    return model._replace(**arrays, addresses=addresses)


def run(model: Model, until: int) -> int:
    """Carry a harvest on to a time, exclusive, as `machine.run` does."""
    reason: int = get_ready()(model.addresses, until)
    return reason


def is_ready() -> bool:
    """Whether the machine is compiled, in this process or on the disk."""
    return bool(get_ready.cache_info().currsize) or is_kept(_run, SIGNATURE)


@cache
def get_ready() -> Any:
    """Return the compiled machine. If it must be compiled, which is done once, that is logged.

    A program that starts processes which need it calls this first. Else each would compile it.
    """
    if not is_kept(_run, SIGNATURE):
        log.warning("%s", COMPILING)
    _run.compile(SIGNATURE)
    return _run


@outer
def _run(addresses: Any, until: Any) -> Any:
    return machine.run(_opens(addresses), until)
