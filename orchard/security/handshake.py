"""Why two machines do not trust each other: the connection once more, by hand, with what went wrong in words."""

import socket
import ssl
from pathlib import Path

from orchard.security.roles import AUTHORITY, CERTIFICATE, KEY

SECONDS = 3.0  # that the other side may take for each step


def why_no_trust(endpoint: str, folder: Path) -> str:
    """What is wrong between a role's files and who listens at tls/host:port; '' if that is not what is wrong."""
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    trust = ssl.create_default_context(cafile=folder / AUTHORITY)
    trust.load_cert_chain(folder / CERTIFICATE, folder / KEY)
    host = host.strip("[]")
    try:
        with socket.create_connection((host, int(port)), SECONDS) as plain, trust.wrap_socket(plain, server_hostname=host) as secured:
            return _verdict(secured)
    except ssl.SSLCertVerificationError as error:
        return f"somebody listens there whom {folder / AUTHORITY} does not vouch for: {error.verify_message}"
    except ssl.SSLError as error:
        return f"who listens there does not speak TLS, or wants none of {folder}: {_words(error)}"
    except (OSError, ValueError):
        return ""


def _verdict(secured: ssl.SSLSocket) -> str:
    """What the other side makes of this one's certificate, which it tells only after the handshake."""
    try:
        secured.recv(1)
    except TimeoutError:
        return "the session is refused, although the certificates are good; is this role at work there already?"
    return ""


def _words(error: ssl.SSLError) -> str:
    return (error.reason or str(error)).replace("_", " ").lower()
