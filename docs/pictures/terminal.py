"""A recording of a terminal: `mecazen up`, `mecazen status` and `mecazen teleop`."""

from __future__ import annotations

import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import matplotlib as mpl
from mecazen_tools.processes import private_router
from PIL import Image, ImageDraw, ImageFont

from docs.pictures.oblique import INK

COLUMNS = 100
FONT_PX, WIDTH_PX, LINE_PX, EDGE_PX = 12, 890, 16, 10
FONT = Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSansMono.ttf"
UP, STATUS, TELEOP = ("up", "teleop", "--no-viewer"), ("status",), ("teleop",)
SHOWN_S, STEP_S = 4.0, 0.2
"""Time for which a whole output is shown, and time between two pictures of teleoperation."""
RUN_S = 3.0
"""Time after which every service has discovered the others."""
STEPS, RELEASED = 30, 24
"""Number of pictures of teleoperation; the key is released at the second number."""
KEY_S = 0.05
"""Time between two repeats of a key."""
GUARD_S = 60.0
"""Timeout, far longer than any command needs."""
READY, LAST = "vx ", "Ctrl-C ends"
ASKED, PLACE = b"\x1b[6n", b"\x1b[1;1R"
"""Request for the position of the cursor, and a terminal's answer."""
REPLACES = "\r\x1b[2K\x1b[1A\x1b[2K"
"""Control sequence at the beginning of an output that replaces the last one."""
SEQUENCE = re.compile(r"\x1b(?:\[[0-9;?>]*[A-Za-z]|P[^\x1b]*\x1b\\)|\r")


def draw(file: Path) -> None:
    """Draw the recording."""
    settings = private_router()
    endpoint, namespace = settings[0].split('"')[1], settings[1].partition("=")[2]
    where = ("--connect", endpoint, "--namespace", namespace)
    up = _start(*UP, *(word for setting in settings for word in ("--set", setting)))
    try:
        assert up.stdout is not None
        said: list[str] = []
        while not said or not said[-1].startswith(LAST):
            said.append(_public(up.stdout.readline().decode().rstrip(), where))
        time.sleep(RUN_S)
        status, _ = _start(*where, *STATUS).communicate(timeout=GUARD_S)
        screens = [
            (SHOWN_S, UP, said),
            (SHOWN_S, STATUS, status.decode().splitlines()),
            *((STEP_S, TELEOP, lines) for lines in _driven(where)),
        ]
    finally:
        up.send_signal(signal.SIGINT)
        up.communicate(timeout=GUARD_S)
    height = max(len(lines) for _, _, lines in screens) + 1
    first, *rest = [_picture(command, lines, height) for _, command, lines in screens]
    first.save(
        file,
        save_all=True,
        append_images=rest,
        duration=[round(1000 * shown_s) for shown_s, _, _ in screens],
        loop=0,
        lossless=True,
    )


def _start(*arguments: str, terminal: int | None = None) -> subprocess.Popen[bytes]:
    """Start a command whose output is read, or shown on a terminal."""
    out = subprocess.PIPE if terminal is None else terminal
    return subprocess.Popen(
        [sys.executable, "-m", "mecazen_tools", *arguments],
        stdin=subprocess.DEVNULL if terminal is None else terminal,
        stdout=out,
        env={**os.environ, "COLUMNS": str(COLUMNS), "TERM": "xterm"},
        start_new_session=True,
    )


def _public(line: str, where: Sequence[str]) -> str:
    """Return a line in the form that a run at the default port prints."""
    _, endpoint, _, _ = where
    line = line.replace(" " + " ".join(where), "").replace(f"{where[3]}/", "")
    return line.replace(endpoint, "tcp/127.0.0.1:7447").replace(f"{Path.cwd()}/", "")


def _driven(where: Sequence[str]) -> Iterator[list[str]]:
    """Drive ahead by the keyboard; yield the lines that are shown, step by step."""
    master, slave = pty.openpty()
    driving = _start(*where, *TELEOP, terminal=slave)
    os.close(slave)
    shown = ""

    def read(time_s: float) -> None:
        nonlocal shown
        if select.select([master], [], [], time_s)[0]:
            read = os.read(master, 65536)
            shown += read.decode()
            if ASKED in read:
                os.write(master, PLACE)

    end = time.monotonic() + GUARD_S
    while READY not in shown:
        assert time.monotonic() < end, shown
        read(KEY_S)
    for step in range(STEPS):
        due = time.monotonic() + STEP_S
        while time.monotonic() < due:
            if step < RELEASED:
                os.write(master, b"w")
            read(KEY_S)
        first, *_, last = [SEQUENCE.sub("", output) for output in shown.split(REPLACES)]
        yield [*first.partition(READY)[0].splitlines(), *last.splitlines()]
    driving.send_signal(signal.SIGINT)
    driving.wait(GUARD_S)
    os.close(master)


def _picture(command: Sequence[str], lines: Sequence[str], height: int) -> Image.Image:
    picture = Image.new("RGB", (WIDTH_PX, height * LINE_PX + 2 * EDGE_PX), "white")
    pen = ImageDraw.Draw(picture)
    font = ImageFont.truetype(FONT, FONT_PX)
    for row, line in enumerate((f"$ mecazen {' '.join(command)}", *lines)):
        pen.text((EDGE_PX, EDGE_PX + row * LINE_PX), line, fill=INK, font=font)
    return picture
