"""A logger whose recorder is slower than the run: it takes `SECONDS` for each picture, and at most
`MOST` pictures wait for it. tests/record/test_logger.py starts it: `python -m slow_logger ...`.
"""

import sys
import time

from orchard.contract.events import Frame
from orchard.processes import logger
from orchard.record import logger as recording
from orchard.record.logger import FrameQueue
from orchard.view.recorder import Recorder

# s of wall time for each picture. A run that nothing holds up makes pictures faster.
SECONDS = 0.2
# Pictures that wait at most. A real logger lets more wait, and a test would have to be longer.
MOST = 20
QUEUE = FrameQueue(MOST)


class SlowRecorder(Recorder):
    """A recorder that pauses after each picture."""

    def tick(self, frame: Frame) -> None:
        super().tick(frame)
        time.sleep(SECONDS)


if __name__ == "__main__":
    # The module `orchard.record.logger` makes both by these names.
    recording.Recorder = SlowRecorder  # type: ignore[attr-defined]
    recording.FrameQueue = lambda: QUEUE
    sys.exit(logger.main())
