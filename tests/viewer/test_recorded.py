"""Recorded runs as files for Rerun, and what can't be shown."""

from types import SimpleNamespace

import pytest
from harness import error_of, load_robot
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.errors import ConfigError, MecazenError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.wire import Stamp, encode
from mecazen_viewer import recorded

TICK_NS = 10_000_000


class Sample(SimpleNamespace):
    """A sample of the robot's pose."""

    def as_published(self):
        odom = m.planar_odometry(m.Time(), "world", "base_link", Pose2D(), Twist2D())
        return encode(odom), "application/json", self.stamp and self.stamp.pack()


def sample(number, run=1):
    stamp = None if run is None else Stamp(number * TICK_NS, run, 3)
    return Sample(key="ground_truth/odom", time_ns=number * TICK_NS, stamp=stamp)


@pytest.fixture
def recording(monkeypatch):
    """Return samples as the reader of `.mcap` gives them."""
    samples = []
    made = SimpleNamespace(
        samples=lambda: iter(samples),
        descriptions=dict,
        scenario=lambda *_: Scenario(robot=load_robot()),
    )
    reader = SimpleNamespace(Recording=lambda _: made)
    monkeypatch.setattr(recorded, "is_installed", lambda extra: True)
    monkeypatch.setattr(recorded, "import_module", lambda name: reader)
    return samples


def test_each_run_becomes_a_file(recording, tmp_path):
    recording += [sample(0, None), sample(0, 1), sample(10, 1), sample(0, 2)]
    files = recorded.draw(tmp_path / "run.mcap", tmp_path)
    assert files == [tmp_path / "0.rrd", tmp_path / "1.rrd"]
    assert all(file.read_bytes().startswith(b"RR") for file in files)


def test_a_recording_without_a_run_is_refused(recording, tmp_path):
    recording.append(sample(0, None))
    said = error_of(MecazenError, lambda: recorded.draw(tmp_path / "run.mcap", tmp_path))
    assert said == f"{tmp_path}/run.mcap: holds no run"


def test_of_a_key_as_many_samples_are_drawn_as_of_a_live_run():
    again = sample(9, run=2)  # a new run is drawn from its first sample on
    samples = [*map(sample, range(10)), again]
    drawn = [(one.time_ns, one.stamp.run) for one in recorded._frames(iter(samples))]
    # 30 a second: of those each 10 ms every fourth
    assert drawn == [(0, 1), (4 * TICK_NS, 1), (8 * TICK_NS, 1), (again.time_ns, 2)]


def test_what_is_no_recording_is_refused(tmp_path):
    text = tmp_path / "text.mcap"
    text.write_text("hello")
    for file, reason in ((text, "not an MCAP file"), (tmp_path, "can't be read: Is a directory")):
        said = error_of(ConfigError, lambda file=file: recorded.open_file(file, native=False))
        assert said == f"{file}: {reason}"
