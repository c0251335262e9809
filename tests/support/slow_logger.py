"""A logger whose recorder takes a fifth of a second for each picture, and 20 of them wait at most:
`python -m slow_logger ...`.
"""

import sys
import time

from orchard.contract.events import Frame
from orchard.processes import logger
from orchard.record import logger as recording
from orchard.record.logger import FrameQueue
from orchard.view.recorder import Recorder

SECONDS = 0.2  # a picture
MOST = 20
QUEUE = FrameQueue(MOST)


class SlowRecorder(Recorder):
    def tick(self, frame: Frame) -> None:
        super().tick(frame)
        time.sleep(SECONDS)


if __name__ == "__main__":
    recording.Recorder = SlowRecorder  # type: ignore[attr-defined]
    recording.FrameQueue = lambda: QUEUE
    sys.exit(logger.main())
