"""The summary of a run: the figures that it must have, as a file, as a table, and in sentences.

A summary is a dictionary, as `orchard.report.metrics` and the processes of a run make it. Its keys
and their meaning are in docs/reference.md.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta
from rich.table import Table

from orchard.contract.agent import WAITING_STATES
from orchard.terminal.files import KindOfFile

# Key of a figure -> its unit, with what is meant, as the table has it after the value.
UNITS = {
    "metres_picked": "m",
    "sim_seconds": "s",
    "wall_seconds": "s",
    "bins_per_hour": "bins/h, a part-full bin by its part",
    "limit_bins_per_hour": "bins/h, of this policy in a long harvest of these rows without traffic",
    "schedule_sim_seconds": "s, this harvest without traffic",
    "lost_seconds": "s, which add up to the harvest's length",
    "row_end_seconds": (
        "s a bin, of driving to the ends of rows, which exchanges inside the rows would save at"
        " most"
    ),
    "row_end_share": "of a picker's time for a bin",
    "picker_waiting_seconds": "s, standing at the row's end until an empty bin comes, mean",
    "carrier_utilisation": "of the time, outside the queue",
    "collisions": "(of robots)",
    "bottleneck": "(in a long harvest)",
    "distance_metres": "m",
    "state_seconds": "s",
    "stopped_seconds": "s",
    "charging_seconds": "s, of all carriers together",
    "flat_seconds": "s, in which carriers stood with a flat battery, all together",
    "bay_waiting_seconds": (
        "s, in which a full bin stood in the bay, and no trailer or no empty bin was there"
    ),
    "recording_gaps": "s, which no recording shows",
}
# Shown if they are not zero.
UNUSUAL = (
    "stopped_seconds",
    "charging_seconds",
    "flat_seconds",
    "bay_waiting_seconds",
    "row_end_seconds",
    "row_end_share",
    "orders_refused",
    "ticks_late",
    "velocities_missed",
    "messages_refused",
    "messages_dropped",
    "recording_gaps",
)
# A rate is of 'full bins' if part-full ones lack more than this share of all; else of 'bins'.
FEW = 0.001
# Characters of a line of progress, at most.
LINE_COLUMNS = 80
# %. What a sum of floats may lack.
ROUNDING = 1e-9
# How many broken agents a line of progress names.
NAMED = 3
# Key -> what the table says if its value is an empty dictionary.
OF_NONE = {
    "lost_seconds": (
        "known of a complete harvest only, of built-in classes, not stopped, not forked with"
        " changes"
    )
}
# For programs. The page shows them in its own way.
NOT_IN_TABLE = ("scenario", "history")
# Shown in the table if they say something.
IF_KNOWN = ("working_day",)


class Headline(msgspec.Struct, kw_only=True):
    """The main figures of a run, and a line of `--progress json`."""

    sim_seconds: float
    times_real_time: float
    rows_picked: int
    rows: Annotated[int, Meta(ge=1)]
    bins: Annotated[int, Meta(ge=1)]
    row_length: Annotated[float, Meta(gt=0.0)]
    metres_picked: float
    bins_delivered: int
    schedule_sim_seconds: float
    carrier_utilisation: float
    # Kind of robot -> state -> s, all robots of the kind together.
    state_seconds: dict[str, dict[str, float]]
    #: Each as 'picker_01, since tick 30'.
    broken_agents: list[str] = []
    # Simulated s at which the harvest will be done, and within what; None: it is not known.
    done_seconds: float | None = None
    done_within_seconds: float = 0.0

    @property
    def pickers_waited_seconds(self) -> float:
        """How long pickers have waited, s of all pickers together."""
        spent = self.state_seconds.get("picker", {})
        return sum(spent.get(state, 0.0) for state in WAITING_STATES)

    @property
    def fraction(self) -> float:
        """Progress from 0 to 1: half for metres picked, half for bins delivered."""
        share_of_metres = self.metres_picked / self._all_metres
        share_of_bins = self.bins_delivered / self.bins
        return (share_of_metres + share_of_bins) / 2

    @property
    def _all_metres(self) -> float:
        """The length of all rows, m."""
        return self.rows * self.row_length

    def seconds_left(self, until: float | None = None) -> float:
        """Return the estimated rest of the harvest, s of wall time.

        `until`: simulated time at which the run ends, s.
        """
        if not self.times_real_time:
            return math.inf
        if self.done_seconds is not None:
            rest = max(0.0, self.done_seconds - self.sim_seconds)
            return self._until_end(rest, until)
        # No forecast. The harvest takes at least its schedule without traffic; with traffic it is
        # late, and then the share that is not done yet tells more.
        rest_by_schedule = self.schedule_sim_seconds - self.sim_seconds
        rest_by_share = (1.0 - self.fraction) * self.schedule_sim_seconds
        return self._until_end(max(rest_by_schedule, rest_by_share), until)

    def _until_end(self, rest: float, until: float | None) -> float:
        """Return a rest of simulated time, s, at most up to `until`, as wall time, s."""
        if until is not None:
            rest = min(rest, max(0.0, until - self.sim_seconds))
        return rest / self.times_real_time

    @property
    def done_words(self) -> str:
        """When the harvest will be done, such as 'done at 52:10 min'; '' if it is not known."""
        if self.done_seconds is None:
            return ""
        words = f"done at {clock(self.done_seconds)}"
        if round(self.done_within_seconds):
            words += f" ± {clock(self.done_within_seconds)}"
        return words

    def line(self, until: float | None = None) -> str:
        """Return the headline as a line of at most LINE_COLUMNS characters, and after these the
        broken agents.

        Of the texts for the simulated time it takes the longest one for which there is room.
        `until`: as in `seconds_left`.
        """
        picked = share_picked(self.metres_picked, self._all_metres)
        parts = [
            f"{self.times_real_time:6.1f} x real time",
            f"{picked:>5} picked  {self.bins_delivered}/{self.bins} bins",
        ]
        seconds_left = self.seconds_left(until)
        if seconds_left < math.inf:
            parts.append(f"{clock(seconds_left)} left")
        line = "  ".join([self._times()[0], *parts])
        for time in self._times():
            if len("  ".join([time, *parts])) <= LINE_COLUMNS:
                line = "  ".join([time, *parts])
        if self.broken_agents:
            line += f"  broken: {self._broken_names()}"
        return line

    def _times(self) -> list[str]:
        """Return the simulated time in words, from the shortest text to the longest one: alone,
        with the time of the end, and with its uncertainty.
        """
        times = [f"{self.sim_seconds:7.1f} s"]
        if self.done_seconds is None:
            return times
        times.append(f"{self.sim_seconds:7.1f} of {self.done_seconds:.0f} s")
        within = round(self.done_within_seconds)
        if within:
            times.append(f"{self.sim_seconds:7.1f} of {self.done_seconds:.0f} ± {within} s")
        return times

    def _broken_names(self) -> str:
        """Return the names of the first broken agents, and how many more there are."""
        names = [agent.partition(",")[0] for agent in self.broken_agents[:NAMED]]
        words = ", ".join(names)
        more = len(self.broken_agents) - NAMED
        if more <= 0:
            return words
        return f"{words} and {more} more"


def headline_of(figures: Mapping[str, Any]) -> Headline:
    """Return the main figures among those of a run. Raises ValueError if one is missing."""
    return msgspec.convert(figures, Headline)


class Outcome(Headline, kw_only=True):
    """The figures that each summary must have, because the terminal reports them."""

    hash: str
    ticks: int
    wall_seconds: float
    finished: bool
    ended: str  # 'harvested', 'duration', 'stopped', 'broken' (all pickers), 'jammed' or 'refused'
    bins_per_hour: float
    limit_bins_per_hour: Annotated[float, Meta(gt=0.0)]
    bottleneck: str
    # On which it ended, and when; "" without a shift.
    working_day: str = ""
    lost_seconds: dict[str, float]
    violations: list[str]
    jam: list[str]


def unusual_figures(summary: dict[str, Any]) -> dict[str, Any]:
    """Return the figures that tell of something unusual."""
    return {key: summary[key] for key in UNUSUAL if summary.get(key)}


# By its first two keys a file is known as a summary before it is overwritten. In this order: of a
# harvest, a study, a benchmark, futures, the moment that decides, and a bound.
_FIRST_KEYS = (
    (b"hash", b"mode"),
    (b"answer", b"orchard"),
    (b"policy", b"scores"),
    (b"at_seconds", b"futures"),
    (b"condition", b"decided_seconds"),
    (b"proven_seconds", b"best_seconds"),
)
SUMMARY = KindOfFile(
    "a summary",
    b"|".join(rb'\{\n  "%b": [^\n]*\n  "%b": ' % first_keys for first_keys in _FIRST_KEYS),
)


def write_summary(path: Path, summary: dict[str, Any]) -> None:
    """Write a summary to a file, as JSON. Raises OSError."""
    path.write_text(json.dumps(summary, indent=2) + "\n")


def write_if_wanted(path: Path | None, summary: dict[str, Any]) -> str:
    """Write a summary, if a file is wanted: `path` is None if not.

    Return why it could not be written, with its path; "" if all is well.
    """
    try:
        if path is not None:
            write_summary(path, summary)
    except OSError as error:
        return f"{path}: not written: {error.strerror}"
    return ""


def as_table(summary: dict[str, Any]) -> Table:
    """Return a table of the figures, with their units, in the order of the summary: the violations
    come last.
    """
    table = Table(show_header=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for key, value in summary.items():
        is_known = bool(value) or key not in IF_KNOWN
        if key not in NOT_IN_TABLE and is_known:
            table.add_row(key.replace("_", " "), _words(key, value))
    return table


def _words(key: str, value: Any) -> str:
    """Return a figure in words, with its unit."""
    if isinstance(value, dict) and not value:
        return OF_NONE.get(key, "none")
    if key == "recording_gaps" and value:
        words = ", ".join(f"{since} to {until}" for since, until in value)
    elif isinstance(value, list):
        return "\n".join(map(str, value)) or "none"
    else:
        words = _without_unit(key, value)
    if key in UNITS:
        words += f" {UNITS[key]}"
    return words


def _without_unit(key: str, value: Any) -> str:
    """Return a figure that is no list in words, without its unit."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {_words('', part)}" for name, part in value.items())
    if key in ("carrier_utilisation", "row_end_share"):
        return f"{100.0 * value:.0f} %"
    if isinstance(value, float):
        return f"{value:,.2f}"
    return str(value)


# Value of a summary's `ended` -> begin of the sentence. Other values come from the processes of the
# run, such as a signal, and are shown as they are.
ENDS = {
    "duration": "Ended by --duration",
    "stopped": "Stopped",
    "broken": "Ended because all pickers were broken,",
    "jammed": "Jammed",
    "refused": "Ended because an order of the dispatch policy was refused,",
}


def sentence(outcome: Outcome) -> str:
    """Return the first sentence of a summary: the result.

    Times are simulated, since the start, also of a resumed run.
    """
    if outcome.finished:
        bins = _counted_bins(outcome.bins_delivered, outcome.bins_per_hour, outcome.sim_seconds)
        done = ""
        if outcome.working_day:
            done = f", done on {outcome.working_day}"
        result = (
            f"{outcome.rows_picked} of {outcome.rows} rows in {clock(outcome.sim_seconds)},"
            f" simulated{done}: {outcome.bins_per_hour:.1f} {bins} an hour"
        )
    else:
        result = _unfinished(outcome)
    parts = [
        result,
        _count(outcome.violations, "violation"),
        _count(outcome.broken_agents, "broken agent"),
    ]
    return "; ".join(filter(None, parts)) + "."


def _counted_bins(delivered: int, per_hour: float, seconds: float) -> str:
    """Return what the rate of a run counts: "full bins" if some that it delivered are part full."""
    counted = per_hour * seconds / 3600.0
    if counted < delivered * (1.0 - FEW):
        return "full bins"
    return "bins"


# Key of `lost_seconds` -> the same in words. What a harvest takes at least is no loss, and left
# out.
LOSSES = {
    "dispatch": "the dispatch policy",
    "absences": "pickers that are away",
    "charging": "charging",
    "load_out": "waits for trailers, the truck or empty bins",
    "traffic": "traffic",
    "people_and_animals": "people and animals",
}


def bottleneck_words(part: str) -> str:
    """Return the part that sets a limit as the subject of a sentence: 'the carriers'."""
    if part == "unloading":
        return part
    return f"the {part}"


def limit_sentence(outcome: Outcome) -> str:
    """Return the second sentence of a summary: what limits the rate.

    If it is known, it also says how far the harvest is from the optimum, and the largest loss.
    """
    parts = [
        f"What limits it: {bottleneck_words(outcome.bottleneck)}, to"
        f" {outcome.limit_bins_per_hour:.1f} bins an hour in a long harvest of these rows without"
        " traffic"
    ]
    proven = outcome.lost_seconds.get("optimum")
    if proven:
        parts.append(f"its time is {above_optimum(outcome.sim_seconds, proven)}")
    most_lost_to = ""
    most_seconds = 0.0
    for part in LOSSES:
        seconds = outcome.lost_seconds.get(part, 0.0)
        if seconds > most_seconds:
            most_lost_to = part
            most_seconds = seconds
    if most_lost_to:
        parts.append(f"{clock(most_seconds)} were lost to {LOSSES[most_lost_to]}")
    return "; ".join(parts) + "."


def above_optimum(seconds: float, proven: float) -> str:
    """Return in words how far the time of a harvest is above what is proven of the shortest one."""
    return f"{100.0 * (seconds / proven - 1.0):.0f} % above the proven optimum without traffic"


def six_figures(summary: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Return the figures that matter most, in words: name, value with its unit, and a note on its
    meaning.
    """
    limit = summary["limit_bins_per_hour"]
    schedule = clock(summary["schedule_sim_seconds"])
    rate = summary["bins_per_hour"]
    bins = _counted_bins(summary["bins_delivered"], rate, summary["sim_seconds"])
    return [
        (
            f"{bins.capitalize()} an hour",
            f"{rate:.1f}",
            f"at most {limit:.1f} in a long harvest of these rows without traffic",
        ),
        (
            "Time",
            clock(summary["sim_seconds"]),
            f"simulated; the whole harvest takes {schedule} without traffic",
        ),
        (
            "Bins",
            f"{summary['bins_delivered']} of {summary['bins']}",
            f"delivered; {summary['rows_picked']} rows picked",
        ),
        (
            "Pickers wait",
            f"{summary['picker_waiting_seconds']:.0f} s",
            "standing at the row's end until an empty bin comes, mean",
        ),
        (
            "Carriers at work",
            f"{100.0 * summary['carrier_utilisation']:.0f} %",
            UNITS["carrier_utilisation"],
        ),
        ("Collisions", str(summary["collisions"]), "of robots"),
    ]


def clock(seconds: float) -> str:
    """Return a time in words: 15:56 min, 2:33:39 h."""
    all_minutes, rest = divmod(round(seconds), 60)
    if all_minutes < 60:
        return f"{all_minutes}:{rest:02d} min"
    hours, minutes = divmod(all_minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d} h"


def share_picked(metres: float, all_metres: float) -> str:
    """Return the share of all metres that is picked: 37 %.

    Rounded down, it is 100 % only when all is picked.
    """
    # Rows are added up as floats, and all of them may be a little less than the whole.
    percent = 100.0 * metres / all_metres + ROUNDING
    return f"{int(percent)} %"


def _unfinished(outcome: Outcome) -> str:
    """Return how a run ended before its harvest did, and how far it was."""
    end = ENDS.get(outcome.ended, f"Ended ({outcome.ended})")
    picked = share_picked(outcome.metres_picked, outcome.rows * outcome.row_length)
    return (
        f"{end} after {clock(outcome.sim_seconds)}, simulated, before the harvest was finished: "
        f"{outcome.rows_picked} of {outcome.rows} rows and {picked} of their metres picked, "
        f"{outcome.bins_delivered} of {outcome.bins} bins delivered"
    )


def _count(items: list[str], name: str) -> str:
    """Return how many items there are, in words; "" if there are none."""
    if not items:
        return ""
    if len(items) == 1:
        return f"1 {name}"
    return f"{len(items)} {name}s"
