"""Progress of a run in the terminal: a live table, or plain lines if the output is not a terminal.

The process that starts a run calls it (`orchard.launch`).
"""

import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import msgspec
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from orchard.contract.events import STOPPED
from orchard.field.kinds import ROBOTS, kind_of, short_name
from orchard.report.summary import clock, headline_of

LINE_SECONDS = 2.0  # s of wall time between two plain lines
# The same while the run gets ready, s. A live table shows each second.
STILL_SECONDS = 10.0
# Characters, the minimum width of a column.
NARROWEST = 24
# Shown for a robot that has lost its agent.
SILENT = "no agent"
# What robots do that is shown in red: robots that cannot go on.
STANDS = (STOPPED, SILENT)


@dataclass(frozen=True)
class EndOfRun:
    """When a run will be done, by a forecast. Of 20 forecasts 19 are right, within `within`."""

    #: Simulated s since the run's start.
    seconds: float
    within: float  #: s earlier or later


class Progress:
    """Shows the progress of a run, in a context: a live table on a terminal, else a line now and
    then.
    """

    def __init__(self, console: Console, as_json: bool = False, until: float | None = None) -> None:
        """`as_json`: lines are objects {"progress": {...}}. `until`: simulated time at which the
        run ends, s.
        """
        self.console = console
        self._as_json = as_json
        self._until = until
        # Returns the forecast of the run's end; at first there is none.
        self._end_of_run: Callable[[], EndOfRun | None] = lambda: None
        self._live: Live | None = None
        if console.is_terminal and not as_json:
            self._live = Live(
                console=console,
                refresh_per_second=4,
                transient=True,
                redirect_stdout=False,
                redirect_stderr=False,
            )
        # s, monotonic time of the last plain line.
        self._printed = 0.0
        # The names of all robots shown so far, in order: a robot that has lost its agent stays in
        # the table.
        self._seen: dict[str, None] = {}
        # Is set once the first figures have come.
        self._has_begun = threading.Event()

    def __enter__(self) -> "Progress":
        """Begin the live table, if there is one."""
        if self._live:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End the live table, and the lines before the first figures."""
        self._has_begun.set()
        if self._live:
            self._live.stop()

    def get_ready(self, words: str) -> None:
        """Print what the run does before it begins, and then how long it does so, until its first
        figures come. With `as_json` these lines are still text: the page shows them to people.
        """
        self.say(words)
        self.preparing = threading.Thread(target=self._show_that_it_goes_on, daemon=True)
        self.preparing.start()

    def _show_that_it_goes_on(self) -> None:
        """Show how long the run gets ready, until its first figures have come."""
        begun = time.monotonic()
        seconds = STILL_SECONDS
        if self._live:
            seconds = 1.0
        while not self._has_begun.wait(seconds):
            words = f"getting ready: {clock(time.monotonic() - begun)} so far"
            if self._live:
                self._live.update(Text(words))
            else:
                self.say(words)

    def tell_end(self, end_of_run: Callable[[], EndOfRun | None]) -> None:
        """Show from now on when the run will be done.

        `end_of_run`: returns the newest forecast, or None if there is none.
        """
        self._end_of_run = end_of_run

    def show(
        self, figures: Mapping[str, Any], doing: Mapping[str, str], waits_for: Mapping[str, str]
    ) -> None:
        """Update the table, or print a line if the last one is LINE_SECONDS old.

        `figures`: of the run's summary so far. `doing`: robot -> what it does. `waits_for`: robot
        -> agent or thing.
        """
        self._has_begun.set()
        headline = headline_of(figures)
        end = self._end_of_run()
        if end is not None:
            headline.done_seconds = end.seconds
            headline.done_within_seconds = end.within
        if self._live:
            self._seen |= dict.fromkeys(doing)
            all_doing = dict.fromkeys(self._seen, SILENT) | dict(doing)
            table = robots(all_doing, waits_for, self.console.width, self.console.height)
            self._live.update(Group(Text(headline.line(self._until), style="bold"), table))
        elif time.monotonic() - self._printed >= LINE_SECONDS:
            self._printed = time.monotonic()
            if self._as_json:
                self.say(msgspec.json.encode({"progress": headline}).decode())
            else:
                self.say(headline.line(self._until))

    def say(self, words: str) -> None:
        """Print a line that stays on the console."""
        self.console.print(words, highlight=False, markup=False, soft_wrap=True)


def robots(
    doing: Mapping[str, str], waits_for: Mapping[str, str], width: int, height: int
) -> Table:
    """Return a table of what each robot does, for a console of `width` x `height` characters.

    Bins are left out if one column is too short for all robots: they only follow other robots. The
    last line says how many robots have no room.
    """
    names = []
    for kind in ROBOTS:
        names += [name for name in sorted(doing) if kind_of(name) == kind]
    # Lines of the table: all but the headline, one below the table, and one for the cursor.
    room = max(4, height - 3)
    if len(names) > room:
        names = [name for name in names if kind_of(name) != "bin"]
    needed_columns = max(1, math.ceil(len(names) / room))
    most_columns = max(1, width // NARROWEST)
    columns = min(needed_columns, most_columns)
    is_full = len(names) > room * columns
    lines = math.ceil(len(names) / columns)
    if is_full:
        # The last line says how many more there are.
        lines = room - 1
    table = Table.grid(padding=(0, 1, 0, 0))
    for _ in range(columns):
        table.add_column(width=width // columns - 1, no_wrap=True, overflow="ellipsis")
    # Names go down the first column, then down the next one.
    for line in range(lines):
        in_line = names[line::lines][:columns]
        table.add_row(*[_line(name, doing, waits_for) for name in in_line])
    if is_full:
        table.add_row(Text(f"and {len(names) - lines * columns} more", "yellow"))
    return table


def _line(name: str, doing: Mapping[str, str], waits_for: Mapping[str, str]) -> Text:
    """Return a robot's short name, what it does, and what it waits for, for a narrow column."""
    words = doing[name]
    waited_for = waits_for.get(name)
    colour = ""
    if words in STANDS:
        colour = "red"
    elif waited_for:
        colour = "yellow"
    if waited_for and waited_for not in words:
        words = f"{words} ({waited_for})"
    return Text.assemble((f"{short_name(name)} ", "bold"), (words, colour))
