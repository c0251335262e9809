"""The command `orchard` of a clone: `python run.py`."""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    # Python has put this folder first: a file random.py in it would be taken for Python's own.
    del sys.path[0]

import os
import runpy
import signal

if __name__ == "__main__":
    # Ctrl-C while the rest is imported ends the process silently: nothing runs yet.
    signal.signal(signal.SIGINT, signal.SIG_DFL)

# The clone may be linked to, and is not installed, so Python would not find its package by name.
# start_module.py loads it from this folder.
FOLDER = os.path.dirname(os.path.realpath(__file__))
runpy.run_path(os.path.join(FOLDER, "orchard", "start_module.py"))["load_package"]()

if __name__ == "__main__":
    from orchard.__main__ import main

    main()
