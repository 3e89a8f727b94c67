"""The section `[sensors]` of a scenario, and the mount of a camera in a robot file."""

import msgspec
import pytest
from mecazen.config import SensorsConfig
from mecazen.robot import Camera


def test_every_setting_can_be_left_out():
    config = msgspec.convert({"lidar": {"beams": 360}}, SensorsConfig)
    assert config.lidar.beams == 360
    assert config.tracker == SensorsConfig().tracker


@pytest.mark.parametrize(
    "section",
    [
        {"lidar": {"beams": 4}},
        {"lidar": {"fov_deg": 361.0}},
        {"lidar": {"min_range_m": 2.0, "max_range_m": 1.0}},
        {"lidar": {"std_m": 0.01}},
        {"tracker": {"horizontal_fov_deg": 180.0}},
        {"tracker": {"hidden_lag_s": 0.0}},
        {"tracker": {"max_range_m": 0.4}},
        {"depth": {"max_range_m": 66.0}},
        {"depth": {"edge_probability": 0.6}},
    ],
)
def test_a_setting_out_of_its_range_is_refused(section):
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(section, SensorsConfig)


def test_a_camera_cannot_be_tilted_beyond_upright():
    mount = {"size_m": [0.02, 0.09, 0.02], "position_m": [0.1, 0.0, 0.2], "mass_kg": 0.1}
    assert msgspec.convert({**mount, "pitch_deg": 22.0, "yaw_deg": -90.0}, Camera).pitch_deg == 22.0
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({**mount, "pitch_deg": 91.0}, Camera)
