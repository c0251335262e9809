"""What came of one run, held against what the orchard promises."""

from dataclasses import dataclass, field
from typing import Any

from chaos.ordeal import Course, Recovery
from chaos.schedule import Trial
from chaos.undisturbed import Result, scenario
from orchard.field.scenario import TIME_STEP


@dataclass
class Verdict:
    """Of one run. `complaints` says in words what is wrong; nothing is, where it is empty."""

    trial: Trial
    injected: list[str]
    recoveries: list[Recovery]
    refused: int = 0  # messages
    bins_lost: int = 0
    invariants_broken: int = 0
    is_hash_changed: bool = False
    is_unfinished: bool = False
    complaints: list[str] = field(default_factory=list)


def verdict(trial: Trial, course: Course, summary: dict[str, Any] | None, undisturbed: Result | None) -> Verdict:
    """`undisturbed`: what the run must have come to, in lockstep; None in realtime, which has no hash."""
    found = Verdict(trial, course.injected, course.recoveries)
    if course.exit_code is None:
        return _unfinished(found, f"not over within {course.limit:.0f} s; the last tick was {course.last}")
    if summary is None:
        return _unfinished(found, f"no summary; exit code {course.exit_code}, the last tick was {course.last}")
    found.refused = sum(summary["messages_refused"].values())
    found.invariants_broken = len(summary["violations"])
    found.complaints += [f"violated: {violation}" for violation in summary["violations"]]
    if undisturbed is None:
        _look_at_realtime(found, summary)
    else:
        _look_at_lockstep(found, summary, undisturbed)
    if course.exit_code and not found.complaints:
        return _unfinished(found, f"exit code {course.exit_code}")
    return found


def _look_at_lockstep(found: Verdict, summary: dict[str, Any], undisturbed: Result) -> None:
    if summary["ticks"] != undisturbed.ticks:
        _unfinished(found, f"ended at tick {summary['ticks']}, not {undisturbed.ticks}")
        return
    found.is_hash_changed = summary["hash"] != undisturbed.hash
    found.bins_lost = max(0, undisturbed.bins - summary["bins_delivered"], undisturbed.rows - summary["rows_picked"])
    if found.is_hash_changed:
        found.complaints.append(f"hash {summary['hash']}, not {undisturbed.hash}")
    if found.bins_lost:
        found.complaints.append(f"{summary['bins_delivered']} bins delivered, not {undisturbed.bins}")


def _look_at_realtime(found: Verdict, summary: dict[str, Any]) -> None:
    """No bin is lost where the harvest ends; how far it came in so many seconds nobody promises."""
    seconds = found.trial.seconds
    if seconds is None:
        found.bins_lost = scenario(found.trial.orchard).rows - summary["bins_delivered"]
        if not summary["finished"] or found.bins_lost:
            _unfinished(found, f"ended with {summary['bins_delivered']} bins delivered")
    elif summary["ticks"] != round(seconds / TIME_STEP):
        _unfinished(found, f"ended at tick {summary['ticks']}, not {round(seconds / TIME_STEP)}")


def _unfinished(found: Verdict, why: str) -> Verdict:
    found.is_unfinished = True
    found.complaints.append(why)
    return found
