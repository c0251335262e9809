"""docs/study.md: a grower's question, answered by `orchard study`, with the answer in
docs/study.json (`python -m docs.study` asks again).

From the answer follow the figures of the document, the lines that the command prints, and the
picture docs/study.svg.
"""

import io
from dataclasses import asdict
from functools import cache
from json import dumps
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
from rich.console import Console

from orchard.field.decisions import Decision, decided
from orchard.field.scenario import Scenario, parse
from orchard.report.summary import clock
from orchard.study.options import StudyOptions
from orchard.study.picture import save
from orchard.study.plus_minus import HELD
from orchard.study.result import StudyResult
from orchard.study.study import study
from orchard.study.table import as_table

ANSWER = Path(__file__).with_name("study.json")
WIDTH = 80  # characters of the lines that the command prints
SCENARIO = """\
rows: 26
row_length: 110                                           # m
pickers: 8
picking_rate: 1.5                                         # bins an hour of each picker
bins_per_row: 6
picking: {spread: {distribution: lognormal, cv: 0.28}}    # rows differ
"""
BUDGET = 600.0  # s, for a busy machine
COMMAND = "orchard study rent.yaml"

TEXT = """\
<!-- Made by docs/study.py: `make docs`. `python -m docs.study` asks the question again. -->
# How many carriers? A study

For people who plan a fleet. After this page you can ask which number of robots, policy or route is
best, and say how sure the answer is.

"I have 26 rows of 110 m with six bins in each, and 8 people who pick 1.5 bins an hour each. How
many carriers should I rent?"

## The question as a file and a command

The scenario says what is given. People and animals are those of the default orchard.

```yaml rent.yaml
{scenario}```

```sh rent
{command}
```

It needs the extra `study` ([install](how-to.md#install)). On two cores that many other programs
used too it took {took}, and printed this:

```text
{output}
```

![Bins an hour under the bound, by the number of carriers](study.svg)

The page (`orchard app`, button "How many carriers?") and Python give the same answer:
`orchard.study.study.study(scenario).answer`.

## What is asked

Told nothing else, a study asks for the long run: a harvest that goes on, without its beginning and
its end. Each picker fills at least 24 bins, and each battery is charged six times; the first 40 %
are left out. Far longer ones differ by 0.5 % on average, 3.1 % at most
(`python examples/long_run.py --random 40 --against 160`). MSER-5, which finds the warm-up in the
data, would leave out 0 to 15 % on average in eight orchards, 48 % at most; its rates differ by 0.4
% on average, so the 40 % are on the safe side (`python examples/run_statistics.py`). A policy by
which one picker picks less than half of what another does has none, as `assignment` where carriers
are few. A single harvest has other answers: `--horizon harvest`.

The study tries as many carriers as it takes: about the number of the [limit without
traffic](bounds.md#the-limit-without-traffic), then more, until the answer has its neighbours and
lies inside. The answer is the fewest that come within 2 % (`--within`) of the best. The same holds
for trailers, chargers and `bays`. With prices in the scenario the answer is the number of carriers
with the least cost of a bin:

```yaml
prices: {{picker_per_hour: 25, carrier_per_hour: 8}}        # in your currency
```

## What is paid for what

All that is set in `prices` adds up, and the answer has a table of it for the best setting:

- a picker: a wage (`picker_per_hour`), a piece rate (`picker_per_bin`), and the least that it gets
  for a day, for hours and bins together (`picker_least_per_day`);
- a carrier: by the hour (`carrier_per_hour`) or the day (`carrier_per_day`);
- a robot that is bought (`picker_bought`, `carrier_bought`): its `price` over `years` of
  `hours_per_year`;
- all else by the hour and the day (`overhead_per_hour`, `overhead_per_day`), and `per_bin`.

Hours are working hours: breaks are not paid. What is paid by the day needs a `shift`, and is paid
for each day that is begun; in the long run all days are whole. A picker that is away is not paid
then. It gets the least of a day on which it is there for more than an hour.

```yaml
shift: {{begin: "07:00", end: "16:30", breaks: [["10:00", "10:15"], ["12:00", "12:45"]]}}
prices:
  picker_per_bin: 20
  picker_least_per_day: 190
  carrier_per_day: 90
  carrier_bought: {{years: 8, hours_per_year: 400}}           # without a price: what may it cost?
  overhead_per_hour: 35
```

The least of a day is paid as if all pickers filled bins at the same rate while they are there.

The notes tell what the last robot may cost, and one more, by its hours and up to the least of a
day, beside piece rates: "carrier number 3 pays if it costs up to
41 ± 2 an hour". With `years` and `hours_per_year` they tell the price at which it is bought, too.

## Done in time: `--finish-within`, `--finish-by`

Which is the cheapest fleet that is done in 8 hours of work, or by the end of the second day of the
`shift`? Without prices it is the one with the fewest robots.

```sh finish
orchard study rent.yaml --vary pickers --vary carriers --finish-within 8h
orchard study rent.yaml --vary carriers=1..6 --finish-within 30h
```

A fleet is in time if 19 of 20 harvests are, each with rows of its own seed (`--confidence 0.9`: 18
of 20). The answer says how many were, and what smaller fleets would need. It says why one that is
in time on average is not the answer. If all of 20 are in time, at least 86 % of all such harvests
are, with 95 % confidence.

Fleets are tried in the order of what they cost at least, which is known from their limit without
traffic. A fleet of which the limit misses the deadline needs no run. Where rows or pickers differ,
each seed has a limit of its own: that of the picker whose rows take longest. If you name no numbers
of pickers, those are left out with which the picker with the most rows has as many as with fewer
pickers. If no fleet can be in time, the command says which limit forbids it, and what would do.

The time of a harvest is working time. With a `shift` it stops at a day's end and in breaks, and
goes on where it stopped. Before a day's end carriers finish their jobs and drive home: all work of
a day ends earlier by the longest job without traffic. That is a little less than a day allows.

## The end of a range

If you name numbers (`--vary carriers=1..8`), and the best is the last one, the answer begins with
"At least". If it is the first one, and the runs tell it from the others, the answer begins with "At
most".

## How sure it is

All settings have the same seeds, as many in each line, so the same rows are slow in all of them.
`behind` is by how much the best mean is ahead of a setting, on the same seeds. A setting has `=`
only if the whole interval of that is within 2 %. It has `?` if the runs do not tell, and the answer
says how much longer would: "not enough runs to tell 4 from 5: 40 s more would". A setting whose
limit without traffic is more than 2 % behind the best mean has no mark, because no run exceeds the
limit. After one run `behind` has no interval. It has none either where all seeds agree by luck, as
those without a rare failure do.

The first runs are those of the ends of each range. The next ones halve its gaps, until each setting
has a run. If the time ends before that, the answer says how many settings have not run, and nothing
of what lies beyond the range.

The study looks after 10, 20, 40 and 80 replications. It ends when nothing is undecided, or when its
time is used (`--budget`, 5 min). A setting on the very edge of 2 % keeps its `?`: it is no longer
undecided when its difference is known to 1 % by itself. All intervals of `behind` together are made
to hold with 95 % (`--confidence`): each look and each pair of settings gets a part of the 5 %
(Bonferroni's rule). They are Student's, and wider where the runs are skewed, by Johnson's
correction of 1978. So is the ± of a figure of one setting, which holds with 95 % by itself. If
nothing is random, one run stands for all seeds.

Do they hold? In each of five small orchards 600 studies drew their seeds from 800, so the truth is
known (`python examples/interval_coverage.py --seeds 800 600`):

| orchard | all of `behind` | before | runs of each | before |
|---|---|---|---|---|
| rows differ (gamma) | 98.2 % | 88.2 % | 44 | 41 |
| rows differ (lognormal) | 98.2 % | 93.3 % | 51 | 51 |
| rows differ (uniform) | 100 % | 99.2 % | 10 | 5 |
| robots fail often | 99.3 % | 95.3 % | 74 | 72 |
| carriers fail rarely | 96.8 % | 8.8 % | 16 | 14 |

"Before" had a first look after five runs, Student's intervals, the pairs with the best mean alone,
and an interval where all seeds agreed. What was said of settings held in 99.8 to 100 % of studies,
and in 99.2 to 100 % before. The best mean is the luckiest one: of 200 made-up studies of 50
settings that are all alike, intervals that may miss in 12.5 % missed in 32 % where they counted the
pairs with the best mean alone, and in 1.5 % now (`tests/study/test_statistics.py`).

The ± of one setting's own rate held the truth so often, in %; in brackets Student's interval:

| orchard | 5 runs | 10 runs | 20 runs | 40 runs | when the study ends |
|---|---|---|---|---|---|
| rows differ (gamma) | 98 (95) | 96 (95) | 97 (96) | 96 (96) | 96 (95) |
| rows differ (lognormal) | 97 (95) | 97 (95) | 95 (94) | 96 (95) | 95 (95) |
| rows differ (uniform) | 96 (94) | 96 (95) | 96 (95) | 96 (95) | 96 (95) |
| robots fail often | {held[5]} (76) | {held[10]} (84) | {held[20]} (90) | 97 (94) | 96 (94) |
| carriers fail rarely | 100 (100) | 100 (100) | 100 (98) | 98 (98) | 100 (98) |

Ten runs may miss what one harvest in ten has, and no interval of their figures tells of that. So
the legend of a table with fewer than 40 harvests of each setting says how often such an ± held
where robots fail often. A study that ends by itself made 74 runs there. Where carriers fail rarely,
most settings had no ±, because no run had a failure. A longer `--budget` changes nothing, because
the study ends when it can tell the settings apart.

A harvest's limit without traffic would be a good control variate where pickers limit: it explains
88 to 100 % of what differs between seeds in six of eight orchards, 43 % in one, and 2 % where
carriers limit (`python examples/run_statistics.py`). A study does not use it: settings that it
compares have the same seeds, which takes most of that away already.

A setting in which a harvest jams is left out, and named. So is one of which a run fails, as by an
error in a policy: the exit code is 1. If all settings fail, there is no table. With a deadline and
of a farm it is the same. A sensitivity ends at the first run that fails, and names the values of
that run, because all its runs have the same policy. A setting is left out, too, if its values
cannot stand together, as a truck that takes more bins than there are; the reason is told. A value
that is wrong by itself ends the study before it begins.

The [fast model](bounds.md#the-discrete-event-model) does all runs; it is compiled once for a
machine, which takes some 40 s. With `--horizon harvest` the simulator checks the best two settings;
`--model full` lets it do all, and agents of your own need that. A setting that fails in the
simulator only stays in the table, and the answer says that it is not checked. The exit code is 1,
too.

## Other questions

`--vary` takes each value but `seed`, and may be given several times: then all combinations are
settings, at most 10,000. A value that is a map, as of `prices`, is put into the scenario's: what
it leaves out stays, and a note names it. `--vary carriers` without numbers is as many as it takes,
with a deadline `--vary pickers` too.

A study looks for the best of what you choose: {choices}.
All else is given: prices, rates, speeds, the crop, the rows, people. If it varies, the table shows
what depends on it, and no best. If something that you choose varies too, each given value has a
best of its own. The scenario says of each field which it is (`orchard/field/decisions.py`).

```sh vary
orchard study rent.yaml --vary carriers --vary dispatch=nearest,predictive
orchard study rent.yaml --vary picking_rate=1.5,2.5 --horizon harvest --goal harvest_seconds
orchard study rent.yaml --vary route=one-way,two-way --vary carriers=2,3
```

A [policy of your own](extending.md#dispatch-and-rows-dispatch-rows_to_pickers) is compared by its
name:

```sh own
orchard study rent.yaml --vary dispatch=nearest,predictive,examples.seams.in_time.InTime
```

`--summary FILE.json` has all of the answer, `--csv FILE.csv` the table, `--picture FILE.svg` or
`.png` the picture, and `--report FILE.html` all of it on a page.

Each run is kept in a store, `studies.db` beside the recordings (`--out` names another one). After
Ctrl-C the same command goes on from there. A store of another version of the program is kept until
you say `--anew`. If you change a policy of yours, its runs are done again; files of data that it
reads are not looked at.

## What the result hangs on: `--sensitivity`

What is given is never known exactly: people may pick 1.2 or 1.8 bins an hour. `--sensitivity` moves
each such value through a range, all at once, and tells from which of them it comes that the result
is unsure.

```sh sensitivity
orchard study rent.yaml --sensitivity --horizon harvest --picture tornado.svg
orchard study rent.yaml --sensitivity --vary picking_rate=1.2..1.8 --vary carriers --vary weeds=50%
```

The first one printed this, after 88 of 256 harvests: a busy machine did no more in the usual budget
of five minutes. All of them make the intervals narrower.

```text
8.5 bins an hour, 6.2 to 10.4 in 19 of 20 runs. More than half of what is unsure
comes from picking rate (1.2 to 1.8): 58 ± 15 %; the luck of the seed is 39 ± 13
%.
moved                 from  to    at low at high by itself, % in all, %
───────────────────────────────────────────────────────────────────────
picking_rate          1.2   1.8   7.0    10.0    58 ± 15      58 ± 15
carriers              5     7     8.7    8.3     2 ± 5        2 ± 5
picking.spread.cv     0.196 0.364 8.8    8.2     1 ± 5        1 ± 5
picking.driving_speed 0.9   1.1   8.3    8.7     1 ± 5        1 ± 5
row_width             4.5   5.5   8.4    8.7     0 ± 4        0 ± 4
bins_per_row          5.1   6.9   8.4    8.6     0 ± 2        0 ± 2
carrying.speed        0.9   1.1   8.5    8.5     0 ± 2        0 ± 2
luck of the seed                                 39 ± 13      39 ± 13
```

A value is moved by a share of its own: rates by 20 %, a crop by 15 %, speeds, the width of rows and
the number of carriers by 10 %, handling and spreads by 30 %. Surveyed rows keep their width. These
are judgements; `--vary KEY=SHARE%` and `--vary KEY=LOW..HIGH` say others. If you name any, only
those are moved. A value that is 0, not set, or at its limit is not moved unless you name its range.
Of carriers, pickers and other numbers of things each number in the range has the same chance.
Points whose values cannot stand together are left out, and a note says why: at most a quarter of
them.

"By itself" is the first-order effect of Sobol, "in all" the total one, both as shares of all
variance of a run. The luck of the seed is a part of that: two runs with different rows, people and
failures. In the long run rows take their mean times, so there it is small. A last row says how much
the fit does not tell, if it misses any. That may come from any value, so the interval of each
reaches up by it. If only one value is moved, all but the luck comes from it.

The runs stand at quasi-random points, two of them at each, with seeds of their own. The effects are
those of a quadratic fit. A note says whether the fit misses more than the luck of the seeds (F
test, 99.9 %), and then how much of what the values move it tells, at points that it has not seen. A
fit that tells less than 90 % is said to be poor. One that tells less than 98 % has no "at low" and
"at high": there it errs most. `--picture` draws a tornado: the mean result at both ends of each
value. `--csv` writes the effects, and `--report` all of it on a page. With a deadline ask what the
time hangs on: `--horizon harvest --goal harvest_seconds`. Of a farm, ask it of each block.

The page (`orchard app`, button "What does it hang on?") asks by the same command of one harvest,
and shows the tornado. Other values, a share such as 20 % and a range such as 1,2-1,8 stand under
"Move other values, or further". A change of an input stops it.

Intervals are by bootstrap of the fit. Of 60 made-up samples (three values, 32 points, known
shares), the intervals of 95 % held the true share in:

| result | luck of the seed | the values |
|---|---|---|
| luck alone | 97 % | 98 to 100 % |
| a sum, 23 % of it luck | 93 % | 90 to 95 % |
| with a product, 23 % of it luck | 92 % | 92 to 95 % |
| a step of one value, 2 % of it luck | 95 % | 95 to 97 % |

`python -m docs.coverage_of_shares` measures it again.

## Who comes late, or is ill

`picker_absences` says in which hours of work somebody is away, counted from the beginning of the
harvest. Breaks and nights do not count. Here one of eight comes at noon, after 4.5 h, and another
one is ill on the third day of 8.5 h of work:

```yaml scenario
pickers: 8
rows: 26
row_length: 110
picking_rate: 1.5
bins_per_row: 6
picker_absences: {{picker_08: [[0, 4.5]], picker_02: [[17, 25.5]]}}
rows_to_pickers: balanced-times
```

Who is away stands in its row, in the state `failed`, and its rows wait for it. It leaves where it
bars no road, and fills its bin first if that is full within ten minutes, so that no carrier waits
for it. With
`rows_to_pickers: balanced-times` rows are given to pickers so that the last one is done as early as
can be. That knows the lengths of rows, `picker_rates` and `picker_absences`, as a manager does who
knows them on the first day. It knows nothing of what the seed draws. What an illness costs is the
difference of two lines of a study of one harvest, without the illness and with it.

A row never goes to the next free picker. Pickers drive southward along the ends of the rows, and
wait there for their empty bins; so the next free one would have to pass one that waits, which holds
places that the carrier needs for whom it waits, and both could wait for ever. Such a rule needs
another proof of the [roads](traffic.md#why-no-robot-waits-for-ever). Use `balanced-times`, or
pickers and rows of which the numbers fit: 8 rows are done by 6 pickers no sooner than by 4.

## Several blocks, one fleet

A farm's file lists its blocks, each a scenario of its own, in the order in which one fleet harvests
them:

```yaml farm.yaml
blocks:
- {{file: top.yaml}}
- {{file: low.yaml, name: Low}}
transfer_minutes: 20
pickers: 4
```

`orchard study farm.yaml` studies one harvest of each block, with runs of its own, and adds them up:
the means with the transfers, and the variances for the interval. The answer is the number of
carriers with which the farm takes least time, and fewest robots. `pickers` and `carriers` hold for
all blocks; without them the blocks must agree, as they must on `carrying` and `handling`. A block
is an orchard by itself: no picture or recording shows two, and nothing is simulated of the way
between them. Prices and deadlines are asked of each block.

On the page (`orchard app`, "Several blocks, one fleet"), set the form to the rows of a block, name
it, and add it; then the next one. The pickers are those of the form when you ask.

## Ten questions, and what answers them

The page asks by the same command, so it gives the same answer. "Compare, too" stands there under
"Compare more". Where it says "ask twice", change the field, and compare two answers by yourself.

- Pickers and carriers at the least cost of a bin: set `prices`, and say
  `--vary pickers=4..8 --vary carriers`. On the page: prices, and "Compare, too": Pickers, 4-8.
- The cheapest fleet that is done in 8 hours, or by Friday:
  `--vary pickers --vary carriers --finish-within 8h`, or `--finish-by 5d`. On the page: "Done
  within", hours of work or days.
- A daily minimum, a piece rate, rent by the day, a machine bought:
  [prices](#what-is-paid-for-what). On the page: "Fleet and prices", "The day", and "Machines that
  are bought".
- One of eight people is ill: `--vary pickers=7,8`, or for some hours
  [`picker_absences`](#who-comes-late-or-is-ill). One is half as fast:
  `--vary carriers --vary 'picker_rates={{}},{{"picker_01": 0.5}}'`. On the page: "Compare, too":
  Pickers, 7-8; "Who is away" (`picker 2: 0-8 h`) with the horizon "one harvest"; "How fast each is"
  (`picker 1: 50 %`), ask twice.
- Three hours of rain on the first day: `picker_absences` of all pickers, from `picker_01: [[3, 6]]`
  on, with a `shift` and `--horizon harvest`. Pickers then get no wage for the rain, but the least
  of the day; carriers are paid. Ask twice, with the rain and without. Breaks would come each day.
  On the page: "Who is away" (`picker 1: 3-6 h; picker 2: 3-6 h`, and so on), ask twice.
- Three blocks a day with one fleet: [a farm](#several-blocks-one-fleet). On the page: "Several
  blocks, one fleet".
- Tractors with trailers of three bins: `load_out: {{metres: 500, speed: 3, trailers: {{count: 2,
  bins: 3}}}}`, and `--vary load_out.trailers.count=1..3`. On the page: "From the bay on", and
  "Compare, too": Trailers at the bay, 1-3.
- The day ends at 16:30, with breaks at 10 and 12: a `shift`, and `--finish-by 1d` or prices for a
  day. On the page: "The day", and "Done within" 1 days.
- A truck for 12 bins every 40 minutes: `load_out: {{truck: {{every: 2400, bins: 12}},
  empty_bins: 24}}`, and `--vary load_out.empty_bins=12,24`. On the page: "From the bay on", and
  "Compare, too": Empty bins at the bay, 12 and 24.
- How sure is the answer: the `±` of each figure, on the page, too. What it hangs on:
  `--sensitivity`. On the page: "What does it hang on?".
- One more picker from noon, or one ill for a day: [`picker_absences`](#who-comes-late-or-is-ill),
  `--horizon harvest`. What that costs: the same with a `shift`, `prices` and
  `--goal cost_per_bin`. On the page: "Who is away", one harvest; with prices it looks for the least
  cost by itself.
- Done in two days of 9 h with two breaks: a `shift`, and
  `--vary pickers --vary carriers --finish-by 2d`. On the page: "The day", "Done within" 2 days.
- A piece rate or wages: both lines of
  `--vary 'prices={{"picker_per_hour": 30}},{{"picker_per_bin": 20}}'` show what a bin costs. Other
  prices of the file stay, and a note names them; `null` takes one out. On the page: "Price of a
  picker" or "Piece rate of a bin", ask twice.
- Rows 4.5 m apart that are drawn as GeoJSON: `orchard layout import rows.geojson --out mine.yaml`
  ([how](how-to.md#harvest-the-rows-of-a-real-orchard)), then `orchard study mine.yaml`. On the
  page: "Open" this file. Rows that are alike need none: "Spacing of rows" 4.5.
- A haul of 600 m with one trailer or two: `load_out: {{metres: 600, speed: 4, trailers: {{count: 1,
  bins: 6}}}}`, and `--vary load_out.trailers.count=1,2`. On the page: "From the bay on", and
  "Compare, too": Trailers at the bay, 1 and 2.
- Apples by hand, and a tractor: `crop`, `picking_rate: 0.56`, and the shipped `forklift` as an
  example. On the page: "Forklift" above, then "Yield", "Fruit in a bin", "Bins an hour each".
- Bins that are 20 % heavier: `--vary crop.kilograms_per_bin=350,420`, and `picking_speed` in place
  of `picking_rate`: a rate counts bins, so with heavier ones people would pick more fruit. On the
  page: "Picking speed" (for experts), and "Compare, too": Fruit in a bin, 350 and 420.

## Many machines

`--workers` sets the number of processes here. For several machines start a scheduler of
[Dask](https://distributed.dask.org), `dask scheduler`, and on each machine
`dask worker tcp://192.168.1.10:8786 --nthreads 1`, all with the same version of the Orchard. Add
`--scheduler tcp://192.168.1.10:8786`. The clocks must agree within 2 s. The table is the same
whatever the workers.
"""


def measure() -> None:
    """Ask the question again, with a fresh store, and keep the answer."""
    with TemporaryDirectory() as folder:
        options = StudyOptions(budget_seconds=BUDGET, store=Path(folder, "studies.db"))
        answer = study(parse(SCENARIO), options=options)
    ANSWER.write_text(dumps(asdict(answer), indent=1) + "\n")
    result.cache_clear()


@cache
def result() -> StudyResult:
    """Return the answer that was measured last."""
    return msgspec.json.decode(ANSWER.read_bytes(), type=StudyResult)


def picture() -> str:
    """Return docs/study.svg."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "study.svg")
        save(result(), path)
        return path.read_text()


def document() -> str:
    """Return the text of docs/study.md."""
    return TEXT.format(
        scenario=SCENARIO,
        command=COMMAND,
        output=_output(),
        took=clock(result().wall_seconds),
        choices=_choices(),
        held=HELD,
    )


def _choices() -> str:
    """Return the keys that a grower chooses, as a list in a sentence."""
    *keys, last = [f"`{path}`" for path in decided(Scenario, Decision.CHOICE)]
    return f"{', '.join(keys)} and {last}"


def _output() -> str:
    """Return what the command prints on a terminal."""
    console = Console(width=WIDTH, file=io.StringIO(), record=True)
    console.print(result().answer)
    console.print(as_table(result()))
    lines = [*console.export_text().splitlines(), *(f"- {note}" for note in result().notes)]
    return "\n".join(line.rstrip() for line in lines)


if __name__ == "__main__":
    measure()
