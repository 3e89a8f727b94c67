"""The description of a recording."""

import pytest
from mecazen.messages import Twist
from mecazen_recorder.reader import Recording
from mecazen_recorder.writer import RecordingWriter
from mecazen_tools.recording_info import inspect
from recorder.ticks import stamp_of, tick


def test_info_counts_rates_and_gaps(tmp_path):
    path = tmp_path / "gaps.mcap"
    writer = RecordingWriter(path, "json")
    for number in [*range(10), *range(15, 20), *range(22, 30)]:
        stamp = stamp_of(number)
        writer.write("cmd_vel", Twist(), stamp, stamp.time_ns)
    writer.write_bytes("my/key", b"x", "text/plain", None, 0)
    writer.close()
    info = inspect(Recording(path))
    cmd_vel, mine = info.keys
    assert (cmd_vel.key, cmd_vel.type, cmd_vel.count) == ("cmd_vel", "geometry_msgs/msg/Twist", 23)
    assert cmd_vel.rate_hz == pytest.approx(100.0)
    assert (cmd_vel.gaps, cmd_vel.longest_gap_s) == (2, pytest.approx(0.06))
    assert (mine.type, mine.count, mine.rate_hz, mine.gaps) == ("text/plain", 1, None, 0)
    assert (info.count, info.is_cut_off, info.duration_s) == (24, False, pytest.approx(0.29))


def test_info_tells_the_robots_of_a_run_and_its_own_seed(tmp_path):
    path = tmp_path / "robots.mcap"
    writer = RecordingWriter(path, "cdr")
    for run in (1, 2):
        writer.write_run(stamp_of(0, run), "[[robots]]\nname = 'one'\n[[robots]]\nname = 'two'\n")
        for seed, key in enumerate(("one/odom", "two/odom", "clock"), start=10):
            if (run, key) != (2, "clock"):
                message = tick(1)[key.rpartition("/")[2]]
                writer.write(key, message, stamp_of(0, run, seed), 0)
    writer.close()
    info = inspect(Recording(path))
    assert [(r.run, r.seed, r.robots) for r in info.runs] == [
        (1, 12, ("one", "two")),
        (2, None, ("one", "two")),
    ]
    assert {key.key: key.type.rpartition("/")[2] for key in info.keys} == {
        "clock": "Clock",
        "one/odom": "Odometry",
        "two/odom": "Odometry",
    }
