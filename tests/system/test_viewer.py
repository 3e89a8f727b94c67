"""The viewer beside a real simulation: pictures, resets, and its own end."""

import io
import os
import shutil
import signal
from collections.abc import Callable
from contextlib import closing

import numpy as np
import pytest
from harness import ROOT, SCENARIOS, Newest
from mecazen import keys
from mecazen.messages import SpeedRequest
from PIL import Image
from stack import Stack

FREE_PORTS = ("viewer.web_port=0", "viewer.data_port=0")
FRAMES = 200
"""Pictures taken one after the other until one shows what it should: only a hang needs so many."""

BACKGROUND = (206, 211, 218)
RED_OVER_OTHERS = 60
"""The arrow and the trail are red by far more; skin, orange and purple by less."""


class Shown:
    """A running scenario with a viewer beside it."""

    def __init__(self, running: Stack) -> None:
        self.running = running
        self._clock = Newest(running.bus, keys.CLOCK)
        running.start()
        running.launch("viewer", needed=False)
        self.url = ""
        running.wait_unwatched(self._has_url)

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

    def pass_time(self, seconds: float) -> None:
        """Let simulated time pass."""
        end_s = self.time_s + seconds
        self.running.wait(lambda: self.time_s > end_s)

    def set_speed(self, speed: float) -> None:
        """Let the run go on slowly, so that there is time to draw it in software, or fast."""
        self.running.call(keys.SIM_SPEED, SpeedRequest(speed=speed))


@pytest.fixture(scope="module")
def shown():
    """A run after some seconds, now slow; the last test ends its viewer."""
    with closing(Stack(SCENARIOS / "side.toml", ("sim.speed=3", *FREE_PORTS))) as running:
        shown = Shown(running)
        # enough to reach beyond the legends of small plots
        shown.pass_time(6.0)
        shown.set_speed(0.02)
        yield shown


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def share(image: np.ndarray, like: Callable[[np.ndarray], np.ndarray]) -> float:
    """The share of pixels for whose colours (..., 3) a condition holds."""
    return float(np.mean(like(image)))


def red(image: np.ndarray) -> np.ndarray:
    return image[..., 0] - image[..., 1:].max(axis=-1) > RED_OVER_OTHERS


def ground(image: np.ndarray) -> np.ndarray:
    return np.abs(image - BACKGROUND).max(axis=-1) < 8


def shows_the_scene(image: np.ndarray) -> bool:
    """Return whether the person's red arrow is visible on mostly free ground."""
    return share(image, red) > 0.001 and 0.5 < share(image, ground) < 0.99


def until_shown(picture: Callable[[], bytes], good: Callable[[np.ndarray], bool]) -> np.ndarray:
    """Take pictures until one is good; the last is kept for who looks into a failure."""
    for _ in range(FRAMES):
        png = picture()
        if good(pixels(png)):
            return pixels(png)
    (ROOT / "out").mkdir(exist_ok=True)
    (ROOT / "out" / "not_shown.png").write_bytes(png)
    raise AssertionError("never shown; the last picture is out/not_shown.png")


def test_a_browser_shows_a_live_run_at_the_printed_address(shown):
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("chromium is not installed (Debian's package chromium)")
    from playwright.sync_api import sync_playwright

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


def test_a_viewer_that_hangs_or_is_killed_delays_no_service(shown):
    shown.set_speed(2.0)
    viewer = shown.running.supervisor.pids["viewer"]
    os.kill(viewer, signal.SIGSTOP)
    shown.pass_time(4.0)
    os.kill(viewer, signal.SIGKILL)
    # waiting raises where a process ends that is needed
    shown.pass_time(2.0)
