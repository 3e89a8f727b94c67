"""Sensors: `[sensor]`, how the robot perceives the person, and `[sensors]`, the devices.

The robot file has the devices' mounting: `camera` carries the body tracker and the depth camera,
`lidar` the lidar.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from mecazen.schema import Finite, NonNegative, Positive, Probability, Section

_FEATURES: dict[str, tuple[str, ...]] = {
    "pose": ("pose",),
    "body": ("skeleton", "tracker", "body"),
    "legs": ("skeleton", "lidar", "legs"),
    "fused": ("skeleton", "tracker", "body", "lidar", "legs"),
}

_BLIND = ("imu", "battery")
"""Sensors that do not perceive people, so they need no skeleton."""


Intervals = tuple[tuple[NonNegative, NonNegative], ...]
"""Intervals [from, to] of simulated time."""


def _check_intervals(key: str, intervals: Intervals) -> None:
    for begin, end in intervals:
        if end <= begin:
            raise ValueError(f"{key}: [{begin}, {end}] must end after it begins")


class SensorFaults(Section):
    """Faults of the robot's person sensor; by default there are none."""

    outlier_probability: Probability = 0.0
    """Probability that a frame shows the person `outlier_m` away, in any direction."""
    outlier_m: Positive = 2.0
    flip_probability: Probability = 0.0
    """Probability that a frame shows the person facing backwards."""
    noise_correlation_s: NonNegative = 0.0
    """Time after which the autocorrelation of the noise is 1/e; its variance is unchanged."""
    reported_noise_ratio: Positive = 1.0
    """Ratio of the reported standard deviation to the true one."""
    unsaid_latency_s: NonNegative = 0.0
    """Unreported latency beyond `sensor.latency_s`; a multiple of a tick."""
    other_m: Finite = 0.0
    """Distance of a second person from the first along y of world; 0: no second person."""
    other_seen: bool = True
    """Whether frames show the second person beside the first."""
    stand_ins_s: Intervals = ()
    """Intervals [from, to] of simulated time in which the second person is seen in place of the
    first."""
    ids: bool = False
    """Whether the sensor identifies persons; in `stand_ins_s` it confuses their identities."""

    def __post_init__(self) -> None:
        _check_intervals("faults.stand_ins_s", self.stand_ins_s)
        if self.stand_ins_s and not self.other_m:
            raise ValueError("faults.stand_ins_s needs faults.other_m: where who stands in walks")


class SensorConfig(Section):
    """How the robot perceives the person.

    The settings from `rate_hz` on describe the sensor "pose", which target simulates. `[sensors]`
    has the settings of lidar and cameras.
    """

    kind: Literal["pose", "body", "legs", "fused"] = "pose"
    """pose: the person's pose with noise; body: joints that a camera sees; legs: legs in a lidar's
    scan; fused: body and legs."""
    also: tuple[Literal["lidar", "tracker", "depth", "imu", "battery"], ...] = ()
    """Additional sensors, whose samples other programs can use."""
    rate_hz: Positive = 25.0
    """Frames a second; divides the tick rate."""
    frame: Literal["base_link", "world"] = "base_link"
    """Frame of the observed poses; world excludes odometry drift."""
    position_std_m: NonNegative = 0.05
    yaw_std_deg: NonNegative = 5.0
    latency_s: NonNegative = 0.0
    """Time from a frame's capture to its arrival; a multiple of a tick."""
    fov_deg: Annotated[float, msgspec.Meta(gt=0.0, le=360.0)] = 360.0
    """Field of view, centred on the robot's x axis."""
    max_range_m: Positive = 10.0
    dropout_probability: Probability = 0.0
    """Probability that a frame shows nothing."""
    occlusions_s: Intervals = ()
    """Intervals [from, to] of simulated time in which nothing is seen."""
    faults: SensorFaults = SensorFaults()

    def __post_init__(self) -> None:
        _check_intervals("occlusions_s", self.occlusions_s)

    @property
    def features(self) -> frozenset[str]:
        """The features of the graph that these sensors need."""
        beside = ("skeleton",) if set(self.also) - set(_BLIND) else ()
        return frozenset((*_FEATURES[self.kind], *beside, *self.also))


FieldOfView = Annotated[float, msgspec.Meta(gt=0.0, lt=180.0)]
"""Angle of a pinhole camera from edge to edge [deg]."""


def _check_range(minimum_m: float, maximum_m: float) -> None:
    if minimum_m >= maximum_m:
        raise ValueError(f"min_range_m = {minimum_m} must be below max_range_m = {maximum_m}")


class LidarConfig(Section):
    """A small 2D lidar, mounted level.

    Ranges and noise are those of the LDROBOT LD19's data sheet (0.02 to 12 m, 10 Hz, a standard
    deviation of 10 mm from 0.3 m on); Slamtec's RPLIDAR A1 has 0.15 to 12 m and a resolution
    below 1 %. The share of dropouts is an assumption: data sheets have none.
    """

    rate_hz: Positive = 10.0
    """Scans a second; divides the tick rate."""
    beams: Annotated[int, msgspec.Meta(ge=8, le=8192)] = 720
    fov_deg: Annotated[float, msgspec.Meta(gt=0.0, le=360.0)] = 360.0
    """Field of view, centred on the robot's x axis."""
    min_range_m: NonNegative = 0.05
    max_range_m: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] = 12.0
    range_std_m: NonNegative = 0.01
    dropout_probability: Probability = 0.005
    """Probability that a beam that hits something returns no valid measurement."""
    occlusions_s: Intervals = ()
    """Intervals without valid measurements."""

    def __post_init__(self) -> None:
        _check_intervals("occlusions_s", self.occlusions_s)
        _check_range(self.min_range_m, self.max_range_m)


class TrackerConfig(Section):
    """An RGB-D camera with a body-tracking SDK, such as an Azure Kinect in its narrow mode.

    Field of view, range and rate are Microsoft's (hardware specification: 75°x65°, 0.5 to 3.86 m,
    30 Hz). Users measured a latency of 0.25 s with the SDKs of 2019 (Azure-Kinect-Sensor-SDK
    issues 514 and 816) and of 0.12 s with a Kinect One. All other values are tuned, so that the
    errors of the raw sagittal angles of a walk match those published: knee 8.5° to 15.3°, hip 8.6°
    to 21.6° RMSE (Ma 2020, APSIPA: 11.9 ± 3.4 and 15.1 ± 6.5; Ceseracciu 2014, PLoS ONE 9:e87640:
    11.75 and 17.62).
    """

    rate_hz: Positive = 25.0
    """Frames a second; divides the tick rate. Ticks of 10 ms do not allow 30 Hz: 25 Hz is the pose
    sensor's rate, and the camera cannot reach 33.3 Hz."""
    latency_s: NonNegative = 0.1
    """Time from a frame's capture to its arrival; a multiple of a tick."""
    horizontal_fov_deg: FieldOfView = 75.0
    vertical_fov_deg: FieldOfView = 65.0
    min_range_m: NonNegative = 0.5
    max_range_m: Positive = 3.86
    """Largest depth along the camera's axis; min_range_m is the smallest."""
    white_std_m: NonNegative = 0.008
    """White noise of a trunk joint near the camera, along each axis. It grows with depth squared,
    to twice this deviation at 3 m."""
    drift_std_m: NonNegative = 0.015
    """Ornstein-Uhlenbeck noise of a trunk joint."""
    drift_time_s: Positive = 0.5
    """Correlation time of this noise."""
    bias_std_m: NonNegative = 0.017
    """Error of a trunk joint that depends only on the view: standard deviation over runs."""
    hidden_factor: Annotated[float, msgspec.Meta(ge=1.0, le=100.0)] = 2.5
    """Factor by which noise and drift are larger for an unseen joint."""
    hidden_lag_s: Positive = 0.1
    """Time constant with which the reported position of an unseen joint follows the true one."""
    hidden_pull: Probability = 0.25
    """Share by which an unseen joint of a leg is moved towards the same joint of the other leg."""
    swap_probability: Probability = 0.007
    """Probability that a frame in which one leg hides the other's knee or ankle starts a confusion
    of the legs. In walks seen obliquely or from the side, 0.5 to 1 % of all frames confuse the
    legs."""
    swap_time_s: Positive = 0.2
    """Mean duration of such a confusion."""
    flip_rate_hz: NonNegative = 0.005
    """Rate at which a person seen from behind is taken to face the camera (issues 575 and 1330 of
    the same SDK)."""
    flip_time_s: Positive = 0.5
    """Mean duration of this error."""
    identity_memory_s: NonNegative = 0.5
    """Time out of sight after which a person gets a new identity."""
    occlusions_s: Intervals = ()
    """Intervals in which no person is seen."""

    def __post_init__(self) -> None:
        _check_intervals("occlusions_s", self.occlusions_s)
        _check_range(self.min_range_m, self.max_range_m)


class DepthConfig(Section):
    """The depth picture of the tracker's camera.

    Noise grows with the square of depth (Khoshelham & Elberink 2012, Sensors 12:1437), to the
    17 mm at 3.86 m that Microsoft names as the largest. Mixed pixels at edges are described by
    Tölgyessy 2021, Sensors 21:413; their share is an assumption.
    """

    rate_hz: Positive = 5.0
    """Pictures a second; divides the tick rate."""
    width: Annotated[int, msgspec.Meta(ge=16, le=1920)] = 320
    height: Annotated[int, msgspec.Meta(ge=16, le=1080)] = 240
    horizontal_fov_deg: FieldOfView = 75.0
    vertical_fov_deg: FieldOfView = 65.0
    min_range_m: NonNegative = 0.5
    max_range_m: Annotated[float, msgspec.Meta(gt=0.0, le=65.0)] = 3.86
    noise_m: NonNegative = 0.00114
    """Standard deviation at a depth of 1 m."""
    edge_probability: Probability = 0.5
    """Probability that a pixel at an edge (a step of 0.1 m in depth) mixes both depths; the
    probability of an invalid pixel is the same."""

    def __post_init__(self) -> None:
        _check_range(self.min_range_m, self.max_range_m)
        if self.edge_probability > 0.5:
            raise ValueError(
                "edge_probability must be at most 0.5: an edge is invalid with the same probability"
            )


class ImuConfig(Section):
    """An inertial measurement unit with the axes and the origin of base_link.

    White noise is that of an MPU-6050's data sheet (0.005 °/s and 400 µg per √Hz) at a bandwidth
    of 50 Hz. Biases, as left by a calibration at rest, and their random walk are assumptions.
    """

    rate_hz: Positive = 100.0
    """Samples a second; divides the tick rate. The specific force is the mean since the last
    sample."""
    gyro_std_rad_s: NonNegative = 0.0006
    """White noise of the angular velocity."""
    gyro_bias_std_rad_s: NonNegative = 0.002
    """Bias of the angular velocity at the start: standard deviation over runs."""
    gyro_walk_rad_s: NonNegative = 0.0001
    """Standard deviation of the change of that bias within 1 s."""
    accel_std_m_s2: NonNegative = 0.03
    """White noise of the specific force."""
    accel_bias_std_m_s2: NonNegative = 0.05
    """Bias of the specific force at the start: standard deviation over runs."""
    accel_walk_m_s2: NonNegative = 0.001
    """Standard deviation of the change of that bias within 1 s."""


class BatteryConfig(Section):
    """The battery that supplies the motors, and the measurement of its voltage."""

    rate_hz: Positive = 10.0
    """Samples a second; divides the tick rate."""
    voltage_v: Positive = 12.0
    """Voltage without load."""
    voltage_std_v: NonNegative = 0.02
    """White noise of the measurement."""


class EncodersConfig(Section):
    """The encoders of the wheels."""

    counts_per_turn: Annotated[int, msgspec.Meta(ge=0, le=1 << 24)] = 0
    """Resolution at the wheel. Positions are whole counts; velocities are their change in a tick.
    0: exact."""


class SensorsConfig(Section):
    """The robot's sensors."""

    skeleton_rate_hz: Annotated[float, msgspec.Meta(ge=10.0, le=1000.0)] = 50.0
    """Rate at which sensors can capture the person's body; divides the tick rate."""
    lidar: LidarConfig = LidarConfig()
    tracker: TrackerConfig = TrackerConfig()
    depth: DepthConfig = DepthConfig()
    imu: ImuConfig = ImuConfig()
    battery: BatteryConfig = BatteryConfig()
    encoders: EncodersConfig = EncodersConfig()
