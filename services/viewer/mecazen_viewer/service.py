"""The viewer: draws all published samples, and serves or stores the pictures."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from functools import partial
from itertools import chain, dropwhile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr
import rerun_bindings
from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.errors import BusError, ConfigError, MecazenError, RefusedError
from mecazen.keys import Topic
from mecazen.messages import MessageT, Parameters
from mecazen.robots import join_key
from mecazen.runtime.observer import Observer
from mecazen.urdf import ask_description, serve_description
from mecazen.wire import NS_PER_S, Stamp

from mecazen_viewer.layout import TIMELINE, blueprint
from mecazen_viewer.panels import StatusText
from mecazen_viewer.picture import Picture
from mecazen_viewer.rerun_process import RerunError, RerunServer, open_window
from mecazen_viewer.scene import surroundings

if TYPE_CHECKING:
    from rerun.notebook import Viewer

logger = logging.getLogger(__name__)

FRAME_S = 1 / 30
FRAME_NS = round(FRAME_S * NS_PER_S)
BATCH_S = 0.1
"""Period of sending logged data: a batch costs as much as a few frames."""
DESCRIPTION_TIMEOUT_S = 2.0
MEMORY_LIMIT = "32MiB"
"""Size of the history for viewers that connect late: some minutes; the oldest data is dropped
first."""


class ViewerService(Observer):
    """Shows every run, with all its robots, as a separate recording."""

    def __init__(self, name: str, bus: Bus, scenario: Scenario) -> None:
        self.config = scenario.viewer
        self.runs = 0
        self.send: Callable[[rr.RecordingStream], None] | None = None
        """Function that is called with the recording of each run before any data is logged. If it
        is None, the recording is kept in memory for `widget`."""
        self.recording: rr.RecordingStream | None = None
        self.thins = True
        """Whether `show` leaves out samples between frames; if not, whoever publishes does."""
        self._shown_ns: dict[tuple[str, int], int] = {}
        self._pictures: dict[str, Picture] = {}
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
        self.show("", keys.PARAMETERS, Picture.on_parameters)
        for part, robot in scenario.parts:
            draw = partial(Picture.on_diagnostics, service=part)
            self.show(robot, keys.diagnostics(part), draw)

    def reset(self, seed: int) -> None:
        self.close()

    def run(self) -> None:
        with ExitStack() as programs:
            server = RerunServer(self.config, f"--server-memory-limit={MEMORY_LIMIT}")
            programs.enter_context(closing(server))
            if self.config.native:
                try:
                    window = open_window(f"--connect={server.uri}")
                    programs.enter_context(closing(window))
                except RerunError as error:
                    logger.warning("msg=%r", f"no window: {error}")
            self.serve_at(server.uri)
            logger.info("msg=serving url=%s", server.url)
            try:
                while True:
                    self.bus.spin_once()
                    self.bus.drain()
                    server.check()
                    # during this time newer samples replace older samples, which are not decoded
                    time.sleep(FRAME_S)
            finally:
                self.close()

    def serve_at(self, uri: str) -> None:
        """Send the recordings of all runs to a server; attached viewers switch to the newest."""

        def connect(recording: rr.RecordingStream) -> None:
            # the server keeps the layout for all runs, and a viewer keeps its user's changes
            first = self.runs == 1
            layout = blueprint(self.scenario.names) if first else None
            recording.connect_grpc(uri, default_blueprint=layout)

        self.send, self.thins = connect, False  # the bus keeps only the newest samples

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
        draw: Callable[[Picture, MessageT], None],
    ) -> None:
        """Draw the messages of a robot's topic, at the time of the tick."""
        key = join_key(topic.key, robot)

        def deliver(message: MessageT, stamp: Stamp | None) -> None:
            if stamp is None and self.recording is None:
                return  # an unstamped sample before the first run
            time_ns = (self.stamp if stamp is None else stamp).time_ns
            if self.thins and not self.is_due(key, self.stamp.run, time_ns):
                return
            if self.recording is None:
                self.recording = self.begin()
            self.recording.set_time(TIMELINE, duration=np.timedelta64(time_ns, "ns"))
            picture = self._pictures[robot]
            picture.time_ns = time_ns
            try:
                draw(picture, message)
            except RefusedError as refusal:
                self.bus.refuse(key, str(refusal))

        self.subscribe(topic, deliver, robot=robot)

    def is_due(self, key: str, run: int, time_ns: int) -> bool:
        """Return whether the last frame of a key is over at a time of a run; begin one if so."""
        if key == keys.PARAMETERS.key:
            return True  # changes are few, and each is needed
        if time_ns - self._shown_ns.get((key, run), -FRAME_NS) < FRAME_NS:
            return False
        self._shown_ns[key, run] = time_ns
        return True

    def begin(self) -> rr.RecordingStream:
        """Return the recording of a new run, with all static entities."""
        self.runs += 1
        scenario = self.scenario
        recording = rr.RecordingStream(
            # under this name Rerun stores the user's changes of the layout
            " ".join(("mecazen", *filter(None, scenario.names))),
            recording_id=f"{self.stamp.run:08x}",
            batcher_config=rr.ChunkBatcherConfig(flush_tick=BATCH_S),
        )
        recording.set_log_tick_enabled(False)
        recording.set_log_time_enabled(False)
        if self.send is not None:
            self.send(recording)
        # each of several robots has a separate seed
        seed = "" if scenario.robots else f", seed {self.stamp.seed}"
        recording.send_recording_name(f"run {self.runs}{seed}")
        for path, archetype in surroundings(scenario):
            recording.log(path, archetype, static=True)
        texts = StatusText()
        self._pictures = {"": Picture(recording, scenario, texts)}
        recording.set_time(TIMELINE, duration=0.0)
        self._pictures[""].on_parameters(Parameters())
        for robot in scenario.names:
            own = scenario.of(robot) if robot else scenario
            picture = self._pictures[robot] = Picture(recording, own, texts, robot)
            picture.begin()
            try:
                picture.draw_robot(ask_description(self.bus, robot, DESCRIPTION_TIMEOUT_S))
            except (BusError, RefusedError) as error:
                logger.warning("msg=%r", f"no picture of {robot or 'the robot'}: {error}")
        return recording

    def close(self) -> None:
        """End the recording of a run."""
        if self.recording is not None and self.send is None:
            self.recording.flush()  # so that a widget shows all data
        self.recording = None
        self._pictures.clear()
        # an orphaned recording keeps its threads until this call, which raises if any recording of
        # this process has lost its server: `run` reports the loss of its own server
        with suppress(RuntimeError):
            rerun_bindings.flush_and_cleanup_orphaned_recordings()


def draw(recording: Any, folder: Path) -> list[Path]:
    """Draw a `mecazen_recorder.reader.Recording` into files for Rerun, one for each run.

    Raises:
        MecazenError: The recording lacks the configuration of its run, or holds no run.
    """
    samples = dropwhile(lambda sample: sample.stamp is None, recording.samples())
    first = next(samples, None)
    if first is None:
        raise ConfigError(f"{recording.path}: holds no run")
    scenario = recording.scenario(first.stamp.run, "follower")  # with its distance
    bus = Bus()
    bus.renamed = scenario.renamed
    for robot, description in recording.descriptions().items():
        serve_description(bus, robot, description)
    files: list[Path] = []

    def save(run: rr.RecordingStream) -> None:
        files.append(folder / f"{len(files)}.rrd")
        run.save(files[-1], default_blueprint=blueprint(scenario.names))

    viewer = ViewerService("viewer", bus, scenario)
    viewer.send, viewer.thins = save, False
    run = first.stamp.run
    with closing(viewer):
        for sample in chain((first,), samples):
            run = run if sample.stamp is None else sample.stamp.run
            if viewer.is_due(sample.key, run, sample.time_ns):  # decoding takes the most time
                try:
                    bus.put_bytes(sample.key, *sample.as_published())
                except RefusedError as refusal:
                    bus.refuse(sample.key, str(refusal))
    return files
