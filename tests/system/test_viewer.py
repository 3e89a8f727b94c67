"""The viewer beside a real simulation: its page, and its own end."""

import io
import os
import shutil
import signal
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

    def _has_url(self) -> bool:
        line = self.running.supervisor.poll(0.0)
        assert line is None or "viewer has ended" not in line.text, line
        if line is not None and line.is_address:
            self.url = line.text
        return bool(self.url)

    def pass_time(self, seconds: float) -> None:
        """Let simulated time pass."""
        self.running.wait(lambda: self._clock.stamp is not None)
        end_ns = self._clock.stamp.time_ns + seconds * 1e9
        self.running.wait(lambda: self._clock.stamp.time_ns > end_ns)

    def set_speed(self, speed: float) -> None:
        """Let the run go on slowly, so that there is time to draw it in software, or fast."""
        self.running.call(keys.SIM_SPEED, SpeedRequest(speed=speed))


@pytest.fixture(scope="module")
def shown():
    """A run after some seconds, now slow; the last test ends its viewer."""
    with closing(Stack(SCENARIOS / "side.toml", ("sim.speed=3", *FREE_PORTS))) as running:
        shown = Shown(running)
        shown.pass_time(3.0)
        shown.set_speed(0.02)
        yield shown


def shows_the_scene(png: bytes) -> bool:
    """Return whether the person's red arrow is visible on mostly free ground."""
    image = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
    height, width, _ = image.shape
    scene = image[height // 8 : height // 2, : width // 2]
    red = scene[..., 0] - scene[..., 1:].max(axis=-1) > RED_OVER_OTHERS
    ground = np.abs(scene - BACKGROUND).max(axis=-1) < 8
    return bool(red.mean() > 0.001 and 0.5 < ground.mean() < 0.99)


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
        for _ in range(FRAMES):
            png = page.screenshot(timeout=300_000)
            if shows_the_scene(png):
                break
        else:
            (ROOT / "out").mkdir(exist_ok=True)
            (ROOT / "out" / "not_shown.png").write_bytes(png)
            pytest.fail("never shown; the last picture is out/not_shown.png")
        browser.close()


def test_a_viewer_that_hangs_or_is_killed_delays_no_service(shown):
    shown.set_speed(2.0)
    viewer = shown.running.supervisor.pids["viewer"]
    os.kill(viewer, signal.SIGSTOP)
    shown.pass_time(2.0)
    os.kill(viewer, signal.SIGKILL)
    # waiting raises where a process ends that is needed
    shown.pass_time(1.0)
