"""The command `orchard secure`: makes the certificates of a secured run."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from typer import Argument

from orchard.field.problems import ScenarioError
from orchard.folders import named
from orchard.launch.request import agent_names, shares
from orchard.launch.scenarios import scenario_of
from orchard.security.identity import bridge_roles, host_roles, make
from orchard.terminal.exits import exit_on_errors
from orchard.terminal.options import File, Hosts, Pickers, Rows, flag, option, with_options
from orchard.terminal.output import print_line

_BRIDGE = (
    "A bridge to ROS 2 that may drive these robots; "
    "simulation: may pause, step, reset and end the run (repeatable)."
)


@dataclass(frozen=True, kw_only=True)
class SecureOptions:
    """The options of `secure`, in the order of --help."""

    folder: Annotated[Path, Argument(metavar="DIR", help="Directory for the certificates.")]
    scenario: File = None
    rows: Rows = None
    pickers: Pickers = None
    carriers: int | None = option(None, "Carriers, 1 to 120.")
    hosts: Hosts = None
    role: list[str] | None = option(
        None, "One host for exactly these agents (repeatable).", "NAME=KIND|AGENT,..."
    )
    bridge: list[str] | None = option(None, _BRIDGE, "NAME[=KIND|AGENT|simulation,...]")
    address: list[str] | None = option(
        None, "Address at which other machines reach this one (repeatable).", "NAME|IP"
    )
    days: float = option(
        None, "Days for which the certificates are valid.", default=365, min=1, max=3650
    )
    anew: bool = flag(None, "--anew", "Replace the files of an earlier call.")


@with_options(SecureOptions)
def secure(chosen: SecureOptions) -> None:
    """Make certificates and access rules, so that each process does only what its role allows."""
    with exit_on_errors(ScenarioError, OSError, ValueError):
        sizes = {"rows": chosen.rows, "pickers": chosen.pickers, "carriers": chosen.carriers}
        names = agent_names(scenario_of(chosen.scenario, sizes))
        # The agents without a --role are shared among --hosts.
        hosts = host_roles(names, chosen.role or (), lambda rest: shares(rest, chosen.hosts))
        bridges = bridge_roles(names, chosen.bridge or ())
        clients = hosts + bridges
        with named(chosen.folder):
            roles = make(chosen.folder, clients, chosen.address or (), chosen.days, chosen.anew)
    for role in roles:
        print_line(f"{chosen.folder / role.name}: {', '.join(role.names) or role.duty}")
