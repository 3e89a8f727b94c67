"""Killed, frozen or slow parts and full disks: the others continue, and following resumes."""

import os
import signal
import subprocess
import sys
import time

import msgspec
import pytest
from faults import RESUME_S, SERVICES, WALK, Following, seconds, strike
from harness import COMMAND_GUARD_S, ROOT, SCENARIOS, Newest, here, tools
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.errors import MecazenError
from mecazen.geometry import Twist2D
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Empty, ResetRequest, Twist
from mecazen_recorder.reader import Recording
from mecazen_tools.simulate import simulate
from mecazen_tools.trajectory import Trajectory
from stack import Stack
from system.intruders import slow_observer

WATCHFUL = ROOT / "configs" / "zenoh" / "watchful.json5"
"""With a lease of 1 s instead of 10 s."""
CIRCLE = SCENARIOS / "circle.toml"
AT_REST_M_S = 0.02
"""Rollers that settle still move the body by less."""
STROLL_M_S = 0.3
"""A faster robot is on its way: the person walks at 0.5 m/s."""
REST_S = 5.0
"""A robot that looks for the person waits 2 s, and needs 1 s to stand; twice that is too much."""


class Running(Following):
    """Services without a supervisor that restarts them, all of them following."""

    def __init__(self, stack: Stack) -> None:
        super().__init__(stack)
        self.wait(lambda: self.watch.speed_m_s > STROLL_M_S)

    def wait_for_rest(self) -> None:
        begin = self.now
        self.wait(lambda: self.watch.speed_m_s < AT_REST_M_S or seconds(begin, self.now) > REST_S)
        assert self.watch.speed_m_s < AT_REST_M_S

    def wait_until_it_follows_again(self) -> None:
        self.watch.following_since = None
        assert self.recovery_s(self.now) <= RESUME_S


@pytest.fixture
def running(stack):
    return Running(stack(CIRCLE, *WALK))


def health(name: str, settings: tuple[str, ...]) -> tuple[int, str]:
    """Ask as a container does whether a service is healthy."""
    done = subprocess.run(
        [sys.executable, "-m", "mecazen.health", name],
        env={**os.environ, "MECAZEN_SCENARIO": str(CIRCLE), "MECAZEN_SET": " ".join(settings)},
        capture_output=True, text=True, check=False, timeout=COMMAND_GUARD_S,
    )  # fmt: skip
    assert not done.stderr
    return done.returncode, done.stdout.strip()


def test_without_a_service_the_robot_rests_and_then_follows_again(running):
    # the target first: a robot that still catches up would touch its person, who stops dead
    for name in ("target", "follower", "controller"):
        running.signal(name, signal.SIGKILL)
        running.wait_for_rest()
        if name == "follower":
            gone = health(name, running.stack.settings)
            assert gone == (1, "error: follower is not on the bus")
        running.stack.launch(name)
        ready = f"{name}/ready"
        running.wait(lambda ready=ready: ready in running.stack.bus.presence.names)
        running.wait_until_it_follows_again()
        returns = running.stack.bus.presence.returns
        assert (returns[name], returns[ready]) == (1, 1)
    assert health("follower", running.stack.settings) == (0, "follower: ready")
    code, wrong = health("follower", ("bus.mode=star",))
    assert (code, len(wrong.splitlines())) == (1, 1)
    assert "bus.mode" in wrong


def test_time_stands_still_without_physics_which_begins_a_run_when_it_is_back(running):
    running.signal("physics", signal.SIGSTOP)
    while running.stack.bus.spin_once(1.0):
        pass
    held = running.now
    running.signal("physics", signal.SIGCONT)
    running.wait_until_it_follows_again()
    assert running.now.run == held.run
    running.stack.call(keys.SIM_PAUSE, Empty())
    running.signal("physics", signal.SIGKILL)
    running.wait(lambda: "physics" not in running.stack.bus.presence.names)
    running.stack.launch("physics")
    running.wait(lambda: running.now.run != held.run)
    assert running.now.time_ns < 10**9
    assert running.now.seed == held.seed
    running.wait_until_it_follows_again()
    assert not running.stack.call(keys.SIM_STATE, Empty()).paused


def test_without_the_router_the_robot_follows_on_and_with_it_tools_and_services_come_back(running):
    running.watch.begin_anew()
    begin = running.now
    running.signal("router", signal.SIGKILL)
    running.wait(lambda: seconds(begin, running.now) > 1.0)
    assert running.watch.follows
    with pytest.raises(MecazenError, match="router: was killed by SIGKILL"):
        running.stack.wait(lambda: False)
    running.stack.supervisor.start_router()
    tool = ZenohBus(running.stack.scenario.bus, "client")
    running.wait(lambda: set(SERVICES) <= tool.alive())
    assert tool.call(keys.SIM_STATE, Empty()).tick > 0
    tool.close()
    assert not running.stack.bus.presence.returns  # no service had gone
    running.signal("follower", signal.SIGKILL)
    running.wait(lambda: "follower" not in running.stack.bus.presence.names)
    running.stack.launch("follower")
    running.wait(lambda: "follower/ready" in running.stack.bus.presence.names)
    running.wait_until_it_follows_again()


def test_what_is_killed_is_started_again_alone_or_two_at_once(stack, tmp_path):
    files = [tmp_path / name for name in ("run.mcap", "run-2.mcap")]
    recorded = f"services={[*SERVICES, 'recorder']}", f"recorder.file={files[0]}"
    robot = Following(stack(CIRCLE, *WALK, *recorded, restart=True), restart=True)
    returns, run = robot.stack.bus.presence.returns, robot.now.run
    robot.wait(lambda: robot.now.time_ns > 3e9)  # some of which is in the file
    robot.signal("recorder", signal.SIGKILL)
    robot.wait(lambda: returns["recorder/ready"] == 1)
    back = robot.now
    robot.wait(lambda: seconds(back, robot.now) > 1.0)
    for names in (("physics", "router"), ("controller", "follower")):
        struck = strike(robot, names)
        assert struck.in_time, struck
    status = here(*tools(robot.stack.scenario.bus), "status", "--json")
    services = msgspec.json.decode(status.stdout)["services"]
    assert {name: service["state"] for name, service in services.items()} == {
        **dict.fromkeys((*SERVICES, "recorder"), "ready"),
        "test": "alive",
    }
    assert returns["controller"] >= 1
    assert services["controller"]["restarts"] <= returns["controller"]
    robot.stack.supervisor.stop()
    before, after = (
        [s.time_ns for s in Recording(file).samples() if s.key == "clock" and s.stamp.run == run]
        for file in files
    )
    assert 0 < max(before) < min(after)


def test_a_service_that_is_frozen_for_longer_than_its_lease_is_counted_as_back(stack):
    # of two peers one may never hear of the other again: eclipse-zenoh/zenoh, issue 2806
    running = Running(stack(CIRCLE, *WALK, f"bus.zenoh_config={WATCHFUL}", "bus.mode=client"))
    tokens = {"controller", "controller/ready"}
    running.signal("controller", signal.SIGSTOP)
    running.wait(lambda: not tokens & running.stack.bus.presence.names)
    running.signal("controller", signal.SIGCONT)
    running.wait(lambda: tokens <= running.stack.bus.presence.names)
    running.wait_until_it_follows_again()
    assert running.stack.bus.presence.returns["controller"] == 1


TELEOP = SCENARIOS / "teleop.toml"
SPEED_M_S = 1.0
FROZEN_S = 1.0
"""Simulated time for which it is frozen: twice as long as a watchdog without a guard waits."""
PERSON_RADIUS_M = 0.2
GAP_M = 0.5
"""At which the guard brakes."""


def test_a_robot_that_drives_at_a_person_touches_nobody_if_a_service_freezes(stack):
    running = stack(TELEOP, "start.x_m=-1.5")
    robot, person = Newest(running.bus, keys.GROUND_TRUTH), Newest(running.bus, keys.TARGET_ODOM)
    front_m = running.scenario.robot.footprint[0]
    gaps: list[float] = []

    def note(_, stamp) -> None:
        if person.message is not None and robot.message is not None:
            gaps.append(robot.pose.distance(person.pose) - front_m - PERSON_RADIUS_M)

    running.bus.subscribe(keys.GROUND_TRUTH, note, every=True)
    command = running.bus.publisher(keys.CMD_VEL)
    running.start()

    def drive_until(condition) -> None:
        def check() -> bool:
            command.put(Twist.planar(Twist2D(SPEED_M_S)), None)
            return condition()

        running.wait_unwatched(check)

    for name in ("guard", "controller", "sensors", "target"):
        drive_until(lambda: gaps and gaps[-1] < GAP_M)
        pid, begin_ns = running.supervisor.pids[name], robot.stamp.time_ns
        os.kill(pid, signal.SIGSTOP)
        try:
            drive_until(lambda end=begin_ns + FROZEN_S * 1e9: robot.stamp.time_ns > end)
        finally:
            os.kill(pid, signal.SIGCONT)
        thawed_ns = robot.stamp.time_ns
        drive_until(lambda end=thawed_ns + 0.5e9: robot.stamp.time_ns > end)
        assert 0.0 < min(gaps) < 0.3, name  # it did drive at them
        run = running.call(keys.SIM_RESET, ResetRequest()).run
        running.wait_unwatched(lambda run=run: robot.stamp.run == person.stamp.run == run)
        gaps.clear()


BACK = SCENARIOS / "back.toml"
RUN = ("sim.duration_s=5.0", "seed=3", "sim.mode=lockstep")
FREEZE_S = 0.5


def test_an_observer_that_takes_50_ms_a_sample_delays_no_tick(stack):
    running = stack(BACK, *RUN)
    trajectory = Trajectory(running.bus, running.scenario)
    with slow_observer(running.scenario.bus, "peer") as heard:
        running.start()
        running.watch(trajectory)
        before = heard.value
        running.wait(lambda: trajectory.complete)
        # had the run waited for it, it would have taken nearly all: eight a tick
        assert heard.value - before < 4 * running.scenario.sim.ticks
    expected = simulate(load_scenario(BACK, parse_settings(RUN)), "back")[0].trajectory_sha256
    assert trajectory.sha256() == expected


def test_a_recorder_that_freezes_for_a_moment_holds_the_run_up_and_loses_nothing(stack, tmp_path):
    file = tmp_path / "run.mcap"
    services = 'services=["physics","controller","target","follower","recorder"]'
    running = stack(BACK, *RUN, services, f'recorder.file="{file}"')
    trajectory = Trajectory(running.bus, running.scenario)
    running.start()
    run = running.watch(trajectory)
    running.wait(lambda: trajectory.done > 100)
    recorder = running.supervisor.pids["recorder"]
    os.kill(recorder, signal.SIGSTOP)
    end = time.monotonic() + FREEZE_S
    running.wait(lambda: time.monotonic() > end)
    assert not trajectory.complete
    os.kill(recorder, signal.SIGCONT)
    running.wait(lambda: trajectory.complete)
    running.supervisor.stop()
    recorded = [s.key for s in Recording(file).samples() if s.stamp and s.stamp.run == run]
    every_tick = (keys.CLOCK, keys.JOINT_STATES, keys.ODOM, keys.CMD_VEL, keys.TARGET_ODOM)
    counts = {topic.key: recorded.count(topic.key) for topic in every_tick}
    assert counts == dict.fromkeys(counts, running.scenario.sim.ticks)
