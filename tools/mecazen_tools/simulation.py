"""A scenario from Python, step by step: `from mecazen import Simulation`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing
from itertools import product
from operator import index
from os import PathLike, fspath
from typing import Any, NamedTuple, Self

from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.errors import ConfigError, MecazenError
from mecazen.explain import show
from mecazen.geometry import Pose2D, Twist2D
from mecazen.graph import OBSERVERS
from mecazen.keys import Topic
from mecazen.loading import load_scenario, scenario_path, with_settings
from mecazen.messages import FollowerState, Message, Odometry, Twist
from mecazen.programs import graph_of
from mecazen.runtime.clock import Clock
from mecazen.runtime.host import Host
from mecazen.runtime.process import observe
from mecazen.text import printable
from mecazen.wire import NS_PER_S, Stamp
from msgspec.structs import replace

from mecazen_tools.trajectory import Contacts, Scores, Trajectory

RECORDER, VIEWER = "recorder", "viewer"


class State(NamedTuple):
    """State of a robot and its person at a tick; None for values not published yet."""

    time_s: float
    robot: Pose2D
    """The true pose of base_link in world [m, m, rad]."""
    robot_twist: Twist2D
    """The true velocity in base_link [m/s, m/s, rad/s]."""
    person: Pose2D | None
    """The person's true pose in world."""
    person_twist: Twist2D | None
    """The person's true velocity in their own frame: x forward, y left."""
    odom: Pose2D | None
    """The robot's own estimate of its pose, in odom."""
    command: Twist2D | None
    """The newest `cmd_vel`, in base_link."""
    follower: FollowerState | None


class Simulation:
    """A scenario in this process, in lockstep, tick by tick.

    The same scenario, seed and commands give the same trajectory to the last bit, and the same
    as `mecazen simulate`. The first tick is made at once. Close the simulation, or use it in a
    `with` statement.

    Args:
        scenario: A name, a TOML file, or a loaded scenario.
        settings: Values that replace those of the scenario, by key.
        seed: Seed of the noise; by default the scenario's.
        duration_s: Simulated seconds; by default the scenario's.
        record: An MCAP file for everything that is published.
        view: Whether the run is drawn for `view`, which takes as long as the run itself.

    Raises:
        ConfigError: A setting can't be used; the message names the allowed values.

    Attributes:
        bus: The bus of the services. A subscriber receives the samples from the next tick on;
            `reset` repeats the first tick.
        trajectory: Every tick so far: `to_numpy()`, `to_pandas()`, `csv()`, `sha256()`.

    Examples:
        >>> with Simulation("back", {"follower.standoff_m": 1.5}, duration_s=8.0) as sim:
        ...     state = sim.run()
        >>> round(state.robot.distance(state.person), 1)
        1.5
    """

    def __init__(
        self,
        scenario: str | PathLike[str] | Scenario,
        settings: Mapping[str, Any] = {},
        *,
        seed: int | None = None,
        duration_s: float | None = None,
        record: str | PathLike[str] | None = None,
        view: bool = False,
    ) -> None:
        settings = dict(settings)
        if seed is not None:
            settings["seed"] = seed
        if duration_s is not None:
            settings["sim.duration_s"] = duration_s
        loaded = load(scenario, settings)
        observers = [RECORDER] * (record is not None) + [VIEWER] * view
        if observers:
            file = {} if record is None else {f"{RECORDER}.file": record}
            names = [*dict.fromkeys((*loaded.services, *observers))]
            loaded = load(loaded, {"services": names, **file})
        self._scenario = in_lockstep(loaded)
        self._graph = graph_of(loaded)
        self._latest: dict[str, Message | None] = {}
        self._commands: dict[Topic[Twist], Twist] = {}
        """Commands that are published before each tick."""
        self.bus = Bus(loaded.renamed)
        self.trajectory = Trajectory(self.bus, self._scenario)
        for robot, topic in product(loaded.names, self._graph.topics):
            self._keep_latest(keys.of_robot(topic, robot))
        parts = self._scenario.parts
        nodes = [part for part in parts if part[0] not in OBSERVERS]
        with ExitStack() as services:
            self.host = services.enter_context(closing(Host(nodes, self.bus, self._scenario)))
            self.clock = Clock(self.host)
            self._observers = [
                services.enter_context(closing(observe(name, self.bus, self._scenario)))
                for name, _ in parts
                if name in OBSERVERS
            ]
            for part in parts:
                self.bus.declare_alive(*part)
            self.clock.begin()
            self._services: ExitStack | None = services.pop_all()

    def _keep_latest(self, topic: Topic[Any]) -> None:
        key = self.bus.key_of(topic)
        self._latest[key] = None

        def keep(message: Message, _: Stamp | None) -> None:
            self._latest[key] = message

        self.bus.subscribe(topic, keep)

    @property
    def scenario(self) -> Scenario:
        """The whole configuration, with the seed of this run and changed parameters."""
        return replace(self.clock.live.requested, seed=self.clock.stamp.seed)

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self.clock.stamp.time_ns / NS_PER_S

    @property
    def is_over(self) -> bool:
        """Whether the scenario's duration has passed."""
        return self._ticks_left <= 0

    @property
    def _ticks_left(self) -> int:
        return self._scenario.sim.ticks - 1 - self.clock.tick

    def reset(self, seed: int | None = None) -> State:
        """Restart with the noise of a seed or of the last run; return the first state.

        The run is bit-identical to that of a new simulation. Trajectory and commands are cleared;
        changed parameters stay. A recording continues with the new run.

        Raises:
            ConfigError: The seed is out of range.
            MecazenError: The simulation is closed.
        """
        self._refuse_closed()
        seed = self.clock.stamp.seed if seed is None else index(seed)
        if not 0 <= seed < 2**32:
            raise ConfigError(f"seed = {seed} must be between 0 and {2**32 - 1}")
        self._commands.clear()
        self._latest = dict.fromkeys(self._latest)
        self.trajectory.reset()
        self.clock.reset(seed)
        self.clock.begin()
        return self.state

    def step(self) -> State:
        """Simulate one tick, and return the state after it.

        Raises:
            MecazenError: The run is over, a service failed, or the simulation is closed.
        """
        self._refuse_closed()
        if self.is_over:
            raise MecazenError(
                f"the run is over after {self._scenario.sim.duration_s:g} s; duration_s sets it"
            )
        return self.run(self._scenario.sim.tick_s)

    def run(self, seconds: float | None = None) -> State:
        """Simulate some seconds, or until the end of the run; return the state there.

        Raises:
            ConfigError: The time is negative or NaN.
            MecazenError: A service failed, or the simulation is closed.
        """
        for _ in self.ticks(seconds):
            pass
        return self.state

    def ticks(self, seconds: float | None = None) -> Iterator[None]:
        """Simulate as `run` does, and yield after each tick; raises as `run`."""
        self._refuse_closed()
        ticks, tick_s = self._ticks_left, self._scenario.sim.tick_s
        if seconds is not None:
            if not seconds >= 0.0:
                raise ConfigError(f"seconds = {seconds} must be a number >= 0")
            if seconds < ticks * tick_s:
                ticks = round(seconds / tick_s)
        for _ in range(ticks):
            for topic, command in self._commands.items():
                self.bus.publisher(topic).put(command, None)
            self.clock.step()
            yield

    def set_parameters(self, settings: Mapping[str, Any]) -> None:
        """Change parameters from the next tick on, as `mecazen param set` does.

        Examples:
            >>> with Simulation("back", duration_s=8.0) as sim:
            ...     sim.set_parameters({"follower.standoff_m": 1.5})
            ...     state = sim.run()
            >>> round(state.robot.distance(state.person), 1)
            1.5

        Raises:
            ConfigError: A parameter can't change during a run, or a value is invalid; then nothing
                changes.
            MecazenError: The simulation is closed.
        """
        self._refuse_closed()
        self.clock.live.set(settings)

    def command(
        self, vx: float = 0.0, vy: float = 0.0, wz: float = 0.0, *, robot: str = ""
    ) -> None:
        """Drive a robot by hand from now on: its velocity in base_link [m/s, m/s, rad/s].

        The velocity is published as `cmd_vel` before each tick; guard and limits apply as to any
        command. By default it is for the first robot, as in all methods with a robot's name.

        Examples:
            >>> with Simulation("teleop", duration_s=1.0) as sim:
            ...     sim.command(wz=0.5)
            ...     state = sim.run()
            >>> round(state.robot_twist.yaw, 1)
            0.5

        Raises:
            ConfigError: A node of the scenario drives the robot, no robot has this name, or a
                velocity is not finite.
            MecazenError: The simulation is closed.
        """
        self._refuse_closed()
        if (node := self._graph.giver(keys.CMD_VEL.key)) is not None:
            raise ConfigError(
                f"{node.name} drives: leave it out of services, as the scenario teleop does"
            )
        velocity = Twist2D(float(vx), float(vy), float(wz))  # also of NumPy
        if not all(map(math.isfinite, velocity)):
            raise ConfigError(f"{velocity} must be finite numbers [m/s, m/s, rad/s]")
        self._commands[keys.of_robot(keys.CMD_VEL, self._name(robot))] = Twist.planar(velocity)

    @property
    def state(self) -> State:
        """The state of the robot, or of the first of several."""
        return self.state_of()

    def state_of(self, robot: str = "") -> State:
        """Return the state of one of several robots.

        Raises:
            ConfigError: There is no robot of this name.
        """
        robot = self._name(robot)
        if self._newest(keys.GROUND_TRUTH, robot) is None:  # of a real robot
            raise ConfigError(f"nothing publishes {keys.GROUND_TRUTH.key}")
        command = self._newest(keys.CMD_VEL, robot)
        return State(
            self.time_s,
            *self._motion(keys.GROUND_TRUTH, robot),
            *self._motion(keys.TARGET_ODOM, robot),
            self._motion(keys.ODOM, robot)[0],
            None if command is None else command.to_planar(),
            self._newest(keys.FOLLOWER_STATE, robot),
        )

    def _motion(self, topic: Topic[Odometry], robot: str) -> tuple[Any, Any]:
        odometry = self._newest(topic, robot)
        if odometry is None:
            return None, None
        return odometry.pose.pose.to_planar(), odometry.twist.twist.to_planar()

    def _newest(self, topic: Topic[Any], robot: str) -> Any:
        return self._latest.get(self.bus.key_of(keys.of_robot(topic, robot)))

    def latest(self, key: str) -> Message | None:
        """Return the newest message on a key, such as `odom` or `one/odom`; None: no message yet.

        Examples:
            >>> with Simulation("back", duration_s=0.1) as sim:
            ...     sim.latest("clock").clock.nanosec, sim.step().time_s, sim.latest("people")
            (0, 0.01, None)

        Raises:
            ConfigError: No node of the scenario receives or publishes the key.
        """
        if key not in self._latest:
            raise ConfigError(
                f"{key}: no key of this scenario; its keys: {', '.join(self._latest)}"
            )
        return self._latest[key]

    def scores(self, robot: str = "") -> Scores:
        """Return the published measures of following so far; raises as `state_of`."""
        return self.trajectory.scores(self._name(robot))

    def contacts(self, robot: str = "") -> Contacts:
        """Return the numbers of contacts so far; raises as `state_of`."""
        return self.trajectory.contacts(self._name(robot))

    def view(self) -> Any:
        """Return Rerun's notebook widget, which shows the run from its start and follows it live.

        Raises:
            MecazenError: The widget is not installed, or the run was begun without `view=True`.
        """
        for observer in self._observers:
            if (widget := getattr(observer, "widget", None)) is not None:
                return widget()
        raise MecazenError("nothing has drawn this run: Simulation(..., view=True) does")

    def close(self) -> None:
        """End the services' work; a recording is then complete."""
        if self._services is not None:
            self._services.close()
            self._services = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _refuse_closed(self) -> None:
        if self._services is None:
            raise MecazenError("the simulation is closed")

    def _name(self, robot: str) -> str:
        """Return the name of a robot; by default of the first of several."""
        names = self._scenario.names
        if robot and robot not in names:
            known = ", ".join(names) or "one without a name"
            raise ConfigError(f"no robot {robot!r}; robots: {known}")
        return robot or names[0]


def load(scenario: str | PathLike[str] | Scenario, settings: Mapping[str, Any]) -> Scenario:
    """Return a scenario by its name or file, or a loaded one, with settings by key.

    Raises:
        ConfigError: One line with the file, the key and the allowed values.
    """
    if isinstance(scenario, Scenario):
        return with_settings(scenario, settings) if settings else scenario
    try:
        name = fspath(scenario)
    except TypeError:
        problem = f"scenario: got {show(scenario)}; must be a name, a file or a Scenario"
        raise ConfigError(printable(problem)) from None
    return load_scenario(scenario_path(name), settings)


def in_lockstep(scenario: Scenario) -> Scenario:
    """Return the scenario with simulated time in lockstep."""
    return replace(scenario, sim=replace(scenario.sim, mode="lockstep"))
