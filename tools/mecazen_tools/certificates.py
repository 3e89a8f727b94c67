"""A private certificate authority: one certificate for each service and for the operator."""

from __future__ import annotations

import ipaddress
import os
import shutil
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from mecazen.bus.session import AUTHORITY, OPERATOR
from mecazen.errors import MecazenError
from mecazen.graph import SERVICES

if TYPE_CHECKING:
    from cryptography import x509

NAMES = ("router", *SERVICES, OPERATOR)
LOOPBACK = ("localhost", "127.0.0.1", "::1")
VALID_DAYS = 3650
NO_USE = (
    *("digital_signature", "content_commitment", "key_encipherment", "data_encipherment"),
    *("key_agreement", "encipher_only", "decipher_only"),
)
"""Key usages that the authority's key does not have: it only signs certificates."""


def create(folder: Path, hosts: Sequence[str] = ()) -> None:
    """Write the authority's certificate, and a certificate and a private key for each name.

    The common name of a certificate is the service's name; it is valid for loopback and for
    `hosts`. The private key of the authority is not written, so no one can sign further
    certificates. To add a host or to replace a lost key, create all certificates again.

    Raises:
        MecazenError: The folder exists, a host is invalid, or the library is missing.
    """
    try:
        from cryptography import x509  # noqa: PLC0415  # needed by nothing else
        from cryptography.hazmat.primitives.asymmetric import ec  # noqa: PLC0415
        from cryptography.hazmat.primitives.hashes import SHA256  # noqa: PLC0415
        from cryptography.hazmat.primitives.serialization import (  # noqa: PLC0415
            Encoding,
            NoEncryption,
            PrivateFormat,
        )
        from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID  # noqa: PLC0415
    except ImportError:
        raise MecazenError(
            "keys need the library cryptography: pip install 'mecazen[keys]'"
        ) from None

    places = x509.SubjectAlternativeName([_place(host) for host in (*LOOPBACK, *hosts)])
    now = datetime.now(UTC)
    authority_key = ec.generate_private_key(ec.SECP256R1())
    authority_name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "mecazen")])

    def begin(subject: x509.Name, key: ec.EllipticCurvePrivateKey) -> x509.CertificateBuilder:
        return (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(authority_name)
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            # tolerate clocks that differ by up to a day
            .not_valid_before(now - timedelta(days=1))
            .not_valid_after(now + timedelta(days=VALID_DAYS))
        )

    authority = (
        begin(authority_name, authority_key)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(
            x509.KeyUsage(**dict.fromkeys(NO_USE, False), key_cert_sign=True, crl_sign=True),
            critical=True,
        )
        .sign(authority_key, SHA256())
    )
    files = {f"{AUTHORITY}.crt": authority.public_bytes(Encoding.PEM)}
    # each certificate is for both: a peer listens and connects
    usage = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
    for name in NAMES:
        key = ec.generate_private_key(ec.SECP256R1())
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        certificate = (
            begin(subject, key)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage(usage), critical=False)
            .add_extension(places, critical=False)
            .sign(authority_key, SHA256())
        )
        files[f"{name}.crt"] = certificate.public_bytes(Encoding.PEM)
        files[f"{name}.key"] = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    _write(folder, files)


def _place(host: str) -> x509.GeneralName:
    """Return a host as a name in a certificate.

    Raises:
        MecazenError: The host is neither an address nor a name.
    """
    from cryptography import x509  # noqa: PLC0415

    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        labels = host.split(".")
    else:
        if address.is_unspecified or address.is_multicast:
            raise MecazenError(
                f"--host {host}: the address of no host; name one that tools connect to"
            )
        return x509.IPAddress(address)
    fine = all(label and label.isascii() and label.replace("-", "").isalnum() for label in labels)
    if not fine or labels[-1].isdigit():
        raise MecazenError(f"--host {host}: neither an IP address nor a host's name")
    return x509.DNSName(host)


def _write(folder: Path, files: dict[str, bytes]) -> None:
    try:
        folder.mkdir(mode=0o700, parents=True)
    except FileExistsError:
        raise MecazenError(
            f"{folder}: is there already, and nothing in it is overwritten; name another folder"
        ) from None
    except OSError as error:
        raise MecazenError(f"{folder}: can't be made: {error.strerror}") from None
    try:
        for name, data in files.items():
            mode = 0o600 if name.endswith(".key") else 0o644
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
            with open(os.open(folder / name, flags, mode), "wb") as file:  # noqa: PTH123
                file.write(data)
    except OSError as error:
        # an incomplete folder would be useless, and would block the next attempt
        shutil.rmtree(folder, ignore_errors=True)
        raise MecazenError(f"{folder}: can't be written: {error.strerror}") from None
