"""The file of a recording on a disk that may be full. Rerun's own file sink hangs there for ever."""

import logging
import os
import threading
from pathlib import Path

PIECE = 1 << 16  # bytes

log = logging.getLogger("orchard")


class RecordingFile(threading.Thread):
    """Writes into a file what is written into the pipe `inlet`. After the first error it reads on, writes nothing more, and says so once.

    Call `seal` when the writer has opened the inlet, and `join` when the writer has closed it.
    """

    def __init__(self, path: Path) -> None:
        """Raises OSError if the file cannot be opened."""
        super().__init__(name="recording", daemon=True)
        self._path, self._file = path, path.open("wb", buffering=0)
        self._outlet, self._sealed = os.pipe()
        self.inlet = f"/dev/fd/{self._sealed}"
        self.is_whole = True
        self.start()

    def seal(self) -> None:
        """Close this end of the inlet, so that the pipe ends with its writer."""
        os.close(self._sealed)

    def run(self) -> None:
        with self._file, open(self._outlet, "rb", buffering=0) as pipe:
            while piece := pipe.read(PIECE):
                if self.is_whole:
                    self._write(piece)

    def _write(self, piece: bytes) -> None:
        try:
            while piece:
                piece = piece[self._file.write(piece) :]
        except OSError as error:
            self.is_whole = False
            log.error("%s: %s; the rest of the run is not recorded", self._path, error.strerror)
