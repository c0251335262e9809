"""An option with one value that is given twice: the last value counts, and a message says so."""

import pytest
from command_line import orchard


# Each command ends with code 2, for there is no file no.yaml.
@pytest.mark.parametrize(
    ("command", "name"),
    [
        (["no.yaml", "--rows", "3", "--rows", "4"], "--rows"),
        (["bound", "no.yaml", "--work", "1", "--work=2"], "--work"),
        (["study", "no.yaml", "--budget", "1s", "--budget", "2s"], "--budget"),
        (["layout", "export", "no.yaml", "--lif", "a", "--lif", "b"], "--lif"),
    ],
)
def test_a_value_that_is_lost_is_told(command, name, tmp_path):
    done = orchard(*command, code=2, folder=tmp_path)
    assert f"{name}: given twice; the last value counts\n" in done.stderr


def test_options_with_several_values_may_be_repeated(tmp_path):
    done = orchard("--mode", "local", "--without", "carrier", "--without", "picker", code=2)
    assert "twice" not in done.stderr
