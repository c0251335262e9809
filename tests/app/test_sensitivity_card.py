"""What the result hangs on, as a user of the page asks it: what is moved, and how far."""

import pytest

from orchard.app.command import Files
from orchard.app.sensitivity_run import SensitivitySettings, movable, sensitivity_command
from orchard.field.scenario import Scenario

RATE = SensitivitySettings(moved=("picking_rate",), far="1,2-1,8", budget="90,5")
ORCHARD = Scenario(rows=3, picking_rate=1.5)


def test_a_range_is_moved_as_a_user_would_type_it(tmp_path):
    assert RATE.problem_with(ORCHARD) == ""
    line = sensitivity_command(RATE, Files(tmp_path, "sensitivity"))
    options = line[line.index("study") + 2 : line.index("--progress")]
    assert options == [
        "--sensitivity",
        "--vary",
        "picking_rate=1.2..1.8",
        "--horizon",
        "harvest",
        "--budget",
        "90.5s",
    ]


def test_a_share_is_of_each_value_that_is_moved():
    settings = SensitivitySettings(moved=("row_length", "carriers"), far="12,5 %")
    assert settings.problem_with(ORCHARD) == ""
    assert settings.moves == ["row_length=12.5%", "carriers=12.5%"]


def test_the_spacing_of_rows_is_not_moved():
    """A share of it would be another share of the width between rows, which the command moves."""
    assert "row_width" not in movable()
    assert movable()["picking_rate"] == "Bins an hour each"


# What is asked, and words of the message.
WRONG = [
    (dict(budget="soon"), "Time to take, s: must be a number"),
    (dict(moved=("rows",), far="far"), "How far: must be a share such as 20 %"),
    (dict(moved=("rows",), far="120 %"), "How far: must be a share such as 20 %"),
    (dict(moved=("row_length",), far="1,250-3"), "write 1.25 or 1250"),
    (dict(far="20 %"), "How far: choose under “What is moved” which value"),
    (dict(moved=("rows", "carriers"), far="2-4"), "How far: from where to where is of one value"),
    (dict(moved=tuple(movable())[:17]), "What is moved: must be at most 16 values"),
    (
        dict(moved=("picking.failure.mean_between",)),
        "Time between failures: it is not set, so no share of it can be moved; enter under “How",
    ),
    (dict(moved=("picking_rate",), far="0,01-99999"), "Bins an hour each: must lie between"),
]


@pytest.mark.parametrize(("settings", "words"), WRONG, ids=[words[:25] for _, words in WRONG])
def test_what_is_wrong_is_told_by_the_label_of_its_field(settings, words):
    assert words in SensitivitySettings(**settings).problem_with(ORCHARD)


def test_who_is_away_is_asked_of_one_harvest():
    ill = Scenario(rows=3, picker_absences={"picker_02": [[0.0, 1.0]]})
    assert SensitivitySettings().problem_with(ill) == ""
    assert "Horizon: " in SensitivitySettings(horizon="long").problem_with(ill)
