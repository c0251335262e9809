"""What is proven of the harvests of an orchard, seed by seed, and the hidden split."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario, check, with_changes
from orchard.study.benchmark.asked import hide_memory
from orchard.study.benchmark.instances import Instance, instance_of
from orchard.study.settings import Setting
from orchard.study.workers import Workers

# Seeds of an orchard in which something is random.
SEEDS = 6
# The work of the solver for a proof, as `orchard.optimum.schedule.optimum` takes it. An orchard
# with more than MOST_SMALL_ROWS rows gets less, because the same work takes several times as long
# there.
WORK = 1.0
WORK_IN_LARGE = 0.3
MOST_SMALL_ROWS = 12
# Bytes. A shorter secret could be guessed.
SHORTEST_SECRET = 16


def seeds_of(scenario: Scenario) -> range:
    """Return the seeds of an orchard: one if nothing in it is random."""
    count = Setting({}, scenario).seeds_that_differ(SEEDS)
    return range(scenario.seed, scenario.seed + count)


def bounds_of(scenario: Scenario) -> dict[int, float]:
    """Return what is proven of each seed: seed -> the time below which no harvest can be, s."""
    # This loads the solver, which takes half a second.
    from orchard.optimum.schedule import optimum

    proven = dict[int, float]()
    work = WORK
    if scenario.rows > MOST_SMALL_ROWS:
        work = WORK_IN_LARGE
    for seed in seeds_of(scenario):
        # A bound leaves failures out, and people too. So seeds have bounds of their own only where
        # they draw the times of picking.
        if scenario.picking.is_drawn or not proven:
            seeded = lay_out(with_changes(scenario, seed=seed))
            proven[seed] = optimum(seeded, work).proven_seconds
        else:
            proven[seed] = proven[scenario.seed]
    return proven


def _bounds_in_worker(scenario: Scenario) -> dict[int, float]:
    """Do `bounds_of` in a worker, whose memory a policy cannot read later."""
    hide_memory()
    return bounds_of(scenario)


def secret_of(path: Path) -> bytes:
    """Return the secret in a file. Raises ValueError for one that can be guessed, or OSError."""
    secret = path.read_bytes().strip()
    if len(secret) < SHORTEST_SECRET:
        raise ValueError(
            f"{path}: a secret of {len(secret)} bytes can be guessed; expected at least"
            f" {SHORTEST_SECRET}, as of: openssl rand -hex 32"
        )
    return secret


def hidden_instances(drawn: Mapping[str, dict[str, Any]], workers: Workers) -> dict[str, Instance]:
    """Return the instances of a hidden split: name -> instance.

    `drawn`: name -> values of its scenario. The bounds are proven now, which takes long.
    """
    scenarios = {name: check(values, name) for name, values in drawn.items()}
    # First seed of an orchard, which no other one has -> what is proven of each of its seeds.
    proven = dict[int, dict[int, float]]()
    for scenario, bounds in workers.do(_bounds_in_worker, [*scenarios.values()], lambda: True):
        proven[scenario.seed] = bounds
    known = {}
    for name, scenario in scenarios.items():
        known[name] = instance_of(name, "hidden", drawn[name], proven[scenario.seed])
    return known
