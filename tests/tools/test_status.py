"""The screens of `mecazen status` and `mecazen up`, from the diagnostics of services on a bus."""

import signal
import time

import pytest
from harness import SCENARIOS
from mecazen.errors import ConfigError
from mecazen.keys import SIM_STATE
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import DiagnosticArray, DiagnosticStatus, KeyValue, SimState, String, Time
from mecazen.wire import encode
from mecazen_tools.cli import status as command
from mecazen_tools.cli import up
from mecazen_tools.cli.status import Diagnostics, InputStatus, screen
from mecazen_tools.cli.up import interrupt_on_signals, settings_without
from mecazen_tools.forking import STOPPING
from rich.console import Console

PARTS = ("physics", "controller", "follower")
READY = {*PARTS, *(f"{name}/ready" for name in PARTS)}
SIM = SimState(clock=Time(12, 500_000_000), mode="real_time", speed=2.0, rtf=1.994, seed=7)
SCENARIO = String(data=f"services = {[*PARTS]}\nrobots = []")
REPORTS = {
    "physics": {
        "missed_deadlines": "3",
        "hz/target/odom": "0.0",
        "age_s/target/odom": "never",
        "refused_payloads": "inf",
        "restarts/follower": "1",
    },
    "follower": {
        "missed_ticks": "4",
        "hz/odom": "100.0",
        "age_s/odom": "0.01",
        "hz/target/observation": "25.0",
        "age_s/target/observation": "0.75",
        "refused_payloads": "2",
    },
    "controller": {"restarts/follower": "2"},
}


class Net:
    """A bus on which services are alive, the clock answers, and any client can publish."""

    prefix, router_entries = "", dict

    def __init__(self, sim=SIM):
        self._sim, self.handlers = sim, {}

    def alive(self):
        return READY

    def call(self, call, *_):
        return self._sim if call is SIM_STATE else SCENARIO

    def drain(self):
        pass

    def subscribe_bytes(self, key, handler, **_):
        self.handlers[key] = handler

    def report(self, service, values):
        pairs = tuple(KeyValue(key=key, value=value) for key, value in values.items())
        # a report counts under the name in its key, whatever it contains
        array = DiagnosticArray(status=(DiagnosticStatus(name="physics", values=pairs),))
        self.handlers["**/diagnostics/*"](f"diagnostics/{service}", encode(array), "", None)


def status_of(reports=REPORTS, sim=SIM):
    """Return the status after some reports."""
    net = Net(sim)
    diagnostics = Diagnostics(net)
    for service, values in reports.items():
        net.report(service, values)
    return diagnostics.status()


def lines_of(status):
    console = Console(width=160, color_system=None)
    with console.capture() as capture:
        console.print(screen(status))
    return capture.get().splitlines()


def test_a_state_comes_from_all_reports():
    services = status_of().services
    follower, physics = services["follower"], services["physics"]
    assert follower.inputs == {
        "odom": InputStatus(100.0, 0.01),
        "target/observation": InputStatus(25.0, 0.75),
    }
    assert (follower.refused, follower.missed, follower.restarts) == (2, 4, 2)
    assert physics.inputs["target/odom"] == InputStatus(0.0, None)
    assert (physics.refused, physics.missed, physics.restarts) == (0, 3, 0)  # inf is no number


@pytest.mark.parametrize(
    ("sim", "age_s", "state"),
    [
        ({}, 1.2, "ready"),  # services report every simulated second
        ({}, 1.3, "stale"),
        ({"speed": 0.1, "rtf": 0.1}, 9.0, "ready"),
        ({"paused": True}, 100.0, "ready"),
        ({"mode": "lockstep"}, 100.0, "ready"),
    ],
)
def test_a_silent_service_is_stale_while_time_passes(sim, age_s, state, monkeypatch):
    net = Net(sim=SimState(**{"mode": "real_time", "rtf": 1.0} | sim))
    diagnostics = Diagnostics(net)
    begin_s = time.monotonic()
    for service, time_s in (("follower", begin_s), ("physics", begin_s + age_s)):
        monkeypatch.setattr(time, "monotonic", lambda time_s=time_s: time_s)
        net.report(service, {})
    status = diagnostics.status()
    assert status.services["follower"].state == state
    assert status.services["physics"].state == "ready"
    assert (f"stale for {age_s} s" in "\n".join(lines_of(status))) is (state == "stale")


def test_warnings_are_text():
    hostile = "[oops] \x1b[2J\x9b\u202e"
    report = {"warning/slow": hostile, f"hz/{hostile}": "1.0"}
    status = status_of({"controller": report}, sim=SimState(mode=hostile))
    assert status.warnings == (f"controller: slow {hostile}",)
    lines = lines_of(status)
    assert lines[-1].startswith("warning: controller: slow [oops] ")
    assert all(line.isprintable() for line in lines)
    many = {f"warning/{number}": "" for number in range(1000)}
    assert len(status_of({"controller": many}).warnings) == command.WARNINGS


@pytest.fixture
def handlers():
    before = {number: signal.getsignal(number) for number in STOPPING}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


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


@pytest.mark.usefixtures("handlers")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupt_in_a_destructor_is_not_lost():
    class Dropping:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    interrupted = interrupt_on_signals()
    assert not interrupted.is_set()
    Dropping()
    assert interrupted.is_set()


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
