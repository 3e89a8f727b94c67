"""The configuration: a typed struct for each section of a scenario, and the scenario of them all.

The structs declare fields, ranges and the checks that need nothing else; what computes with them
is in the services.
"""

from mecazen.config.bus import BusConfig
from mecazen.config.changes import Change
from mecazen.config.controller import ControllerConfig
from mecazen.config.crowd import CrowdConfig
from mecazen.config.follower import FollowerConfig
from mecazen.config.guard import GuardConfig
from mecazen.config.physics import PhysicsConfig
from mecazen.config.recorder import RecorderConfig
from mecazen.config.robots import LIVELINESS, RobotConfig
from mecazen.config.scenario import Process, Scenario, with_guard
from mecazen.config.sensor import SensorConfig, SensorFaults
from mecazen.config.sensors import SensorsConfig
from mecazen.config.sim import SimConfig
from mecazen.config.start import StartConfig
from mecazen.config.target import TargetConfig
from mecazen.config.viewer import ViewerConfig
from mecazen.config.world import WorldConfig

__all__ = [
    "LIVELINESS",
    "BusConfig",
    "Change",
    "ControllerConfig",
    "CrowdConfig",
    "FollowerConfig",
    "GuardConfig",
    "PhysicsConfig",
    "Process",
    "RecorderConfig",
    "RobotConfig",
    "Scenario",
    "SensorConfig",
    "SensorFaults",
    "SensorsConfig",
    "SimConfig",
    "StartConfig",
    "TargetConfig",
    "ViewerConfig",
    "WorldConfig",
    "with_guard",
]
