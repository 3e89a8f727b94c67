"""The follower's configuration: defaults, what is refused, and with which words."""

import math

import msgspec
import pytest
from mecazen_follower.config import FollowerConfig
from mecazen_follower.estimators import ESTIMATORS


def load(**table):
    return msgspec.convert(table, FollowerConfig)


def test_defaults_follow_1_m_behind_with_constant_velocity():
    config = load()
    assert config.standoff == pytest.approx((1.0, math.pi, 0.0))
    assert isinstance(config.make_estimator(), ESTIMATORS["kf_cv"])


def test_explicit_angles_take_the_views_place():
    config = load(view="back", bearing_deg=135, heading_deg=-45.0, standoff_m=2)
    assert config.standoff == pytest.approx((2.0, math.radians(135.0), math.radians(-45.0)))


def test_effective_configuration_has_every_parameter_and_loads_to_the_same():
    config = load(estimator="kf_displacement", estimator_params={"smoothing_s": 2})
    assert config.estimator_params["smoothing_s"] == 2.0
    assert "min_speed_m_s" in config.estimator_params
    assert msgspec.convert(msgspec.to_builtins(config), FollowerConfig) == config


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"bearing_deg": 90.0}, "bearing_deg and heading_deg must be given together"),
        ({"heading_deg": 90.0}, "bearing_deg and heading_deg must be given together"),
        ({"view": "top"}, "view"),
        ({"estimator": "ukf"}, "allowed: kf_cv, kf_displacement, none"),
        ({"estimator_params": {"gain": 1.0}}, "kf_cv has no parameter gain"),
        ({"estimator_params": {"position_std_m": 0.0}}, "position_std_m"),
        ({"standoff_m": 0.0}, "standoff_m"),
        ({"coast_after_s": 2.0}, "lost_after_s = 2 must be above coast_after_s = 2"),
        ({"gains": {"x": {"kp": 1.0}}}, "limit"),
        ({"gains": {"z": {}}}, "unknown field"),
    ],
)
def test_what_is_wrong_is_refused_and_named(table, message):
    with pytest.raises(msgspec.ValidationError, match=message):
        load(**table)
