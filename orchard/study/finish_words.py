"""The answer of a study with a deadline, in words. `orchard.study.finishing` finds it."""

from collections.abc import Sequence

from scipy import special

from orchard.report.days import WorkDays
from orchard.report.summary import bottleneck_words
from orchard.study.deadline import Deadline, Trial, hours_words
from orchard.study.fleets import Fleet
from orchard.study.result import Interval, Row, StudyResult
from orchard.study.words import counted, interval_words

# Part of an orchard that sets a limit -> what would make this limit shorter.
REMEDIES = {
    "pickers": "more pickers, shorter shares of rows, or a higher picking_rate",
    "carriers": "more carriers, or faster ones",
    "unloading": "a shorter time at the bay (handling.unloading), or more places there (bays)",
    "chargers": "more chargers",
    "trailers": "more trailers, or a shorter way to the load-out",
    "truck": "a truck that comes more often, or takes more bins",
}


def too_early(fastest: Fleet, deadline: Deadline) -> str:
    """Return why no fleet can meet a deadline, and what would help."""
    needed = hours_words(fastest.limit_seconds)
    return (
        f"no fleet finishes {deadline.words}: without traffic even {_fleet_words(fastest)} need"
        f" {needed}, because {bottleneck_words(fastest.part)} would allow no more; a deadline after"
        f" that would do, or {REMEDIES[fastest.part]}"
    )


def finish_answer(
    result: StudyResult, smaller: Sequence[Fleet], trial: Trial, days: WorkDays | None
) -> str:
    """Return the answer: the fleet, its time, how sure that is, its cost, and what slightly smaller
    fleets need.

    `smaller`: these fleets. `trial`: how often a fleet must be in time. `days`: the working days of
    the answer; None without a shift.
    """
    if not result.table:
        return "No setting has been run yet."
    best = result.best_row
    if best is None:
        words = _none_in_time(result, trial)
        is_sure = False
    else:
        words = _best_words(best, result, days)
        is_sure = best.replications >= trial.replications
    parts = [words, *_smaller_words(result, smaller)]
    if result.is_cut and not is_sure:
        parts.append("not all runs are done, so this is the answer so far")
    return f"{'; '.join(parts)}. The orchard: {result.orchard}."


def _fleet_words(fleet: Fleet) -> str:
    return _counted(fleet.pickers, fleet.carriers)


def _counted(pickers: int, carriers: int) -> str:
    return f"{counted('pickers', pickers)} and {counted('carriers', carriers)}"


def _row_words(row: Row) -> str:
    return _counted(row.setting["pickers"], _carriers_of(row))


def _carriers_of(row: Row) -> int:
    carriers: int = row.setting["carriers"]
    return carriers


def _best_words(best: Row, result: StudyResult, days: WorkDays | None) -> str:
    """Return the answer, its time, and how many harvests were in time."""
    seconds = best.harvest_seconds
    assert seconds is not None
    words = f"{_row_words(best)} finish in {_time_words(seconds)}"
    if days is not None:
        words += f" of work, on {days.words(seconds.mean)}"
    if best.replications > 1:
        words += f", {best.in_time} of {best.replications} harvests {result.deadline}"
        share = least_share(best.in_time or 0, best.replications, result.confidence)
        words += f" (of all such harvests at least {100.0 * share:.0f} %)"
    else:
        words += f", {result.deadline}"
    if best.cost_per_bin is not None:
        words += f", for {interval_words(best.cost_per_bin)} a bin"
    return words


def least_share(in_time: int, count: int, confidence: float) -> float:
    """Return the share of all harvests that is in time at least, with a confidence: 0 to 1.

    `in_time` of `count` harvests were. It is the lower limit of Clopper and Pearson.
    """
    if in_time == 0:
        return 0.0
    return float(special.betaincinv(in_time, count - in_time + 1, 1.0 - confidence))


def _time_words(seconds: Interval) -> str:
    return hours_words(seconds.mean, seconds.high - seconds.mean)


def _smaller_words(result: StudyResult, smaller: Sequence[Fleet]) -> list[str]:
    """Return what fleets with fewer robots of one kind need."""
    words = []
    for fleet in smaller:
        row = result.row_of(fleet.setting.values)
        if row is None or row.harvest_seconds is None:
            need = f"at least {hours_words(fleet.limit_seconds)}"
        else:
            need = hours_words(row.harvest_seconds.mean)
        words.append(f"{_fleet_words(fleet)} would need {need}")
    return words


def _none_in_time(result: StudyResult, trial: Trial) -> str:
    """Return that no fleet is in time as often as is asked, and which one is the fastest."""
    known = [row for row in result.table if row.harvest_seconds is not None]
    wanted = f"{trial.replications - trial.late} of {trial.replications} harvests"
    if not known:
        return "All fleets jammed: some robots waited for ever"
    fastest = min(known, key=_mean_seconds)
    seconds = fastest.harvest_seconds
    assert seconds is not None
    return (
        f"No fleet finishes {wanted} {result.deadline}: the fastest of {len(known)}"
        f" is {_row_words(fastest)} with {_time_words(seconds)}, {fastest.in_time} of"
        f" {fastest.replications} in time"
    )


def _mean_seconds(row: Row) -> float:
    assert row.harvest_seconds is not None
    return row.harvest_seconds.mean
