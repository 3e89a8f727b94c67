"""A user-defined sensor: the distance from the robot to the person, ten times per second."""

import numpy as np
from mecazen.config import Scenario
from mecazen.keys import GROUND_TRUTH, TARGET_ODOM, Topic
from mecazen.messages import Float, Header, Message
from mecazen.node import Inputs, Node, Outputs, Row, Tick, every
from mecazen.schema import NonNegative, Positive, Section


class Range(Message):
    """A distance, as from an ultrasonic sensor; at most the sensor's range."""

    ROS_TYPE = "mecazen_examples/msg/Range"
    header: Header = Header()
    range: Float = 0.0


class RangeConfig(Section):
    """The section `[range]` of a scenario."""

    rate_hz: Positive = 10.0
    max_range_m: Positive = 4.0
    std_m: NonNegative = 0.01


RANGE = Topic("range", Range, "distance from the robot to the person")


class RangeSensor(Node):
    """Measures the distance to the person's middle."""

    ROW = Row(
        "range",
        "measures the distance to the person",
        inputs=(every(GROUND_TRUTH), every(TARGET_ODOM)),
        outputs=(RANGE,),
        rates={RANGE.key: "range.rate_hz"},
    )
    SECTION = RangeConfig

    def __init__(self, scenario: Scenario) -> None:
        """Take the section `[range]`."""
        super().__init__(scenario)
        self.config = scenario.section(RangeConfig)
        self.ticks_per_sample = scenario.ticks_per("range.rate_hz")

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
        return {RANGE: Range(header=Header(stamp=tick.time, frame_id="base_link"), range=measured)}
