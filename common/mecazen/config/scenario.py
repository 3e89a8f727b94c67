"""A scenario: every setting of a run, with a typed section for each part of mecazen."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import combinations, product
from typing import Annotated, Any, NamedTuple, cast

import msgspec

from mecazen.config.bus import BusConfig
from mecazen.config.follower import FollowerConfig, GuardConfig
from mecazen.config.people import Body, CrowdConfig, Goal, TargetConfig
from mecazen.config.sensors import SensorConfig, SensorsConfig
from mecazen.config.services import (
    ControllerConfig,
    HardwareConfig,
    PhysicsConfig,
    RecorderConfig,
    SimConfig,
    ViewerConfig,
)
from mecazen.config.world import WorldConfig
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, overlap
from mecazen.robot import Robot
from mecazen.robots import join_key, seed_of
from mecazen.schema import AngleDeg, Finite, Program, Section, SectionT
from mecazen.ticks import ticks_per_sample


class StartConfig(Section):
    """The start pose of the robot in world, where the odometry begins too."""

    x_m: Finite = 0.0
    y_m: Finite = 0.0
    yaw_deg: AngleDeg = 0.0

    @property
    def pose(self) -> Pose2D:
        """The pose in world."""
        return Pose2D(self.x_m, self.y_m, math.radians(self.yaw_deg))


LIVELINESS = "mecazen"
"""The tokens of services that are alive are `mecazen/<name>`."""


class RobotConfig(Section):
    """One of several robots; settings left out are those of the scenario."""

    name: Annotated[str, msgspec.Meta(pattern="^[A-Za-z0-9_-]+$")]
    """Name of the robot, and of its namespace within the run's."""
    robot: Robot | None = None
    """Robot file, or its content as a table."""
    start: StartConfig | None = None
    sensor: SensorConfig | None = None
    """This section and those of the robot's services override the scenario's, key by key."""
    controller: ControllerConfig | None = None
    target: TargetConfig | None = None
    follower: FollowerConfig | None = None

    def __post_init__(self) -> None:
        from mecazen.keys import CALLS, TOPICS  # noqa: PLC0415  # only several robots need them

        known = [*(topic.key for topic in TOPICS), *(call.key for call in CALLS), LIVELINESS]
        if self.name in {key.partition("/")[0] for key in known}:
            raise ValueError(f"name = {self.name!r} begins a key of mecazen's own: take another")

    @property
    def sections(self) -> dict[str, Section]:
        """The sections that differ from the scenario, by name."""
        values = {name: getattr(self, name) for name in self.__struct_fields__}
        return {name: value for name, value in values.items() if isinstance(value, Section)}


SHARED = ("physics", "hardware", "crowd", "viewer", "recorder", "collector")
"""Services that run once for all robots."""
OBSERVERS = ("viewer", "recorder")
"""Services that no tick waits for and whose exit is no error."""


class Process(NamedTuple):
    """A process of a distributed run: services of one robot, or some that all robots share."""

    services: tuple[str, ...]
    robot: str = ""

    @property
    def name(self) -> str:
        """Name of the process: its services, preceded by the robot's name."""
        return join_key("+".join(self.services), self.robot)


class Scenario(Section):
    """The robot, the services, and all their settings.

    A user node's section is an additional field of a derived struct, see `scenario_with`; the node
    reads it by `section`.
    """

    robot: Robot
    """A robot file, its content as a table, or a table that changes parts of a file:
    `{ file = "../robots/nexus.toml", payload = { … } }`."""
    services: tuple[Annotated[str, msgspec.Meta(pattern="^[A-Za-z0-9_-]+$")], ...] = (
        "physics",
        "controller",
        "target",
        "follower",
    )
    """Names of the services that take part; classes belong in `programs`."""
    programs: dict[str, Program] = msgspec.field(default_factory=dict)
    """User classes by node name, as in `follower = "my_follower.py:MyFollower"`. A class replaces a
    node or adds one, which then takes part."""
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)] = 0
    sim: SimConfig = SimConfig()
    world: WorldConfig = WorldConfig()
    """A table, a world file, or a table that changes parts of a file."""
    start: StartConfig = StartConfig()
    sensor: SensorConfig = SensorConfig()
    sensors: SensorsConfig = SensorsConfig()
    physics: PhysicsConfig = PhysicsConfig()
    controller: ControllerConfig = ControllerConfig()
    target: TargetConfig = TargetConfig()
    crowd: CrowdConfig = CrowdConfig()
    follower: FollowerConfig = FollowerConfig()
    guard: GuardConfig = GuardConfig()
    hardware: HardwareConfig = HardwareConfig()
    viewer: ViewerConfig = ViewerConfig()
    recorder: RecorderConfig = RecorderConfig()
    bus: BusConfig = BusConfig()
    processes: tuple[tuple[str, ...], ...] = ()
    """Groups of services that share a process; every other service has its own."""
    robots: tuple[RobotConfig, ...] = ()
    """Several robots in one world, each with its own services; if empty, `robot` is the only
    one."""
    robot_name: str = ""
    """Name of the robot to which this part of the scenario belongs, if there are several robots."""
    others: dict[str, Robot] = msgspec.field(default_factory=dict)
    """The other robots in the same world, by name."""

    def __post_init__(self) -> None:
        needed = (name for name in self._needed_services() if name not in self.services)
        msgspec.structs.force_setattr(self, "services", (*self.services, *needed))
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
        if "hardware" in self.services and "physics" in self.services:
            raise ValueError("services: hardware takes the place of physics: name one of them")
        if "hardware" in self.services and self.robots:
            raise ValueError("robots: hardware drives one robot; each has a scenario of its own")
        if len({robot.name for robot in self.robots}) != len(self.robots):
            raise ValueError("robots: each name at most once")
        for robot in self.robots:
            if robot.sensor and robot.sensor.features != self.sensor.features:
                raise ValueError(
                    f"robots: {robot.name}: sensor.kind and sensor.also are the same for all robots"
                )
        places = {name: self.of(name) for name in self.names}
        self._check_mounts(place.robot for place in places.values())
        self._check_bodies(place.target.body for place in places.values())
        for (name, a), (neighbour, b) in combinations(places.items(), 2):
            if overlap(a.start.pose, a.robot.footprint, b.start.pose, b.robot.footprint):
                raise ValueError(f"robots: {name} and {neighbour} overlap at their starts")

    def _needed_services(self) -> Iterator[str]:
        """Yield user nodes, the services that the sensors need, and the crowd if it is needed.

        The crowd is needed if other people walk, or if several robots see each other and all
        persons.
        """
        if self.programs:
            from mecazen.graph import NODES  # noqa: PLC0415  # loading is light without programs

            yield from (name for name in self.programs if name not in NODES)
        features = self.features
        # a real robot has sensors of its own
        if features & {"lidar", "tracker", "depth"} and "hardware" not in self.services:
            yield "sensors"
        if features & {"body", "legs"}:
            yield "follower"
        if "guard" in features:
            yield "guard"
        several_see = "skeleton" in features and len(self.robots) > 1
        if self.crowd.walkers or self.crowd.reactive or self.world.passersby or several_see:
            yield "crowd"

    def _check_mounts(self, robots: Iterable[Robot]) -> None:
        mounts = {"lidar": {"lidar"}, "camera": {"tracker", "depth"}}
        needed = [mount for mount, sensors in mounts.items() if sensors & self.sensor.features]
        for robot, mount in product(robots, needed):
            if getattr(robot, mount) is None:
                raise ValueError(
                    f"robot: {robot.name} has no {mount}, which sensor.kind = {self.sensor.kind!r} "
                    f"or sensor.also needs: add [{mount}] to its file"
                )

    def _check_bodies(self, followed: Iterable[Body]) -> None:
        walkers = [walker for walker in (*self.crowd.walkers, self.crowd.reactive) if walker]
        bodies = (
            *followed,
            *(walker.body for walker in walkers),
        )  # without a sensor, only their heights are seen
        if "skeleton" in self.features or all(b == Body(height_m=b.height_m) for b in bodies):
            return
        raise ValueError(
            "target.body and crowd: no sensor sees how a body walks; sensor.kind = 'body', 'legs' "
            "or 'fused' does, or any in sensor.also"
        )

    @property
    def features(self) -> frozenset[str]:
        """The features by which nodes take part and choose their topics; see `graph.rows`."""
        features = set(self.sensor.features)
        if self.guard.enabled and "lidar" in features:
            features.add("guard")
        parts = [self.of(name) for name in self.names]
        if "hardware" in self.services:
            features.add("hardware")
        if any(isinstance(part.target.path, Goal) for part in parts):
            features.add("goal")
        if any(part.controller.odometry == "ground_truth" for part in parts):
            features.add("truth")
        if any(part.follower.planner is not None for part in parts):
            features.add("planner")
        return frozenset(features)

    @property
    def has_real_lidar(self) -> bool:
        """Whether scans come from a real lidar, whose driver may send 0 for no return."""
        return "sensors" not in self.services

    @property
    def command_timeout_s(self) -> float:
        """Age above which the controller no longer obeys a command [s]."""
        if "guard" not in self.features:
            return self.controller.reference_timeout_s
        late_ticks = self.ticks_per(self.controller.update_rate_hz) - 1  # the guard's rate
        return late_ticks * self.sim.tick_s + self.guard.hold_s

    @property
    def wheel_timeout_s(self) -> float:
        """Age above which the wheels no longer obey a command [s]."""
        held_s = self.guard.hold_s if "guard" in self.features else math.inf
        real = "hardware" in self.services
        waits_s = self.hardware.command_timeout_s if real else self.physics.watchdog_s
        return min(waits_s, held_s)

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
        """The robots' names; ("",) for a single robot, which needs no name."""
        return tuple(robot.name for robot in self.robots) or ("",)

    @property
    def renamed(self) -> dict[str, str]:
        """Keys on the bus that differ from those of their topics, by topic key."""
        from mecazen.keys import renamed  # noqa: PLC0415  # loading is light without messages

        changes: dict[str, str] = {}
        for name in self.names:
            controller = self.of(name).controller
            changes |= renamed(name, controller.command_key, controller.odometry_key)
        return changes

    @property
    def parts(self) -> tuple[tuple[str, str], ...]:
        """The services and their robots; a shared service has no robot."""
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
            rate: Rate [Hz], or the configuration key of the rate; None: every tick.

        Raises:
            ConfigError: The rate does not divide the tick rate.
        """
        key, rate_hz = (rate, self._setting(rate)) if isinstance(rate, str) else ("rate", rate)
        if rate_hz is None:
            return 1
        return ticks_per_sample(key, rate_hz, self.sim.tick_s)

    def _setting(self, key: str) -> float | None:
        value: object = self
        for name in key.split("."):
            value = getattr(value, name, "none")
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
                    **robot.sections,
                    seed=seed_of(self.seed, name),
                    bus=self.bus.within(name),
                    robots=(),
                    robot_name=name,
                    others={r.name: r.robot or self.robot for r in self.robots if r is not robot},
                )
        known = ", ".join(robot.name for robot in self.robots) or "none, but one without a name"
        raise ConfigError(f"{name!r}: no such robot in the scenario; its robots: {known}")

    def section(self, kind: type[SectionT]) -> SectionT:
        """Return the section of a user node by its type; the type's defaults if there is none."""
        values = (getattr(self, name) for name in self.__struct_fields__)
        return next((value for value in values if isinstance(value, kind)), None) or kind()


@cache
def scenario_with(**sections: type[Section]) -> type[Scenario]:
    """Return the struct of a scenario that has these sections of user nodes as well.

    Args:
        sections: Types of the sections, by node name; a type that replaces a section of `Scenario`
            must be a subclass of that section's type.
    """
    if not sections:
        return Scenario
    each = [(name, kind | None, None) for name, kind in sections.items() if name not in SHARED]
    robot: Any = msgspec.defstruct("RobotConfig", each, bases=(RobotConfig,))
    fields: list[Any] = [("robots", tuple[robot, ...], ())]
    for name, kind in sections.items():
        is_required = any(field.required for field in msgspec.structs.fields(kind))
        fields.append((name, kind) if is_required else (name, kind, kind()))
    struct = msgspec.defstruct("Scenario", fields, bases=(Scenario,), kw_only=True)
    return cast(type[Scenario], struct)
