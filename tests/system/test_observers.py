"""Observers in lockstep: a slow one delays no tick, and a recorder loses no sample."""

import os
import signal
import time

from harness import SCENARIOS
from mecazen import keys
from mecazen.loading import load_scenario, parse_settings
from mecazen_recorder.reader import Recording
from mecazen_tools.simulate import simulate
from mecazen_tools.trajectory import Trajectory
from system.observing import slow_observer

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
