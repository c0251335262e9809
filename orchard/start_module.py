"""Starts a module of this package in a process of its own.

    python -P orchard/start_module.py orchard.processes.physics -

All after the module are its arguments; this `-` tells physics that its options come over stdin.

`python -m` puts the folder in which it runs before Python's own ones: a file random.py of a user
would be taken for Python's. Here the package is found by the place of this file, and no folder is
added. `orchard.field.plugins` adds the user's folder, at the end, when a class is named.
"""

import runpy
import sys
from collections.abc import Sequence
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from pathlib import Path


def command_for(module: str, arguments: Sequence[str]) -> list[str]:
    """Return the command line that runs a module of this package with these arguments."""
    return [sys.executable, "-P", __file__, module, *arguments]


def load_package() -> None:
    """Load this package from the place of this file, even if Python would find one of its name
    elsewhere.
    """
    package = Path(__file__).resolve().parent
    if package.name in sys.modules:
        return
    spec = PathFinder.find_spec(package.name, [str(package.parent)])
    assert spec is not None and spec.loader is not None
    sys.modules[package.name] = module_from_spec(spec)
    spec.loader.exec_module(sys.modules[package.name])


if __name__ == "__main__":
    load_package()
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
