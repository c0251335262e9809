"""A study, a benchmark and futures replace a file only if the Orchard has written one of the same
kind there.
"""

from dataclasses import asdict
from pathlib import Path

import pytest
from files_of_others import words_of_refusal
from made_studies import by_carriers

from orchard.report.summary import SUMMARY, write_summary
from orchard.study.benchmark.scores import BenchmarkResult
from orchard.study.kinds_of_files import PICTURE, REPORT, TABLE
from orchard.study.picture import save as save_picture
from orchard.study.picture import save_futures
from orchard.study.report import save as save_report
from orchard.study.table import save_csv
from orchard.terminal.files import check_writable

# A word with a space is an option and the file that it names, as `words_of_refusal` takes them.
# Other options stand in words of their own.
COMMANDS = {
    "study": (
        "study",
        "--summary summary.json",
        "--csv table.csv",
        "--picture picture.svg",
        "--report report.html",
    ),
    "study, another picture": ("study", "--picture picture.png"),
    "benchmark": ("benchmark", "--summary summary.json"),
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
def test_no_study_replaces_a_file_of_others(command, tmp_path):
    """It is told before the work begins, and the file stays.

    `words_of_refusal` puts files of a user where the command would write. It returns their names,
    and what the command says.
    """
    written, told = words_of_refusal(COMMANDS[command], tmp_path)
    # A study names all these files at once, and the others name the first.
    expected = written if command == "study" else written[:1]
    assert [name for name in written if name in told] == expected


def test_what_a_study_has_written_may_be_replaced(tmp_path):
    result = by_carriers()
    write = {
        "table.csv": (TABLE, lambda path: save_csv(result, path)),
        "picture.svg": (PICTURE, lambda path: save_picture(result, path)),
        "picture.png": (PICTURE, lambda path: save_picture(result, path)),
        "futures.png": (PICTURE, lambda path: save_futures(path, {1.0: [2.0]}, {1.0: 1.0}, None)),
        "report.html": (REPORT, lambda path: save_report(result, path)),
    }
    for name, (kind, save) in write.items():
        path: Path = tmp_path / name
        save(path)
        assert kind.is_kind_of(path), name
        check_writable(path, kind=kind)


SUMMARIES = {
    "study": asdict(by_carriers()),
    "benchmark": asdict(
        BenchmarkResult(policy="own", scores={"own": 0.5}, harvests=[], notes=[], version="1.0")
    ),
    # As `compare_futures` and `bisect_futures` return them.
    "futures": {"at_seconds": 60.0, "futures": {}},
    "decision": {"condition": "bins_per_hour<1", "decided_seconds": None},
}


@pytest.mark.parametrize("command", SUMMARIES)
def test_an_own_summary_may_be_replaced(command, tmp_path):
    """What each of these commands writes is known as a summary of the Orchard."""
    path = tmp_path / "summary.json"
    write_summary(path, SUMMARIES[command])
    check_writable(path, kind=SUMMARY)


def test_a_table_of_a_study_without_a_run_is_replaced(tmp_path: Path) -> None:
    """The study was stopped before its first run, and the same command goes on."""
    # What `save_csv` writes of no row: an empty head.
    table = tmp_path / "table.csv"
    table.write_bytes(b"\r\n")
    check_writable(table, kind=TABLE)
    table.write_bytes(b"\r\nmine\r\n")
    with pytest.raises(OSError, match="is not the table of a study"):
        check_writable(table, kind=TABLE)
