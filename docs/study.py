"""docs/study.md: a grower's question, answered by `orchard study`, with the answer in docs/study.json (`python -m docs.study` asks again).

From the answer follow the figures of the document, the lines that the command prints, and the picture docs/study.svg.
"""

import io
from dataclasses import asdict
from functools import cache
from json import dumps
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
from rich.console import Console

from orchard.field.scenario import parse
from orchard.report.summary import clock
from orchard.study.picture import svg
from orchard.study.result import StudyResult
from orchard.study.study import StudyOptions, study
from orchard.study.table import as_table
from orchard.study.words import number_words, sentence

ANSWER = Path(__file__).with_name("study.json")
WIDTH = 100  # characters of the lines that the command prints
SHOWN = ("1", "5", "10", "15", "20")  # carriers: the lines of its table that the document shows
SCENARIO = """\
rows: 20
pickers: 10
picking_speed: 0.5                                        # m/s, the mean
picking: {spread: {distribution: gamma, cv: 0.3}}         # rows differ
prices: {picker_per_hour: 15, carrier_per_hour: 6}        # in your currency
"""
BUDGET = 120.0  # s
COMMAND = "orchard study rent.yaml --vary carriers=1..20 --goal cost_per_bin --budget 2min"

TEXT = """\
<!-- Made by docs/study.py: `make docs`. `python -m docs.study` asks the question again. -->
# How many carriers? A study

For people who plan a fleet. After this page you can ask which number of robots, policy or route is best, and say how sure the answer is.

"I have 20 rows and 10 picking robots. How many carriers should I rent at 6 an hour, when a picker costs 15?"

## The question as a file and a command

The scenario says what is given: the rows, the pickers, and the prices. People and animals are those of the default orchard.

```yaml rent.yaml
{scenario}```

The command says what varies, and what is best:

```sh rent
{command}
```

It needs the extra `study` ([install](how-to.md#install)). It took {took}, and printed this table,
here with every fifth line:

```text
{output}
```

![Bins an hour under the bound, and what a bin costs, by the number of carriers](study.svg)

## How to read it

The sentence below the table is the answer. The lines of the table say why.

- **bins/h** is the harvest's rate: its 20 bins, divided by its length. **a bin** is what a bin costs: the prices an hour of all
  robots, divided by the bins an hour: (10 x 15 + {carriers} x 6) / {rate} = {cost}.
- **bound** is the [limit without traffic](bounds.md#the-limit-without-traffic), with the share of it that the harvest reaches. **limit** is
  what allows no more. **lost to** is the largest part of what the harvest [loses](bounds.md#what-a-harvest-loses), s.
- In the picture the band is the interval, the dotted line the bound, and the dashed line the knee: beyond it a carrier gains under 1 %.

`*` marks the best setting; `=` marks those that cannot be told apart from it: choose among them by what the study does not know.

## What the intervals mean

All settings have the same seeds, so the same rows are slow in all of them. The study compares each setting with the best one by the
differences. It looks after 5, 10, 20, 40 and 80 replications, and leaves out what is worse for certain. The chance that it leaves out the
truly best setting is at most 5 % (Holm's and Bonferroni's rules; `--confidence`). It ends when the best is certain, when all intervals are
within 1 % of their means (`--within`), or when its time is used (`--budget`). If nothing is random, one run stands for all seeds.

Intervals of 95 % held the truth in 92.7 to 98.0 % of 200 small studies (`python examples/interval_coverage.py`).

A setting in which a harvest jams is left out, and named. The [fast model](bounds.md#the-discrete-event-model) does all runs, and the
simulator checks the best two settings. `--model full` lets the simulator do all of it, which takes much longer; agents of your own need it.
The study knows no transport, no day's end and no repair.

## Other questions

`--vary` takes each value of the scenario, and may be given several times: then all combinations are settings, at most 10,000.

```sh vary
orchard study rent.yaml --vary carriers=6..12..2 --vary dispatch=nearest,predictive
orchard study rent.yaml --vary picking_speed=0.3,0.5 --goal harvest_seconds
orchard study rent.yaml --vary carriers=6,9,12 --horizon long
```

`--goal` is `bins_per_hour`, `cost_per_bin` or `harvest_seconds`; `--horizon long` asks for the rate of a long run, without the
beginning and the end of a harvest.

A [policy of your own](extending.md#dispatch-and-rows-dispatch-rows_to_pickers) is compared by its name:

```sh own
orchard study rent.yaml --vary dispatch=nearest,predictive,examples.seams.in_time.InTime
```

`--summary FILE.json` has all of the answer, `--csv FILE.csv` the table, `--picture FILE.svg` or `.png` the picture, and `--report
FILE.html` all of it on a page. In the page (`orchard app`) the button "How many carriers?" asks the same.

Each run is kept in a store, `studies.db` beside the recordings (`--out` names another one). After Ctrl-C the same command goes on from
there. A store of another version of the program is kept until you say `--anew`. If you change a policy of yours, its runs are done again;
files of data that it reads are not looked at.

## Many machines

`--workers` sets the number of processes here. For several machines start a scheduler of [Dask](https://distributed.dask.org),
`dask scheduler`, and on each machine `dask worker tcp://192.168.1.10:8786 --nthreads 1`, all with the same version of the Orchard. Add
`--scheduler tcp://192.168.1.10:8786`. The clocks must agree within 2 s. The table is the same whatever the workers.

In Python: `orchard.study.study.study(scenario, {{"carriers": [1, 2]}}, StudyOptions(...))`.
"""


def measure() -> None:
    """Ask the question again, with a fresh store, and keep the answer."""
    with TemporaryDirectory() as folder:
        options = StudyOptions(goal="cost_per_bin", budget_seconds=BUDGET, store=Path(folder, "studies.db"))
        found = study(parse(SCENARIO), {"carriers": list(range(1, 21))}, options)
    ANSWER.write_text(dumps(asdict(found), indent=1) + "\n")
    result.cache_clear()


@cache
def result() -> StudyResult:
    """The answer that was measured last."""
    return msgspec.json.decode(ANSWER.read_bytes(), type=StudyResult)


def picture() -> str:
    """Return docs/study.svg."""
    return svg(result())


def document() -> str:
    """Return the text of docs/study.md."""
    best = next(row for row in result().table if row.setting == result().best)
    assert best.bins_per_hour is not None and best.cost_per_bin is not None
    return TEXT.format(
        scenario=SCENARIO,
        command=COMMAND,
        output=_output(),
        took=clock(result().wall_seconds),
        carriers=best.setting["carriers"],
        rate=number_words(best.bins_per_hour.mean),
        cost=number_words(best.cost_per_bin.mean),
    )


def _output() -> str:
    """What the command prints, with some of the lines of its table."""
    console = Console(width=WIDTH, file=io.StringIO(), record=True)
    console.print(as_table(result()))
    table = [line for line in console.export_text().splitlines() if not line[:1].isdigit() or line.split()[0] in SHOWN]
    lines = [*table, f"Orchard: {result().orchard}", sentence(result()), *(f"- {note}" for note in result().notes)]
    return "\n".join(line.rstrip() for line in lines)


if __name__ == "__main__":
    measure()
