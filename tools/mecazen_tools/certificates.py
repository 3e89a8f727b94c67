"""A private certificate authority: one certificate for each service and for the operator.

It needs the extra `keys`.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from mecazen.bus.session import AUTHORITY, OPERATOR
from mecazen.errors import MecazenError
from mecazen.graph import SERVICES

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
        MecazenError: The folder exists or can't be written, or a host is invalid.
    """
    hosts_name = x509.SubjectAlternativeName([_host_name(host) for host in (*LOOPBACK, *hosts)])
    authority_key = ec.generate_private_key(ec.SECP256R1())
    authority = (
        _certificate("mecazen", authority_key)
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
        certificate = (
            _certificate(name, key)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage(usage), critical=False)
            .add_extension(hosts_name, critical=False)
            .sign(authority_key, SHA256())
        )
        files[f"{name}.crt"] = certificate.public_bytes(Encoding.PEM)
        files[f"{name}.key"] = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    try:
        folder.mkdir(mode=0o700, parents=True)
        for file, data in files.items():
            mode = 0o600 if file.endswith(".key") else 0o644
            (folder / file).touch(mode)
            (folder / file).write_bytes(data)
    except FileExistsError:
        raise MecazenError(
            f"{folder}: is there already, and nothing in it is overwritten; name another folder"
        ) from None
    except OSError as error:
        raise MecazenError(f"{folder}: can't be written: {error.strerror}") from None


def _certificate(name: str, key: ec.EllipticCurvePrivateKey) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)]))
        .issuer_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "mecazen")]))
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        # tolerate clocks that differ by up to a day
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(days=VALID_DAYS))
    )


def _host_name(host: str) -> x509.GeneralName:
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
