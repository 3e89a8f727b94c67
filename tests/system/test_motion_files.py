"""A walk from a motion file, followed as the walk that the file recorded."""

from types import SimpleNamespace

import numpy as np
import pytest
from mecazen_tools.simulation import Simulation
from people.test_files import FORMATS, points_of, write


def followed(settings):
    """Return the D_err of 7 s [m], and the person's postures, 50 in a second."""
    skeletons = []
    with Simulation("mocap", settings, duration_s=7.0) as sim:
        for _ in sim.ticks(7.0):
            if (skeleton := sim.latest("target/skeleton")) not in skeletons[-1:]:
                skeletons.append(skeleton)
        joints = [np.array([(p.x, p.y, p.z) for p in s.joints]) for s in skeletons]
        return sim.scores().d_err_m, [SimpleNamespace(joints=places) for places in joints]


@pytest.mark.parametrize(("suffix", "unit", "axes", "prefix"), [FORMATS[0], FORMATS[-1]])
def test_a_walk_from_a_file_is_followed_as_the_original(suffix, unit, axes, prefix, tmp_path):
    steps = [{"duration_s": 4.0, "speed_m_s": 1.0}]  # 4 m, from standing to standing
    path = {"kind": "script", "steps": steps, "acceleration_m_s2": 2.0, "start_after_s": 1.0}
    d_err_m, postures = followed({"target.path": path, "target.body.height_m": 1.6})
    file = tmp_path / f"walk.{suffix}"
    points = {f"{prefix}{name}": places for name, places in points_of(postures).items()}
    write(file, points, unit, axes, rate=50.0)
    path = {"kind": "recorded", "file": str(file)}
    again, _ = followed({"target.path": path, "target.body.motion_file": str(file)})
    assert again == pytest.approx(d_err_m, abs=0.01)
