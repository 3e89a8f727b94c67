"""A scenario from Python, step by step: `from mecazen import Simulation`."""

from __future__ import annotations

import difflib
import inspect
import math
from collections.abc import Iterator, Mapping
from operator import index
from os import PathLike, fspath
from typing import Any, NamedTuple, NoReturn, Self

from mecazen import keys
from mecazen.config import Scenario
from mecazen.config.people import Driven
from mecazen.errors import ConfigError, MecazenError
from mecazen.explain import one_line, show
from mecazen.files import to_value
from mecazen.geometry import Pose2D, Twist2D
from mecazen.keys import Topic
from mecazen.loading import load_scenario, scenario_path, with_settings
from mecazen.messages import FollowerState, Message, Odometry, Twist
from mecazen.programs import graph_of
from mecazen.wire import NS_PER_S, Stamp
from msgspec.structs import replace

from mecazen_tools.simulate import InProcess
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
    as `mecazen simulate`. The run begins at once; close it, or use it in a `with` statement.

    Args:
        scenario: A name, a TOML file, or a loaded scenario.
        seed: Seed of the noise; by default the scenario's.
        duration_s: Simulated seconds; by default the scenario's.
        record: An MCAP file for everything that is published.
        view: Whether the run is drawn for `view`, which takes as long as the run itself.
        settings: Overrides of the scenario by key: `**{"follower.standoff_m": 1.5}`.

    Raises:
        ConfigError: A setting can't be used; the message names the allowed values.

    Examples:
        >>> with Simulation("back", duration_s=2.0) as sim:
        ...     state = sim.run()
        >>> round(state.robot.distance(state.person), 2)
        1.02
    """

    def __init__(
        self,
        scenario: str | PathLike[str] | Scenario,
        *,
        seed: int | None = None,
        duration_s: float | None = None,
        record: str | PathLike[str] | None = None,
        view: bool = False,
        **settings: Any,
    ) -> None:
        refuse_unknown_options(settings, Simulation)
        if seed is not None:
            settings["seed"] = seed
        if duration_s is not None:
            settings["sim.duration_s"] = duration_s
        observers = [RECORDER] * (record is not None) + [VIEWER] * view
        loaded = load(scenario, settings)
        if observers:
            settings["services"] = [*dict.fromkeys((*loaded.services, *observers))]
            if record is not None:
                settings[f"{RECORDER}.file"] = fspath(record)
            loaded = load(scenario, settings)
        self._name = "scenario" if isinstance(scenario, Scenario) else fspath(scenario)
        self._closed = False
        self._run = InProcess(loaded)
        self._graph = graph_of(loaded)
        self._latest: dict[str, Message | None] = {}
        self._held: dict[Topic[Twist], Twist] = {}
        """Commands that are published before each tick."""
        for robot in loaded.names:
            for topic in self._graph.topics:
                self._listen(topic, robot)
        self._run.begin()

    def __repr__(self) -> str:
        """Return scenario, time and seed."""
        of = f"{self.time_s:g} of {self._run.scenario.sim.duration_s:g} s, seed {self._seed}"
        return f"<Simulation {self._name}: {of}{', closed' * self._closed}>"

    def __reduce__(self) -> NoReturn:
        """Refuse a copy: the state of the physics engine can't be copied."""
        raise TypeError(
            "a Simulation can't be pickled or copied; make another from its scenario: "
            "Simulation(sim.scenario)"
        )

    @property
    def _seed(self) -> int:
        return self._run.clock.stamp.seed

    @property
    def scenario(self) -> Scenario:
        """The whole configuration, with the seed of this run and changed parameters."""
        return replace(self._run.clock.live.requested, seed=self._seed)

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self._run.clock.stamp.time_ns / NS_PER_S

    @property
    def is_over(self) -> bool:
        """Whether the scenario's duration has passed."""
        return self._run.clock.tick >= self._run.scenario.sim.ticks - 1

    def reset(self, seed: int | None = None) -> State:
        """Restart with the noise of a seed or of the last run; return the first state.

        The run is bit-identical to that of a new simulation, which takes longer to create. The
        trajectory and the commands are cleared; changed parameters stay. A recording continues with
        the new run.

        Raises:
            ConfigError: The seed is out of range.
            MecazenError: The simulation is closed.
        """
        self._refuse_closed()
        seed = self._seed if seed is None else index(seed)
        if not 0 <= seed < 2**32:
            raise ConfigError(f"seed = {seed} must be between 0 and {2**32 - 1}")
        self._run.reset(seed)
        self._held.clear()
        self._latest = dict.fromkeys(self._latest)
        self._run.begin()
        return self.state

    def step(self) -> State:
        """Simulate one tick, and return the state after it.

        Raises:
            MecazenError: The scenario's duration has passed, a service failed, or the simulation is
                closed.
        """
        self._refuse_closed()
        if self.is_over:
            raise MecazenError(
                f"the run is over after {self._run.scenario.sim.duration_s:g} s; duration_s sets it"
            )
        self._step()
        return self.state

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
        """Simulate as `run` does, and yield after each tick.

        Raises:
            ConfigError: As `run`.
            MecazenError: As `run`.
        """
        self._refuse_closed()
        sim, now = self._run.scenario.sim, self._run.clock.tick
        ticks = sim.ticks - 1 - now
        if seconds is not None:
            if not seconds >= 0.0:
                raise ConfigError(f"seconds = {seconds} must be a number >= 0")
            if seconds < ticks * sim.tick_s:
                ticks = round(seconds / sim.tick_s)
        for _ in range(ticks):
            self._step()
            yield

    def set_parameters(self, **settings: Any) -> None:
        """Change parameters from the next tick on, as `mecazen param set` does.

        >>> with Simulation("back", duration_s=8.0) as sim:
        ...     sim.set_parameters(**{"follower.standoff_m": 1.5})
        ...     state = sim.run()
        >>> round(state.robot.distance(state.person), 1)
        1.5

        Raises:
            ConfigError: A parameter can't change during a run, or a value is invalid; then nothing
                changes.
            MecazenError: The simulation is closed.
        """
        self._refuse_closed()
        self._run.clock.live.set({key: _setting(key, value) for key, value in settings.items()})

    def command(
        self, vx: float = 0.0, vy: float = 0.0, wz: float = 0.0, *, robot: str = ""
    ) -> None:
        """Drive a robot by hand from now on: its velocity in base_link [m/s, m/s, rad/s].

        The velocity is published as `cmd_vel` before each tick; guard and limits apply as to any
        command.

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
        self._hold(keys.CMD_VEL, robot, Twist2D(vx, vy, wz))

    def command_person(
        self, vx: float = 0.0, vy: float = 0.0, wz: float = 0.0, *, robot: str = ""
    ) -> None:
        """Walk the person from now on, in their own frame; their `target.path` must be driven.

        Raises:
            ConfigError: The path is known in advance, there is no robot of this name, or a velocity
                is not finite.
        """
        if not isinstance(self.scenario.of(robot).target.path, Driven):
            raise ConfigError("command_person needs target.path = { kind = 'driven' }")
        self._hold(keys.TARGET_CMD_VEL, robot, Twist2D(vx, vy, wz))

    @property
    def state(self) -> State:
        """The state of the robot, or of the first of several."""
        return self.state_of(self._run.scenario.names[0])

    def state_of(self, robot: str) -> State:
        """Return the state of one of several robots.

        Raises:
            ConfigError: There is no robot of this name.
        """
        truth = self._motion(keys.GROUND_TRUTH, robot)
        person = self._motion(keys.TARGET_ODOM, robot) or (None, None)
        odom = self._motion(keys.ODOM, robot) or (None, None)
        command = self._newest(keys.CMD_VEL, robot)
        follower = self._newest(keys.FOLLOWER_STATE, robot)
        if truth is None:
            raise ConfigError(f"no robot {robot!r}; robots: {', '.join(self.scenario.names)}")
        return State(
            self.time_s,
            truth[0],
            truth[1],
            person[0],
            person[1],
            odom[0],
            command.to_planar() if isinstance(command, Twist) else None,
            follower if isinstance(follower, FollowerState) else None,
        )

    def latest(self, key: str) -> Message | None:
        """Return the newest message on a key, such as `odom` or `one/odom`; None: no message yet.

        >>> with Simulation("back", duration_s=0.1) as sim:
        ...     sim.latest("clock").clock.nanosec, sim.step().time_s, sim.latest("scan")
        (0, 0.01, None)

        Raises:
            ConfigError: No node of the scenario receives or publishes the key.
        """
        if key not in self._latest:
            raise ConfigError(
                f"{key}: no key of this scenario; its keys: {', '.join(self._latest)}"
            )
        return self._latest[key]

    @property
    def trajectory(self) -> Trajectory:
        """Every tick so far: `to_numpy()`, `to_pandas()`, `csv()`, `sha256()`."""
        return self._run.trajectory

    def scores(self, robot: str | None = None) -> Scores:
        """Return the published measures of following so far, of the first robot or a named one."""
        name = self.scenario.names[0] if robot is None else robot
        return self.trajectory.scores(self._run.scenario.of(name).follower.standoff, name)

    def contacts(self, robot: str | None = None) -> Contacts:
        """Return the numbers of contacts so far, of the first robot or a named one."""
        name = self.scenario.names[0] if robot is None else robot
        return self.trajectory.contacts(self._run.scenario, name)

    def view(self) -> Any:
        """Return Rerun's notebook widget, which shows the run from its start and follows it live.

        Raises:
            MecazenError: The widget is not installed, or the run was begun without `view=True`.
        """
        for member in self._run.observers:
            if (widget := getattr(member, "widget", None)) is not None:
                return widget()
        raise MecazenError("nothing has drawn this run: Simulation(..., view=True) does")

    def close(self) -> None:
        """End the services' work; a recording is then complete."""
        self._closed = True
        self._run.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _step(self) -> None:
        for topic, command in self._held.items():
            self._run.bus.publisher(topic).put(command, None)
        self._run.step()

    def _refuse_closed(self) -> None:
        if self._closed:
            raise MecazenError("the simulation is closed")

    def _listen(self, topic: Topic[Any], robot: str) -> None:
        on_bus = keys.of_robot(topic, robot)
        key = self._run.bus.key_of(on_bus)
        self._latest[key] = None

        def take(message: Message, stamp: Stamp | None) -> None:
            del stamp
            self._latest[key] = message

        self._run.bus.subscribe(on_bus, take)

    def _newest(self, topic: Topic[Any], robot: str) -> Message | None:
        return self._latest.get(self._run.bus.key_of(keys.of_robot(topic, robot)))

    def _motion(self, topic: Topic[Odometry], robot: str) -> tuple[Pose2D, Twist2D] | None:
        odometry = self._newest(topic, robot)
        if not isinstance(odometry, Odometry):
            return None
        return odometry.pose.pose.to_planar(), odometry.twist.twist.to_planar()

    def _hold(self, topic: Topic[Twist], robot: str, velocity: Twist2D) -> None:
        self._refuse_closed()
        if robot not in self.scenario.names:
            known = ", ".join(self.scenario.names) or "one without a name"
            raise ConfigError(f"no robot {robot!r}; there is {known}")
        giver = self._graph.giver(topic.key)
        if giver is not None:
            raise ConfigError(
                f"{giver.name} drives: leave it out of services, as the scenario teleop does"
            )
        velocity = Twist2D(*map(float, velocity))  # also for NumPy's numbers
        if not all(map(math.isfinite, velocity)):
            raise ConfigError(f"{velocity} must be finite numbers [m/s, m/s, rad/s]")
        self._held[keys.of_robot(topic, robot)] = Twist.planar(velocity)


def load(scenario: str | PathLike[str] | Scenario, settings: Mapping[str, Any]) -> Scenario:
    """Return a scenario by its name or file, or a loaded one, with settings by key.

    Raises:
        ConfigError: One line with the file, the key and the allowed values.
    """
    try:
        if isinstance(scenario, Scenario):
            return with_settings(scenario, settings)
        try:
            name = fspath(scenario)
        except TypeError:
            said = f"scenario: got {show(scenario)}; must be a name, a file or a Scenario"
            raise ConfigError(one_line(said)) from None
        return load_scenario(scenario_path(name), settings)
    except ConfigError as error:
        raise ConfigError(str(error).replace("--set ", "")) from None  # Python has no such option


def refuse_unknown_options(settings: Mapping[str, Any], made: type) -> None:
    """Check settings for misspelt options of the class `made`.

    Raises:
        ConfigError: A setting is no section of a scenario, but similar to an option.
    """
    options = inspect.signature(made).parameters
    for name in settings.keys() - set(Scenario.__struct_fields__):
        if near := difflib.get_close_matches(name, options, n=1):
            raise ConfigError(f"{name}: no option of {made.__name__}; did you mean {near[0]}?")


def _setting(key: str, value: Any) -> str:
    """Return the value of a setting as TOML.

    Raises:
        ConfigError: TOML has no such value.
    """
    try:
        return to_value(value)
    except (TypeError, ValueError):
        raise ConfigError(one_line(f"{key}: got {show(value)}; TOML has no such value")) from None
