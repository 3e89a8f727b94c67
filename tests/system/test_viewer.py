"""The viewer beside a real simulation: pictures, resets, and its own end."""

import io
import os
import shutil
import signal
from collections.abc import Callable
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from harness import ROOT, SCENARIOS, Newest, here
from mecazen import keys
from mecazen.messages import SpeedRequest
from mecazen_recorder.reader import Recording
from mecazen_viewer.layout import path_of_robot
from mecazen_viewer.panels import ROBOT_PLOTS
from mecazen_viewer.service import draw
from PIL import Image
from viewer_stage import paths_of

FREE_PORTS = ("viewer.web_port=0", "viewer.data_port=0")
FRAMES = 200
"""Pictures taken one after the other until one shows what it should: only a hang needs so many."""

BACKGROUND = (206, 211, 218)
RED_OVER_OTHERS = 60
"""The arrow and the trail are red by far more; skin, orange and purple by less."""


class Shown:
    """A running scenario with a viewer beside it."""

    def __init__(self, stack, scenario: str, *settings: str) -> None:
        self.running = stack(SCENARIOS / f"{scenario}.toml", *FREE_PORTS, *settings)
        self._clock = Newest(self.running.bus, keys.CLOCK)
        self.running.start()
        self.running.launch("viewer", needed=False)
        self.url = ""
        self.running.wait_unwatched(self._has_url)

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return self._clock.stamp.time_ns / 1e9 if self._clock.stamp else 0.0

    def _has_url(self) -> bool:
        line = self.running.supervisor.poll(0.0)
        assert line is None or "viewer has ended" not in line.text, line
        if line is not None and line.is_address:
            self.url = line.text
        return bool(self.url)

    @property
    def uri(self) -> str:
        """The address for a native viewer."""
        return parse_qs(urlsplit(self.url).query)["url"][0]

    def until(self, time_s: float) -> None:
        """Let simulated time pass."""
        self.running.wait(lambda: self.time_s > time_s)

    def slow_down(self) -> None:
        """Let the run go on so slowly that there is time to draw it in software."""
        self.running.call(keys.SIM_SPEED, SpeedRequest(speed=0.02))


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def share(image: np.ndarray, like: Callable[[np.ndarray], np.ndarray]) -> float:
    """The share of pixels for whose colours (..., 3) a condition holds."""
    return float(np.mean(like(image)))


def red(image: np.ndarray) -> np.ndarray:
    return image[..., 0] - image[..., 1:].max(axis=-1) > RED_OVER_OTHERS


def ground(image: np.ndarray) -> np.ndarray:
    return np.abs(image - BACKGROUND).max(axis=-1) < 8


def yellow(image: np.ndarray) -> np.ndarray:
    return image[..., 1] - image[..., 2] > 60


def shows_the_scene(image: np.ndarray) -> bool:
    """Return whether the person's red arrow is visible on mostly free ground."""
    return share(image, red) > 0.001 and 0.5 < share(image, ground) < 0.99


def shows_two_persons(image: np.ndarray) -> bool:
    """Whether the view from above, at the lower left, shows two persons on their ways along x."""
    height, width, _ = image.shape
    above = image[int(0.65 * height) : int(0.96 * height), : int(0.3 * width)]
    rows = np.flatnonzero(red(above).any(axis=1))
    # they are 1.5 m apart, and y is up: 0.5 m are a tenth of what is seen from 5 m
    return len(rows) > 1 and np.diff(rows).max() > 0.1 * len(above)


def until_shown(picture: Callable[[], bytes], good: Callable[[np.ndarray], bool]) -> np.ndarray:
    """Take pictures until one is good; the last is kept for who looks into a failure."""
    for _ in range(FRAMES):
        png = picture()
        if good(pixels(png)):
            return pixels(png)
    (ROOT / "out").mkdir(exist_ok=True)
    (ROOT / "out" / "not_shown.png").write_bytes(png)
    raise AssertionError("never shown; the last picture is out/not_shown.png")


def test_a_native_viewer_shows_robot_person_and_every_plot_of_a_live_run(stack, attach):
    shown = Shown(stack, "side", "sim.speed=3")
    # counted from when the viewer is there, and enough to reach beyond the legends of small plots
    shown.until(shown.time_s + 6.0)
    shown.slow_down()
    attach.open(shown.uri)
    whole = until_shown(attach.take_screenshot, lambda image: share(image, red) > 0.001)
    assert whole.shape == (720, 1280, 3)
    state = attach.get_state()
    assert all(view.visible and not view.reports for view in state.views)
    views = {view.name: view.view_id for view in state.views}

    def take(name):
        return lambda: attach.take_screenshot(views[name])

    follow = until_shown(take("following"), shows_the_scene)
    # the robot is yellow, in the lower middle of the view that follows it
    height, width, _ = follow.shape
    around = follow[height // 2 :, width // 5 : 4 * width // 5]
    assert share(around, yellow) > 0.01
    assert shows_the_scene(until_shown(take("from above"), shows_the_scene))
    for plot in (name for name in views if "error" in name or "speed" in name or "NEES" in name):
        # lines take up some of it: blue is in every plot
        blue = until_shown(
            take(plot), lambda image: share(image, lambda i: i[..., 2] - i[..., 0] > 60) > 0.001
        )
        assert share(blue, ground) < 0.5


def test_browser_shows_a_live_run_at_the_printed_address(stack):
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("chromium is not installed (Debian's package chromium)")
    from playwright.sync_api import sync_playwright

    shown = Shown(stack, "side")
    shown.slow_down()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=chromium, args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        # drawn in software, beside the run and other tests: a small page takes a third of the time
        page = browser.new_page(viewport={"width": 800, "height": 450})
        page.goto(shown.url)
        whole = until_shown(
            lambda: page.screenshot(timeout=300_000),
            lambda image: share(image, red) > 0.0005 and share(image, ground) > 0.1,
        )
        browser.close()
    height, width, _ = whole.shape
    assert shows_the_scene(whole[height // 8 : height // 2, : width // 2])


def test_a_viewer_that_hangs_or_is_killed_delays_no_service(stack):
    shown = Shown(stack, "side", "sim.speed=2")
    viewer = shown.running.supervisor.pids["viewer"]
    os.kill(viewer, signal.SIGSTOP)
    shown.until(shown.time_s + 4.0)
    os.kill(viewer, signal.SIGKILL)
    # `until` raises where a process ends that is needed
    shown.until(shown.time_s + 2.0)


def test_a_recorded_run_of_several_robots_is_shown_whole(tmp_path, attach):
    file = tmp_path / "run.mcap"
    assert here("simulate", "convoy", "--duration", 4, "--record", file).returncode == 0
    (drawn,) = draw(Recording(file), tmp_path)
    attach.open(str(drawn))
    until_shown(attach.take_screenshot, shows_two_persons)
    (recording,) = attach.get_state().recordings
    paths = paths_of(attach, recording)
    for robot in ("one", "two"):
        expected = {"world/robot/front_left_roller_00", *ROBOT_PLOTS}
        assert {f"/{path_of_robot(path, robot)}" for path in expected} <= paths
