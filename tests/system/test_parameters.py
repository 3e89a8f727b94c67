"""A change of parameters during a run gives bit-identical results, whatever its source."""

import json
import threading
from contextlib import closing

import pytest
from harness import COMMAND_GUARD_S, SCENARIOS, tools
from mecazen import keys
from mecazen import messages as m
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.errors import ConfigError
from mecazen.graph import COLLECTOR
from mecazen.loading import load_scenario, parse_settings
from mecazen_recorder.reader import Recording
from mecazen_recorder.recompute import recompute
from mecazen_tools.cli.app import app
from mecazen_tools.recording_info import inspect
from mecazen_tools.simulate import collect
from mecazen_tools.simulation import Simulation
from typer.testing import CliRunner

THINGS = {
    "world.added.crate": '{kind = "box", size_m = [0.4, 0.4, 0.8], position_m = [-0.6, 0.0]}',
    "world.added.anna": '{kind = "person", path = {kind = "straight", x_m = 1.0, y_m = -1.0}}',
}
SHORT = "sim.duration_s=1.0"
FARTHER = {
    "follower.standoff_m": "1.4",
    "follower.control.linear_gain_1_s": "2.0",
    "controller.limits.x.max_acceleration_m_s2": "0.8",
}


def scenario(name, *settings):
    return load_scenario(SCENARIOS / f"{name}.toml", parse_settings((SHORT, *settings)))


def set_all(bus, settings):
    """Ask for changes; return the time from which they count [s]."""
    values = tuple(m.Parameter(key, value) for key, value in settings.items())
    answer = bus.call(keys.SET_PARAMETERS, m.Parameters(parameters=values))
    return answer.header.stamp.ns / 1e9


def run_with(loaded, *changes):
    """Make a run in this process, with what is set at some ticks; return its hash."""
    with Simulation(loaded) as sim:
        for tick, settings in changes:
            sim.run(tick * loaded.sim.tick_s - sim.time_s)
            set_all(sim.bus, settings)
        sim.run()
        return sim.trajectory.sha256()


@pytest.mark.parametrize(
    ("name", "services", "settings"),
    [
        ("back", ("physics", "controller", "target", "follower"), FARTHER),
        (
            "senses",
            ("physics", "controller", "target", "sensors", "crowd", "follower", "guard"),
            THINGS,
        ),
    ],
)
def test_what_is_set_over_zenoh_in_lockstep_counts_in_all_processes_from_the_tick_it_says(
    stack, name, services, settings
):
    listed = f"services={json.dumps([*services, COLLECTOR])}"
    running = stack(SCENARIOS / f"{name}.toml", "sim.duration_s=3.0", "sim.mode=lockstep", listed)
    running.launch("physics")
    running.wait(lambda: "physics" in running.bus.presence.names)
    running.call(keys.SIM_PAUSE, m.Empty())
    running.launch(*services[1:])
    begins_s = []

    def change():
        try:
            running.call(keys.SIM_STEP, m.StepRequest(ticks=100), COMMAND_GUARD_S)
            begins_s.append(set_all(running, settings))
        finally:
            running.call(keys.SIM_RESUME, m.Empty())

    changer = threading.Thread(target=change)
    changer.start()
    result, _ = collect(running.scenario, name)
    changer.join()
    assert begins_s == [1.01]
    loaded = scenario(name, "sim.duration_s=3.0", f"services={json.dumps(services)}")
    assert result.trajectory_sha256 == run_with(loaded, (100, settings)) != run_with(loaded)


def test_a_recording_holds_what_was_added_until_a_reset(tmp_path):
    file = tmp_path / "run.mcap"
    with_crowd = [*scenario("senses").services, "crowd"]
    loaded = scenario("senses", "sim.duration_s=2.0", f"services={json.dumps(with_crowd)}")
    with Simulation(loaded, record=file) as sim:
        sim.run(0.4)
        set_all(sim.bus, THINGS)
        sim.run(0.5)
        set_all(sim.bus, {"world.added.anna": ""})
        sim.run()
        assert [*sim.scenario.world.added] == ["crate"]
        sim.reset()
        assert sim.scenario.world.added == {}
        sim.run()
        assert sim.trajectory.sha256() == run_with(loaded)
    recording = Recording(file)
    changes, after = (run.changes for run in inspect(recording).runs)
    things = ", ".join(f"{key}={value}" for key, value in THINGS.items())
    assert changes == (f"t = 0.41 s: {things}", "t = 0.91 s: world.added.anna=")
    assert after == ()
    for service in ("sensors", "crowd", "follower"):
        assert recompute(recording, service).difference is None


def test_a_recording_holds_the_changes_and_nodes_are_computed_anew_with_them(tmp_path):
    name, recorded = "convoy", ["two/odom", "two/target/*", "two/cmd_vel", "clock"]
    file = tmp_path / "run.mcap"
    loaded = scenario(name)
    services = json.dumps([*loaded.services, "recorder"])
    to = f"services={services}", f"recorder.file={file}", f"recorder.keys={json.dumps(recorded)}"
    run_with(scenario(name, *to), (40, FARTHER), (90, {"follower.standoff_m": "0.9"}))
    recording = Recording(file)
    (run,) = inspect(recording).runs
    assert run.changes == (
        "t = 0.41 s: " + ", ".join(f"{key}={value}" for key, value in FARTHER.items()),
        "t = 0.91 s: follower.standoff_m=0.9",
    )
    found = [sample.key for sample in recording.samples() if "parameters" in sample.key]
    assert found == ["sim/parameters"] * 2
    assert recompute(recording, "follower", "two").difference is None


def test_the_command_line_shows_and_changes_parameters(stack):
    running = stack(
        SCENARIOS / "back.toml", "services=['physics','controller','target','follower']"
    )
    running.start()
    to = tools(running.scenario.bus)

    def ask(*arguments):
        return CliRunner().invoke(app, [*to, "param", *arguments])

    def param(*arguments):
        done = ask(*arguments)
        assert done.exception is None
        return done.stdout

    said = param("set", "follower.bearing_deg=120", "follower.heading_deg=-60")
    assert said.startswith("follower.bearing_deg=120 from t = ")
    assert param("get", "follower.heading_deg") == "follower.heading_deg=-60.0\n"
    (shown,) = [line for line in param("list", "follower").splitlines() if "standoff_m" in line]
    assert "1.0" in shown
    assert "a number > 0" in shown
    found = json.loads(param("list", "controller", "--json"))["parameters"]
    assert {one["name"].partition(".")[0] for one in found} == {"controller"}
    for wrong, words in (
        (("set", "follower.standof_m=1"), ("did you mean follower.standoff_m?",)),
        (("set", "follower.standoff_m=-1"), ("follower.standoff_m: got -1", "> 0")),
        (("set", "physics.dt_s=0.002"), ("can't change while it runs",)),
        (("set", "follower.standoff_m"), ("must be NAME=VALUE",)),
        (("list", "nobody"), ("'nobody'",)),
    ):
        error = ask(*wrong).exception
        assert isinstance(error, ConfigError)
        assert all(word in str(error) for word in words)
    added = CliRunner().invoke(app, [*to, "world", "add", "box", "crate", "--at", "-5", "0"])
    assert added.stdout.startswith("crate added from t = ")
    listed = CliRunner().invoke(app, [*to, "world", "list"]).stdout
    assert listed.startswith('crate = {kind = "box", size_m = [0.5, 0.5, 0.5], position_m = [-5.0')
    twice = CliRunner().invoke(app, [*to, "world", "add", "box", "crate", "--at", "-5", "0"])
    assert str(twice.exception).startswith("crate: exists already")
    walk = ("--set", "path.kind=straight", "--set", "path.speed_m_s=1.2")
    person = CliRunner().invoke(app, [*to, "world", "add", "person", "a", "--at", "5", "5", *walk])
    assert str(person.exception).startswith("people need the crowd: start with --set 'services=")
    gone = CliRunner().invoke(app, [*to, "world", "remove", "crate"])
    assert gone.stdout.startswith("crate removed from t = ")
    # who comes late has them as well
    with closing(ZenohBus(running.scenario.bus)) as bus:
        heard = []
        bus.subscribe(keys.PARAMETERS, lambda message, _: heard.append(message), every=True)
        while not heard:
            bus.spin_once(0.1)
    assert [one.name for one in heard[0].parameters] == [
        "follower.bearing_deg",
        "follower.heading_deg",
        "world.added.crate",
    ]
