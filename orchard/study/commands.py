"""The commands `orchard study` and `orchard benchmark`."""

from importlib import import_module

import typer

from orchard.study.command_options import BenchmarkOptions, StudyArguments
from orchard.terminal.exits import needs_extra
from orchard.terminal.options import with_options


@with_options(StudyArguments)
def study(chosen: StudyArguments) -> None:
    """Compare settings of an orchard, and tell which is best, and with what confidence."""
    with needs_extra("A study", "study", ", or in a clone: make study"):
        from orchard.study.study_command import run_study
    raise typer.Exit(run_study(chosen))


@with_options(BenchmarkOptions)
def benchmark(chosen: BenchmarkOptions) -> None:
    """Score a dispatch policy in fixed orchards, beside the built-in ones:
    docs/benchmark.md.
    """
    with needs_extra("A benchmark", "study,optimum", ", or in a clone: make study"):
        from orchard.study.benchmark.command import run_benchmark

        if chosen.secret is not None:
            # The bounds of a hidden split are proven.
            import_module("orchard.optimum.schedule")
    raise typer.Exit(run_benchmark(chosen))
