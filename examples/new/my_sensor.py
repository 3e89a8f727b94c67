"""A sensor: the distance from the robot to the person, ten times per second, with noise."""

import numpy as np
from mecazen.config import Scenario
from mecazen.keys import GROUND_TRUTH, TARGET_ODOM, Topic
from mecazen.messages import Float, Header, Message
from mecazen.node import Inputs, Node, Outputs, Row, Tick, every
from mecazen.schema import Live, NonNegative, Positive, Section


class Distance(Message):
    """The message that the sensor publishes."""

    ROS_TYPE = "my_msgs/msg/Distance"
    header: Header = Header()
    distance: Float = 0.0


class MySensorConfig(Section):
    """The section `[my_sensor]` of a scenario."""

    rate_hz: Positive = 10.0
    max_range_m: Positive = 4.0
    std_m: Live[NonNegative] = 0.01  # `mecazen param set` can change it


DISTANCE = Topic("my_sensor", Distance, "distance from the robot to the person")


class MySensor(Node):
    """Measures the distance to the person's middle."""

    ROW = Row(
        "my_sensor",
        "measures the distance to the person",
        inputs=(every(GROUND_TRUTH), every(TARGET_ODOM)),
        outputs=(DISTANCE,),
        rates={DISTANCE.key: "my_sensor.rate_hz"},  # so that others can wait for its samples
    )
    SECTION = MySensorConfig

    def __init__(self, scenario: Scenario) -> None:
        """Take the section `[my_sensor]`."""
        super().__init__(scenario)
        self.config = scenario.section(MySensorConfig)
        self.ticks_per_sample = scenario.ticks_per("my_sensor.rate_hz")

    def reset(self, seed: int) -> None:
        """Begin a run with noise from `seed`."""
        self.random = np.random.default_rng(seed)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return a measurement in ticks in which one is due."""
        if tick.number % self.ticks_per_sample:
            return {}
        robot, person = (inputs[t].pose.pose.to_planar() for t in (GROUND_TRUTH, TARGET_ODOM))
        noise = self.config.std_m * self.random.standard_normal()
        measured = min(robot.distance(person) + noise, self.config.max_range_m)
        header = Header(stamp=tick.time, frame_id="base_link")
        return {DISTANCE: Distance(header=header, distance=measured)}
