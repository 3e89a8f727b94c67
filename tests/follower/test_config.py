"""The follower's configuration: defaults, what is refused, and with which words."""

import math

import msgspec
import pytest
from mecazen.config import FollowerConfig
from mecazen.config.follower import LinearGains, PidControl, PolarControl
from mecazen_follower.estimators import ESTIMATORS


def load(**table):
    return msgspec.convert(table, FollowerConfig)


def test_defaults_follow_1_m_behind_around_the_person():
    config = load()
    assert config.standoff == pytest.approx((1.0, math.pi, 0.0))
    assert config.estimator in ESTIMATORS
    assert config.control == PolarControl()


def test_what_of_the_control_is_not_given_keeps_its_default():
    pid = load(control={"kind": "pid", "x": {"kp": 1.0}}).control
    assert pid == PidControl(x=LinearGains(kp=1.0))
    assert (pid.x.ki, pid.x.limit) == (LinearGains().ki, LinearGains().limit)
    polar = load(control={"kind": "polar", "max_speed_m_s": 1}).control
    assert polar == PolarControl(max_speed_m_s=1.0)


@pytest.mark.parametrize("kind", ["pid", "polar"])
def test_effective_configuration_loads_to_the_same(kind):
    params = {"smoothing_s": 2}
    config = load(estimator="kf_displacement", estimator_params=params, control={"kind": kind})
    assert msgspec.to_builtins(config)["control"]["kind"] == kind
    assert config.estimator_params == params  # as given, so that another estimator can be chosen
    assert msgspec.convert(msgspec.to_builtins(config), FollowerConfig) == config


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"bearing_deg": 90.0}, "bearing_deg and heading_deg must be given together"),
        ({"heading_deg": 90.0}, "bearing_deg and heading_deg must be given together"),
        ({"view": "top"}, "view"),
        ({"estimator": "ukf"}, "allowed: ekf_ctrv, imm, kf_cv, kf_displacement, none"),
        (
            {"estimator": "kf_cv", "estimator_params": {"gain": 1.0}},
            "kf_cv has no parameter gain, allowed: position_std_m, ",
        ),
        ({"estimator": "imm", "estimator_params": {"sway_m_sqrt_m": -1.0}}, "sway_m_sqrt_m"),
        ({"estimator_params": {"position_std_m": 0.0}}, "position_std_m"),
        ({"standoff_m": 0.0}, "standoff_m"),
        ({"coast_after_s": 2.0}, "lost_after_s = 2 must be above coast_after_s = 2"),
        ({"response_s": -0.1}, "response_s"),
        ({"gains": {}}, "unknown field `gains`"),
        ({"control": {"kind": "fuzzy"}}, r"'fuzzy' - at `\$.control.kind`"),
        ({"control": {"max_speed_m_s": 1.0}}, "missing required field `kind`"),
        ({"control": {"kind": "pid", "z": {}}}, "unknown field `z`"),
        ({"control": {"kind": "polar", "x": {}}}, "unknown field `x`"),
        ({"control": {"kind": "pid", "x": {"kp": -1.0}}}, r"\$.control.x.kp"),
        ({"control": {"kind": "polar", "linear_gain_1_s": 0.0}}, "linear_gain_1_s"),
    ],
)
def test_what_is_wrong_is_refused_and_named(table, message):
    with pytest.raises(msgspec.ValidationError, match=message):
        load(**table)
