"""A logger whose recorder takes a fifth of a second for each picture, and 20 of them wait at most: `python -m slow_logger ...`."""

import sys
import time

from orchard.frames import Frame
from orchard.view import Recorder
from processes import logger
from processes.pages import Pages

SECONDS = 0.2  # a picture
MOST = 20


class SlowRecorder(Recorder):
    def tick(self, frame: Frame) -> None:
        super().tick(frame)
        time.sleep(SECONDS)


if __name__ == "__main__":
    logger.Recorder, logger.Pages = SlowRecorder, lambda: Pages(MOST)
    sys.exit(logger.main())
