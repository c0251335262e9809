"""The door to the machine: what Python calls."""

from typing import Any

from orchard.event_model.columns import ARRAYS, Model
from orchard.event_model.kernel import machine
from orchard.event_model.kernel.compiled import outer
from orchard.sim.kernels.arrays import ArrayRecord

_RECORD = ArrayRecord(ARRAYS)
_opens = _RECORD.opens


def addressed(model: Model) -> Model:
    """Return a model with the addresses of its present arrays."""
    return model._replace(addresses=_RECORD.addresses(model._asdict()))


def run(model: Model, until: int) -> int:
    """Carry a harvest on to a time, exclusive, as `machine.run` does."""
    reason: int = _run(model.addresses, until)
    return reason


@outer
def _run(addresses: Any, until: Any) -> Any:
    return machine.run(_opens(addresses), until)
