"""`mecazen keys create`: an authority and a certificate for each part, and no way around."""

import ipaddress
import json
import os
import sys

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
    made = tmp_path_factory.mktemp("authority") / "keys"
    certificates.create(made, ["robot.local", "192.168.1.7", "fe80::1"])
    return made


def load(folder, name):
    return x509.load_pem_x509_certificate((folder / f"{name}.crt").read_bytes())


@pytest.mark.parametrize("name", certificates.NAMES)
def test_a_certificate_has_the_name_of_its_service_and_is_signed_by_the_authority(folder, name):
    certificate = load(folder, name)
    (common_name,) = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    assert common_name.value == name
    certificate.verify_directly_issued_by(load(folder, "ca"))
    key = load_pem_private_key((folder / f"{name}.key").read_bytes(), None)
    assert key.public_key() == certificate.public_key()


def test_certificates_are_valid_for_loopback_and_the_hosts_that_were_given(folder):
    places = load(folder, "physics").extensions.get_extension_for_class(x509.SubjectAlternativeName)
    assert places.value.get_values_for_type(x509.DNSName) == ["localhost", "robot.local"]
    expected = ["127.0.0.1", "::1", "192.168.1.7", "fe80::1"]
    assert places.value.get_values_for_type(x509.IPAddress) == [
        ipaddress.ip_address(address) for address in expected
    ]


def test_no_service_can_sign_and_the_authoritys_own_key_is_nowhere(folder):
    for name in certificates.NAMES:
        constraints = load(folder, name).extensions.get_extension_for_class(x509.BasicConstraints)
        assert not constraints.value.ca
    assert sorted(file.stem for file in folder.glob("*.key")) == sorted(certificates.NAMES)


def test_under_a_lax_umask_folder_and_keys_are_for_their_owner_alone_too(tmp_path):
    before = os.umask(0)
    try:
        certificates.create(tmp_path / "keys")
    finally:
        os.umask(before)
    modes = {file.name: file.stat().st_mode & 0o777 for file in (tmp_path / "keys").iterdir()}
    assert (tmp_path / "keys").stat().st_mode & 0o777 == 0o700
    assert {mode for name, mode in modes.items() if name.endswith(".key")} == {0o600}
    assert {mode for name, mode in modes.items() if name.endswith(".crt")} == {0o644}


def test_what_is_there_is_not_overwritten(folder):
    before = {file: file.read_bytes() for file in folder.iterdir()}
    assert error_of(MecazenError, lambda: certificates.create(folder)).startswith(
        f"{folder}: is there already"
    )
    assert {file: file.read_bytes() for file in folder.iterdir()} == before


UNREACHABLE = ["0.0.0.0", "::", "224.0.0.1", "ff02::1"]  # noqa: S104  # refused


@pytest.mark.parametrize("host", ["", "a b", "-/", "256.1.1.1", "a..b", "*", "ä.de", *UNREACHABLE])
def test_when_a_host_is_none_expect_one_line_and_no_folder(tmp_path, host):
    text = error_of(MecazenError, lambda: certificates.create(tmp_path / "keys", [host]))
    assert text.startswith(f"--host {host}: ")
    assert not (tmp_path / "keys").exists()


def test_when_the_folder_cant_be_made_expect_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    assert "can't be made" in error_of(
        MecazenError, lambda: certificates.create(tmp_path / "file" / "keys")
    )


def test_when_the_library_is_missing_expect_one_line_that_says_what_to_install(
    tmp_path, monkeypatch
):
    monkeypatch.setitem(sys.modules, "cryptography", None)
    text = error_of(MecazenError, lambda: certificates.create(tmp_path / "keys"))
    assert text == "keys need the library cryptography: pip install 'mecazen[keys]'"


@pytest.mark.parametrize("mode", ["router", "peer"])
def test_with_keys_all_links_are_tls_and_may_be_beyond_loopback(tmp_path, mode):
    certificates.create(tmp_path / "keys", ["robot.local"])
    folder = Folder(tmp_path / "keys")
    config = session_config(BusConfig(connect=("tls/0.0.0.0:7447",), keys=folder), mode, "physics")
    assert json.loads(config.get_json("transport/link/protocols")) == ["tls"]
    assert config.get_json("transport/link/tls/enable_mtls") == "true"
    own = json.loads(config.get_json("transport/link/tls/listen_private_key"))
    assert own == str(folder / "physics.key")
    usual = session_config(BusConfig(keys=folder), mode)
    assert "tls/127.0.0.1:" in usual.get_json("listen/endpoints")
