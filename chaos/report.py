"""The results of a soak: tables for the terminal, and chaos/results.md."""

import os
import platform
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from statistics import median

from rich.table import Table

from chaos.endurance import EVERY, MOST_GROWTH, WARM_UP, Endurance
from chaos.oracle import Verdict

TITLE = """\
# Results of the soak test

For people who ask how often, and how fast, a run recovers. [Reliability](../docs/reliability.md)
has the promise."""
HEAD = ("fault", "times", "recovered", "median s", "worst s")


@dataclass
class Results:
    """The verdicts of all runs of a soak, and the endurance test if it ran."""

    seed: int = 0
    day: str = ""  # ISO date
    verdicts: list[Verdict] = field(default_factory=list)
    seconds: float = 0.0  # wall time of the soak
    endurance: Endurance | None = None
    load: float = 0.0  # one-minute load average of the machine, at the end

    @property
    def is_good(self) -> bool:
        """Whether no run has a complaint, and the endurance test, if it ran, was passed."""
        if any(verdict.complaints for verdict in self.verdicts):
            return False
        return self.endurance is None or self.endurance.is_good

    def promises(self) -> list[tuple[str, int]]:
        """Return (description, count) of all that must be 0."""
        return [
            ("runs that did not finish", sum(v.is_unfinished for v in self.verdicts)),
            ("bins lost", sum(v.bins_lost for v in self.verdicts)),
            ("invariants broken", sum(v.invariants_broken for v in self.verdicts)),
            ("hashes changed", sum(v.is_hash_changed for v in self.verdicts)),
        ]

    def faults(self) -> list[tuple[str, ...]]:
        """Return the rows below HEAD: one for each fault, in lockstep and in realtime."""
        times: dict[str, Counter[str]] = {"lockstep": Counter(), "realtime": Counter()}
        seconds: dict[tuple[str, str], list[float]] = defaultdict(list)
        for v in self.verdicts:
            times[v.trial.mode].update(v.injected)
            for recovery in v.recoveries:
                seconds[v.trial.mode, recovery.fault].append(recovery.seconds)
        rows: list[tuple[str, ...]] = []
        for mode, counter in times.items():
            for fault, count in sorted(counter.items()):
                took = seconds[mode, fault]
                row = (f"{fault}, {mode}", str(count), str(len(took)), *_median_and_worst(took))
                rows.append(row)
        return rows

    def figures(self) -> list[tuple[str, ...]]:
        """Return (description, figure) of the whole soak."""
        runs = Counter(v.trial.mode for v in self.verdicts)
        whole = sum(v.trial.seconds is None for v in self.verdicts)
        injected = sum(len(v.injected) for v in self.verdicts)
        kinds_of_runs = (
            f"{len(self.verdicts)} ({runs['lockstep']} in lockstep, {runs['realtime']} in"
            f" realtime; {whole} whole harvests)"
        )
        figures: list[tuple[str, ...]] = [
            ("runs", kinds_of_runs),
            ("minutes", f"{self.seconds / 60:.1f}"),
            ("faults injected", str(injected)),
            ("messages refused", f"{sum(v.refused for v in self.verdicts):,}"),
        ]
        for what, count in self.promises():
            figures.append((what, str(count)))
        return figures


def _median_and_worst(seconds: list[float]) -> tuple[str, str]:
    """Return the median and the largest of some times, s, as text; "-" without any."""
    if not seconds:
        return "-", "-"
    return f"{median(seconds):.2f}", f"{max(seconds):.2f}"


def as_tables(results: Results) -> list[Table]:
    """Return all results as tables for the terminal."""
    parts: list[tuple[str, tuple[str, ...], list[tuple[str, ...]]]] = []
    if results.verdicts:
        parts += [
            ("The soak", ("", ""), results.figures()),
            ("Faults and recoveries", HEAD, results.faults()),
        ]
    if results.endurance is not None:
        parts.append(("Memory and file handles", ENDURANCE_HEAD, _endurance(results.endurance)))
    return [_table(*part) for part in parts]


def _table(title: str, head: tuple[str, ...], rows: list[tuple[str, ...]]) -> Table:
    """Return a table for the terminal. Its head is shown if one of its words is not empty."""
    table = Table(*head, title=title, title_justify="left", show_header=any(head))
    for row in rows:
        table.add_row(*row)
    return table


ENDURANCE_HEAD = (
    "process",
    "MB after the warm-up",
    "MB at the end",
    "growth",
    "file handles",
    "flat",
)


def _endurance(endurance: Endurance) -> list[tuple[str, ...]]:
    """Return the rows below ENDURANCE_HEAD, one for each process."""
    rows: list[tuple[str, ...]] = []
    for series in endurance.series:
        first = series.samples[0]
        last = series.samples[-1]
        flat = "no"
        if series.is_flat:
            flat = "yes"
        row = (
            series.name,
            f"{first.megabytes:.1f}",
            f"{last.megabytes:.1f}",
            f"{series.growth:+.1%}",
            f"{first.handles} to {last.handles}",
            flat,
        )
        rows.append(row)
    return rows


# -- chaos/results.md


def markdown(results: Results) -> str:
    """Return the text of chaos/results.md."""
    head = f"{TITLE}\n\n{_machine(results)}"
    parts = [
        head,
        _lines(("what", "figure"), results.figures()),
        "## Faults and recoveries",
        RECOVERY,
        _lines(HEAD, results.faults()),
    ]
    if results.endurance is not None:
        parts += [
            "## Memory and file handles",
            _endurance_text(results.endurance),
            _lines(ENDURANCE_HEAD, _endurance(results.endurance)),
        ]
    return "\n\n".join(parts) + "\n"


RECOVERY = """\
A recovery is the wall time from the beginning of a fault to the first later tick that was not
received before it, as a client of the bus measures it. A few hundredths of a second mean that the
fault held up no process. A fault does not count as recovered if its run ended earlier."""


def _machine(results: Results) -> str:
    """Return the sentence on what was measured, when, and on which machine."""
    versions = ", ".join(f"{name} {version(name)}" for name in ("eclipse-zenoh", "numpy", "numba"))
    return (
        f"Written by `make chaos` on {results.day}: seed {results.seed}, Python"
        f" {platform.python_version()}, {versions}, {platform.system()} on {os.cpu_count()} cores"
        f" of {_processor()}, load {results.load:.1f} at the end."
    )


def _processor() -> str:
    """Return the name of the processor. Linux has it in a file."""
    file = Path("/proc/cpuinfo")
    if file.exists():
        for line in file.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown"


def _endurance_text(endurance: Endurance) -> str:
    """Return the paragraph on the endurance test."""
    rates = " and ".join(
        f"{rate:,.0f} ticks/s in {mode}" for mode, rate in endurance.ticks_per_second.items()
    )
    return (
        f"{endurance.ticks:,} ticks at {rates}, sampled every {EVERY:,} ticks from tick {WARM_UP:,}"
        f" on. A process is flat if its memory grows by no more than {MOST_GROWTH:.0%} along a"
        " fitted straight line and it has no more file handles in the later half of the run than"
        " in the earlier half."
    )


def _lines(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a table in Markdown."""
    top, *body = (f"| {' | '.join(line)} |" for line in (head, *rows))
    return "\n".join([top, f"|{'---|' * len(head)}", *body])
