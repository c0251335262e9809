"""How the functions of a batch are compiled."""

import hashlib
from functools import partial
from pathlib import Path

from orchard.event_model import bystanders, codes, columns, program_columns, results
from orchard.event_model.kernel import drives
from orchard.field import picking
from orchard.plans import robot, robot_memory, sense
from orchard.sim.kernels.jit import jit

# Modules of which constants and functions are part of the code.
CONSTANTS_OF = (
    bystanders,
    codes,
    columns,
    program_columns,
    drives,
    picking,
    results,
    robot,
    robot_memory,
    sense,
)


def _sources() -> str:
    """Return a digest of the files on which the code depends."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    files += [Path(str(module.__file__)) for module in CONSTANTS_OF]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


inner = partial(jit, sources=None, no_cpython_wrapper=True, no_cfunc_wrapper=True)
outer = partial(jit, sources=_sources(), no_cfunc_wrapper=True)
