"""`mecazen keys create`: an authority and a certificate for each part, and no way around."""

import ipaddress
import json
import os

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import NameOID
from harness import error_of
from mecazen.bus.session import session_config
from mecazen.config import BusConfig
from mecazen.errors import MecazenError
from mecazen.schema import Folder
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


@pytest.mark.parametrize("mode", ["router", "peer"])
def test_keys_make_all_links_tls_also_beyond_loopback(folder, mode):
    keys = Folder(folder)
    config = session_config(BusConfig(connect=("tls/0.0.0.0:7447",), keys=keys), mode, "physics")
    assert json.loads(config.get_json("transport/link/protocols")) == ["tls"]
    assert config.get_json("transport/link/tls/enable_mtls") == "true"
    private_key = json.loads(config.get_json("transport/link/tls/listen_private_key"))
    assert private_key == str(folder / "physics.key")
    config = session_config(BusConfig(keys=keys), mode)
    assert "tls/127.0.0.1:" in config.get_json("listen/endpoints")
