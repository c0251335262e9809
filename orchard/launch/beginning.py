"""With what a run begins: the scenario of a file, of a bag or of a snapshot.

A bag is a recording of ROS 2, whose velocities can drive robots.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from orchard.field.scenario import Scenario, check
from orchard.launch.options import CHANGES, HarvestOptions
from orchard.launch.run_folder import RunFolder
from orchard.launch.run_notes import end_orphaned_processes
from orchard.launch.scenarios import scenario_of
from orchard.server.snapshots import examine, sole_writer
from orchard.sim.restore import world_from
from orchard.sim.snapshot import Snapshot, SnapshotError, newest
from orchard.sim.stops import stopped
from orchard.sim.world import World
from orchard.terminal.output import print_error, print_line
from orchard.terminal.values import clock

if TYPE_CHECKING:
    from orchard.bags.velocities import BagVelocities


@dataclass(frozen=True)
class Beginning:
    """With what a run begins."""

    scenario: Scenario
    # The snapshot from which the run goes on; None: it begins at its first tick.
    snapshot: Snapshot | None = None
    # Of a fork: the id of the run that it was forked from, and the moment, s.
    parent: Mapping[str, Any] | None = None
    # The velocities of the bag that drives robots.
    velocities: "BagVelocities | None" = None


def beginning_of(chosen: HarvestOptions, runs: RunFolder) -> Beginning:
    """Return with what a harvest begins.

    Raises ScenarioError, SnapshotError, OSError or ValueError.
    """
    if chosen.resume is not None:
        return _resumed(chosen, chosen.resume, runs)
    if chosen.replay is not None:
        # The packages for bags are an extra.
        from orchard.launch.replayed import scenario_and_velocities

        scenario, velocities = scenario_and_velocities(chosen, chosen.replay)
        return Beginning(scenario, velocities=velocities)
    return Beginning(scenario_of(chosen.scenario, chosen.changes))


def check_end(world: World, duration: float | None) -> None:
    """Raise SnapshotError if nothing would end a run in local mode.

    That is so if an emergency stop holds robots, and the run has no `duration`, s. Without a
    network no command can let them go on, and a harvest does not end while robots are stopped.
    """
    standing = stopped(world)
    if duration is None and standing:
        raise SnapshotError(
            "--duration: is missing: a harvest does not end while robots stand: "
            f"{', '.join(standing)}"
        )


def _resumed(chosen: HarvestOptions, run: str, runs: RunFolder) -> Beginning:
    """Return the newest snapshot of a run as a beginning."""
    snapshot = _newest_snapshot(chosen, run, runs)
    scenario = check(snapshot.scenario, "the snapshot's scenario")
    if chosen.mode == "local":
        check_end(world_from(snapshot), chosen.duration)
    return Beginning(scenario, snapshot)


def _newest_snapshot(chosen: HarvestOptions, run: str, runs: RunFolder) -> Snapshot:
    """Return the newest usable snapshot of a run, and say which one it is."""
    needless = chosen.typed(name for name in chosen.given() if name in (*CHANGES, "scenario"))
    if needless:
        raise ValueError(f"--resume: leave out {needless}: the snapshot has its scenario")
    refused: list[str] = []
    # Processes that an earlier `orchard` has left may still write into the run's folder.
    end_orphaned_processes(runs.folder, print_error)
    folder = runs.snapshots(run)
    # This refuses a run that is still active.
    with sole_writer(folder):
        snapshot = newest(folder, refused, examine=examine)
    for reason in refused:
        print_error(f"not used: {reason}")
    print_line(f"going on with {folder.stem} from {clock(snapshot.tick)}")
    if snapshot.lost:
        lost = ", ".join(f"{name} (tick {tick})" for name, tick in sorted(snapshot.lost.items()))
        print_error(
            f"no host was there for {lost}: the robots stood, "
            "and the hash is not that of a run without this"
        )
    return snapshot
