"""Free ports: none that somebody else's connection could take."""

import socket

from mecazen.bus import ports


def given_by_the_kernel():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def test_a_free_port_is_not_of_those_that_connections_get():
    first = min(given_by_the_kernel() for _ in range(50))
    for _ in range(50):
        port = ports.free_port()
        assert ports.FIRST <= port < first
        socket.create_server(("127.0.0.1", port)).close()


def test_a_port_that_is_taken_is_not_free(tmp_path, monkeypatch):
    first = ports.free_port()
    file = tmp_path / "range"
    file.write_text(f"{first + 2}\t60999\n")
    monkeypatch.setattr(ports, "FIRST", first)
    monkeypatch.setattr(ports, "_GIVEN_BY_THE_KERNEL", file)
    with socket.create_server(("127.0.0.1", first)):
        assert {ports.free_port() for _ in range(10)} == {first + 1}


def test_where_the_kernel_gives_all_ports_any_is_free(tmp_path, monkeypatch):
    file = tmp_path / "range"
    file.write_text("1024\t65535\n")
    monkeypatch.setattr(ports, "_GIVEN_BY_THE_KERNEL", file)
    assert ports.FIRST <= ports.free_port() < 1 << 16
