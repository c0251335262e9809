"""The directory of roles: which user may read it, what `orchard secure` does not make, and what a user may get wrong."""

import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from local_runs import SMALL
from typer.testing import CliRunner

from orchard.field.scenario import to_yaml
from orchard.launch.commands import app, main
from orchard.security.certificates import Authority
from orchard.security.identity import Keyring
from orchard.security.roles import AUTHORITY

LONGEST = "w" * 64  # the longest name of an agent

# -- the directory


def test_keys_are_for_the_owners_eyes_only(folder):
    assert folder.stat().st_mode & 0o777 == 0o700
    for role in folder.iterdir():
        assert role.stat().st_mode & 0o777 == 0o700
        assert (role / "key.pem").stat().st_mode & 0o777 == 0o600


def secured(*arguments: object):
    """`orchard secure` in this process: what it printed, and its exit code."""
    return CliRunner().invoke(app, ["secure", *map(str, arguments)], catch_exceptions=False)


def test_an_authority_is_not_overwritten_unasked(tmp_path):
    path = tmp_path / "roles"
    assert secured(path, "--rows", 3, "--hosts", 2).exit_code == 0
    before = (path / "authority" / "key.pem").read_bytes()
    again = secured(path, "--rows", 3, "--hosts", 1)
    assert again.exit_code == 2
    assert "--anew" in again.stderr
    assert (path / "authority" / "key.pem").read_bytes() == before
    assert secured(path, "--rows", 3, "--hosts", 1, "--anew").exit_code == 0
    assert (path / "authority" / "key.pem").read_bytes() != before
    assert not (path / "agents_2").exists()


def test_each_agent_gets_a_role_however_long_its_name_is(tmp_path):
    (tmp_path / "own.yaml").write_text(f"agents_without_body: {{{LONGEST}: my_package.Weather}}")
    done = secured(tmp_path / "roles", tmp_path / "own.yaml", "--hosts", "each")
    assert done.exit_code == 0, done.stderr
    assert Keyring.load(tmp_path / "roles").of(LONGEST).role.names == (LONGEST,)


NO_ROLES = [
    (["--role", f"{LONGEST}x=carrier"], f"{LONGEST}x: not a name for a role; use up to 64 letters"),
    (["--role", "authority=carrier"], "authority: not a name for a role; the directory of this name"),
    (["--role", "shed"], "shed: expected NAME=KIND|AGENT"),
    (["--role", "Shed!=carrier"], "Shed!: not a name for a role"),
    (["--role", "physics=carrier"], "physics is the name of two roles"),
    (["--role", "shed=carier"], "carier: no such agent or kind"),
    (["--role", "shed=carrier", "--role", "barn=carrier_01"], "carrier_01 is in two roles"),
    (["--bridge", "ros2=carier"], "carier: no such agent or kind"),
    (["--bridge", "ROS 2"], "ROS 2: not a name for a role"),
    (["--address", "http://shed"], "http://shed: neither an address nor the name of a machine"),
]


@pytest.mark.parametrize(("arguments", "named"), NO_ROLES)
def test_what_cannot_be_made_is_named_and_nothing_is_written(arguments, named, tmp_path):
    done = secured(tmp_path / "roles", "--rows", 3, *arguments)
    assert done.exit_code == 2
    assert named in done.stderr
    assert not (tmp_path / "roles").exists()


def test_another_directorys_things_are_left_alone(tmp_path):
    (tmp_path / "diary.txt").write_text("dear diary")
    done = secured(tmp_path, "--rows", 3)
    assert done.exit_code == 2
    assert "it has other files" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["diary.txt"]


# -- what a user may get wrong


NO_RUNS = [
    (["--secure", "nowhere"], "nowhere: no roles there"),
    (["--secure", "{folder}", "--listen", "tcp/127.0.0.1:0"], "not secure; with --secure use an endpoint such as tls/"),
    (["--listen", "tls/127.0.0.1:0"], "tls needs certificates; --secure DIR"),
    (["--secure", "{folder}", "--pickers", 3], "no role for"),
    (["--secure", "{folder}", "--hosts", 2], "leave out --hosts"),
    (["--secure", "{folder}", "--mode", "local"], "local mode is one process"),
    (["--secure", "{folder}", "--without", "bin_01"], "ben is the role of bin_01, picker_02"),
    (["--secure", "{folder}", "--without", "bin_01"], "`orchard secure --role NAME=bin_01` gives the others a role of their own"),
    (["--secure", "{folder}/shed"], "shed: the role physics is not in it; it has shed"),
    (["--secure", "{folder}", "--connect", "tls/127.0.0.1:9", "--only", "carrier"], "with --only choose one of them: DIR/<role>"),
]


@pytest.mark.parametrize(("arguments", "named"), NO_RUNS)
def test_what_cannot_be_run_is_named(arguments, named, folder, tmp_path, monkeypatch, capfd):
    (tmp_path / "scenario.yaml").write_text(to_yaml(SMALL))
    words = [str(word).format(folder=folder) for word in arguments]
    guest = [] if "--only" in words else [tmp_path / "scenario.yaml", "--record", "none"]
    monkeypatch.setattr("sys.argv", ["orchard", "harvest", *map(str, guest), *words])
    with pytest.raises(SystemExit, match="2"):
        main()
    assert named in " ".join(capfd.readouterr().err.split())


@pytest.fixture
def roles(folder, tmp_path) -> Path:
    return shutil.copytree(folder, tmp_path / "roles")


def of_ben(own: Path, stranger: Path) -> None:
    for name in ("certificate.pem", "key.pem"):
        shutil.copy(own.parent / "ben" / name, own)


def expired(own: Path, stranger: Path) -> None:
    Authority.begin(30).vouch(Keyring.load(own).of("amy").role, own, until=datetime.now(UTC) - timedelta(minutes=1))


def with_more_names(own: Path, stranger: Path) -> None:
    (own / "role.json").write_text((own / "role.json").read_text().replace('"picker_01"', '"picker_01", "picker_02"'))


NO_USE = [  # what makes a role's directory useless -> what is said of it
    (lambda own, stranger: (own / "key.pem").unlink(), "key.pem: no such file"),
    (lambda own, stranger: shutil.copy(stranger / "amy" / "key.pem", own), "not the key of the certificate"),
    (lambda own, stranger: shutil.copy(stranger / "amy" / AUTHORITY, own), "not issued by authority.pem"),
    (of_ben, "the certificate of ben, not of amy"),
    (expired, "UTC, not now"),
    (lambda own, stranger: (own / "certificate.pem").write_text("nonsense"), "certificate.pem: not a certificate"),
    (lambda own, stranger: (own / "role.json").write_text("{}"), "role.json: not as `orchard secure` wrote it"),
    (with_more_names, "role.json has changed .duty host, names picker_01, picker_02."),
]


@pytest.mark.parametrize(("spoil", "named"), NO_USE)
def test_a_directory_of_no_use_is_named(spoil, named, roles, stranger):
    spoil(roles / "amy", stranger)
    with pytest.raises(ValueError, match=named):
        Keyring.load(roles).of("amy")


@pytest.mark.parametrize(
    "rules", ["{}", "", "[]", '{"enabled": false}', '{"enabled": true, "default_permission": "allow", "subjects": []}']
)
def test_access_rules_that_let_all_through_are_refused(rules, roles):
    (roles / "router" / "access.json").write_text(rules)
    with pytest.raises(ValueError, match=r"access\.json: "):
        Keyring.load(roles).of("router").rules()


def test_a_private_key_that_others_can_read_is_named(roles, caplog):
    key = roles / "amy" / "key.pem"
    Keyring.load(roles).of("amy")
    assert not caplog.records
    key.chmod(0o644)
    Keyring.load(roles).of("amy")
    assert f"{key}: other users can read this private key (mode 644)" in caplog.text
