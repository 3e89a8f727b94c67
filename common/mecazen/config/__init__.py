"""The configuration: a typed struct for each section of a scenario, and one for the scenario.

The structs declare fields, ranges and checks that need only these fields. Code that computes with
the values is in the services.
"""

from mecazen.config.bus import BusConfig as BusConfig
from mecazen.config.follower import FollowerConfig as FollowerConfig
from mecazen.config.follower import GuardConfig as GuardConfig
from mecazen.config.people import CrowdConfig as CrowdConfig
from mecazen.config.people import TargetConfig as TargetConfig
from mecazen.config.scenario import LIVELINESS as LIVELINESS
from mecazen.config.scenario import Process as Process
from mecazen.config.scenario import RobotConfig as RobotConfig
from mecazen.config.scenario import Scenario as Scenario
from mecazen.config.scenario import StartConfig as StartConfig
from mecazen.config.sensors import SensorConfig as SensorConfig
from mecazen.config.sensors import SensorFaults as SensorFaults
from mecazen.config.sensors import SensorsConfig as SensorsConfig
from mecazen.config.services import ControllerConfig as ControllerConfig
from mecazen.config.services import HardwareConfig as HardwareConfig
from mecazen.config.services import PhysicsConfig as PhysicsConfig
from mecazen.config.services import RecorderConfig as RecorderConfig
from mecazen.config.services import SimConfig as SimConfig
from mecazen.config.services import ViewerConfig as ViewerConfig
from mecazen.config.world import WorldConfig as WorldConfig
