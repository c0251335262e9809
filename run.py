"""The command `orchard` of a clone: it keeps recordings and snapshots in `runs/` beside this file."""

import signal

if __name__ == "__main__":  # Ctrl-C while the rest is imported ends the process silently: nothing runs yet
    signal.signal(signal.SIGINT, signal.SIG_DFL)

import os
from pathlib import Path

from orchard.__main__ import main

if __name__ == "__main__":
    os.environ.setdefault("ORCHARD_RUNS", str(Path(__file__).parent / "runs"))
    main()
