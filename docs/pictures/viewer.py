"""Pictures of the viewer: scenarios as processes, in a viewer without a window."""

from __future__ import annotations

import io
from pathlib import Path

from mecazen.config import Process
from mecazen.loading import load_scenario
from mecazen_tools.processes import Supervisor, private_router
from mecazen_viewer.rerun_process import free_port, headless_viewer, uri
from PIL import Image

ROOT = Path(__file__).parents[2]
START_S = 30.0
"""Longer than any process is silent while all start."""
KEPT_BITS = 0b11111100
"""Bits of each colour that are kept: the rest is invisible and makes a fifth of the file."""


def draw(picture_file: Path, scenario: str, at_s: float) -> None:
    """Take pictures of a scenario until the viewer shows a simulated time [s]."""
    path = ROOT / "configs" / "scenarios" / f"{scenario}.toml"
    data_port = free_port("viewer.data_port", 0)
    settings = (
        f"viewer.data_port={data_port}",
        "viewer.web_port=0",
        *private_router(),
    )
    supervisor = Supervisor(path, settings)
    try:
        supervisor.start_router()
        with headless_viewer() as viewer:
            for process in (*load_scenario(path, settings).process_plan, Process(("viewer",))):
                supervisor.start(process)
            while (line := supervisor.poll(START_S)) is not None and not line.is_address:
                pass
            viewer.open(uri(data_port))
            shown_s = 0.0
            while shown_s < at_s:
                png = viewer.take_screenshot()
                supervisor.poll(0.0)
                for recording in viewer.get_state().recordings:
                    shown_s = (recording.current_time or 0) / 1e9
    finally:
        supervisor.stop()
    picture = Image.open(io.BytesIO(png)).convert("RGB").point(lambda level: level & KEPT_BITS)
    picture.save(picture_file, optimize=True)
