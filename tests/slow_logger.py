"""A logger whose recorder takes a fifth of a second for each picture, and 20 of them wait at most: `python -m slow_logger ...`."""

import sys
import time

from orchard.contract.events import Frame
from orchard.record.frame_queue import FrameQueue
from orchard.view.recorder import Recorder
from processes import logger

SECONDS = 0.2  # a picture
MOST = 20


class SlowRecorder(Recorder):
    def tick(self, frame: Frame) -> None:
        super().tick(frame)
        time.sleep(SECONDS)


if __name__ == "__main__":
    logger.Recorder, logger.Pages = SlowRecorder, lambda: FrameQueue(MOST)
    sys.exit(logger.main())
