"""What must hold after a session was lost: it owns no agent, and its robots do not drive on."""

from collections.abc import Iterator

from orchard.field.geometry import STILL
from orchard.server.loop import RunLoop


def faults_of_lost(loop: RunLoop) -> Iterator[str]:
    """Yield a sentence on each session that is lost for some of its agents only, and each robot
    that drives on without one.

    It holds in lockstep, between two ticks, if no client speaks for others or drives robots.
    """
    drivers = loop.run.drivers
    roster = drivers.roster
    actions = loop.run.engine.actions
    # Agent without an owner -> its last one.
    last_owners = roster._last_owners.items()
    released = {name: owner for name, owner in last_owners if name not in roster.owners}
    for name, owner in sorted(released.items()):
        kept = sorted(other for other, its_owner in roster.owners.items() if its_owner == owner)
        if kept:
            yield f"a session is lost for {name}, and keeps {kept[0]}"
    for name in sorted(released):
        action = actions.get(name)
        if action is not None and action.twist != STILL and not drivers.unowned.drives(name):
            yield f"{name} drives on, though no session owns it"
