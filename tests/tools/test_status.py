"""The screen of `mecazen status`, from the diagnostics of services."""

import pytest
from mecazen.bus import LocalBus
from mecazen.messages import DiagnosticArray, DiagnosticStatus, KeyValue, SimState, Time
from mecazen.wire import encode
from mecazen_tools.cli import status as command
from mecazen_tools.cli.status import Input, ServiceStatus, screen, status_of
from rich.console import Console

PARTS = ("physics", "controller", "follower")
READY = {*PARTS, *(f"{name}/ready" for name in PARTS)}
SIM = SimState(clock=Time(12, 500_000_000), mode="real_time", speed=2.0, rtf=1.994, seed=7)
REPORTS = {
    "physics": {
        "missed_deadlines": "3",
        "hz/joint_command": "99.5",
        "age_s/joint_command": "0.01",
        "hz/target/odom": "0.0",
        "age_s/target/odom": "never",
        "refused_payloads": "0",
        "restarts/follower": "1",
    },
    "follower": {
        "late/target/observation": "9",
        "missed_ticks": "4",
        "hz/odom": "100.0",
        "age_s/odom": "0.01",
        "hz/target/observation": "25.0",
        "age_s/target/observation": "0.75",
        "refused_payloads": "2",
        "refused/odom": "2",
    },
    "controller": {"restarts/follower": "2"},
}


def text_of(status, width=160):
    console = Console(width=width, color_system=None)
    with console.capture() as capture:
        console.print(screen(status))
    return capture.get().splitlines()


def test_a_service_is_what_it_says_and_what_the_others_have_seen():
    services = status_of(SIM, PARTS, READY, REPORTS).services
    assert services["follower"] == ServiceStatus(
        state="ready",
        inputs={"odom": Input(100.0, 0.01), "target/observation": Input(25.0, 0.75)},
        refused=2,
        missed=4,
        restarts=2,
    )
    assert services["physics"] == ServiceStatus(
        state="ready",
        inputs={"joint_command": Input(99.5, 0.01), "target/odom": Input(0.0, None)},
        missed=3,
    )
    assert services["controller"] == ServiceStatus(state="ready")


@pytest.mark.parametrize(
    ("alive", "state"),
    [(set(), "gone"), ({"follower"}, "alive"), ({"follower", "follower/ready"}, "ready")],
)
def test_who_is_alive_is_told_by_the_tokens_alone(alive, state):
    assert status_of(SIM, PARTS, alive, REPORTS).services["follower"].state == state


@pytest.mark.parametrize(
    ("sim", "age_s", "state"),
    [
        ({}, 1.2, "ready"),  # services report every simulated second
        ({}, 1.3, "stale"),
        ({"speed": 0.1, "rtf": 0.1}, 9.0, "ready"),
        ({"rtf": 0.0}, 1.3, "stale"),  # in the first second
        ({"paused": True}, 100.0, "ready"),
        ({"mode": "lockstep"}, 100.0, "ready"),
        (None, 1.3, "stale"),  # physics does not answer
    ],
)
def test_a_service_that_does_not_report_while_time_goes_on_is_stale(sim, age_s, state):
    sim = None if sim is None else SimState(**{"mode": "real_time", "rtf": 1.0} | sim)
    status = status_of(sim, PARTS, READY, REPORTS, ages_s={"follower": age_s})
    assert (status.services["follower"].state, status.services["follower"].age_s) == (state, age_s)
    assert status.services["physics"].state == "ready"
    assert (f"stale for {age_s} s" in "\n".join(text_of(status))) is (state == "stale")


def test_those_that_there_should_be_come_first_then_whoever_else_is_there():
    status = status_of(None, PARTS, {"test", "physics", "physics/ready"}, {"record": {}})
    assert list(status.services) == ["physics", "controller", "follower", "record", "test"]
    assert [service.state for service in status.services.values()] == [
        *("ready", "gone", "gone", "gone", "alive")
    ]


def test_what_is_no_number_is_none():
    said = {"follower": {"refused_payloads": "inf", "hz/odom": "?", "age_s/odom": "", "hz/x": "1"}}
    follower = status_of(None, (), {"follower"}, said).services["follower"]
    assert follower == ServiceStatus("alive", {"odom": Input(0.0, None), "x": Input(1.0, None)})


def test_the_screen_shows_a_line_for_each_and_simulated_time_above():
    head, *table = text_of(status_of(SIM, PARTS, READY - {"controller"}, REPORTS))
    assert head == "t = 12.5 s  ·  1.99 × real time (speed 2)  ·  real time  ·  seed 7"
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in table if "│" in line]
    assert rows == [
        ["physics", "ready", "joint_command 99.5  target/odom 0", "0.01", "0", "3", "0"],
        ["controller", "gone", "", "", "0", "0", "0"],
        ["follower", "ready", "odom 100  target/observation 25", "0.75", "2", "4", "2"],
    ]


def test_what_somebody_has_sent_for_nothing_is_told_once_below():
    ignored = {"ignored/cmd_vel": "linaer is ignored\x1b[2J"}
    reports = {"controller": ignored, "guard": ignored}
    status = status_of(SIM, (), set(), reports, ["cmd_vle: no key"])
    assert status.warnings == ("cmd_vle: no key", "cmd_vel: linaer is ignored\x1b[2J")
    assert text_of(status)[-2:] == [
        "warning: cmd_vle: no key",
        "warning: cmd_vel: linaer is ignored\\u001b[2J",
    ]
    many = [f"{number}: no key" for number in range(1000)]
    assert len(status_of(SIM, (), set(), {}, many).warnings) == 20


def test_a_physics_that_is_alive_and_silent_is_not_taken_for_none():
    assert text_of(status_of(None, (), READY, {}))[0] == "physics does not answer"


def test_the_screen_says_when_time_is_held_and_when_nobody_simulates():
    held = SimState(mode="lockstep", paused=True, seed=1)
    expected = {held: "t = 0.0 s  ·  paused  ·  lockstep  ·  seed 1", None: "nobody simulates"}
    assert {sim: text_of(status_of(sim, (), set(), {}))[0] for sim in expected} == expected


class Told(LocalBus):
    """A bus whose subscriber of bytes can be told anything."""

    def subscribe_bytes(self, key, handler):
        self.tell = handler


def says(name, **values):
    pairs = tuple(KeyValue(key=key, value=value) for key, value in values.items())
    return encode(DiagnosticArray(status=(DiagnosticStatus(name=name, values=pairs),)))


def test_a_report_counts_under_the_name_of_its_key_whatever_name_is_in_it():
    bus = Told()
    diagnostics = command.Diagnostics(bus, "")
    bus.tell("diagnostics/viewer", says("physics", missed_deadlines="999"), "", None)
    assert diagnostics.reports == {"viewer": {"missed_deadlines": "999"}}
    for number in range(2 * command.REPORTS):
        bus.tell(f"diagnostics/{number}", says("physics"), "", None)
    assert len(diagnostics.reports) == command.REPORTS


def test_what_a_stranger_says_is_text_on_the_screen():
    hostile = "[/oops] \x1b[2J\x9b\u202e"
    reports = {hostile: {f"hz/{hostile}": "1.0"}}
    lines = text_of(status_of(SimState(mode=hostile), (), {hostile}, reports))
    text = "".join(lines)
    assert text.count("[/oops]") == 3
    assert all(line.isprintable() for line in lines)


def test_units_and_keys_are_not_lost_however_narrow_the_terminal():
    status = status_of(SIM, PARTS, READY, REPORTS)
    assert "oldest [s]" in "\n".join(text_of(status))
    assert not any("…" in line for line in text_of(status, 80))
