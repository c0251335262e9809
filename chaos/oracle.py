"""The oracle of the soak: checks one run against the promises of docs/reliability.md."""

from dataclasses import dataclass, field
from typing import Any

from chaos.baseline import Result, scenario
from chaos.fault_injection import Execution, Recovery
from chaos.mistakes import MISTAKEN
from chaos.schedule import Trial
from orchard.field.scenario import TIME_STEP


@dataclass
class Verdict:
    """The verdict on one run.

    `complaints`: each fault that was found, as a sentence; empty for a good run.
    """

    trial: Trial
    # Names of the faults that were injected.
    injected: list[str]
    recoveries: list[Recovery]
    # Messages that were refused.
    refused: int = 0
    bins_lost: int = 0
    invariants_broken: int = 0
    is_hash_changed: bool = False
    # Whether it has not come to its end, or not to the one that it should have.
    is_unfinished: bool = False
    complaints: list[str] = field(default_factory=list)


def judge(
    trial: Trial, execution: Execution, summary: dict[str, Any] | None, baseline: Result | None
) -> Verdict:
    """Return the verdict on a run.

    `summary`: run.py's summary; None if it wrote none. `baseline`: what a lockstep run must reach;
    None in realtime, which has no hash.
    """
    verdict = Verdict(trial, execution.injected, execution.recoveries)
    if execution.exit_code is None:
        return _unfinished(
            verdict,
            f"not finished within {execution.limit:.0f} s; the last tick was {execution.last}",
        )
    if summary is None:
        return _unfinished(
            verdict,
            f"no summary; exit code {execution.exit_code}, the last tick was {execution.last}",
        )
    verdict.refused = sum(summary["messages_refused"].values())
    verdict.invariants_broken = len(summary["violations"])
    verdict.complaints += [f"violated: {violation}" for violation in summary["violations"]]
    if baseline is None:
        _check_realtime(verdict, summary)
    else:
        _check_lockstep(verdict, summary, baseline)
    # An agent that makes mistakes is broken, and then run.py ends with code 1.
    expected_broken = set()
    expected_code = 0
    if trial.is_mistaken:
        expected_broken = {MISTAKEN}
        expected_code = 1
    # "cat_01, it raised ...".
    broken = {agent.partition(",")[0] for agent in summary["broken_agents"]}
    if broken != expected_broken:
        return _unfinished(verdict, f"broken agents: {', '.join(sorted(broken)) or 'none'}")
    if execution.exit_code != expected_code and not verdict.complaints:
        return _unfinished(verdict, f"exit code {execution.exit_code}")
    return verdict


def _check_lockstep(verdict: Verdict, summary: dict[str, Any], baseline: Result) -> None:
    """Complain about another end, hash or progress than that of local mode without faults."""
    if summary["ticks"] != baseline.ticks:
        _unfinished(verdict, f"ended at tick {summary['ticks']}, not {baseline.ticks}")
        return
    verdict.is_hash_changed = summary["hash"] != baseline.hash
    verdict.bins_lost = max(
        0, baseline.bins - summary["bins_delivered"], baseline.rows - summary["rows_picked"]
    )
    if verdict.is_hash_changed:
        verdict.complaints.append(f"hash {summary['hash']}, not {baseline.hash}")
    if verdict.bins_lost:
        verdict.complaints.append(
            f"{summary['bins_delivered']} bins delivered, not {baseline.bins}"
        )


def _check_realtime(verdict: Verdict, summary: dict[str, Any]) -> None:
    """Complain about a whole harvest that has not delivered every bin.

    A run of limited time must only reach its last tick: its progress is not promised.
    """
    seconds = verdict.trial.seconds
    if seconds is None:
        # A row fills one bin.
        verdict.bins_lost = scenario(verdict.trial.orchard).rows - summary["bins_delivered"]
        if not summary["finished"] or verdict.bins_lost:
            _unfinished(verdict, f"ended with {summary['bins_delivered']} bins delivered")
    elif summary["ticks"] != round(seconds / TIME_STEP):
        _unfinished(verdict, f"ended at tick {summary['ticks']}, not {round(seconds / TIME_STEP)}")


def _unfinished(verdict: Verdict, why: str) -> Verdict:
    """Note in a verdict that the run has not ended as it should, and return it."""
    verdict.is_unfinished = True
    verdict.complaints.append(why)
    return verdict
