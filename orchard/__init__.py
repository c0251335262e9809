"""A kiwifruit orchard harvested by robots: the library.

`orchard.local` is the whole program in one loop: read it first.

What users need is imported from here: `from orchard import Scenario, Local, Action, Twist,
connect`. `__init__.pyi` lists all of it. Each name is imported when it is first used, so an agent's
process does not load Rerun, and local mode does not load Zenoh.
"""

import os
import sys

# `python -m orchard` puts the working folder first in Python's path: a user's ast.py there would be
# taken for Python's own.
if (
    # "-m" stands in the place of the program's name while Python looks for the module.
    sys.argv[:1] == ["-m"]
    and sys.orig_argv[-len(sys.argv)].split(".")[0] == __name__
    and not sys.flags.safe_path
    # In a clone the working folder stays, because it holds the package.
    and sys.path[0] != os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
):
    del sys.path[0]

from pathlib import Path

import lazy_loader

_here = Path(__file__).parent
if not (_here / "processes").is_dir():
    # In a clone, `orchard.processes` and `orchard.config` are folders at the top level.
    __path__.append(str(_here.parent))

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
