"""From where a camera sees the whole of a person."""

import math

import numpy as np
import pytest
from mecazen.config.sensors import TrackerConfig
from mecazen.robot import CameraMount
from mecazen_sensors.camera import CameraView
from people import NEXUS

PERSON_M = 1.75
NEAR_M = 0.005
"""Half of the last digit that the distances are given with."""


def mounted(height, pitch_deg=0.0, yaw_deg=0.0):
    place = (0.0, 0.0, height)
    return CameraMount(
        size_m=(0.02, 0.09, 0.02),
        position_m=place,
        mass_kg=0.1,
        pitch_deg=pitch_deg,
        yaw_deg=yaw_deg,
    )


def sees(mount, *points):
    camera = CameraView(mount, TrackerConfig(min_range_m=0.01, max_range_m=5.0))
    return camera.look(np.array(points) - mount.position_m)[1].tolist()


def fits(mount, distance):
    return all(sees(mount, (distance, 0.0, 0.0), (distance, 0.0, PERSON_M)))


@pytest.mark.parametrize(("height", "pitch_deg", "nearest"), [(0.2, 22.15, 1.10), (0.8, 2.2, 1.37)])
def test_a_person_fits_into_the_picture_from_this_distance(height, pitch_deg, nearest):
    assert fits(mounted(height, pitch_deg), nearest + NEAR_M)
    assert not fits(mounted(height, pitch_deg), nearest - NEAR_M)
    for other in (pitch_deg - 1.0, pitch_deg + 1.0):
        assert not fits(mounted(height, other), nearest + NEAR_M)


def test_a_low_level_camera_sees_the_legs_only():
    low = mounted(0.2)
    assert sees(low, (1.0, 0.0, 0.835), (1.0, 0.0, 0.845)) == [True, False]


def test_a_camera_looks_where_it_is_panned_and_tilted_to():
    mount = mounted(0.5, pitch_deg=30.0, yaw_deg=90.0)
    up = 2.0 * math.tan(math.radians(30.0))
    camera = CameraView(mount, TrackerConfig(max_range_m=3.0))
    depths, inside = camera.look(np.array(((0.0, 2.0, up), (2.0, 0.0, up), (0.0, 3.0, 1.5 * up))))
    assert depths[0] == pytest.approx(math.hypot(2.0, up))
    assert inside.tolist() == [True, False, False]


def test_the_camera_of_a_robot_file_sees_shoulders_from_1_m_and_feet_from_1_5_m_on():
    x, _, z = NEXUS.camera.position_m
    pitch = math.radians(NEXUS.camera.pitch_deg)
    half = math.radians(TrackerConfig().vertical_fov_deg / 2)
    shoulders = 0.818 * 1.75  # Winter, after Drillis & Contini
    assert math.atan2(shoulders - z, 1.0 - x) < pitch + half
    assert math.atan2(-z, 1.5 - x) > pitch - half
