"""Commands that the page starts: the settings of a run or a study become options."""

import pytest

from orchard.app.command import Files, fresh_files
from orchard.app.harvest_run import RunSettings, command
from orchard.app.study_run import StudySettings, study_command
from orchard.field.scenario import Scenario

# Settings of mode, speed and duration as they are typed; field -> words of the message there.
WRONG_PACES = [
    (RunSettings("lockstep", "max"), {"speed": "from 0.1 to 1000"}),
    (RunSettings("realtime", "max"), {"speed": "it cannot be max"}),
    (RunSettings("realtime", "", as_fast_as_it_goes=True), {"speed": "it cannot be max"}),
    (
        RunSettings("local", "1,250", "-1"),
        {"speed": "1,250 may mean 1.25 or 1250: write 1.25", "duration": "from 1 to 1000000"},
    ),
    (RunSettings("local", "8", "300 h"), {"duration": "a unit such as 7.5 h or 90 min"}),
    (
        RunSettings("local", "", "soon", as_fast_as_it_goes=True),
        {"duration": "empty: the whole harvest"},
    ),
]


@pytest.mark.parametrize(("pace", "words"), WRONG_PACES)
def test_what_is_wrong_with_a_pace_is_told_at_its_field(pace, words):
    assert pace.problems.keys() == words.keys()
    for name, part in words.items():
        assert part in pace.problems[name]


@pytest.mark.parametrize(
    ("pace", "options"),
    [
        (
            RunSettings("realtime", "12", "090.5", as_fast_as_it_goes=True),
            {"--mode": "realtime", "--speed": "12", "--duration": "90.5"},
        ),
        (
            RunSettings("lockstep", "", " ", as_fast_as_it_goes=True),
            {"--mode": "lockstep", "--speed": "max"},
        ),
        (
            RunSettings("local", "8", "7,5 h"),
            {"--mode": "local", "--speed": "8", "--duration": "27000"},
        ),
        (
            RunSettings("local", "0,125", "1000000"),
            {"--mode": "local", "--speed": "0.125", "--duration": "1000000"},
        ),
    ],
)
def test_a_pace_becomes_options_of_run_py(tmp_path, pace, options):
    """As fast as it goes is `--speed max`. In realtime that does not apply, and the speed counts.
    An empty duration is no option.
    """
    words = command(pace, Files(tmp_path, "run"), web_port=9090)
    for option in ("--mode", "--speed", "--duration"):
        value = words[words.index(option) + 1] if option in words else None
        assert value == options.get(option)


def test_when_a_run_ends_is_said():
    assert RunSettings(duration="7.5 h").end == "after 7:30:00 h, simulated"
    assert RunSettings(duration="90").end == "after 1:30 min, simulated"
    assert RunSettings(duration="").end == RunSettings(duration="soon").end == ""


def test_two_runs_of_a_second_have_files_of_their_own(tmp_path):
    """The name of a file has the time to a second, so more than that must tell them apart."""
    assert len({fresh_files(tmp_path, "harvest").scenario for _ in range(5)}) == 5


def test_the_page_asks_as_a_user_would_type_it(tmp_path):
    settings = StudySettings(dispatch=("nearest", "predictive"), horizon="harvest")
    command_line = study_command(Scenario(), settings, Files(tmp_path, "study"))
    words = command_line[command_line.index("study") : command_line.index("--progress")]
    # words[1] is the scenario's file.
    assert words[2:] == [
        "--vary",
        "carriers",
        "--vary",
        "dispatch=nearest,predictive",
        "--horizon",
        "harvest",
        "--budget",
        "300s",
    ]
