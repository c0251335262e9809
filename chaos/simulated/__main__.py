"""Carry out schedules on the simulated network, each from one seed, and check each run.

    python -m chaos.simulated --count 1000 --summary counts.json
    python -m chaos.simulated --seed 83     what happened, in the smallest plan that fails like it
    python -m chaos.simulated mutations --most 2000
    python -m chaos.simulated expected             count anew what happens in each scene

The exit code is 1 if a promise is broken, or if a safety net can be cut out without any schedule
that fails.
"""

import json
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from datetime import date
from functools import partial
from itertools import islice, takewhile
from multiprocessing import get_context
from pathlib import Path
from time import monotonic
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import track

from chaos.simulated.census import summed_up
from chaos.simulated.drawing import draw
from chaos.simulated.harvest import EXPECTED, store_counts
from chaos.simulated.mutations import BY_TESTS, MUTATIONS, first_seed
from chaos.simulated.plan import Plan
from chaos.simulated.trial import carry_out, outcome_of, shrink
from chaos.simulated.verdict import NEAR_TICKS, Outcome
from orchard.memory import collect_seldom

TABLE = Path(__file__).parent / "mutations.md"
AHEAD = 8  # schedules that are handed out to the workers at a time
MOST = 2000  # schedules, after which a mutation counts as not found

# Each worker imports this file, so it holds there, too.
collect_seldom()

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
console = Console(highlight=False)


@app.callback(invoke_without_command=True)
def schedules(
    context: typer.Context,
    count: Annotated[int, typer.Option(min=1, help="How many schedules.")] = 1000,
    first: Annotated[int, typer.Option(min=0, help="The seed of the first one.")] = 0,
    seconds: Annotated[
        float, typer.Option(min=1.0, help="Begin no further schedule after so many seconds.")
    ] = 1e9,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Only this one; if it fails, shrink it.")
    ] = None,
    summary: Annotated[
        Path | None, typer.Option(help="A JSON file: in how many schedules what occurred.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; default: one for each core.")
    ] = None,
) -> None:
    """Carry out schedules on the simulated network, each from one seed, and check each run."""
    if context.invoked_subcommand is not None:
        return
    if seed is not None:
        raise typer.Exit(_tell(seed))
    begun = monotonic()
    outcomes: list[Outcome] = []
    with _workers(workers) as pool:
        runs = _in_turn(pool, range(first, first + count), begun + seconds)
        for outcome in track(runs, "schedules", count, console=console):
            outcomes.append(outcome)
            if outcome.complaints:
                _say(f"seed {outcome.seed}: {'; '.join(outcome.complaints)}")
    failed = [outcome.seed for outcome in outcomes if outcome.complaints]
    _say(f"{len(outcomes)} schedules in {monotonic() - begun:.0f} s, {len(failed)} failed")
    if summary is not None:
        summary.write_text(json.dumps(_summary_of(outcomes), indent=2) + "\n")
    if failed:
        _say(f"what happened: python -m chaos.simulated --seed {failed[0]}")
    raise typer.Exit(1 if failed else 0)


def _summary_of(outcomes: list[Outcome]) -> dict[str, Any]:
    """Return in how many schedules what occurred, and which failed."""
    near = f"a fault within {NEAR_TICKS} ticks of an event of the harvest"
    return {
        "schedules": len(outcomes),
        "failed": [outcome.seed for outcome in outcomes if outcome.complaints],
        near: sum(outcome.is_near for outcome in outcomes),
        **summed_up(outcome.occurred for outcome in outcomes),
    }


@app.command()
def expected() -> None:
    """Count anew what happens in each scene, and write that to chaos/simulated/expected.json."""
    for scene, counts in store_counts().items():
        _say(f"{scene}: {counts.ticks} ticks, {counts.bins['unloaded']} bins unloaded")
    _say(f"written: {EXPECTED.relative_to(Path.cwd())}")


@app.command()
def mutations(
    most: Annotated[int, typer.Option(min=1, help="Give a mutation up after so many.")] = MOST,
    only: Annotated[str, typer.Option(help="Only mutations with these words.")] = "",
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; default: one for each core.")
    ] = None,
) -> None:
    """Cut out one safety net of the protocol after the other.

    Write at which seed each is found to chaos/simulated/mutations.md.
    """
    names = [name for name in MUTATIONS if only in name and name not in BY_TESTS]
    with _workers(workers) as pool:
        seeds = pool.map(partial(first_seed, most), names)
        found = list(track(seeds, "mutations", len(names), console=console))
    rows = []
    for name, (seed, what) in zip(names, found, strict=True):
        at = str(seed)
        if seed is None:
            at = "not found"
        rows.append(f"| {name} | {at} | {what} |")
    rows += [f"| {name} | by a test | {why} |" for name, why in BY_TESTS.items() if only in name]
    # Complaints name files. The table must not depend on the folder of a clone.
    rows = [row.replace(f"{Path.cwd()}/", "") for row in rows]
    _say("\n".join(rows))
    if not only:
        _write_table(rows, most)
    raise typer.Exit(1 if any(seed is None for seed, _ in found) else 0)


def _write_table(rows: list[str], most: int) -> None:
    """Write the rows of all mutations, of at most `most` schedules each, to TABLE."""
    head = (
        f"What fails if one safety net of the protocol is cut out ({date.today()}, at most"
        f" {most} schedules each)."
    )
    again = "To measure it again: `python -m chaos.simulated mutations`."
    lines = [
        "# Mutations",
        "",
        f"{head} {again}",
        "",
        "| cut out | found at seed | what fails |",
        "|---|---|---|",
        *rows,
    ]
    TABLE.write_text("\n".join(lines) + "\n")


def _workers(count: int | None = None) -> ProcessPoolExecutor:
    """Return processes that carry out schedules; None: one for each core."""
    return ProcessPoolExecutor(count or os.cpu_count(), get_context("spawn"))


def _in_turn(
    workers: Executor, seeds: Iterable[int], deadline: float, clock: Callable[[], float] = monotonic
) -> Iterator[Outcome]:
    """Yield the outcome of each schedule that is handed out before the deadline, in the order of
    their seeds.

    What a schedule does follows from its seed alone; the deadline decides only how many there are.
    """
    # Both are lazy: a schedule is handed out when `under_way` takes it, if it is in time then.
    in_time = takewhile(lambda _: clock() < deadline, seeds)
    begun = (workers.submit(outcome_of, seed) for seed in in_time)
    under_way = deque(islice(begun, AHEAD))
    while under_way:
        yield under_way.popleft().result()
        under_way.extend(islice(begun, 1))


def _tell(seed: int) -> int:
    """Print what happens in a schedule, in a smaller one if it fails. Return the exit code."""
    plan: Plan = draw(seed)
    if carry_out(plan).complaints:
        plan = shrink(plan)
    verdict = carry_out(plan, is_traced=True)
    _say(
        f"seed {seed}: {plan.scene!r}, {plan.ticks} ticks from {plan.begin} on, {plan.hosts} hosts,"
        f" {plan.mode}, {plan.delays}"
    )
    for line in [*map(str, plan.faults), *verdict.lines, *verdict.complaints]:
        _say(line)
    return 1 if verdict.complaints else 0


def _say(words: str) -> None:
    """Print a line."""
    console.print(words, markup=False, soft_wrap=True)


if __name__ == "__main__":
    app()
