"""The command line as a user meets it: what it prints, and one line where something is wrong."""

import os
import signal
import time
import tomllib
from contextlib import closing, nullcontext

import msgspec
from harness import (
    COMMAND_GUARD_S,
    SCENARIOS,
    Command,
    assert_one_line,
    here,
    is_running,
    mecazen,
    options,
    tools,
)
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.loading import effective, load_scenario, parse_settings
from mecazen_tools.cli import simulate
from mecazen_tools.processes import private_router


def test_the_printed_configuration_is_whole_and_loads_again(tmp_path):
    copy = tmp_path / "copy.toml"
    for path in SCENARIOS.glob("*.toml"):
        printed = here("config", path.stem).stdout
        copy.write_text(printed)
        assert effective(load_scenario(copy)) == effective(load_scenario(path))
        sections = {"robot", "physics", "controller", "target", "follower", "bus"}
        assert sections <= set(tomllib.loads(printed))


def test_scenario_and_settings_may_come_from_the_environment():
    variables = {
        "MECAZEN_SCENARIO": "side",
        "MECAZEN_SET": 'sim.speed=2  follower.standoff_m=1.5 services=["physics","controller"]',
    }
    printed = tomllib.loads(here("config", **variables).stdout)
    assert printed["follower"]["view"] == "side_left"
    assert (printed["sim"]["speed"], printed["follower"]["standoff_m"]) == (2, 1.5)
    assert printed["services"] == ["physics", "controller"]
    printed = tomllib.loads(here("config", "back", "--set", "sim.speed=3", **variables).stdout)
    assert (printed["sim"]["speed"], printed["follower"]["view"]) == (3, "back")
    wrong = {**variables, "MECAZEN_SET": "sim.speed=0"}
    assert_one_line(here("config", **wrong), 2, "sim.speed", "0.01")


def test_a_run_works_on_one_core_and_where_only_ascii_is_printed():
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        run = ("simulate", "back", "--duration", "1.2", "--distributed")
        done = mecazen(*run, PYTHONIOENCODING="ascii")
    finally:
        os.sched_setaffinity(0, cores)
    assert done.returncode == 0
    assert "trajectory: sha256" in done.stdout
    assert done.stdout.isascii()
    assert "?" in done.stdout  # in place of °
    (warning,) = done.stderr.splitlines()
    assert warning.startswith("all processes share the only core")


def test_ctrl_c_keeps_a_run_and_no_file_is_overwritten(monkeypatch, tmp_path):
    def interrupt(done):
        raise KeyboardInterrupt  # at the first progress, after 100 ticks

    monkeypatch.setattr(simulate, "progress", lambda *_: nullcontext(interrupt))
    csv, png = tmp_path / "run.csv", tmp_path / "run.png"
    run = ("simulate", "back", "--trajectory", csv, "--plot", png)
    done = here(*run)
    assert (done.returncode, done.stderr) == (130, "interrupted after 1 of 82 s\n")
    assert png.stat().st_size > 0
    assert len(csv.read_text().splitlines()) == 1 + 100
    assert_one_line(here(*run), 1, "run.csv", "exists already")


def pids_of(up: Command) -> dict[str, int]:
    """Return the processes that `mecazen up` has shown."""
    rows = [line.split("│") for line in up.text.splitlines() if line.startswith("│")]
    return {row[1].strip(): int(row[2]) for row in rows}


def test_up_shows_what_runs_and_ends_all_of_it_by_ctrl_c_or_when_a_process_dies():
    router = private_router()
    up = Command("up", "back", "--no-viewer", *options(router))
    bus = load_scenario(SCENARIOS / "back.toml", parse_settings(router)).bus
    up.read_until("following")
    pids = pids_of(up)
    assert set(pids) == {"router", "physics", "controller", "target", "follower"}
    services = {}
    end = time.monotonic() + COMMAND_GUARD_S
    with closing(ZenohBus(bus, "client")) as hand:
        while not services.get("controller", {}).get("refused"):
            assert time.monotonic() < end, services
            for _ in range(10):  # of which the follower's commands may take the place
                hand.put_bytes("cmd_vel", b'{"angluar":{}}')
            services = msgspec.json.decode(here(*tools(bus), "status", "--json").stdout)["services"]
    assert list(services) == ["physics", "controller", "target", "follower"]
    assert {service["state"] for service in services.values()} == {"ready"}
    shown = here(*tools(bus), "status").stdout  # once, since it is no terminal
    assert all(f"│ {name}" in shown for name in services)
    line = "unknown field `angluar`"
    assert line in up.text or up.read_until(line)
    live = here(*tools(bus), "topics", "--live").stdout
    assert "nav_msgs/Odometry" in live
    assert "depth picture [mm]" in live
    # a second run shares the router in a namespace of its own, until Ctrl-C ends it
    shared = options((router[0], "bus.namespace=second"))
    second = Command("up", "side", "--no-viewer", "--restart", *shared)
    second.read_until("robot (")
    assert "│ router" not in second.text
    os.kill(pids_of(second)["follower"], signal.SIGKILL)
    assert "again at once" in second.read_until("follower: was killed by SIGKILL")
    shown = f"mecazen --connect {bus.connect[0]} --namespace second echo odom"
    assert shown in second.text
    odom = msgspec.json.decode(here(*shown.split()[1:], "--count", 1).stdout)
    assert odom["header"]["frame_id"] == "odom"
    code, out, err = second.end()
    assert (code, err) == (0, "")
    assert "all processes have ended" in out
    # the end of a process ends all of the first
    os.kill(pids["target"], signal.SIGKILL)
    code, _, err = up.end(None)
    assert code == 1
    assert err.splitlines()[-1].startswith("error: target:")
    assert not any(is_running(pid) for pid in pids.values())
