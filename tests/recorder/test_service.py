"""The recorder as a service, beside others on a bus."""

from collections import Counter

from harness import load_robot
from mecazen import keys
from mecazen.bus import LocalBus
from mecazen.config import RecorderConfig, Scenario
from mecazen.loading import to_toml
from mecazen.runtime.host import Host
from mecazen.runtime.process import observe
from mecazen.runtime.worker import Worker
from mecazen.schema import OutputFile
from mecazen_recorder.reader import Recording
from mecazen_recorder.service import free_name
from recorder.ticks import odometry, stamp_of


def test_the_recorder_beside_a_follower_writes_what_both_say(program, tmp_path):
    config = RecorderConfig(file=OutputFile(tmp_path / "run.mcap"), keys=("odom", "diagnostics/*"))
    scenario = Scenario(
        robot=load_robot(),
        services=("follower", "recorder"),
        programs={"follower": program()},
        recorder=config,
    )
    bus = LocalBus()
    worker = Worker(Host([("follower", "")], bus, scenario))
    recorder = observe("recorder", bus, scenario)
    odom, clock = bus.publisher(keys.ODOM), bus.publisher(keys.CLOCK)
    for number in (0, 100, 200):
        clock.put(keys.CLOCK.type(), stamp_of(number))
        odom.put(odometry(number), stamp_of(number))
        while worker.step():
            pass
    recorder.close()
    recording = Recording(tmp_path / "run.mcap", trusted=True)
    by_key = Counter(sample.key for sample in recording.samples())
    assert by_key == {"odom": 3, "diagnostics/follower": 3, "diagnostics/recorder": 3}
    assert recording.scenarios == {7: to_toml(scenario)}
    # its last diagnostics are themselves the ninth sample, and were written after the count
    assert recorder.diagnostics() == {"recorded": 9}


def test_a_file_that_is_there_is_left_and_the_next_number_is_free(tmp_path, caplog):
    path = tmp_path / "run.mcap"
    assert free_name(path) == path
    for name in ("run.mcap", "run-2.mcap"):
        (tmp_path / name).touch()
    assert free_name(path) == tmp_path / "run-3.mcap"
    assert "run.mcap exists already; this recording is " in caplog.text
