"""A command replaces a file only if the Orchard has written one of the same kind there."""

from dataclasses import asdict
from pathlib import Path

import pytest
from command_line import orchard, scenario_file
from local_runs import SMALL
from made_studies import by_carriers

from orchard.commands.trace import TRACE, TraceOptions, print_trace
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.report.summary import SUMMARY, write_summary
from orchard.roads.export import MAP, export_map
from orchard.study.benchmark.scores import BenchmarkResult
from orchard.study.kinds_of_files import PICTURE, REPORT, TABLE
from orchard.study.picture import save as save_picture
from orchard.study.picture import save_futures
from orchard.study.report import save as save_report
from orchard.study.table import save_csv
from orchard.terminal.files import check_writable

# What belongs to a user: one text for each kind, as near to ours as a text of others may be.
OTHERS = {
    "summary.json": '{\n  "hash": "of another program",\n  "name": "thesis"\n}\n',
    "table.csv": "carriers,bins\n3,11\n",
    "picture.svg": '<?xml version="1.0"?>\n<svg><dc:title>Matplotlib</dc:title></svg>\n',
    "picture.png": "\x89PNG, which somebody has drawn",
    "report.html": "<!DOCTYPE html>\n<title>My orchard</title>\n",
    "trace.txt": "a year's work\n",
    "map.json": '{\n "metaInformation": {\n  "creator": "another program"\n }\n}\n',
}
COMMANDS = {
    "harvest": ("--mode", "local", "--duration", 1, "--record", "none", "--summary summary.json"),
    "study": (
        "study",
        "--summary summary.json",
        "--csv table.csv",
        "--picture picture.svg",
        "--report report.html",
    ),
    "study, another picture": ("study", "--picture picture.png"),
    "benchmark": ("benchmark", "--summary summary.json"),
    "bound": ("bound", "--summary summary.json"),
    "trace": ("trace", "--out trace.txt"),
    "map": ("layout", "export", "--lif map.json"),
    "futures": ("fork", "run.snapshots", "--at", 1, "--futures", 1, "--summary summary.json"),
    "decision": (
        "fork",
        "run.snapshots",
        "--bisect",
        "bins_per_hour<1",
        "--summary summary.json",
        "--picture picture.svg",
    ),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_replaces_a_file_of_others(command, tmp_path):
    """It is told before the work begins, and the file stays."""
    (tmp_path / "run.snapshots").mkdir()
    words: list[str] = []
    written = []
    for word in map(str, COMMANDS[command]):
        option, _, name = word.partition(" ")
        if name:
            (tmp_path / name).write_text(OTHERS[name])
            written.append(name)
        words += filter(None, (option, name))
    told = orchard(*words, code=2, folder=tmp_path).stderr
    assert "that the Orchard has written, and is not replaced; expected another name" in told
    # A study tells of all its files at once.
    assert [name for name in written if name in told] == (
        written if command == "study" else written[:1]
    )
    assert all((tmp_path / name).read_text() == OTHERS[name] for name in written)


def test_what_the_orchard_has_written_may_be_replaced(tmp_path):
    result = by_carriers()
    scenario = scenario_file(tmp_path, Scenario(rows=3, pickers=2, row_length=30.0, carriers=1))
    write = {
        "table.csv": (TABLE, lambda path: save_csv(result, path)),
        "picture.svg": (PICTURE, lambda path: save_picture(result, path)),
        "picture.png": (PICTURE, lambda path: save_picture(result, path)),
        "futures.png": (PICTURE, lambda path: save_futures(path, {1.0: [2.0]}, {1.0: 1.0}, None)),
        "report.html": (REPORT, lambda path: save_report(result, path)),
        "map.json": (MAP, lambda path: export_map(lay_out(SMALL), path)),
        "trace.txt": (TRACE, lambda path: print_trace(TraceOptions(scenario=scenario, out=path))),
    }
    for name, (kind, save) in write.items():
        path: Path = tmp_path / name
        save(path)
        assert kind.is_kind_of(path), name
        check_writable(path, kind=kind)


SUMMARIES = (
    ("--mode", "local", "--duration", 1, "--record", "none"),
    ("bound", "--work", 1),
)


@pytest.mark.parametrize("words", SUMMARIES, ids=["harvest", "bound"])
def test_a_summary_replaces_an_older_one(words, tmp_path):
    path = tmp_path / "summary.json"
    write_summary(path, asdict(by_carriers()))
    scenario = scenario_file(tmp_path, SMALL)
    command = [word for word in words if word == "bound"]
    orchard(*command, scenario, *words[len(command) :], "--summary", path)
    assert '"bottleneck"' in path.read_text()
    assert SUMMARY.is_kind_of(path)


OTHER_SUMMARIES = {
    "benchmark": asdict(
        BenchmarkResult(policy="own", scores={"own": 0.5}, harvests=[], notes=[], version="1.0")
    ),
    # As `compare_futures` and `bisect_futures` return them.
    "futures": {"at_seconds": 60.0, "futures": {}},
    "decision": {"condition": "bins_per_hour<1", "decided_seconds": None},
}


@pytest.mark.parametrize("command", OTHER_SUMMARIES)
def test_a_summary_of_another_command_is_one_too(command, tmp_path):
    path = tmp_path / "summary.json"
    write_summary(path, OTHER_SUMMARIES[command])
    check_writable(path, kind=SUMMARY)


def test_an_empty_file_and_a_device_may_be_written(tmp_path):
    empty = tmp_path / "summary.json"
    empty.touch()
    for path in (empty, Path("/dev/null")):
        check_writable(path, kind=SUMMARY)


def test_a_table_of_a_study_without_a_run_is_replaced(tmp_path: Path) -> None:
    """The study was stopped before its first run, and the same command goes on."""
    table = tmp_path / "table.csv"
    table.write_bytes(b"\r\n")
    check_writable(table, kind=TABLE)
    table.write_bytes(b"\r\nmine\r\n")
    with pytest.raises(OSError, match="is not the table of a study"):
        check_writable(table, kind=TABLE)
