"""`orchard trace`: what each robot does when."""

from pathlib import Path

import pytest
from quiet import NOBODY

from orchard.commands.trace import TraceOptions, print_trace
from orchard.field.scenario import Scenario, to_yaml

SMALL = {"rows": 3, "pickers": 2, "carriers": 1, "row_length": 30.0}


def options(folder: Path, **values: object) -> TraceOptions:
    """Return the options of a trace of the small orchard, with other values in its scenario."""
    path = folder / "scenario.yaml"
    path.write_text(to_yaml(Scenario(**SMALL | values)))
    return TraceOptions(scenario=path, out=folder / "trace.txt")


def test_a_trace_has_a_line_for_each_thing_that_a_robot_begins(tmp_path: Path) -> None:
    chosen = options(tmp_path, **NOBODY)
    print_trace(chosen)
    assert chosen.out is not None
    lines = chosen.out.read_text().splitlines()
    unloaded = [line.split(maxsplit=2) for line in lines if line.endswith("unloads")]
    assert [robot for _, robot, _ in unloaded] == 3 * ["carrier_01"]
    assert any(line.endswith("leaves the full bin in row 2") for line in lines)


def test_a_trace_tells_when_a_carrier_is_away_at_the_load_out(tmp_path: Path) -> None:
    chosen = options(tmp_path, **NOBODY, load_out={"seconds_away": 100.0})
    print_trace(chosen)
    assert chosen.out is not None
    lines = chosen.out.read_text().splitlines()
    assert sum(line.endswith("is away at the load-out") for line in lines) == 3


def test_what_the_event_model_does_not_know_is_said(tmp_path: Path) -> None:
    chosen = options(tmp_path, sensors={"odometry": {"distance": 0.02}})
    with pytest.raises(ValueError, match="knows no errors of sensors; run the simulator"):
        print_trace(chosen)
    assert not (tmp_path / "trace.txt").exists()
