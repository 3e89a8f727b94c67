"""A change of parameters during a run gives bit-identical results, whatever its source."""

import json
import threading
from contextlib import closing

from harness import COMMAND_GUARD_S, SCENARIOS, Newest, tools, wait
from mecazen import keys
from mecazen import messages as m
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.errors import MecazenError
from mecazen.graph import COLLECTOR
from mecazen.loading import load_scenario, parse_settings, with_settings
from mecazen_recorder.reader import Recording
from mecazen_recorder.recompute import recompute
from mecazen_tools.cli.app import app
from mecazen_tools.recorded import inspect
from mecazen_tools.simulate import collect
from mecazen_tools.simulation import Simulation
from typer.testing import CliRunner

THINGS = {
    "world.added.crate": '{kind = "box", size_m = [0.4, 0.4, 0.8], position_m = [-0.6, 0.8]}',
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


def test_what_is_set_over_zenoh_in_lockstep_counts_in_all_processes_from_the_tick_it_says(stack):
    services = ("physics", "controller", "target", "sensors", "crowd", "follower", "guard")
    settings = THINGS | FARTHER
    listed = f"services={json.dumps([*services, COLLECTOR])}"
    running = stack(SCENARIOS / "senses.toml", "sim.duration_s=1.5", "sim.mode=lockstep", listed)
    running.launch("physics")
    running.wait(lambda: "physics" in running.bus.presence.names)
    running.call(keys.SIM_PAUSE, m.Empty())
    running.launch(*services[1:])
    running.bus.close()  # the test does not read it from now on, and the clock would wait for it
    begins_s = []

    def change():
        try:
            running.call(keys.SIM_STEP, m.StepRequest(ticks=100), COMMAND_GUARD_S)
            begins_s.append(set_all(running, settings))
        finally:
            running.call(keys.SIM_RESUME, m.Empty())

    changer = threading.Thread(target=change)
    changer.start()
    result, _ = collect(running.scenario, "senses")
    changer.join()
    assert begins_s == [1.01]
    loaded = scenario("senses", "sim.duration_s=1.5", f"services={json.dumps(services)}")
    assert result.trajectory_sha256 == run_with(loaded, (100, settings)) != run_with(loaded)


def test_a_recording_holds_the_changes_and_nodes_are_computed_anew_with_them(tmp_path):
    file = tmp_path / "run.mcap"
    with_crowd = [*scenario("senses").services, "crowd"]
    close = "follower.standoff_m=0.6"  # the guard holds the robot back behind the person
    loaded = scenario("senses", "sim.duration_s=2.0", close, f"services={json.dumps(with_crowd)}")
    with Simulation(loaded, record=file) as sim:
        sim.run(0.4)
        set_all(sim.bus, THINGS)
        sim.run(0.5)
        set_all(sim.bus, {"world.added.anna": "", **FARTHER})
        sim.run()
        assert [*sim.scenario.world.added] == ["crate"]
        sim.reset()
        assert sim.scenario.world.added == {}
        sim.run()
        # the crate has gone, and the settings stay
        stays = parse_settings(f"{key}={value}" for key, value in FARTHER.items())
        assert sim.trajectory.sha256() == run_with(with_settings(loaded, stays))
    recording = Recording(file)
    changes, after = (run.changes for run in inspect(recording).runs)
    things, farther = (
        ", ".join(f"{key}={value}" for key, value in table.items()) for table in (THINGS, FARTHER)
    )
    assert changes == (f"t = 0.41 s: {things}", f"t = 0.91 s: world.added.anna=, {farther}")
    assert after == (f"t = 0 s: {farther}",)
    for service in ("sensors", "crowd", "follower"):
        assert recompute(recording, service).difference is None
    guard = recompute(recording, "guard")
    assert guard.difference is None
    assert guard.counts == {keys.GUARD_STATE.key: 400, keys.GUARD_CMD_VEL.key: 400}
    states = [s.message(m.GuardState).state for s in recording.samples() if s.key == "guard/state"]
    assert {"clear", "slow"} <= {*states}


def test_the_command_line_shows_and_changes_parameters_and_things(stack):
    services = "services=['physics','controller','target','follower']"
    running = stack(SCENARIOS / "back.toml", services)
    running.start()
    to = tools(running.scenario.bus)

    def ask(*arguments):
        return CliRunner().invoke(app, [*to, *arguments])

    def shown(*arguments):
        done = ask(*arguments)
        assert done.exception is None
        return done.stdout

    changed = shown("param", "set", "follower.bearing_deg=120", "follower.heading_deg=-60")
    assert changed.startswith("follower.bearing_deg=120 from t = ")
    assert shown("param", "get", "follower.heading_deg") == "follower.heading_deg=-60.0\n"
    listed = shown("param", "list", "follower").splitlines()
    (standoff,) = [line for line in listed if "standoff_m" in line]
    assert "a number > 0" in standoff
    parameters = json.loads(shown("param", "list", "controller", "--json"))["parameters"]
    assert {row["name"].partition(".")[0] for row in parameters} == {"controller"}
    crate = ("world", "add", "box", "crate", "--at", "-5", "0")
    assert shown(*crate).startswith("crate added from t = ")
    assert shown("world", "list").startswith('crate = {kind = "box", size_m = [0.5, 0.5, 0.5], ')
    error = ask(*crate).exception
    assert isinstance(error, MecazenError)
    assert "crate: exists already" in str(error)
    assert shown("world", "remove", "crate").startswith("crate removed from t = ")
    # who comes late has them as well
    with closing(ZenohBus(running.scenario.bus)) as bus:
        newest = Newest(bus, keys.PARAMETERS)
        wait(bus, lambda: newest.message)
    assert [parameter.name for parameter in newest.message.parameters] == [
        "follower.bearing_deg",
        "follower.heading_deg",
        "world.added.crate",
    ]
