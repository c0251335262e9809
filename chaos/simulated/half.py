"""A disk that takes half of a write, because it is full or because the process that writes is
killed.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch


class WriterKilled(BaseException):
    """Ends a write as a kill does: no code of the program handles it."""


@contextmanager
def takes_half(end: BaseException) -> Iterator[None]:
    """Let each file that is written in this context have half of its bytes, and the write end with
    `end`.
    """

    def keep_half(file: int) -> None:
        os.ftruncate(file, os.fstat(file).st_size // 2)
        raise end

    with patch.object(os, "fsync", keep_half):
        yield
