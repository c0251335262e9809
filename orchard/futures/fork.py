"""A fork: a run that goes on from a moment of another one, with changes.

`orchard.fork` makes its first snapshot; here is what the command line adds: it finds the moment,
and reads the changes.
"""

import uuid
from collections.abc import Mapping
from typing import Any

from orchard.field.kinds import kind_of
from orchard.field.scenario import TICKS_PER_SECOND, Scenario, check
from orchard.fork.forked import forked
from orchard.futures.moments import snapshot_at
from orchard.futures.options import ForkOptions
from orchard.launch.beginning import Beginning, check_end
from orchard.launch.run_folder import RunFolder
from orchard.sim.restore import world_from
from orchard.sim.snapshot import KEYFRAME, Snapshot
from orchard.terminal.exits import as_typed
from orchard.terminal.output import print_error
from orchard.terminal.values import value_of


def beginning_of_fork(chosen: ForkOptions, runs: RunFolder) -> Beginning:
    """Return with what the fork begins that a user has chosen.

    Raises SnapshotError, ScenarioError or ValueError.
    """
    folder = runs.snapshots(chosen.run, KEYFRAME)
    moment = snapshot_at(folder, chosen.at or 0, print_error)
    _say_which_are_left_behind(moment, chosen.without or [])
    with as_typed():
        changes = changes_of(chosen, check(moment.scenario))
        fork = forked(moment, changes, chosen.stop or [])
    fork.run = uuid.uuid4().hex[:16]
    # In local mode no command can let stopped robots go on. Elsewhere one can, but robots that the
    # user has stopped by `--stop` are meant to stand: without a duration the fork would never end.
    if chosen.mode == "local" or chosen.stop:
        check_end(world_from(fork), chosen.duration)
    parent = {"run": folder.stem, "seconds": (chosen.at or 0) / TICKS_PER_SECOND}
    return Beginning(check(fork.scenario, "the snapshot's scenario"), fork, parent)


def _say_which_are_left_behind(moment: Snapshot, without: list[str]) -> None:
    """Say which robots were driven by clients elsewhere, if the fork does not wait for these.

    `without`: agents that are left to clients, by name or kind.
    """
    left_behind = [
        name for name in moment.elsewhere if not {name, kind_of(name)}.intersection(without)
    ]
    if left_behind:
        print_error(
            f"clients elsewhere drove {', '.join(left_behind)}: "
            "here the agents of the scenario do; --without leaves them to clients again"
        )


def changes_of(chosen: ForkOptions, scenario: Scenario) -> dict[str, Any]:
    """Return what is changed: dotted path -> value. Raises ValueError.

    "+1" is one more than there are, or more than what null stands for. "-1" is one less, so no
    negative number can be set.
    """
    changes = dict(chosen.changes)
    for word in chosen.settings or []:
        path, _, text = word.partition("=")
        if not path or not text:
            raise ValueError(
                f"--set {word}: expected KEY=VALUE, such as carriers=+1 or picking.spread.cv=0.5"
            )
        if path in changes:
            raise ValueError(f"--set {word}: {path} is given twice; once is allowed")
        value = value_of(text.removeprefix("+"))
        if text[0] in "+-" and isinstance(value, int | float):
            value += _present(scenario, path)
        changes[path] = value
    return changes


def _present(scenario: Scenario, path: str) -> float:
    """Return the number that a scenario has at a dotted path. Raises ValueError."""
    # `Scenario.chosen` has a number for each value that may be null, such as carriers.
    value: Any = scenario.model_dump() | scenario.chosen
    for key in path.split("."):
        value = value.get(key) if isinstance(value, Mapping) else None
    if not isinstance(value, int | float):
        raise ValueError(
            f"--set {path}: it has no number to which something can be added; expected KEY=VALUE"
        )
    return value
