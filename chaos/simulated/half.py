"""A disk that takes half of a write: it is full, or the process that writes is killed."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch


class WriterKilled(BaseException):
    """Ends a write as a kill does: no code of the program handles it."""


@contextmanager
def takes_half(end: BaseException) -> Iterator[None]:
    """In this context each file that is written gets half of its bytes, and then `end` is raised.

    Files are written by `orchard.folders.write_whole`, which calls `os.fsync` at its end.
    """

    def keep_half(file: int) -> None:
        """Cut off the second half of a file, in place of `os.fsync`."""
        os.ftruncate(file, os.fstat(file).st_size // 2)
        raise end

    with patch.object(os, "fsync", keep_half):
        yield
