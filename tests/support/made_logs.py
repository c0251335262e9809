"""Logs of bins for tests of `orchard calibrate`, made of simulated harvests.

The rates of these harvests are known, so a test can compare what is fitted to the log with them.
"""

from datetime import datetime, timedelta

from orchard.calibrate.bins import LoggedBin
from orchard.calibrate.model_bins import DAY
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.local import Local
from orchard.tables.exchanges import exchanges

# The time of day at which a made harvest begins.
BEGIN = timedelta(hours=7)


def simulated_bins(scenario: Scenario) -> list[LoggedBin]:
    """Return the bins of a harvest of the simulator, by its own events."""
    run = Local(scenario, is_hashed=False)
    events = []
    while not run.ended:
        tick = run.engine.tick
        for event in run.tick():
            events.append({"tick": tick, "who": event.who, "what": event.what} | _more(event))
    bins = []
    for row in exchanges(events):
        bins.append(
            LoggedBin(
                picker=row["picker"],
                row=str(row["row"]),
                carrier=row["carrier"] or "",
                day=DAY,
                full=row["full"] * TIME_STEP,
                fetched=row["fetched"] * TIME_STEP,
                unloaded=row["unloaded"] * TIME_STEP,
            )
        )
    return bins


def _more(event) -> dict:
    """Return the rest of an event as a row of the table of events has it: empty is None there."""
    return {"whom": event.whom or None, "detail": event.detail}


def log_text(bins: list[LoggedBin]) -> str:
    """Return bins as the lines of a log, in the order of time."""
    lines = []
    for bin_ in bins:
        midnight = datetime.combine(bin_.day, datetime.min.time())
        for event in ("full", "fetched", "unloaded"):
            seconds = getattr(bin_, event)
            if seconds is not None:
                time = midnight + BEGIN + timedelta(seconds=round(seconds))
                names = f"{bin_.picker},{bin_.row},{bin_.carrier}"
                lines.append(f"{time.isoformat()},{event},{names}")
    # Times are whole seconds. Where two are equal, a bin is full before it is fetched.
    order = {"full": 0, "fetched": 1, "unloaded": 2}
    lines.sort(key=lambda line: (line.split(",")[0], order[line.split(",")[1]]))
    return "\n".join(["time,event,picker,row,carrier", *lines]) + "\n"
