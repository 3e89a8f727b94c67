"""The viewer: draws all published samples, and serves the pictures."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun_bindings
from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.errors import BusError, MecazenError, RefusedError
from mecazen.keys import Topic
from mecazen.messages import MessageT
from mecazen.robots import join_key
from mecazen.runtime.observer import Observer
from mecazen.urdf import ask_description
from mecazen.wire import NS_PER_S, Stamp

from mecazen_viewer.entities import TIMELINE, Entity, of_robot
from mecazen_viewer.health import Health
from mecazen_viewer.layout import application, blueprint
from mecazen_viewer.picture import Picture, surroundings
from mecazen_viewer.server import serving

if TYPE_CHECKING:
    from rerun.notebook import Viewer

logger = logging.getLogger(__name__)

FRAME_S = 1 / 30
FRAME_NS = round(FRAME_S * NS_PER_S)
BATCH_S = 0.1
"""Period of sending logged data: a batch costs as much as a few frames."""
DESCRIPTION_TIMEOUT_S = 2.0


class ViewerService(Observer):
    """Shows every run, with all its robots, as a separate recording."""

    def __init__(self, name: str, bus: Bus, scenario: Scenario) -> None:
        self.config = scenario.viewer
        self.runs = 0
        self.send: Callable[[rr.RecordingStream], None] | None = None
        """Function that is called with the recording of each run before any data is logged. If it
        is None, the recording is kept in memory for `widget`, at the rate of a live picture."""
        self.recording: rr.RecordingStream | None = None
        self.logged_ns = -1
        self._shown: dict[str, int] = {}
        super().__init__(name, bus, scenario)
        self.reset(scenario.seed)
        for robot in scenario.names:
            self.show(robot, keys.GROUND_TRUTH, Picture.on_ground_truth)
            self.show(robot, keys.JOINT_STATES, Picture.on_joint_states)
            self.show(robot, keys.JOINT_COMMAND, Picture.on_joint_command)
            self.show(robot, keys.ODOM, Picture.on_odom)
            self.show(robot, keys.TARGET_ODOM, Picture.on_target_odom)
            self.show(robot, keys.OBSERVATION, Picture.on_observation)
            self.show(robot, keys.TARGET_SKELETON, Picture.on_skeleton)
            self.show(robot, keys.SKELETONS, Picture.on_skeletons)
            self.show(robot, keys.SCAN, Picture.on_scan)
            self.show(robot, keys.DEPTH, Picture.on_depth)
            self.show(robot, keys.FOLLOWER_STATE, Picture.on_follower_state)
            self.show(robot, keys.CMD_VEL, Picture.on_cmd_vel)
            self.show(robot, keys.GUARD_STATE, Picture.on_guard_state)
        self.show("", keys.PEOPLE, Picture.on_people)
        for part, robot in scenario.parts:
            draw = partial(Picture.on_diagnostics, service=part)
            self.show(robot, keys.diagnostics(part), draw)

    def reset(self, seed: int) -> None:
        """Begin new pictures: one for each robot, and one for shared entities."""
        del seed
        self.end()
        self._shown.clear()
        scenario, health = self.scenario, Health()
        self.pictures = {
            robot: Picture(scenario.of(robot) if robot else scenario, health, robot)
            for robot in dict.fromkeys(("", *scenario.names))
        }

    def run(self) -> None:
        """Show the newest samples, 30 times a second."""
        with serving(self.config, blueprint(self.scenario.names)) as server:
            self.send = server.take
            logger.info("msg=serving url=%s", server.url)
            try:
                while True:
                    self.bus.spin_once()
                    self.bus.drain()
                    server.check()
                    # during this time newer samples replace older samples, which are not decoded
                    time.sleep(FRAME_S)
            finally:
                self.end()

    def widget(self) -> Viewer:
        """Return a notebook widget that shows this run from its start and follows it live.

        Raises:
            MecazenError: Rerun's widget is not installed, or nothing has been published yet.
        """
        if self.recording is None:
            raise MecazenError("nothing to view yet")
        try:
            from rerun.notebook import Viewer  # noqa: PLC0415 - only notebooks need widgets

            return Viewer(recording=self.recording, blueprint=blueprint(self.scenario.names))
        except ImportError:
            problem = "a notebook shows the run with Rerun's widget"
            raise MecazenError(f"{problem}: pip install 'mecazen[notebook]'") from None

    def show(
        self,
        robot: str,
        topic: Topic[MessageT],
        draw: Callable[[Picture, MessageT, int], Iterable[Entity]],
    ) -> None:
        """Log the entities that `draw` returns for a robot's topic, at the time of the tick."""
        key = join_key(topic.key, robot)

        def deliver(message: MessageT, stamp: Stamp | None) -> None:
            if stamp is None and self.recording is None:
                return  # an unstamped sample before the first run
            time_ns = (self.stamp if stamp is None else stamp).time_ns
            if self.send is None:
                if time_ns - self._shown.get(key, -FRAME_NS) < FRAME_NS:
                    return
                self._shown[key] = time_ns
            try:
                entities = list(draw(self.pictures[robot], message, time_ns))
            except RefusedError as refusal:
                self.bus.refuse(join_key(topic.key, robot), str(refusal))
                return
            self.log(robot, entities, time_ns)

        self.subscribe(topic, deliver, robot=robot)

    def log(self, robot: str, entities: Iterable[Entity], time_ns: int) -> None:
        """Log a robot's entities at a simulated time in the recording of this run."""
        if self.recording is None:
            self.recording = self.begin()
        if time_ns != self.logged_ns:
            self.recording.set_time(TIMELINE, duration=np.timedelta64(time_ns, "ns"))
            self.logged_ns = time_ns
        for path, archetype in entities:
            self.recording.log(of_robot(path, robot), archetype)
        for path, archetype in self.pictures[robot].statics():
            self.recording.log(of_robot(path, robot), archetype, static=True)

    def begin(self) -> rr.RecordingStream:
        """Return the recording of a new run, with all static entities."""
        self.runs += 1
        recording = rr.RecordingStream(
            application(self.scenario.names),
            recording_id=f"{self.stamp.run:08x}",
            batcher_config=rr.ChunkBatcherConfig(flush_tick=BATCH_S),
        )
        recording.set_log_tick_enabled(False)
        recording.set_log_time_enabled(False)
        if self.send is not None:
            self.send(recording)
        # each of several robots has a separate seed
        seed = "" if self.scenario.robots else f", seed {self.stamp.seed}"
        recording.send_recording_name(f"run {self.runs}{seed}")
        for path, archetype in surroundings(self.scenario):
            recording.log(path, archetype, static=True)
        for robot in self.scenario.names:
            for path, archetype in [*self.pictures[robot].shapes(), *self.robot(robot)]:
                recording.log(of_robot(path, robot), archetype, static=True)
        return recording

    def close(self) -> None:
        """End the recording."""
        self.end()

    def end(self) -> None:
        """End the recording of a run."""
        if self.recording is not None and self.send is None:
            self.recording.flush()  # so that a widget shows all data
        self.recording, self.logged_ns = None, -1
        # an orphaned recording keeps its threads until this call, which raises if any recording of
        # this process has lost its server: `run` reports the loss of its own server
        with suppress(RuntimeError):
            rerun_bindings.flush_and_cleanup_orphaned_recordings()

    def robot(self, name: str) -> Iterable[Entity]:
        """Return the static entities of a robot; none if no service describes it."""
        try:
            description = ask_description(self.bus, name, DESCRIPTION_TIMEOUT_S)
            return self.pictures[name].robot_shapes(description)
        except (BusError, RefusedError) as error:
            logger.warning("msg=%r", f"no picture of {name or 'the robot'}: {error}")
            return []
