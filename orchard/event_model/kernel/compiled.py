"""How the functions of the machine are compiled.

Only the outermost one is called from Python, and only its code is kept on the disk: it contains
that of the others.
"""

import hashlib
from functools import partial
from pathlib import Path

from orchard.behaviour import bin, carrier, dispatcher
from orchard.dispatch import ranking
from orchard.event_model import codes, columns, program_columns, swing
from orchard.field import geometry
from orchard.plans import driving, failures, forecast, handling, robot, sense
from orchard.sim.kernels.jit import jit

# Modules of which constants are part of the code. Those of `orchard.field` that are count for all
# kernels.
CONSTANTS_OF = (
    bin,
    carrier,
    dispatcher,
    ranking,
    failures,
    forecast,
    robot,
    sense,
    driving,
    handling,
    codes,
    columns,
    program_columns,
    swing,
    geometry,
)


def _sources() -> str:
    """Return a digest of the files on which the machine's code depends."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    files += [Path(str(module.__file__)) for module in CONSTANTS_OF]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


inner = partial(jit, sources=None, no_cpython_wrapper=True, no_cfunc_wrapper=True)
outer = partial(jit, sources=_sources(), no_cfunc_wrapper=True)
