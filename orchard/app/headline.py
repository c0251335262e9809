"""Reads the plain lines of `orchard.report.progress.headline`."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

LINE = re.compile(r"^\s*([\d.]+) s\s+([\d.]+) x real time\s+rows picked (\d+)/(\d+)\s+bins delivered (\d+)/(\d+)")


@dataclass(frozen=True)
class Headline:
    """How far a run has come."""

    sim_seconds: float
    times_real_time: float
    rows_picked: int
    bins_delivered: int
    rows: int

    @property
    def fraction(self) -> float:
        """From 0 to 1: half for the picking, half for the bins."""
        return (self.rows_picked + self.bins_delivered) / (2 * self.rows)


def read_headline(line: str) -> Headline | None:
    """What a line tells; None if it is another kind of line."""
    found = LINE.match(line)
    if found is None:
        return None
    seconds, times, picked, rows, delivered, _ = found.groups()
    return Headline(float(seconds), float(times), int(picked), int(delivered), int(rows))


def of_summary(summary: Mapping[str, Any]) -> Headline:
    """The last word on a run."""
    figures = (summary[name] for name in ("sim_seconds", "times_real_time", "rows_picked", "bins_delivered", "rows"))
    return Headline(*figures)
