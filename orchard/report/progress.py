"""Progress of a run in the terminal: a live table, or plain lines if the output is not a terminal."""

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

LINE_SECONDS = 2.0  # s of wall time between two plain lines
SHOWN = ("picker", "carrier", "tractor", "bin")  # kinds in the table, in this order
NARROWEST = 24  # characters, the minimum width of a column
SILENT = "no agent"  # shown for a robot whose agent was lost
STANDS = (STOPPED, SILENT)  # shown in red


class Headline(msgspec.Struct):
    """The main figures of a run, and a line of `--progress json`."""

    sim_seconds: float
    times_real_time: float
    rows_picked: int
    rows: int
    bins_delivered: int

    @property
    def fraction(self) -> float:
        """Progress from 0 to 1: half for rows picked, half for bins delivered."""
        return (self.rows_picked + self.bins_delivered) / (2 * self.rows)

    def __str__(self) -> str:
        return (
            f"{self.sim_seconds:7.1f} s  {self.times_real_time:6.1f} x real time  "
            f"rows picked {self.rows_picked}/{self.rows}  bins delivered {self.bins_delivered}/{self.rows}"
        )


def headline_of(figures: Mapping[str, Any]) -> Headline:
    """The main figures among those of a run. Raises ValueError if one is missing."""
    return msgspec.convert(figures, Headline)


class Progress:
    """Shows the progress of a run on a console: a live table on a terminal, else a line now and then. Use it as a context manager."""

    def __init__(self, console: Console, as_json: bool = False) -> None:
        """`as_json`: each line of progress is a JSON object, {"progress": {...}}, for programs."""
        self.console, self._as_json = console, as_json
        self._live = Live(console=console, refresh_per_second=4, transient=True) if console.is_terminal and not as_json else None
        self._printed = 0.0  # s, monotonic time of the last plain line
        self._seen: dict[str, None] = {}  # names of all robots shown so far, in order

    def __enter__(self) -> "Progress":
        if self._live:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()

    def show(self, figures: Mapping[str, Any], doing: Mapping[str, str], waits_for: Mapping[str, str]) -> None:
        """Update the table, or print a line if the last one is LINE_SECONDS old.

        `doing`: robot -> what it does. `waits_for`: robot -> the agent or thing for which it waits.
        """
        if self._live:
            self._seen |= dict.fromkeys(doing)
            table = robots(dict.fromkeys(self._seen, SILENT) | dict(doing), waits_for, self.console.width, self.console.height)
            self._live.update(Group(Text(str(headline_of(figures)), style="bold"), table))
        elif time.monotonic() - self._printed >= LINE_SECONDS:
            self._printed, known = time.monotonic(), headline_of(figures)
            self.say(msgspec.json.encode({"progress": known}).decode() if self._as_json else str(known))

    def say(self, words: str) -> None:
        """Print a line that stays on the console."""
        self.console.print(words, highlight=False, markup=False, soft_wrap=True)


def robots(doing: Mapping[str, str], waits_for: Mapping[str, str], width: int, height: int) -> Table:
    """Return a table of what each robot does, for a console of `width` x `height` characters.

    It has as many columns as the robots need. Bins only follow other robots: if one column is too short for all, bins are left out.
    """
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
    """One robot: its short name, what it does, and what it waits for. The name is short because columns are narrow."""
    kind, _, number = name.rpartition("_")
    waits = waits_for.get(name)
    words = f"{doing[name]} ({waits})" if waits and waits not in doing[name] else doing[name]
    return Text.assemble((f"{kind[0].upper()}{number} ", "bold"), (words, "red" if doing[name] in STANDS else "yellow" if waits else ""))
