"""What came of a soak: a table for the terminal, and docs/chaos.md."""

import os
import platform
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from statistics import median

from rich.table import Table

from chaos.endurance import EVERY, MOST_GROWTH, WARM_UP, Endurance
from chaos.verdict import Verdict

HEAD = ("fault", "times", "recovered", "median s", "worst s")


@dataclass
class Results:
    """All runs of a soak."""

    seed: int = 0
    day: str = ""
    verdicts: list[Verdict] = field(default_factory=list)
    seconds: float = 0.0  # that the soak took
    endurance: Endurance | None = None
    load: float = 0.0  # of the machine, at the end

    @property
    def is_good(self) -> bool:
        return not any(v.complaints for v in self.verdicts) and (self.endurance is None or self.endurance.is_good)

    def promises(self) -> list[tuple[str, int]]:
        """What must be 0."""
        return [
            ("runs that did not finish", sum(v.is_unfinished for v in self.verdicts)),
            ("bins lost", sum(v.bins_lost for v in self.verdicts)),
            ("invariants broken", sum(v.invariants_broken for v in self.verdicts)),
            ("hashes changed", sum(v.is_hash_changed for v in self.verdicts)),
        ]

    def faults(self) -> list[tuple[str, ...]]:
        """A line for each kind of fault, in lockstep and in realtime: how often, and how long it took to recover."""
        times: dict[str, Counter[str]] = {"lockstep": Counter(), "realtime": Counter()}
        seconds: dict[tuple[str, str], list[float]] = defaultdict(list)
        for v in self.verdicts:
            times[v.trial.mode].update(v.injected)
            for recovery in v.recoveries:
                seconds[v.trial.mode, recovery.fault].append(recovery.seconds)
        lines = [(fault, mode, n, seconds[mode, fault]) for mode, counter in times.items() for fault, n in sorted(counter.items())]
        return [(f"{fault}, {mode}", str(n), str(len(took)), *_middle_and_worst(took)) for fault, mode, n, took in lines]

    def figures(self) -> list[tuple[str, ...]]:
        runs = Counter(v.trial.mode for v in self.verdicts)
        whole = sum(v.trial.seconds is None for v in self.verdicts)
        injected = sum(len(v.injected) for v in self.verdicts)
        return [
            ("runs", f"{len(self.verdicts)} ({runs['lockstep']} in lockstep, {runs['realtime']} in realtime; {whole} whole harvests)"),
            ("minutes", f"{self.seconds / 60:.1f}"),
            ("faults injected", str(injected)),
            ("messages refused", f"{sum(v.refused for v in self.verdicts):,}"),
            *((what, str(n)) for what, n in self.promises()),
        ]


def _middle_and_worst(seconds: list[float]) -> tuple[str, str]:
    return (f"{median(seconds):.2f}", f"{max(seconds):.2f}") if seconds else ("-", "-")


def as_tables(results: Results) -> list[Table]:
    """For the terminal."""
    parts: list[tuple[str, tuple[str, ...], list[tuple[str, ...]]]] = []
    if results.verdicts:
        parts += [("The soak", ("", ""), results.figures()), ("Faults and recoveries", HEAD, results.faults())]
    if results.endurance is not None:
        parts.append(("Memory and file handles", ENDURANCE_HEAD, _endurance(results.endurance)))
    return [_table(*part) for part in parts]


def _table(title: str, head: tuple[str, ...], rows: list[tuple[str, ...]]) -> Table:
    table = Table(*head, title=title, title_justify="left", show_header=any(head))
    for row in rows:
        table.add_row(*row)
    return table


ENDURANCE_HEAD = ("process", "MB after the warm-up", "MB at the end", "growth", "file handles", "flat")


def _endurance(endurance: Endurance) -> list[tuple[str, ...]]:
    return [
        (
            course.who,
            f"{course.looks[0].megabytes:.1f}",
            f"{course.looks[-1].megabytes:.1f}",
            f"{course.growth:+.1%}",
            f"{course.looks[0].handles} to {course.looks[-1].handles}",
            "yes" if course.is_flat else "no",
        )
        for course in endurance.courses
    ]


# -- docs/chaos.md


def markdown(results: Results) -> str:
    """The whole of docs/chaos.md."""
    head = f"# A soak\n\n{_machine(results)} What it does, and what it promises: [reliability.md](reliability.md)."
    parts = [head, _lines(("what", "figure"), results.figures()), "## Faults and recoveries", RECOVERY, _lines(HEAD, results.faults())]
    if results.endurance is not None:
        parts += ["## Memory and file handles", _endurance_words(results.endurance), _lines(ENDURANCE_HEAD, _endurance(results.endurance))]
    return "\n\n".join(parts) + "\n"


RECOVERY = """\
A recovery is the wall time from the beginning of the fault to the first tick that is stepped after it and lies beyond all that was
heard before it, at somebody who listens on the bus: physics that goes on from a snapshot has then caught up. Of a freeze, a stall or a
delay the time that it lasts is in it. What ended with its run before that is not counted as recovered; the run itself is judged.
A few hundredths of a second mean that nobody was held up, or that who listens, on a busy machine, was that far behind."""


def _machine(results: Results) -> str:
    versions = ", ".join(f"{name} {version(name)}" for name in ("eclipse-zenoh", "numpy", "numba"))
    return (
        f"Written by `make chaos` on {results.day}: seed {results.seed}, Python {platform.python_version()}, {versions}, "
        f"{platform.system()} on {os.cpu_count()} cores of {_processor()}, load {results.load:.1f} at the end."
    )


def _processor() -> str:
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.processor() or "unknown")


def _endurance_words(endurance: Endurance) -> str:
    rates = " and ".join(f"{rate:,.0f} ticks/s in {mode}" for mode, rate in endurance.ticks_per_second.items())
    return (
        f"Over {endurance.ticks:,} ticks at {rates}, looked at every {EVERY:,} ticks from tick {WARM_UP:,} on. Flat is a memory that grows "
        f"by no more than {MOST_GROWTH:.0%}, as a straight line goes through it, and no more file handles in the later half than before."
    )


def _lines(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *rows))
