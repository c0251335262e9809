"""Run all benchmarks, print the tables and write bench/results.md: `python -m bench`.

It takes less than ten minutes.
"""

import os
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from bench.measure import STEPS, measure
from bench.report import markdown
from orchard.launch.supervisor import QUICK_TICKS

TARGET = Path(__file__).with_name("results.md")


def main() -> None:
    """Measure all, and write bench/results.md."""
    # The settings of a run's processes: this process is the hub of the floor benchmark. What the
    # user has set stays.
    os.environ |= QUICK_TICKS | os.environ
    console = Console(stderr=True, highlight=False)
    columns = (BarColumn(30), TimeElapsedColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("", total=STEPS)

        def say(line: str) -> None:
            progress.update(task, advance=1, description=line)
            if not console.is_terminal:
                console.print(line)

        text = markdown(measure(say))
    TARGET.write_text(text)
    print(text)
    shown = TARGET
    if TARGET.is_relative_to(Path.cwd()):
        shown = TARGET.relative_to(Path.cwd())
    console.print(f"wrote {shown}")


if __name__ == "__main__":
    main()
