"""The answer of a study with a deadline, in words. `orchard.study.finishing` finds it."""

from collections.abc import Sequence
from dataclasses import dataclass

from scipy import special

from orchard.report.days import WorkDays
from orchard.report.summary import bottleneck_words
from orchard.study.answer_words import failed_words
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


@dataclass(frozen=True)
class SmallerFleet:
    """A fleet with fewer robots of one kind than the answer."""

    fleet: Fleet
    #: How many harvests of a trial must be late, by their limits without traffic.
    late: int


def too_early(fastest: Fleet, deadline: Deadline) -> str:
    """Return why no fleet can meet a deadline, and what would help."""
    needed = hours_words(fastest.limit_seconds)
    return (
        f"no fleet finishes {deadline.words}: without traffic even {_fleet_words(fastest)} need"
        f" {needed}, because {bottleneck_words(fastest.part)} would allow no more; a deadline after"
        f" that would do, or {REMEDIES[fastest.part]}"
    )


def finish_answer(
    result: StudyResult, smaller: Sequence[SmallerFleet], trial: Trial, days: WorkDays | None
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
    parts = [words, *_smaller_words(result, smaller, trial)]
    if result.failed:
        parts.append(failed_words(result.failed))
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


def _smaller_words(result: StudyResult, smaller: Sequence[SmallerFleet], trial: Trial) -> list[str]:
    """Return what fleets with fewer robots of one kind need, and why one that is in time in its few
    runs is not the answer: it is late with other seeds, or costs more.
    """
    words = []
    for one in smaller:
        row = result.row_of(one.fleet.setting.values)
        if row is None or row.harvest_seconds is None:
            need = f"at least {hours_words(one.fleet.limit_seconds)}"
        else:
            need = f"{hours_words(row.harvest_seconds.mean)}{_why_not(row, one, trial)}"
        words.append(f"{_fleet_words(one.fleet)} would need {need}")
    return words


def _why_not(row: Row, smaller: SmallerFleet, trial: Trial) -> str:
    """Return why a fleet of which the runs are in time is not the answer; '' if they are late."""
    if row.in_time != row.replications:
        return ""
    if smaller.late > trial.late:
        return (
            f" on average, but {smaller.late} of {trial.replications} harvests would be late even"
            " without traffic"
        )
    if row.cost_per_bin is None:
        return ""
    return f", for {interval_words(row.cost_per_bin)} a bin"


def _none_in_time(result: StudyResult, trial: Trial) -> str:
    """Return that no fleet is in time as often as is asked, which one is the fastest, and what
    would help.
    """
    known = [row for row in result.table if row.harvest_seconds is not None]
    wanted = f"{trial.replications - trial.late} of {trial.replications} harvests"
    if not known:
        return "All fleets jammed: some robots waited for ever"
    fastest = min(known, key=_mean_seconds)
    seconds = fastest.harvest_seconds
    assert seconds is not None
    the_fastest = "the fastest one"
    if len(known) > 1:
        the_fastest = f"the fastest of {len(known)}"
    return (
        f"No fleet finishes {wanted} {result.deadline}: {the_fastest}"
        f" is {_row_words(fastest)} with {_time_words(seconds)}, {fastest.in_time} of"
        f" {fastest.replications} in time; a later deadline would do, or"
        f" {REMEDIES[fastest.bottleneck]}"
    )


def _mean_seconds(row: Row) -> float:
    assert row.harvest_seconds is not None
    return row.harvest_seconds.mean
