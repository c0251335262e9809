"""The bridge's role in a secured run: the directory that `orchard secure --bridge NAME` makes.

The run's router enforces what it may do.
"""

import json
import socket
import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# Time that the other side has for each step, when the bridge finds out why it cannot connect.
SECONDS = 3.0
MADE_BY = "`orchard secure DIR --bridge NAME=...` makes one, as DIR/NAME"
DUTIES = {
    "bridge": False,
    "operating-bridge": True,
}  # whether it may pause, step, reset and end the run


@dataclass(frozen=True)
class Role:
    """A role, and the directory with its certificate. `robots`: those that it may drive."""

    name: str
    session: str
    robots: tuple[str, ...]
    may_operate: bool
    folder: Path

    def file(self, name: str) -> str:
        """Return the path of one of the role's files."""
        return str(self.folder / f"{name}.pem")

    def settings(self) -> dict[str, Any]:
        """Return the settings of Zenoh with which the router knows this role."""
        files = {
            "root_ca_certificate": "authority",
            "connect_certificate": "certificate",
            "connect_private_key": "key",
        }
        tls = {setting: self.file(name) for setting, name in files.items()} | {
            "enable_mtls": True,
            "close_link_on_expiration": True,
        }
        return {"id": self.session} | {
            f"transport/link/tls/{setting}": value for setting, value in tls.items()
        }

    def why_no_trust(self, endpoint: str) -> str:
        """Return why this role and the process at tls/host:port refuse each other's certificates;
        '' if they do not, or nothing listens.
        """
        host, _, port = endpoint.partition("/")[2].rpartition(":")
        host = host.strip("[]")
        try:
            trust = ssl.create_default_context(cafile=self.file("authority"))
            trust.load_cert_chain(self.file("certificate"), self.file("key"))
            with (
                socket.create_connection((host, int(port)), SECONDS) as plain,
                trust.wrap_socket(plain, server_hostname=host) as secured,
            ):
                secured.recv(
                    1
                )  # the other side reports on this certificate only after the handshake
        except ssl.SSLEOFError:
            pass  # that process begins, or ends
        except ssl.SSLError as error:
            return (
                f"it and the certificates in {self.folder} do not accept each other:"
                f" {error.reason or error}"
            )
        except (OSError, ValueError):
            pass
        return ""


def role_in(folder: str) -> Role:
    """Return the role of a directory. Raises ValueError if it has none for a bridge."""
    try:
        data = json.loads((Path(folder) / "role.json").read_text())
        role = Role(
            data["name"],
            data["session"],
            tuple(data["names"]),
            DUTIES[data["duty"]],
            Path(folder).resolve(),
        )
    except FileNotFoundError:
        raise ValueError(
            f"{folder}: not the directory of a role: no role.json in it; {MADE_BY}"
        ) from None
    except KeyError as error:
        raise ValueError(f"{folder}: not the role of a bridge ({error}); {MADE_BY}") from None
    except (OSError, ValueError, TypeError) as error:
        raise ValueError(f"{folder}/role.json: not as `orchard secure` wrote it: {error}") from None
    if missing := [
        name for name in ("authority", "certificate", "key") if not Path(role.file(name)).is_file()
    ]:
        raise ValueError(f"{folder}: {', '.join(missing)}.pem is missing; {MADE_BY}")
    return role
