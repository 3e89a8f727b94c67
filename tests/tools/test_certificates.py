"""`mecazen keys create`: an authority and a certificate for each part, and no way around."""

import ipaddress
import os

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import NameOID
from harness import error_of
from mecazen.errors import MecazenError
from mecazen_tools import certificates


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Keys that are made under a lax umask."""
    made = tmp_path_factory.mktemp("authority") / "keys"
    before = os.umask(0)
    try:
        certificates.create(made, ["robot.local", "192.168.1.7", "fe80::1"])
    finally:
        os.umask(before)
    return made


def load(folder, name):
    return x509.load_pem_x509_certificate((folder / f"{name}.crt").read_bytes())


def test_each_service_has_a_certificate_that_signs_nothing(folder):
    assert sorted(file.stem for file in folder.glob("*.key")) == sorted(certificates.NAMES)
    for name in certificates.NAMES:
        certificate = load(folder, name)
        (common_name,) = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
        assert common_name.value == name
        certificate.verify_directly_issued_by(load(folder, "ca"))
        key = load_pem_private_key((folder / f"{name}.key").read_bytes(), None)
        assert key.public_key() == certificate.public_key()
        constraints = certificate.extensions.get_extension_for_class(x509.BasicConstraints)
        assert not constraints.value.ca


def test_certificates_are_valid_for_loopback_and_the_hosts(folder):
    hosts = load(folder, "physics").extensions.get_extension_for_class(x509.SubjectAlternativeName)
    assert hosts.value.get_values_for_type(x509.DNSName) == ["localhost", "robot.local"]
    assert hosts.value.get_values_for_type(x509.IPAddress) == [
        *map(ipaddress.ip_address, ("127.0.0.1", "::1", "192.168.1.7", "fe80::1"))
    ]


def test_keys_are_private_and_never_overwritten(folder):
    files = {file: (file.stat().st_mode & 0o777, file.read_bytes()) for file in folder.iterdir()}
    assert folder.stat().st_mode & 0o777 == 0o700
    assert {mode for file, (mode, _) in files.items() if file.suffix == ".key"} == {0o600}
    error = error_of(MecazenError, lambda: certificates.create(folder))
    assert error.startswith(f"{folder}: is there already")
    assert all(file.read_bytes() == data for file, (_, data) in files.items())


@pytest.mark.parametrize("host", ["", "256.1.1.1", "a..b", "*", "ä.de", "::", "224.0.0.1"])
def test_a_wrong_host_leaves_no_folder(tmp_path, host):
    text = error_of(MecazenError, lambda: certificates.create(tmp_path / "keys", [host]))
    assert text.startswith(f"--host {host}: ")
    assert not (tmp_path / "keys").exists()
