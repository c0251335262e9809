"""The bridge's role in a secured run: the directory that `orchard secure --bridge NAME` makes.

The run's router enforces what it may do.
"""

import json
import socket
import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# Seconds that the other side has for each step, when the bridge finds out why it cannot connect.
SECONDS = 3.0
MADE_BY = "`orchard secure DIR --bridge NAME=...` makes one, as DIR/NAME"
# Duty of a role -> whether it may pause, step, reset and end the run.
DUTIES = {"bridge": False, "operating-bridge": True}
# Files of a role, without their ending.
FILES = ("authority", "certificate", "key")


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
        tls = "transport/link/tls"
        return {
            "id": self.session,
            f"{tls}/root_ca_certificate": self.file("authority"),
            f"{tls}/connect_certificate": self.file("certificate"),
            f"{tls}/connect_private_key": self.file("key"),
            f"{tls}/enable_mtls": True,
            f"{tls}/close_link_on_expiration": True,
        }

    def why_no_trust(self, endpoint: str) -> str:
        """Return why this role and the process at tls/host:port do not trust each other.

        Return '' if they accept each other's certificates, or nothing listens.
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
                # The other side reports on this certificate only after the handshake.
                secured.recv(1)
        except ssl.SSLEOFError:
            # That process begins, or ends.
            pass
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
            name=data["name"],
            session=data["session"],
            robots=tuple(data["names"]),
            may_operate=DUTIES[data["duty"]],
            folder=Path(folder).resolve(),
        )
    except FileNotFoundError:
        raise ValueError(
            f"{folder}: not the directory of a role: no role.json in it; {MADE_BY}"
        ) from None
    except KeyError as error:
        raise ValueError(f"{folder}: not the role of a bridge ({error}); {MADE_BY}") from None
    except (OSError, ValueError, TypeError) as error:
        raise ValueError(f"{folder}/role.json: not as `orchard secure` wrote it: {error}") from None
    missing = [name for name in FILES if not Path(role.file(name)).is_file()]
    if missing:
        raise ValueError(f"{folder}: {', '.join(missing)}.pem is missing; {MADE_BY}")
    return role
