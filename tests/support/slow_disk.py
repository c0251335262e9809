"""Physics on a disk that takes so many seconds for each snapshot: `python -m slow_disk SECONDS ...`."""

import os
import sys
import time

from orchard.processes import physics

if __name__ == "__main__":
    seconds, fsync = float(sys.argv.pop(1)), os.fsync

    def slow(file: int) -> None:
        time.sleep(seconds)
        fsync(file)

    os.fsync = slow
    sys.exit(physics.main())
