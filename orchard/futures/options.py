"""The options of a fork, and of the futures of a moment."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from typer import Argument

from orchard.launch.options import CHANGES, HarvestOptions
from orchard.server.options import last_tick
from orchard.terminal.options import FORK, option, picture_file
from orchard.terminal.values import moment

# Options that futures have; each future is a run of its own, with a seed of its own.
OF_FUTURES = {
    *CHANGES,
    "run",
    "at",
    "settings",
    "stop",
    "futures",
    "bisect",
    "picture",
    "duration",
    "summary",
} - {"seed"}

_PARENT = "The run: last, its name, its recording, or its folder of snapshots."
_FUTURES = (
    "Compare N futures of the moment, as it was and as changed, in place of a run. "
    "Default for --bisect: 8."
)
_BISECT = "Find the last moment, up to --at, from which some future does not end so."
_CHANGED = "What changes: carriers=+1, dispatch=nearest, people.workers=0 (repeatable)."
_Parent = Annotated[str, Argument(metavar="RUN", help=_PARENT, show_default=False)]


@dataclass(frozen=True, kw_only=True)
class ForkOptions(HarvestOptions):
    """The options of a run that goes on from a moment of another one."""

    run: _Parent = field()
    at: int | None = option(FORK, "The moment, simulated: s, or M:SS.", "M:SS", parser=moment)
    settings: list[str] | None = option(FORK, _CHANGED, "KEY=VALUE", "--set")
    stop: list[str] | None = option(
        FORK, "Robots that stand from then on (repeatable).", "ROBOT|KIND"
    )
    futures: int | None = option(FORK, _FUTURES, "N", min=1, max=1000)
    bisect: str | None = option(FORK, _BISECT, "jam|collision|FIGURE<NUMBER")
    picture: Path | None = option(
        FORK, "Draw the futures of --bisect over the moments.", "FILE.svg|png", parser=picture_file
    )
    # These are no options of a fork.
    scenario: None = field(default=None, init=False)
    resume: None = field(default=None, init=False)
    replay: None = field(default=None, init=False)

    @property
    def asks_for_futures(self) -> bool:
        """Whether futures are lived, in place of one run."""
        return self.futures is not None or self.bisect is not None

    def faults(self) -> Iterator[tuple[str, str]]:
        """Yield each option that cannot be together with the others, and why."""
        yield from super().faults()
        if self.at is None and self.bisect is None:
            yield "--at", "is missing: the moment at which the fork begins"
        if self.picture is not None and self.bisect is None:
            yield "--picture", "it shows the futures of --bisect: give that, too"
        if self.asks_for_futures:
            yield from self._faults_of_futures()
        if self.at is not None and last_tick(self.duration) <= self.at:
            yield (
                "--duration",
                "the run would end before --at; it counts from the beginning of the harvest",
            )

    def _faults_of_futures(self) -> Iterator[tuple[str, str]]:
        """Yield what futures cannot have."""
        needless = self.given_but(OF_FUTURES)
        if needless:
            yield (
                "--bisect" if self.bisect else "--futures",
                f"leave out {needless}: each future is a run of its own, in local mode",
            )
        if any(word.startswith("seed=") for word in self.settings or []):
            yield "--set seed", "each future has a seed of its own; change something else"
