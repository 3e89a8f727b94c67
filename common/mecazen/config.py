"""A scenario: what more than one service needs to know, as strict structs.

Each service's own section is a struct in its own `config.py`; `mecazen.loading` finds it
through the entry points `mecazen.configs`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import combinations
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, cast

import msgspec

from mecazen.bus_config import BusConfig
from mecazen.changes import Change
from mecazen.errors import ConfigError
from mecazen.faults import SensorFaults, check_intervals
from mecazen.geometry import Pose2D, overlap
from mecazen.graph import OBSERVERS, SERVICES, SHARED
from mecazen.guard import GuardConfig
from mecazen.keys import CALLS, TOPICS
from mecazen.robot import Robot
from mecazen.robots import join_key, seed_of
from mecazen.schema import AngleDeg, Finite, NonNegative, Positive, Probability, Section
from mecazen.sensors import SensorsConfig
from mecazen.ticks import ticks_per_sample
from mecazen.world import WorldConfig

SectionT = TypeVar("SectionT", bound=Section)


LIVELINESS = "mecazen"
"""The tokens of services that are alive are `mecazen/<name>`."""

RESERVED = ("sections", "others")
"""Fields that are no keys of a file: they hold sections by name."""
FLEET = "fleet"
"""A field that is no key of a file either: the others, for who sees the part of one robot."""


class SimConfig(Section):
    """Simulated time."""

    mode: Literal["real_time", "lockstep"] = "real_time"
    """real_time follows the wall clock; lockstep waits for every answer and for nothing else."""
    tick_s: Annotated[float, msgspec.Meta(ge=0.001, le=1.0)] = 0.01
    """The control period; whole nanoseconds."""
    speed: Annotated[float, msgspec.Meta(ge=0.01, le=1000.0)] = 1.0
    """Simulated seconds per wall second in real time."""
    duration_s: Positive = 60.0
    """Length of a lockstep run; a real-time run goes on until it is stopped."""
    answer_timeout_s: Positive = 10.0
    """Wall time after which a service that does not answer a tick in lockstep is an error."""

    @property
    def tick_ns(self) -> int:
        """The control period [ns]."""
        return round(self.tick_s * 1e9)

    @property
    def ticks(self) -> int:
        """Ticks of a lockstep run."""
        return round(self.duration_s / self.tick_s)


class StartConfig(Section):
    """Where the robot stands at first, in world; the odometry begins there too."""

    x_m: Finite = 0.0
    y_m: Finite = 0.0
    yaw_deg: AngleDeg = 0.0

    @property
    def pose(self) -> Pose2D:
        """The pose in world."""
        return Pose2D(self.x_m, self.y_m, math.radians(self.yaw_deg))


_FEATURES: dict[str, tuple[str, ...]] = {
    "pose": ("pose",),
    "body": ("skeleton", "tracker", "body"),
    "legs": ("skeleton", "lidar", "legs"),
    "fused": ("skeleton", "tracker", "body", "lidar", "legs"),
}


class SensorConfig(Section):
    """How the robot perceives the person.

    The settings from `rate_hz` on are the data sheet of the sensor "pose", which target
    simulates; those of lidar and cameras are in `[sensors]`.
    """

    kind: Literal["pose", "body", "legs", "fused"] = "pose"
    """The person's pose with noise; joints that a camera sees; legs in a lidar's scan; both."""
    also: tuple[Literal["lidar", "tracker", "depth"], ...] = ()
    """Sensors that run beside it, for others to take."""
    rate_hz: Positive = 25.0
    """Frames a second; divides the tick rate."""
    frame: Literal["base_link", "world"] = "base_link"
    """Frame of the observed poses; world leaves out the drift of the odometry."""
    position_std_m: NonNegative = 0.05
    yaw_std_deg: NonNegative = 5.0
    latency_s: NonNegative = 0.0
    """From a frame's capture to its arrival; whole ticks."""
    fov_deg: Annotated[float, msgspec.Meta(gt=0.0, le=360.0)] = 360.0
    """Field of view about the robot's x axis."""
    max_range_m: Positive = 10.0
    dropout_probability: Probability = 0.0
    """Chance of a frame to show nothing."""
    occlusions_s: tuple[tuple[NonNegative, NonNegative], ...] = ()
    """Intervals [from, to] of simulated time in which nothing is seen."""
    faults: SensorFaults = SensorFaults()

    def __post_init__(self) -> None:
        check_intervals("occlusions_s", self.occlusions_s)

    @property
    def features(self) -> frozenset[str]:
        """What rows of the graph need or offer in a scenario with it."""
        return features(self.kind, self.also)

    def ticks_per_frame(self, tick_s: float) -> int:
        """Return the ticks from one frame to the next.

        Raises:
            ConfigError: The rate does not divide the tick rate.
        """
        return ticks_per_sample("sensor.rate_hz", self.rate_hz, tick_s)


class RobotConfig(Section):
    """One of several robots; what is not said here is as the scenario has it for all."""

    name: Annotated[str, msgspec.Meta(pattern="^[A-Za-z0-9_-]+$")]
    """Its namespace within the run's."""
    robot: Robot | None = None
    """Its robot file, relative to the scenario; or the same as a table."""
    start: StartConfig | None = None
    sensor: SensorConfig | None = None
    sections: dict[str, Section] = msgspec.field(default_factory=dict)
    """Sections of its own services that differ, whole, by name."""
    others: dict[str, Any] = msgspec.field(default_factory=dict)
    """The same of known services that are not installed here."""

    def __post_init__(self) -> None:
        taken = [*(topic.key for topic in TOPICS), *(call.key for call in CALLS), LIVELINESS]
        if self.name in {key.partition("/")[0] for key in taken}:
            raise ValueError(f"name = {self.name!r} begins a key of mecazen's own: take another")


class Process(NamedTuple):
    """A process of a distributed run: services of one robot, or some that all robots share."""

    services: tuple[str, ...]
    robot: str = ""

    @property
    def name(self) -> str:
        """What it is called beside others."""
        return join_key("+".join(self.services), self.robot)


class Fleet(NamedTuple):
    """Whose part of a scenario it is, of several robots."""

    name: str = ""
    """The robot's; of a single one, empty."""
    robots: dict[str, Robot] = {}  # noqa: RUF012 - never changed
    """All of them."""


class Scenario(Section):
    """A whole scenario: the robot, who takes part, and every setting."""

    robot: Robot
    """The robot file, relative to the scenario; the same as a table; or a table that changes
    some of a file: `{ file = "../robots/nexus.toml", payload = { … } }`."""
    services: tuple[str, ...] = ("physics", "controller", "target", "follower")
    """Who takes part."""
    programs: dict[str, str] = msgspec.field(default_factory=dict)
    """Your own class in a node's place, or a node of your own, which then takes part as well:
    `follower = "my_follower.py:MyFollower"`."""
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)] = 0
    sim: SimConfig = SimConfig()
    world: WorldConfig = WorldConfig()
    """A table; a world file, relative to the scenario; or a table that changes some of a file."""
    start: StartConfig = StartConfig()
    sensor: SensorConfig = SensorConfig()
    sensors: SensorsConfig = SensorsConfig()
    guard: GuardConfig = GuardConfig()
    bus: BusConfig = BusConfig()
    processes: tuple[tuple[str, ...], ...] = ()
    """Services that share a process, by groups; any other has one of its own."""
    robots: tuple[RobotConfig, ...] = ()
    """Several robots in one world, each with services of its own; none: the one of `robot`."""
    changes: tuple[Change, ...] = ()
    """Parameters that have other values from some time on."""
    sections: dict[str, Section] = msgspec.field(default_factory=dict)
    """The sections of the services that are installed here, by name."""
    others: dict[str, Any] = msgspec.field(default_factory=dict)
    """Sections of known services that are not installed here, as they were given."""
    fleet: Fleet = Fleet()
    """Not a key of a file; see `of`."""

    def __post_init__(self) -> None:
        if abs(self.sim.tick_s * 1e9 - self.sim.tick_ns) > 1e-3:
            raise ValueError(f"sim.tick_s = {self.sim.tick_s} must be whole nanoseconds")
        if self.sim.ticks < 1:
            raise ValueError(
                f"sim.duration_s = {self.sim.duration_s} must be at least a tick of "
                f"sim.tick_s = {self.sim.tick_s}"
            )
        if len(set(self.services)) != len(self.services):
            raise ValueError("services: each at most once")
        self._check_processes()
        if len({robot.name for robot in self.robots}) != len(self.robots):
            raise ValueError("robots: each name at most once")
        for robot in self.robots:
            if robot.sensor and robot.sensor.features != self.sensor.features:
                raise ValueError(
                    f"robots: {robot.name}: sensor.kind and sensor.also are the same for all robots"
                )
        places = {name: self.of(name) for name in self.names}
        for (one, a), (other, b) in combinations(places.items(), 2):
            if overlap(a.start.pose, a.robot.footprint, b.start.pose, b.robot.footprint):
                raise ValueError(f"robots: {one} and {other} overlap at their starts")

    @property
    def features(self) -> frozenset[str]:
        """What rows of the graph need or offer: what the sensors ask, and a guard with a lidar."""
        return with_guard(self.sensor.features, enabled=self.guard.enabled)

    def _check_processes(self) -> None:
        grouped = [part for group in self.processes for part in group]
        for part in grouped:
            if part not in self.services:
                raise ValueError(f"processes: {part} is not among services")
            if part in OBSERVERS:
                raise ValueError(f"processes: {part} observes, and has a process of its own")
        if len(set(grouped)) != len(grouped) or not all(self.processes):
            raise ValueError("processes: each service at most once, and no empty group")
        if self.bus.keys is not None and any(len(group) > 1 for group in self.processes):
            raise ValueError(
                "processes: with bus.keys each service has a process of its own, since its "
                "certificate tells what it may publish"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """The robots' names; of a single one, which needs none, the empty one."""
        return tuple(robot.name for robot in self.robots) or ("",)

    @property
    def parts(self) -> tuple[tuple[str, str], ...]:
        """Who takes part: service and robot, of which those that are shared have none."""
        return tuple(
            (part, robot)
            for part in self.services
            for robot in (("",) if part in SHARED else self.names)
        )

    @property
    def process_plan(self) -> tuple[Process, ...]:
        """The processes of a distributed run, in the order of the services."""
        grouped = {part: group for group in self.processes for part in group}
        groups = dict.fromkeys(grouped.get(part, (part,)) for part in self.services)
        return tuple(
            Process(group, robot)
            for group in groups
            for robot in (("",) if set(group) & set(SHARED) else self.names)
        )

    def ticks_per(self, rate: str | float | None) -> int:
        """Return the ticks from one sample to the next.

        Args:
            rate: In [Hz], or the configuration key that has it; None is every tick.

        Raises:
            ConfigError: The rate does not divide the tick rate.
        """
        key, rate_hz = "rate", rate
        if isinstance(rate, str):
            key, rate_hz = rate, self._setting(rate)
        if rate_hz is None:
            return 1
        return ticks_per_sample(key, float(cast(float, rate_hz)), self.sim.tick_s)

    def _setting(self, key: str) -> Any:
        """Return the value of `section.key`; None where that service is not installed here."""
        name, *fields = key.split(".")
        value: Any = getattr(self, name, None) or self.sections.get(name) or self.others.get(name)
        if value is None and name in SERVICES:
            return None
        for field in fields:
            of_table = isinstance(value, dict)
            value = value.get(field) if of_table else getattr(value, field, "none")
        if not isinstance(value, int | float | None):
            raise ConfigError(f"{key}: a node's rate that is no number of the configuration")
        return value

    def of(self, name: str) -> Scenario:
        """Return the scenario as the services of the robot `name` see it.

        Raises:
            ConfigError: There is no such robot.
        """
        if not self.robots and not name:
            return self
        for robot in self.robots:
            if robot.name == name:
                return msgspec.structs.replace(
                    self,
                    robot=robot.robot or self.robot,
                    seed=seed_of(self.seed, name),
                    start=robot.start or self.start,
                    sensor=robot.sensor or self.sensor,
                    bus=self.bus.within(name),
                    robots=(),
                    fleet=Fleet(name, {one.name: one.robot or self.robot for one in self.robots}),
                    sections={**self.sections, **robot.sections},
                    others={**self.others, **robot.others},
                )
        known = ", ".join(robot.name for robot in self.robots) or "none, but one without a name"
        raise ConfigError(f"{name!r}: no such robot in the scenario; its robots: {known}")

    def section(self, kind: type[SectionT], name: str) -> SectionT:
        """Return the section of service `name`, its defaults where the file says nothing."""
        section = self.sections.get(name)
        return kind() if section is None else cast(SectionT, section)


def features(kind: str, also: Iterable[str]) -> frozenset[str]:
    """Return what sensors of a scenario ask of the graph; those of an unknown kind ask nothing."""
    beside = ("skeleton",) if also else ()
    return frozenset((*_FEATURES.get(kind, ()), *beside, *also))


def with_guard(sensed: frozenset[str], *, enabled: bool) -> frozenset[str]:
    """Return what sensors ask of the graph, and the guard where a lidar lets it see."""
    return sensed | {"guard"} if enabled and "lidar" in sensed else sensed


def wanted_view(scenario: Scenario) -> tuple[float, float]:
    """Return the distance [m] and the difference of headings [rad] that are to be kept.

    They are the follower's to know; a follower that says nothing is held to 1 m and 0°.
    """
    standoff = getattr(scenario.sections.get("follower"), "standoff", None)
    if standoff is None:
        return 1.0, 0.0
    return standoff.distance, math.remainder(standoff.heading, math.tau)
