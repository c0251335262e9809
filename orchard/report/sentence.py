"""A run in one sentence: how far it came, how long it took, and how good that is."""

from orchard.report.summary import Outcome

ENDS = {  # other words come from the processes of the run
    "duration": "Ended by --duration",
    "stopped": "Stopped",
    "broken": "Ended because all pickers were broken,",
    "jammed": "Jammed",
    "refused": "Ended because an order of the dispatch policy was refused,",
}


def sentence(outcome: Outcome) -> str:
    """Return the first sentence of a summary. Times are simulated, from the start of the harvest, also of a run that was resumed."""
    faults = [_count(outcome.violations, "violation"), _count(outcome.broken_agents, "broken agent")]
    told = _finished(outcome) if outcome.finished else _unfinished(outcome)
    return f"{told}{''.join(f'; {fault}' for fault in faults if fault)}."


def clock(seconds: float) -> str:
    """Return a time in words: 15:56 min, 2:33:39 h."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d} min" if minutes < 60 else f"{minutes // 60}:{minutes % 60:02d}:{rest:02d} h"


def share_picked(metres: float, all_metres: float) -> str:
    """Return the share of all metres that is picked: 37 %. It is rounded down, so that it is 100 % only when all is picked."""
    return f"{int(100.0 * metres / all_metres + 1e-9)} %"


def _finished(outcome: Outcome) -> str:
    rate, limit = outcome.bins_per_hour, outcome.limit_bins_per_hour
    limited_by = outcome.bottleneck if outcome.bottleneck == "unloading" else f"the {outcome.bottleneck}"
    return (
        f"{outcome.rows_picked} of {outcome.rows} rows in {clock(outcome.sim_seconds)}, simulated: {rate:.1f} bins an hour, "
        f"{100.0 * rate / limit:.0f} % of the {limit:.1f} that {limited_by} would allow without traffic"
    )


def _unfinished(outcome: Outcome) -> str:
    end = ENDS.get(outcome.ended, f"Ended ({outcome.ended})")
    picked = share_picked(outcome.metres_picked, outcome.rows * outcome.row_length)
    return (
        f"{end} after {clock(outcome.sim_seconds)}, simulated, before the harvest was finished: "
        f"{outcome.rows_picked} of {outcome.rows} rows and {picked} of their metres picked, "
        f"{outcome.bins_delivered} of {outcome.rows} bins delivered"
    )


def _count(things: list[str], name: str) -> str:
    return f"{len(things)} {name}{'s' if len(things) > 1 else ''}" if things else ""
