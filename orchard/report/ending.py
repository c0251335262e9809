"""Why a run is over, in the words of a summary's `ended`, and what robots wait for in a jam.

The physics process, a local run and a study ask this after each tick.
"""

from orchard.contract.agent import STATES
from orchard.field.scenario import END
from orchard.report.metrics import HarvestFigures, lines_of_waits, orders_refused
from orchard.sim.engine import Engine
from orchard.sim.stops import as_shown

# Each picker must have been broken in this number of ticks before the run ends for it. An agent is
# broken in a tick in which it raised an error or gave an invalid action, and works on in the next.
BROKEN_TICKS = 10


def why_over(engine: Engine, figures: HarvestFigures) -> str:
    """Return why a run is over: 'harvested', or what `fault_of` returns; '' if it goes on."""
    if engine.over:
        return "harvested"
    return fault_of(engine, figures)


def fault_of(engine: Engine, figures: HarvestFigures) -> str:
    """Return why a run must end before the harvest: 'broken', 'jammed', or 'refused' if the
    scenario says so; '' if it goes on.
    """
    ends_by_refusal = engine.layout.scenario.dispatch_errors == END
    # `figures` may not have counted the tick that has just ended, so its answers are read too.
    is_refused = figures.orders_refused or orders_refused(engine.answers)
    if ends_by_refusal and is_refused:
        return "refused"
    if _are_pickers_broken(engine):
        return "broken"
    if figures.jammed(engine.world):
        return "jammed"
    return ""


def jam_of(engine: Engine, figures: HarvestFigures) -> list[str]:
    """Return which robot waits for what, one line each, if the run is jammed; else empty."""
    if not figures.jammed(engine.world):
        return []
    waiting = lines_of_waits(as_shown(engine.world, engine.actions))
    return waiting or ["no robot waits for another"]


def _are_pickers_broken(engine: Engine) -> bool:
    """Whether all pickers are broken now, and each was so in BROKEN_TICKS ticks of the run."""
    fixed = engine.world.fixed
    pickers = [engine.layout.names[i] for i in fixed.pickers.tolist()]
    for name in pickers:
        action = engine.actions.get(name)
        if action is None or action.state != "broken":
            return False
    ticks = engine.states.counts.ticks
    return all(ticks[name][STATES.index("broken")] >= BROKEN_TICKS for name in pickers)
