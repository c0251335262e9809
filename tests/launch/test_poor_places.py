"""Without stdout, a working folder or enough files, and with settings of no use: words, and no
traceback.

Real processes, as a shell starts them. In a shell `>&-` closes stdout, `<&-` stdin, and `2>&-`
stderr; `ulimit -n` sets how many files a program may open at once.
"""

import pytest
from command_line import summary_of
from made_surveys import UNEQUAL, points_of, write_geojson
from secured_run import make_roles
from shell import shell

from orchard.net.endpoints import BusError
from orchard.net.zenoh_bus import check_runtime
from orchard.security.identity import identity_in
from orchard.wire.keys import PREFIX

SHORT = "--rows 3 --duration 1 --hosts 1 --record none"


@pytest.mark.parametrize("mode", ["local", "lockstep"])
def test_a_run_without_stdout_says_so_and_goes_on(mode, tmp_path):
    line = f"orchard {SHORT} --mode {mode} --summary summary.json >&-"
    code, err = shell(line, tmp_path)
    assert code == 0, err
    assert "stdout cannot be written: it is closed; the run goes on without it" in err
    assert "Ended by --duration" in err
    assert summary_of(tmp_path / "summary.json")["ticks"] == 10


def test_a_run_without_standard_streams_writes_its_summary(tmp_path):
    """The run has neither stdin nor stdout nor stderr."""
    line = f"orchard {SHORT} --mode local --summary summary.json <&- >&- 2>&-"
    assert shell(line, tmp_path) == (1, "")
    assert summary_of(tmp_path / "summary.json")["ticks"] == 10


@pytest.mark.parametrize("command", ["--help", "--version", "layout --help"])
@pytest.mark.parametrize(
    ("to", "why"), [(">&-", "it is closed"), (">/dev/full", "No space left on device")]
)
def test_help_that_cannot_be_written_is_told(command, to, why, tmp_path):
    """`to`: where the shell sends stdout."""
    code, err = shell(f"orchard {command} {to}", tmp_path)
    assert code == 2
    assert err == f"stdout cannot be written: {why}\n"


# Commands whose answer goes to stdout.
ANSWERS = [
    "bound small.yaml --work 0.1",
    "layout import rows.geojson",
    "layout export small.yaml --lif roads.json",
    "secure certificates",
]


@pytest.mark.parametrize("command", ANSWERS)
@pytest.mark.parametrize(
    ("to", "why"), [(">&-", "it is closed"), (">/dev/full", "No space left on device")]
)
def test_an_answer_that_cannot_be_written_is_a_failure(command, to, why, tmp_path):
    (tmp_path / "small.yaml").write_text("rows: 3\npeople: {workers: 0, visitors: 0}\n")
    lines = {f"r{number}": points_of(row) for number, row in enumerate(UNEQUAL)}
    write_geojson(tmp_path / "rows.geojson", lines)
    code, err = shell(f"orchard {command} {to}", tmp_path)
    assert code == 1, err
    assert f"stdout cannot be written: {why}" in err


@pytest.mark.parametrize("command", [SHORT, "study --budget 1s", "stop", "view"])
def test_a_working_folder_that_is_gone_is_told(command, tmp_path):
    (tmp_path / "gone").mkdir()
    code, err = shell(f"cd gone && rmdir ../gone && orchard {command}", tmp_path)
    assert code == 2
    assert err == (
        "the folder in which this was started is not there any more; start it in another one\n"
    )


def test_a_limit_of_files_that_is_too_low_is_told(tmp_path):
    """The message says how many files the processes of this run need in all."""
    code, err = shell(f"ulimit -n 24; orchard {SHORT}", tmp_path)
    assert code == 2
    assert err == (
        "this program may open 24 files at once, and 4 processes need 68; "
        "`ulimit -n 68` allows them, and --mode local needs fewer\n"
    )


@pytest.mark.parametrize(
    ("command", "needs"),
    [
        ("app --quiet --port 0", "the page needs 128"),
        (f"{SHORT} --mode local --web 9291", "a viewer in a browser needs 48"),
    ],
)
def test_a_limit_of_files_that_is_too_low_to_serve_is_told(command, needs, tmp_path):
    code, err = shell(f"ulimit -n 24; orchard {command}", tmp_path)
    assert code == 2, err
    allowed = needs.rpartition(" ")[2]
    assert err.endswith(
        f"this program may open 24 files at once, and {needs}; `ulimit -n {allowed}` allows them\n"
    )


def test_a_limit_of_files_that_can_be_raised_is_raised(tmp_path):
    """`ulimit -Sn` sets the soft limit, which a program may raise up to the hard one."""
    line = f"ulimit -Sn 24; orchard {SHORT} --summary summary.json"
    code, err = shell(line, tmp_path)
    assert code == 0, err
    assert summary_of(tmp_path / "summary.json")["ticks"] == 10


@pytest.mark.parametrize("command", [SHORT, "stop --connect tcp/127.0.0.1:9"])
def test_a_runtime_that_zenoh_does_not_know_is_told(command, tmp_path):
    code, err = shell(f"ZENOH_RUNTIME=nonsense orchard {command}", tmp_path)
    assert code == 2
    assert err.startswith("ZENOH_RUNTIME=nonsense: expected a value that Zenoh knows, or none; ")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("runtime", "key"),
    # Also as a number of another base, and with a comment.
    [
        ("(rx: (worker_threads: 0))", "worker_threads"),
        ("(acc:(worker_threads:0x0 /* none */,))", "worker_threads"),
        ("(rx: (max_blocking_threads: 0))", "max_blocking_threads"),
    ],
)
def test_a_runtime_without_threads_is_told(runtime, key, monkeypatch):
    """Zenoh starts these threads when something connects, and would end the process then."""
    monkeypatch.setenv("ZENOH_RUNTIME", runtime)
    with pytest.raises(BusError) as refused:
        check_runtime()
    assert str(refused.value) == f"ZENOH_RUNTIME={runtime}: {key} must be 1 or more"


def test_a_runtime_of_the_users_own_is_used(tmp_path):
    line = f"ZENOH_RUNTIME='(rx: (worker_threads: 1))' orchard {SHORT} --summary summary.json"
    code, err = shell(line, tmp_path)
    assert code == 0, err
    assert summary_of(tmp_path / "summary.json")["ticks"] == 10


@pytest.mark.parametrize(
    "name", ["key.pem", "certificate.pem", "authority.pem", "role.json", "access.json"]
)
def test_a_file_of_a_role_that_never_ends_is_refused(name, tmp_path):
    """A role is a folder of certificates and rights. /dev/zero has no end."""
    role = make_roles(tmp_path / "roles") / "physics"
    (role / name).unlink()
    (role / name).symlink_to("/dev/zero")
    with pytest.raises(ValueError, match=rf"{name}: .*is no regular file|may not listen"):
        identity_in(str(role), PREFIX).rules()
