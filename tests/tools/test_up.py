"""The output of `mecazen up`, and its end by a signal."""

import os
import signal
import time
from types import SimpleNamespace

import pytest
from harness import SCENARIOS
from mecazen import messages as m
from mecazen.errors import ConfigError
from mecazen.loading import load_scenario, parse_settings, scenario_path
from mecazen.wire import encode
from mecazen_tools.cli import up
from mecazen_tools.cli.status import Diagnostics
from mecazen_tools.cli.up import (
    hints,
    interrupt_on_signals,
    overview,
    settings_without,
)
from mecazen_tools.forking import STOPPING


@pytest.fixture(autouse=True)
def handlers():
    before = {number: signal.getsignal(number) for number in STOPPING}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("setting", "options"),
    [
        ('bus.connect=["tcp/127.0.0.1:7447"]', ""),
        ('bus.connect=["tcp/127.0.0.1:7448"]', " --connect tcp/127.0.0.1:7448"),
        ("bus.namespace=lab/a", " --namespace lab/a"),
        ("bus.keys=/", f" --tls {os.path.relpath('/')}"),
    ],
)
def test_the_shown_commands_connect_to_the_scenario(setting, options):
    lines = hints(load_scenario(SCENARIOS / "teleop.toml", parse_settings((setting,))))
    tools = [line for line in lines if line.startswith("mecazen ")]
    assert all(line.startswith(f"mecazen{options} ") for line in tools)
    assert f"mecazen{options} echo odom" in tools
    assert any(line.startswith(f"mecazen{options} teleop ") for line in tools)


@pytest.mark.parametrize(
    ("settings", "taken", "moved"),
    [
        ((), {7447, 9090, 9876}, ["bus.connect=", "viewer.web_port=0", "viewer.data_port=0"]),
        ((), {9876}, ["viewer.data_port=0"]),
        # ports that a user chooses stay, and their conflict is an error
        (('bus.connect=["tcp/127.0.0.1:7448"]', "viewer.web_port=9091"), {7448, 9091}, []),
    ],
)
def test_a_second_run_takes_free_ports(settings, taken, moved, monkeypatch):
    monkeypatch.setattr(up, "is_free", lambda port, *_: port not in taken)
    ports = up.moved_ports(
        load_scenario(SCENARIOS / "back.toml", parse_settings(settings)), shares_router=False
    )
    assert [setting.partition('"')[0].rstrip("[") for setting in ports] == moved


@pytest.mark.parametrize("number", STOPPING)
def test_a_signal_interrupts(number):
    interrupted = interrupt_on_signals()
    assert not interrupted.is_set()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupt_in_a_destructor_is_not_lost():
    class Dropping:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    interrupted = interrupt_on_signals()
    Dropping()
    assert interrupted.is_set()


@pytest.fixture
def report():
    """Return a function by which a service reports; it returns the overview."""
    handlers = []
    bus = SimpleNamespace(
        subscribe_bytes=lambda _, handler, **__: handlers.append(handler),
        prefix="",
        router_entries=dict,
    )
    diagnostics = Diagnostics(bus)

    def take(service="", **values):
        pairs = tuple(m.KeyValue(key=key, value=str(value)) for key, value in values.items())
        array = m.DiagnosticArray(status=(m.DiagnosticStatus(name=service, values=pairs),))
        handlers[0](f"diagnostics/{service}", encode(array), "", None)
        return overview(diagnostics, load_scenario(scenario_path("back")))[1]

    return take


def test_the_overview_shows_places_pace_and_stale_reports(report, monkeypatch):
    monkeypatch.setattr(time, "monotonic", lambda: 1000.0)
    report("physics", x_m=0.5, y_m=-1.0, rtf=1.0, missed_deadlines=0)
    text = report("target", x_m=1.0, y_m=2.0, walk_ended=True)
    assert "  robot (+0.50, -1.00)  ·  person (+1.00, +2.00), the walk has ended" in text
    assert text.endswith("  ·  1.0 × real time, 0 missed")
    text = report("follower", tracking="following", distance_error_m=0.01)
    assert "following, +0.010 m off (estimated)  ·" in text
    monkeypatch.setattr(time, "monotonic", lambda: 1003.0)
    text = report("target", true_distance_error_m=0.5)
    assert "following, +0.500 m off (true) (stale, 3.0 s old)" in text
    assert "stale" not in report("physics", rtf=0.1)  # so services report every 10 s
    text = report("follower", tracking="lost", reason="hidden by a [wall]")
    assert "lost: hidden by a \\[wall], +0.500 m off (true)" in text


def test_service_is_left_out_unless_needed():
    loaded = load_scenario(SCENARIOS / "back.toml", {"processes": [["physics", "follower"]]})
    settings = parse_settings(settings_without(loaded, ["follower"]))
    left = load_scenario(SCENARIOS / "back.toml", settings)
    assert left.services == ("physics", "controller", "target")
    assert left.processes == (("physics",),)
    assert settings_without(loaded, []) == []
    with pytest.raises(ConfigError, match="--without folower: no such service; services: physics"):
        settings_without(loaded, ["folower"])
    with pytest.raises(ConfigError, match=r"--without follower: sensor.kind = 'fused' needs it"):
        settings_without(load_scenario(SCENARIOS / "senses.toml"), ["follower"])
