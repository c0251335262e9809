"""Certificates on the curve P-256: an authority, what it issues, and checks.

Only this module imports `cryptography`; identity.py uses it.

An authority signs the certificates of all roles with its key, which never leaves its directory. A
process verifies the certificate of another one with the authority's certificate.
"""

import ipaddress
import os
import secrets
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TypeVar

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.types import PrivateKeyTypes
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from orchard.folders import regular
from orchard.security.roles import AUTHORITY, CERTIFICATE, KEY, Role

T = TypeVar("T")
# So long before it is made a certificate is valid: another machine's clock may be behind.
EARLIER = timedelta(hours=1)
PEM = serialization.Encoding.PEM
# What a certificate is for: to accept connections, and to make them.
SERVES = ExtendedKeyUsageOID.SERVER_AUTH
CALLS = ExtendedKeyUsageOID.CLIENT_AUTH


@dataclass(frozen=True)
class Authority:
    """The issuer of all roles' certificates."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    @classmethod
    def begin(cls, days: float) -> "Authority":
        """Return a new authority with a random name, valid for `days` days. Its key only signs."""
        name = f"orchard {secrets.token_hex(8)}"
        key = ec.generate_private_key(ec.SECP256R1())
        draft = _draft(_name(name), _name(name), key, datetime.now(UTC) + timedelta(days=days))
        # `path_length` 0: what it issues is no authority itself.
        draft = draft.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        never = (
            "digital_signature",
            "content_commitment",
            "key_encipherment",
            "data_encipherment",
            "key_agreement",
        )
        only = x509.KeyUsage(
            **dict.fromkeys(never, False),
            key_cert_sign=True,
            crl_sign=True,
            encipher_only=False,
            decipher_only=False,
        )
        return cls(draft.add_extension(only, critical=True).sign(key, hashes.SHA256()), key)

    def write(self, folder: Path) -> None:
        """Write the authority's certificate and its key into its directory."""
        _write(folder, self.certificate, self.key)

    def vouch(
        self, role: Role, folder: Path, addresses: Iterable[str] = (), until: datetime | None = None
    ) -> None:
        """Write a role's certificate, its key and the authority's certificate.

        `until`: when the role's certificate expires; None: with the authority's. Only a role with
        `addresses` can accept connections. Raises ValueError for an address that is malformed.
        """
        key = ec.generate_private_key(ec.SECP256R1())
        draft = _draft(
            _name(role.name, role.digest),
            self.certificate.subject,
            key,
            until or self.certificate.not_valid_after_utc,
        )
        draft = draft.add_extension(
            x509.BasicConstraints(ca=False, path_length=None), critical=True
        )
        names = [address(text) for text in addresses]
        usages = [CALLS]
        if names:
            usages = [SERVES, CALLS]
        draft = draft.add_extension(x509.ExtendedKeyUsage(usages), critical=False)
        if names:
            draft = draft.add_extension(x509.SubjectAlternativeName(names), critical=False)
        _write(folder, draft.sign(self.key, hashes.SHA256()), key)
        (folder / AUTHORITY).write_bytes(self.certificate.public_bytes(PEM))


def _draft(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, until: datetime
) -> x509.CertificateBuilder:
    """Return a certificate with names, key and validity, to which extensions are added."""
    begin = min(datetime.now(UTC), until) - EARLIER
    draft = x509.CertificateBuilder(issuer, subject, key.public_key(), x509.random_serial_number())
    return draft.not_valid_before(begin).not_valid_after(until)


def _name(text: str, digest: str = "") -> x509.Name:
    """Return the name in a certificate. `digest`: that of a role, see `Role.digest`."""
    attributes = []
    if text:
        attributes.append(x509.NameAttribute(NameOID.COMMON_NAME, text))
    if digest:
        attributes.append(x509.NameAttribute(NameOID.SERIAL_NUMBER, digest))
    return x509.Name(attributes)


def _attribute(name: x509.Name, oid: x509.ObjectIdentifier) -> str:
    """Return an attribute of the name in a certificate; '' if it has none."""
    attributes = name.get_attributes_for_oid(oid)
    if not attributes:
        return ""
    return str(attributes[0].value)


def _is_label(part: str) -> bool:
    """Whether a text may stand between two dots in the name of a machine."""
    return part.isascii() and part.replace("-", "").isalnum()


def address(text: str) -> x509.GeneralName:
    """Return an IP address, or the name of a machine, for a certificate.

    Raises ValueError if the text is neither.
    """
    try:
        return x509.IPAddress(ipaddress.ip_address(text))
    except ValueError:
        if not all(map(_is_label, text.split("."))):
            raise ValueError(
                f"{text}: neither an address nor the name of a machine; examples: 192.168.1.10, "
                "shed.local"
            ) from None
        return x509.DNSName(text)


def _write(folder: Path, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> None:
    """Write a certificate and its key, which only the owner of the file can read."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    (folder / CERTIFICATE).write_bytes(certificate.public_bytes(PEM))
    secret = key.private_bytes(PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    # A new file is made with the mode of a secret; an old one would keep its own.
    (folder / KEY).unlink(missing_ok=True)
    with open(os.open(folder / KEY, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(secret)


# -- checks of the files that a user names


def check(folder: Path, role: Role) -> None:
    """Raise ValueError if a file of the role cannot be used.

    It is missing, of another role, not of this authority, or not valid now.
    """
    certificate = _certificate(folder / CERTIFICATE)
    authority = _certificate(folder / AUTHORITY)
    name = _attribute(certificate.subject, NameOID.COMMON_NAME)
    if name != role.name:
        raise ValueError(
            f"{folder / CERTIFICATE}: this is the certificate of {name}, not of {role.name}"
        )
    try:
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature):
        raise ValueError(
            f"{folder / CERTIFICATE}: not issued by {AUTHORITY} beside it; are both from one "
            "directory?"
        ) from None
    key = _read(folder / KEY, _private_key, "not a private key without a password")
    if key.public_key() != certificate.public_key():
        raise ValueError(f"{folder / KEY}: not the key of the certificate beside it")
    if _attribute(certificate.subject, NameOID.SERIAL_NUMBER) != role.digest:
        change = f"role.json has changed (duty {role.duty}, names {', '.join(role.names)})"
        raise ValueError(
            f"{folder}: {change}, and a router does not grant that; `orchard secure --anew` "
            "makes new roles"
        )
    for checked in (certificate, authority):
        begin = checked.not_valid_before_utc
        end = checked.not_valid_after_utc
        if not begin <= datetime.now(UTC) <= end:
            span = f"from {begin:%Y-%m-%d %H:%M} to {end:%Y-%m-%d %H:%M} UTC"
            raise ValueError(
                f"{folder}: its certificate is valid {span}, not now; `orchard secure --anew` "
                "makes new ones"
            )


def _certificate(path: Path) -> x509.Certificate:
    """Return the certificate in a file. Raises ValueError."""
    return _read(path, x509.load_pem_x509_certificate, "not a certificate")


def _private_key(data: bytes) -> PrivateKeyTypes:
    """Return a private key. Raises ValueError or TypeError if it has a password, or is none."""
    return serialization.load_pem_private_key(data, password=None)


def _read(path: Path, load: Callable[[bytes], T], fault: str) -> T:
    """Return what `load` makes of a file. Raises ValueError, with `fault` if `load` fails."""
    try:
        return load(regular(path).read_bytes())
    except OSError as error:
        raise ValueError(f"{path}: {(error.strerror or 'cannot be read').lower()}") from error
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {fault}") from error
