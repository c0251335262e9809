"""What a person sees in the terminal while a run goes on: a live table, or plain lines where the output is no terminal."""

import math
import time
from collections.abc import Mapping
from typing import Any

import msgspec
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from orchard.contract.events import STOPPED
from orchard.field.kinds import kind_of

LINE_SECONDS = 2.0  # of wall time between two plain lines
SHOWN = ("picker", "carrier", "tractor", "bin")
NARROWEST = 24  # characters of a column
SILENT = "no agent"  # what a robot does whose agent was lost
STANDS = (STOPPED, SILENT)  # in red


class Headline(msgspec.Struct):
    """The figures that `headline` shows."""

    sim_seconds: float
    times_real_time: float
    rows_picked: int
    rows: int
    bins_delivered: int


class Progress:
    """Shows how a run goes; use it with `with`."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self._live = Live(console=console, refresh_per_second=4, transient=True) if console.is_terminal else None
        self._told = 0.0
        self._seen: dict[str, None] = {}  # all of whom was ever told what they do

    def __enter__(self) -> "Progress":
        if self._live:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()

    def show(self, figures: Mapping[str, Any], doing: Mapping[str, str], waits_for: Mapping[str, str]) -> None:
        """Bring the picture up to date."""
        if self._live:
            self._seen |= dict.fromkeys(doing)
            table = robots(dict.fromkeys(self._seen, SILENT) | dict(doing), waits_for, self.console.width, self.console.height)
            self._live.update(Group(Text(headline(figures), style="bold"), table))
        elif time.monotonic() - self._told >= LINE_SECONDS:
            self._told = time.monotonic()
            self.console.print(headline(figures), highlight=False)

    def say(self, words: str) -> None:
        """A line that stays."""
        self.console.print(words, highlight=False, markup=False, soft_wrap=True)


def headline(figures: Mapping[str, Any]) -> str:
    """The run in one line."""
    return (
        f"{figures['sim_seconds']:7.1f} s  {figures['times_real_time']:6.1f} x real time  "
        f"rows picked {figures['rows_picked']}/{figures['rows']}  bins delivered {figures['bins_delivered']}/{figures['rows']}"
    )


def robots(doing: Mapping[str, str], waits_for: Mapping[str, str], width: int, height: int) -> Table:
    """What each robot does, in as many columns as it takes to fit; bins that just follow are left out when there are many robots."""
    names = [name for kind in SHOWN for name in sorted(doing) if kind_of(name) == kind]
    room = max(4, height - 3)
    if len(names) > room:
        names = [name for name in names if kind_of(name) != "bin"]
    columns = min(math.ceil(len(names) / room), max(1, width // NARROWEST)) or 1
    lines = min(room, math.ceil(len(names) / columns))
    table = Table.grid(padding=(0, 1, 0, 0))
    for _ in range(columns):
        table.add_column(width=width // columns - 1, no_wrap=True, overflow="ellipsis")
    for line in range(lines):
        table.add_row(*(_line(name, doing, waits_for) for name in names[line::lines][:columns]))
    return table


def _line(name: str, doing: Mapping[str, str], waits_for: Mapping[str, str]) -> Text:
    """One robot: its name short where a column is narrow, what it does, and for whom it waits."""
    kind, _, number = name.rpartition("_")
    waits = waits_for.get(name)
    words = f"{doing[name]} ({waits})" if waits and waits not in doing[name] else doing[name]
    return Text.assemble((f"{kind[0].upper()}{number} ", "bold"), (words, "red" if doing[name] in STANDS else "yellow" if waits else ""))
