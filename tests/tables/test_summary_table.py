"""The table of a summary: one row, with one schema for all runs."""

import pyarrow as pa
import pytest

from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.server.figures import RunFigures
from orchard.tables.columns import SUMMARY
from orchard.tables.folder import as_table


def test_a_summary_becomes_one_row():
    """A map becomes a column for each of its keys, if these are known; else, as lists, its JSON."""
    summary = {"hash": "ab", "ticks": 5, "lost_seconds": {"traffic": 1.5}, "violations": []}
    summary |= {"scenario": {"rows": 3}, "history": {"seconds": [1, 2]}}
    table = as_table(summary)
    (row,) = table.to_pylist()
    assert {name: value for name, value in row.items() if value is not None} == {
        "hash": "ab",
        "ticks": 5,
        "lost_seconds.traffic": 1.5,
        "violations": "[]",
        "scenario": '{"rows":3}',
        "history.seconds": [1.0, 2.0],
    }
    assert (
        table.schema.field("lost_seconds.traffic").metadata[b"unit"]
        == b"s, which add up to the harvest's length"
    )


def test_all_summaries_have_one_schema_whatever_happened():
    """Some figures are of some runs only, in another order, or whole numbers for decimal ones."""
    local = Local(Scenario(rows=3, tractor=False))
    figures = RunFigures(local.engine, lambda: 0.0)
    plain = figures.summary()
    local.engine.stop(["picker_01"])
    for _ in range(20):
        figures.update(local.tick())
    eventful = figures.summary()
    eventful |= {"messages_refused": {"not a letter": 2}, "jam": ["x"]}
    eventful |= {"ticks_late": 1, "answer_milliseconds": {"p50": 1, "p99": None}}
    eventful |= {"forked_from": {"run": "harvest", "seconds": 2}, "lost_seconds": {}}
    reordered = dict(reversed(plain.items())) | {"bins_per_hour": 1}
    tables = [as_table(summary) for summary in (plain, eventful, reordered)]
    assert all(table.schema.equals(SUMMARY) for table in tables)
    together = pa.concat_tables(tables)
    assert together["stopped_seconds"].to_pylist()[:2] == ["{}", '{"bin_01":2.0,"picker_01":2.0}']
    assert together["bins_per_hour"].to_pylist()[2] == 1.0


def test_a_figure_without_a_column_is_told(tmp_path):
    with pytest.raises(ValueError, match="golden_kiwis: no such column"):
        as_table({"golden_kiwis": 1.0, "scenario": {}})
