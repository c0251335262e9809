"""An option that has one value is refused if it is given twice: one value would be lost."""

import pytest
from command_line import orchard


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (["--rows", "3", "--rows", "4"], "--rows"),
        (["bound", "--work", "1", "--work=2"], "--work"),
        (["study", "--budget", "1s", "--budget", "2s"], "--budget"),
        (["layout", "export", "--lif", "a", "--lif", "b"], "--lif"),
    ],
)
def test_an_option_with_one_value_is_given_once(command, name, tmp_path):
    done = orchard(*command, code=2, folder=tmp_path)
    assert done.stderr == f"{name}: given twice; it has one value\n"


def test_options_with_several_values_may_be_repeated(tmp_path):
    done = orchard("--mode", "local", "--without", "carrier", "--without", "picker", code=2)
    assert "twice" not in done.stderr
