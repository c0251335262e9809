"""What is printed and written at the end of a run: its result, and commands to type next."""

import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from orchard.field.scenario import TIME_STEP
from orchard.launch.request import RunRequest
from orchard.report.summary import (
    Outcome,
    as_table,
    limit_sentence,
    sentence,
    unusual_figures,
    write_if_wanted,
)
from orchard.sim.snapshot import SNAPSHOT, SnapshotError, newest, snapshots_in
from orchard.terminal.exits import FAILED, FINISHED
from orchard.terminal.output import is_all_lost, print_error, print_line, print_result
from orchard.terminal.typed import typed
from orchard.view.files import remove_half_packed

# A run has not kept its speed if it took longer by more than so many seconds of wall time, and by
# more than this share of its wall time.
LATE_SECONDS = 1.0
LATE_SHARE = 0.1
# Why a run ends when nothing has gone wrong, or when its summary tells all that has.
EXPECTED_ENDS = ("harvested", "duration", "stopped", "broken", "refused")


def report(request: RunRequest, result: dict[str, Any] | None, why: str) -> int:
    """Print the result of a run, and how to go on and to watch it. Write the summary.

    `result`: the summary, or None without one. `why`: why the run ended. Returns the exit code.
    """
    code = FAILED if result is None else _report_result(request, result, why)
    if result is None:
        print_error(why)
    # A run that was harvested does not go on. One that a bag drives cannot go on without the bag.
    if why == "harvested" or request.options.replay:
        _remove_snapshots(request.snapshots)
    elif request.snapshots.is_dir():
        with suppress(SnapshotError):
            # This raises SnapshotError if there is no snapshot.
            newest(request.snapshots, [])
            print_line(f"To go on: {typed('--resume', request.snapshots)}")
    if request.recording is not None and request.recording.exists():
        print_line(f"To watch it: {typed('view', request.recording)}")
    if result is not None:
        print_result(f"hash {result['hash']}")
    return code


def _remove_snapshots(folder: Path) -> None:
    """Remove what a run needs only to go on. Its keyframes stay, for forks."""
    for snapshot in snapshots_in(folder, SNAPSHOT):
        snapshot.unlink(missing_ok=True)


def _report_result(request: RunRequest, result: dict[str, Any], why: str) -> int:
    """Complete the summary, print and write it. Return the exit code."""
    _complete_summary(request, result)
    outcome = msgspec.convert(result, Outcome)
    _print_outcome(request, result, outcome)
    too_slow = speed_not_kept(request, outcome)
    if too_slow:
        print_error(too_slow)
    troubles = [
        *filter(None, [write_if_wanted(request.options.summary, result)]),
        *_troubles(request, result, why),
        *_complete_table(request.options.table, result),
    ]
    for trouble in troubles:
        print_error(trouble)
    if troubles or is_all_lost():
        return FAILED
    return FINISHED


def _complete_summary(request: RunRequest, result: dict[str, Any]) -> None:
    """Add to a summary what only this process knows: gaps of the recording, and the parent."""
    if request.recording is not None:
        # Rerun takes half a second to load.
        from orchard.view.reader import missing

        remove_half_packed(request.recording)
        result |= missing(request.recording, result["ticks"])
    if request.forked_from is not None:
        result["forked_from"] = request.forked_from


def _print_outcome(request: RunRequest, result: dict[str, Any], outcome: Outcome) -> None:
    """Print the sentences and the figures of a result."""
    lines = [sentence(outcome), limit_sentence(outcome)]
    if request.velocities is not None:
        lines.append(request.velocities.sentence(outcome.ticks))
    lines.append(_what_to_try(request))
    if request.options.verbose:
        figures = {key: value for key, value in result.items() if key != "hash"}
    else:
        figures = unusual_figures(result)
    if figures:
        print_result(*lines, as_table(figures))
    else:
        print_result(*lines)


def _troubles(request: RunRequest, result: dict[str, Any], why: str) -> list[str]:
    """Return what has gone wrong in a run, a line each."""
    troubles = [f"violated: {violation}" for violation in result["violations"]]
    troubles += [f"broken: {agent}" for agent in result["broken_agents"]]
    if why not in EXPECTED_ENDS:
        troubles += [why, *result["jam"]]
    if request.velocities is not None and why != "stopped":
        troubles += request.velocities.troubles(result["ticks"])
    return troubles


def _complete_table(folder: Path | None, result: dict[str, Any]) -> list[str]:
    """Complete the tables of a run, if they are wanted. Return what they lack."""
    if folder is None:
        return []
    # pyarrow takes some time to load.
    from orchard.tables.folder import complete

    return list(complete(folder, result))


def _what_to_try(request: RunRequest) -> str:
    """Return the line that proposes what to type next."""
    proposals = []
    if _may_be_studied(request):
        study = typed("study", *_study_of(request))
        proposals.append(f"{study} tells how many carriers are worth it")
    if not request.options.verbose:
        proposals.append("--verbose shows all figures")
    return f"To try next: {'; '.join(proposals) or typed('view')}"


def _may_be_studied(request: RunRequest) -> bool:
    """Whether `orchard study` can be asked about this orchard with the options that were typed.

    A study does many harvests in the event model, which knows built-in agents and exact sensors.
    """
    options = request.options
    is_typed = request.resumed is None and (options.scenario is not None or not options.replay)
    return is_typed and not request.scenario.agents and request.scenario.sensors.are_exact


def _study_of(request: RunRequest) -> list[object]:
    """Return the arguments of `orchard study` that ask how many carriers this orchard needs."""
    options = request.options
    words: list[object] = [] if options.scenario is None else [options.scenario]
    fixed = []
    for name, value in options.changes.items():
        if name not in ("carriers", "seed"):
            fixed.append(f"{name}={value}")
    if fixed:
        # `--vary name=value` changes a value of the scenario. A study with `--vary` varies only
        # what is named, so `carriers` is named, too.
        for varied in ("carriers", *fixed):
            words += ["--vary", varied]
    return words


def speed_not_kept(request: RunRequest, outcome: Outcome) -> str:
    """Return what to say if the machine was too slow for the speed; "" if it was not.

    Of a resumed run only the time since its resumption counts.
    """
    pace = request.options.pace
    seconds = outcome.wall_seconds
    simulated = outcome.sim_seconds
    if request.resumed is not None:
        seconds -= request.resumed.figures.get("wall_seconds", 0.0)
        simulated -= request.resumed.tick * TIME_STEP
    lateness = seconds - simulated / pace
    if pace == math.inf or lateness <= max(LATE_SECONDS, LATE_SHARE * seconds):
        return ""
    reached = simulated / seconds
    return f"the speed of {pace:g} times real time was not kept: the machine reached {reached:.1f}"
