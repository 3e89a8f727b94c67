"""The configuration: a typed struct for each section of a scenario, and one for the scenario.

The structs declare fields, ranges and checks that need only these fields. Code that computes with
the values is in the services.
"""

from mecazen.config.bus import BusConfig as BusConfig
from mecazen.config.controller import ControllerConfig as ControllerConfig
from mecazen.config.crowd import CrowdConfig as CrowdConfig
from mecazen.config.follower import FollowerConfig as FollowerConfig
from mecazen.config.guard import GuardConfig as GuardConfig
from mecazen.config.hardware import HardwareConfig as HardwareConfig
from mecazen.config.physics import PhysicsConfig as PhysicsConfig
from mecazen.config.recorder import RecorderConfig as RecorderConfig
from mecazen.config.robots import LIVELINESS as LIVELINESS
from mecazen.config.robots import RobotConfig as RobotConfig
from mecazen.config.scenario import Process as Process
from mecazen.config.scenario import Scenario as Scenario
from mecazen.config.scenario import with_guard as with_guard
from mecazen.config.sensor import SensorConfig as SensorConfig
from mecazen.config.sensor import SensorFaults as SensorFaults
from mecazen.config.sensors import SensorsConfig as SensorsConfig
from mecazen.config.sim import SimConfig as SimConfig
from mecazen.config.start import StartConfig as StartConfig
from mecazen.config.target import TargetConfig as TargetConfig
from mecazen.config.viewer import ViewerConfig as ViewerConfig
from mecazen.config.world import WorldConfig as WorldConfig
