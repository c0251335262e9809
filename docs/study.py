"""docs/study.md: a grower's question, answered by `orchard study`. `make docs` asks it again, and keeps the answer in docs/study.json.

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
from orchard.report.sentence import clock
from orchard.study.answer import sentence
from orchard.study.picture import svg
from orchard.study.result import StudyResult
from orchard.study.study import StudyOptions, study
from orchard.study.table import as_table
from orchard.study.words import number_words

ANSWER = Path(__file__).with_name("study.json")
WIDTH = 100  # characters of the lines that the command prints
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
# How many carriers? A study

Written by docs/study.py from the answer of the command below (`make docs` asks again); do not edit.

"I have 20 rows and 10 picking robots. How many carriers should I rent at 6 an hour, when a picker costs 15?"

## The question as a file and a command

The scenario says what is given: the rows, the pickers, and the prices. People and animals are those of the default orchard.

```yaml rent.yaml
{scenario}```

The command says what varies, and what is best:

```sh rent
{command}
```

It needs the extra `study` ([install](install.md)). It took {took}, and printed:

```text
{output}
```

![Bins an hour under the bound, and what a bin costs, by the number of carriers](study.svg)

## How to read it

The sentence is the answer: "{answer}" The lines of the table say why.

- **bins/h** is the harvest's rate: its 20 bins, divided by its length. **a bin** is what a bin costs: the prices an hour of all
  robots, divided by the bins an hour. Here, with {carriers} carriers: (10 x 15 + {carriers} x 6) / {rate} = {cost}. Prices may also
  have `overhead_per_hour` and `per_bin` ([scenario](scenario.md)).
- **wait** is the mean time of a picker from its full bin to an empty one, s, and **busy** the share of the time that carriers are
  outside the queue.
- **bound** is the [long-run rate](bounds.md#the-long-run-rate) of this policy and route, with the share of it that the harvest
  reaches, and **limit** the part of the orchard that allows no more. In one harvest pickers wait at its start and carriers at its
  end, so it reaches less.
- **lost to** is the largest part of what the harvest [loses](bounds.md#what-a-harvest-loses), s. Where the seed draws how long rows
  take, it is the mean of the first five harvests, each split with its own rows.
- **checked** is the simulator's bins/h on the same seeds, and by how many percent they differ from those of the fast model.
- In the picture the band is the interval, the dotted line the bound, and the ring the best setting. A dashed line marks the knee: the
  fewest carriers from which on more of them gain under 1 %. There is none if even the last carrier that was tried gains more, as it may
  where all pickers begin together. The cheapest number is often smaller: the last carriers gain less than they cost.

`*` marks the best setting; `=` marks those that cannot be told apart from it. That is an answer, too: choose among them by what the
study does not know, such as a carrier in reserve.

## What the intervals mean

All settings have the same seeds, so the same rows are slow in all of them. The study compares each setting with the best one by the
differences on these seeds, and sees smaller differences so. It looks after 5, 10, 20, 40 and 80 replications, and leaves out what is
worse for certain. The chance that it leaves out the setting that is truly best is at most 5 %, over all looks and all comparisons
(Holm's and Bonferroni's rules; `--confidence` sets another one). The intervals of all settings that are left hold together with the
same confidence.

It ends when the best is certain, when all intervals are within 1 % of their means (`--within`), or when its time is used
(`--budget`). If nothing is random - no people, no animals, no spread of picking - one run of each setting stands for all seeds, and
there are no intervals.

How often do intervals of 95 % hold the truth? In 200 small studies by the fast model - 4 rows, 2 pickers, 1 to 3 carriers, picking that
varies, `--within 3%` - `python examples/interval_coverage.py` counts it. In brackets is the 95 % interval of the count. Measured on
2026-11-23.

| interval | holds the truth, % |
| --- | --- |
| one setting, 5 replications | 93.7 (91.4 to 95.5) |
| one setting, replications until its interval is within 3 % | 92.7 (90.3 to 94.6) |
| a race of three settings: the best one's own interval | 94.0 (89.8 to 96.9) |
| the same race: all differences from the best one together | 98.0 (95.0 to 99.5) |
| the same race: the setting that is truly best is not left out | 100.0 (98.2 to 100.0) |

A study that ends as soon as an interval is narrow ends a little too often when the interval is narrow by luck: here that costs about 1 of
100 intervals. The figures of a race agree with 95 %, or are higher because its corrections leave a reserve.

A setting in which a harvest jams is out, and told: robots that wait for each other for ever do not harvest.

## What it cannot know

- The fast model races, and the simulator confirms only the best two. [How near the fast model is](bounds.md#the-discrete-event-model)
  was measured; where both disagree about the best two, the answer says so. `--model full` lets the simulator do all of it, which
  takes much longer.
- People, animals and picking times are those of the scenario. Intervals hold for its seeds, and say nothing of an orchard where
  people walk otherwise.
- Agents of your own run in the simulator only (`--model full`). Dispatch policies, rules for rows and routes of your own run in both.
- Prices are those of an hour of the harvest. It knows no transport, no day's end and no repair.

## Other questions

`--vary` takes each value of the scenario, and may be given several times: then all combinations are settings, at most 10,000.

```sh vary
orchard study rent.yaml --vary carriers=6..12..2 --vary dispatch=nearest,predictive
orchard study rent.yaml --vary picking_speed=0.3,0.5 --goal harvest_seconds
orchard study rent.yaml --vary carriers=6,9,12 --horizon long
```

`--goal` is `bins_per_hour`, `cost_per_bin` or `harvest_seconds`; `--horizon long` asks for the rate of a long run, without the
beginning and the end of a harvest.

A policy of your own ([Extending the Orchard](extending.md#dispatch-and-rows-dispatch-rows_to_pickers)) is compared by its name:

```sh own
orchard study rent.yaml --vary dispatch=nearest,predictive,examples.seams.in_time.InTime
```

The files for others: `--summary FILE.json` has all of the answer, `--csv FILE.csv` the table with every figure, `--picture FILE.svg`
or `.png` the picture, and `--report FILE.html` all of it on a page that needs nothing else.

In the page (`orchard app`) the button "How many carriers?" asks the same. The picture grows while the study runs, and each setting
has a button that sets the form to it: run it, and watch it.

## It can be stopped, and goes on

Each run is kept in a store, the file `studies.db` beside the recordings (`--out` names another one). What is there is never run
again. After Ctrl-C, or a power cut, the same command goes on from there and comes to the same table. A store of another version of
the program is named, and kept until you say `--anew`. If you change a policy of your own, or a file of yours that it imports, its runs
are done again. Other files that it reads, such as a table of data, are not looked at: after a change there, name another store.

## Many machines

`--workers` sets the number of processes here, one for each core if you leave it out. A study can also give its runs to a scheduler of
[Dask](https://distributed.dask.org): start `dask scheduler` on one machine and `dask worker tcp://192.168.1.10:8786 --nthreads 1` on
each, all with the same version of the Orchard, and add `--scheduler tcp://192.168.1.10:8786`. The clocks of the machines must agree
within 2 s: this is checked when the study begins. The table is the same whatever the workers and their order. A worker that dies loses
nothing.

## In Python

```python
from orchard.field.scenario import Scenario
from orchard.study.study import StudyOptions, study

if __name__ == "__main__":  # the workers are processes that import this file
    result = study(Scenario(rows=3), {{"carriers": [1, 2]}}, StudyOptions(model="fast", budget_seconds=10))
    print(result.answer)
```
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
        answer=sentence(result()),
        took=clock(result().wall_seconds),
        carriers=best.setting["carriers"],
        rate=number_words(best.bins_per_hour.mean),
        cost=number_words(best.cost_per_bin.mean),
    )


def _output() -> str:
    """What the command prints."""
    console = Console(width=WIDTH, file=io.StringIO(), record=True)
    console.print(as_table(result()))
    lines = [*console.export_text().splitlines(), sentence(result()), *(f"- {note}" for note in result().notes)]
    return "\n".join(line.rstrip() for line in lines)
