"""The output of `mecazen up`, and its end by a signal."""

import os
import signal
from types import SimpleNamespace

import pytest
from harness import SCENARIOS
from mecazen import messages as m
from mecazen.loading import load_scenario, parse_settings, scenario_path
from mecazen.wire import encode
from mecazen_tools.cli import status, up
from mecazen_tools.cli.up import Interrupts, Overview, _work, hints
from mecazen_tools.forking import STOPPING


@pytest.fixture(autouse=True)
def handlers():
    before = {number: signal.getsignal(number) for number in STOPPING}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("settings", "options"),
    [
        ((), ""),
        (('bus.connect=["tcp/127.0.0.1:7447"]',), ""),
        (('bus.connect=["tcp/127.0.0.1:7448"]',), " --connect tcp/127.0.0.1:7448"),
        (("bus.namespace=lab/a",), " --namespace lab/a"),
        (("bus.keys=/",), f" --tls {os.path.relpath('/')}"),
    ],
)
def test_the_commands_that_are_shown_act_on_what_was_started(settings, options):
    scenario = load_scenario(SCENARIOS / "teleop.toml", parse_settings(settings))
    lines = [line.partition("   #")[0] for line in hints(scenario, "my folder/teleop.toml")]
    tools = [line for line in lines if line.startswith("mecazen ") and " up " not in line]
    assert len(tools) >= 5
    assert all(options in line for line in tools)
    assert "--connect" in options or not any("mecazen" in x and "--connect" in x for x in tools)
    namespace = scenario.bus.namespace
    puts = [line for line in lines if line.startswith("zenoh ")]
    assert all(f" -k {namespace + '/' if namespace else ''}cmd_vel " in line for line in puts)
    other = load_scenario(SCENARIOS / "back.toml", parse_settings(settings))
    renamed = load_scenario(
        SCENARIOS / "teleop.toml", parse_settings((*settings, "controller.command_key=drive"))
    )
    shown = " ".join(hints(renamed, "teleop"))
    assert "pub drive" in shown
    assert "cmd_vel" not in shown.replace("target/cmd_vel", "")
    assert any(
        "up 'my folder/back.toml' --set" in line for line in hints(other, "my folder/back.toml")
    )


@pytest.mark.parametrize(
    ("settings", "shares_router", "taken", "moved"),
    [
        (
            (),
            False,
            {7447, 9090, 9876},
            ["bus.connect=", "viewer.web_port=0", "viewer.data_port=0"],
        ),
        ((), False, {9876}, ["viewer.data_port=0"]),
        (("bus.namespace=two",), True, {7447, 9090}, ["viewer.web_port=0"]),
        # ports that a user chooses stay, and their conflict is an error
        (
            ('bus.connect=["tcp/127.0.0.1:7448"]', "viewer.web_port=9091"),
            False,
            {7448, 9091},
            [],
        ),
    ],
)
def test_a_second_run_takes_free_ports(settings, shares_router, taken, moved, monkeypatch):
    monkeypatch.setattr(up, "is_free", lambda port: port not in taken)
    scenario = load_scenario(SCENARIOS / "back.toml", parse_settings(settings))
    found = up._moved_ports(scenario, shares_router=shares_router)
    assert [setting.partition('"')[0].rstrip("[") for setting in found] == moved


@pytest.mark.parametrize("number", STOPPING)
def test_a_signal_that_asks_to_end_interrupts(number):
    interrupts = Interrupts()
    interrupts.check()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupt_that_a_destructor_drops_is_not_lost():
    class Dropping:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    interrupts = Interrupts()
    Dropping()
    with pytest.raises(KeyboardInterrupt):
        interrupts.check()


def test_every_process_of_a_scenario_with_a_guard_is_described():
    scenario = load_scenario(scenario_path("teleop"))
    assert "guard" in scenario.services
    assert all(_work(service, scenario) for service in scenario.services)


@pytest.fixture
def shown():
    """The overview, and a function by which a service reports."""
    bus = SimpleNamespace(subscribe_bytes=lambda _, take: setattr(bus, "take", take))
    overview = Overview(bus, load_scenario(scenario_path("back")))

    def report(service, **values):
        pairs = tuple(m.KeyValue(key=key, value=str(value)) for key, value in values.items())
        array = m.DiagnosticArray(status=(m.DiagnosticStatus(name=service, values=pairs),))
        bus.take(f"diagnostics/{service}", encode(array), "", None)

    return overview, report


def test_the_overview_says_that_a_walk_has_ended_and_no_factor_that_is_unknown(shown):
    overview, report = shown
    report("physics", mode="lockstep")
    report("target", x_m=1.0, y_m=2.0)
    assert overview.text == "[bold]t = 0.0 s[/]  person (+1.00, +2.00)"
    report("target", x_m=1.0, y_m=2.0, walk_ended=True)
    assert overview.text.endswith("person (+1.00, +2.00), the walk has ended")
    report("physics", rtf=1.0, missed_deadlines=0)
    assert overview.text.endswith("  ·  1.0 × real time, 0 missed")


def test_the_overview_shows_the_age_of_what_a_service_has_not_reported_anew(shown, monkeypatch):
    overview, report = shown
    now_s = 100.0
    monkeypatch.setattr(status, "time", SimpleNamespace(monotonic=lambda: now_s))
    report("follower", tracking="following", distance_error_m=0.01)
    assert overview.text.endswith("following, +0.010 m off")
    now_s = 103.0
    assert overview.text.endswith("following, +0.010 m off (stale, 3.0 s old)")
    report("physics", rtf=0.1)  # so services report every 10 s
    assert "stale" not in overview.text
    report("follower", tracking="following", distance_error_m=0.02)
    report("physics", rtf=1.0)
    assert "following, +0.020 m off  ·" in overview.text
