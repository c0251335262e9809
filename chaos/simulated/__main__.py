"""Carry out schedules on the simulated network, each from one seed, and check each run.

    python -m chaos.simulated --count 1000
    python -m chaos.simulated --seed 83            what happened, line by line, in the smallest plan that fails in the same way
    python -m chaos.simulated mutations --most 2000

The exit code is 1 if a promise is broken, or if a safety net can be cut out without any schedule that fails.
"""

import os
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from datetime import date
from functools import partial
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from time import monotonic
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import track

from chaos.simulated.mutations import MUTATIONS, first_seed
from chaos.simulated.plan import Plan, draw
from chaos.simulated.schedule import carry_out, complaints_of, shrink
from orchard.memory import collect_seldom

TABLE = Path(__file__).parent / "mutations.md"
MOST = 2000  # schedules in which a mutation is to be found

collect_seldom()  # also in each worker, which imports this file

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
) -> None:
    """Carry out schedules on the simulated network, each from one seed, and check each run."""
    if context.invoked_subcommand is not None:
        return
    if seed is not None:
        raise typer.Exit(_tell(seed))
    begun, failed, done = monotonic(), [], 0
    with _workers() as workers:
        runs = _in_turn(workers, range(first, first + count), begun + seconds)
        for number, complaints in track(runs, "schedules", count, console=console):
            done += 1
            if complaints:
                failed.append(number)
                _say(f"seed {number}: {'; '.join(complaints)}")
    _say(f"{done} schedules in {monotonic() - begun:.0f} s, {len(failed)} failed")
    if failed:
        _say(f"what happened: python -m chaos.simulated --seed {failed[0]}")
    raise typer.Exit(1 if failed else 0)


@app.command()
def mutations(
    most: Annotated[int, typer.Option(min=1, help="How many schedules may not find it.")] = MOST,
    only: Annotated[str, typer.Option(help="Only mutations with these words.")] = "",
) -> None:
    """Cut out one safety net of the protocol after the other. Write at which seed each is found to chaos/simulated/mutations.md."""
    names = [name for name in MUTATIONS if only in name]
    with _workers() as workers:
        found = list(
            track(
                workers.map(partial(first_seed, most), names),
                "mutations",
                len(names),
                console=console,
            )
        )
    rows = [
        f"| {name} | {'not found' if seed is None else seed} | {what} |"
        for name, (seed, what) in zip(names, found, strict=True)
    ]
    rows = [row.replace(f"{Path.cwd()}/", "") for row in rows]
    _say("\n".join(rows))
    if not only:
        head = f"What fails if one safety net of the protocol is cut out ({date.today()}, at most {most} schedules each)."
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
    raise typer.Exit(1 if any(seed is None for seed, _ in found) else 0)


def _workers() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(os.cpu_count(), get_context("spawn"))


def _in_turn(
    workers: ProcessPoolExecutor, seeds: Iterable[int], deadline: float
) -> Iterator[tuple[int, list[str]]]:
    """Yield seed and complaints of each schedule that begins before the deadline."""
    rest = iter(seeds)
    while monotonic() < deadline and (batch := list(islice(rest, 40))):
        yield from zip(batch, workers.map(complaints_of, batch, chunksize=5), strict=True)


def _tell(seed: int) -> int:
    """Print what happens in a schedule; the exit code."""
    plan: Plan = draw(seed)
    verdict = carry_out(plan)
    if verdict.complaints:
        plan = shrink(plan)
        verdict = carry_out(plan, is_traced=True)
    else:
        verdict = carry_out(plan, is_traced=True)
    _say(
        f"seed {seed}: {plan.scenario}, {plan.ticks} ticks, {plan.hosts} hosts, {plan.mode}, {plan.delays}"
    )
    for line in [*map(str, plan.faults), *verdict.lines, *verdict.complaints]:
        _say(line)
    return 1 if verdict.complaints else 0


def _say(words: str) -> None:
    console.print(words, markup=False, soft_wrap=True)


if __name__ == "__main__":
    app()
