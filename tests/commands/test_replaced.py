"""A command replaces a file only if the Orchard has written one of the same kind there."""

from pathlib import Path

import pytest
from command_line import orchard, scenario_file
from files_of_others import words_of_refusal
from local_runs import SMALL

from orchard.commands.trace import TRACE, TraceOptions, print_trace
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.report.summary import SUMMARY, write_summary
from orchard.terminal.files import check_writable

# The last word is an option and its file: the test first writes something into this file.
COMMANDS = {
    "harvest": ("--mode", "local", "--duration", 1, "--record", "none", "--summary summary.json"),
    "bound": ("bound", "--summary summary.json"),
    "trace": ("trace", "--out trace.txt"),
    "map": ("layout", "export", "--lif map.json"),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_replaces_a_file_of_others(command, tmp_path):
    """The command names the file and ends with code 2, and the file stays."""
    (written,), words = words_of_refusal(COMMANDS[command], tmp_path)
    assert written in words


def test_a_trace_that_was_written_may_be_replaced(tmp_path):
    scenario = scenario_file(tmp_path, Scenario(rows=3, pickers=2, row_length=30.0, carriers=1))
    trace = tmp_path / "trace.txt"
    print_trace(TraceOptions(scenario=scenario, out=trace))
    assert TRACE.is_kind_of(trace)
    check_writable(trace, kind=TRACE)


def test_a_map_that_was_written_may_be_replaced(tmp_path):
    export = pytest.importorskip("orchard.roads.export")
    path = tmp_path / "map.json"
    export.export_map(lay_out(SMALL), path)
    assert export.MAP.is_kind_of(path)
    check_writable(path, kind=export.MAP)


# Words before the scenario, and after it.
SUMMARIES = {
    "harvest": ((), ("--mode", "local", "--duration", 1, "--record", "none")),
    "bound": (("bound",), ("--work", 1)),
}


@pytest.mark.parametrize(("command", "options"), SUMMARIES.values(), ids=SUMMARIES)
def test_a_summary_replaces_an_older_one(command, options, tmp_path):
    """The older summary may be that of another command, such as one of the futures of a run."""
    path = tmp_path / "summary.json"
    write_summary(path, {"at_seconds": 60.0, "futures": {}})
    scenario = scenario_file(tmp_path, SMALL)
    orchard(*command, scenario, *options, "--summary", path)
    assert '"bottleneck"' in path.read_text()
    assert SUMMARY.is_kind_of(path)


def test_an_empty_file_and_a_device_may_be_written(tmp_path):
    empty = tmp_path / "summary.json"
    empty.touch()
    for path in (empty, Path("/dev/null")):
        check_writable(path, kind=SUMMARY)
