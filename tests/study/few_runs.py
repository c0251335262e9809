"""Workers of a test: they do a study's runs one after another in this process, so many of them."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any


class FewRuns:
    """Workers that stop after so many runs, as when the budget is used: no clock decides."""

    count = 1

    def __init__(self, runs: int) -> None:
        self.left = runs
        self.done: list[Any] = []

    def __enter__(self) -> "FewRuns":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def do(
        self, work: Callable[[Any], Any], items: Sequence[Any], goes_on: Callable[[], bool]
    ) -> Iterator[tuple[Any, Any]]:
        for item in items:
            if not self.left:
                return
            self.left -= 1
            self.done.append(item)
            yield item, work(item)
