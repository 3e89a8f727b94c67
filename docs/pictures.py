"""Makes the pictures of the documents that `make results` does not make: views of the viewer.

Run from the repository by `make pictures`, or for some pictures: ONLY="senses viewer".
"""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib import style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mecazen.config import Process
from mecazen.keys import FOLLOWER_STATE, JOINT_STATES
from mecazen.loading import load_scenario, parse_settings, scenario_path
from mecazen.robot import WHEELS
from mecazen_tools.drawing import BLUE, PALETTE, STYLE
from mecazen_tools.observe import observe
from mecazen_tools.processes import Supervisor, private_router
from mecazen_tools.table import deviations
from mecazen_viewer.rerun_process import free_port, headless_viewer, uri
from PIL import Image
from rerun.experimental import ViewerClient

START_S = 30.0
"""Timeout, longer than the silence of any process while all start."""
DROPPED_BITS = 0b11
"""Bits of each colour that are set to 1: they are invisible, and this reduces the file to a
fifth."""
WINDOW_PX = 2400, 1500
SCENE, ABOVE = "following", "from above"
SCENE_PX, ABOVE_PX, GAP_PX = (1000, 580), (494, 580), 6
PLOTS_PX, DPI = (1500, 300), 100.0
PLOTTED_S = 30.0
PURPLE = PALETTE[3]
DOCS = Path(__file__).parent
WIDE = {"font.size": 13.0, "axes.linewidth": 1.0, "lines.linewidth": 1.6, "grid.linewidth": 0.6}
"""Style with larger text than in print: the picture is shown at half its size."""


def scene(file: Path, scenario: str, at_s: float, world: str | None = None) -> None:
    """Draw a view of a scenario at a simulated time [s]."""
    with _shown(scenario, at_s, world) as viewer:
        _save(_view(viewer, SCENE, SCENE_PX), file)


def views(file: Path, scenario: str, at_s: float) -> None:
    """Draw both scenes of a scenario at a simulated time [s], and three of the plots."""
    sheet = Image.new("RGB", (PLOTS_PX[0], SCENE_PX[1] + GAP_PX + PLOTS_PX[1]), "white")
    with _shown(scenario, at_s) as viewer:
        sheet.paste(_view(viewer, SCENE, SCENE_PX), (0, 0))
        sheet.paste(_view(viewer, ABOVE, ABOVE_PX), (SCENE_PX[0] + GAP_PX, 0))
    sheet.paste(_plots(scenario, at_s), (0, SCENE_PX[1] + GAP_PX))
    _save(sheet, file)


@contextmanager
def _shown(scenario: str, at_s: float, world: str | None = None) -> Iterator[ViewerClient]:
    """Run a scenario as processes until a viewer shows a simulated time [s]."""
    path = scenario_path(scenario)
    data_port = free_port("viewer.data_port", 0)
    settings = (
        f"viewer.data_port={data_port}",
        "viewer.web_port=0",
        *private_router(),
        *(() if world is None else (f"world={world}",)),
    )
    supervisor = Supervisor(path, settings)
    try:
        supervisor.start_router()
        with headless_viewer(*WINDOW_PX) as viewer:
            for process in (
                *load_scenario(path, parse_settings(settings)).process_plan,
                Process(("viewer",)),
            ):
                supervisor.start(process)
            while (line := supervisor.poll(START_S)) is not None and not line.is_address:
                pass
            viewer.open(uri(data_port))
            shown_s = 0.0
            while shown_s < at_s:
                viewer.take_screenshot(max_size=64)  # lets the viewer process incoming data
                supervisor.poll(0.0)
                for recording in viewer.get_state().recordings:
                    shown_s = (recording.current_time or 0) / 1e9
            viewer.set_time(play_state="paused")
            yield viewer
    finally:
        supervisor.stop()


def _view(viewer: ViewerClient, name: str, size: tuple[int, int]) -> Image.Image:
    """Return the middle of a view, in the largest crop with this aspect ratio."""
    view = next(view for view in viewer.get_state().views if view.name == name)
    taken = Image.open(io.BytesIO(viewer.take_screenshot(view.view_id))).convert("RGB")
    scale = min(taken.width / size[0], taken.height / size[1])
    width, height = scale * size[0], scale * size[1]
    left, top = (taken.width - width) / 2.0, (taken.height - height) / 2.0
    return taken.resize(size, box=(left, top, left + width, top + height))


def _plots(scenario: str, at_s: float) -> Image.Image:
    """Return plots of the same run in one process: errors, and speeds of the wheels."""
    loaded = load_scenario(scenario_path(scenario), {"sim.duration_s": at_s})
    run = observe(loaded, FOLLOWER_STATE, JOINT_STATES)
    distance, _, yaw = deviations(run.table, loaded.follower.standoff)
    states, joints = run.samples[FOLLOWER_STATE.key], run.samples[JOINT_STATES.key]
    with style.context([*STYLE, WIDE]):
        width, height = PLOTS_PX
        figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, layout="constrained")
        FigureCanvasAgg(figure)
        errors, angles, speeds = figure.subplots(1, 3)
        state_s = [state.header.stamp.ns / 1e9 for state in states]
        estimated = "as estimated"
        errors.plot(state_s, [one.distance_error for one in states], color=PURPLE, label=estimated)
        errors.plot(run.table["t_s"], distance, color=BLUE, label="true")
        errors.set(title="distance error [m]", ylim=(-0.1, 0.1))
        headings = np.degrees([one.heading_error for one in states])
        angles.plot(state_s, headings, color=PURPLE, label=estimated)
        angles.plot(run.table["t_s"], np.degrees(yaw), color=BLUE, label="true")
        angles.set(title="heading error [°]", ylim=(-10.0, 10.0))
        joint_s = [joint.header.stamp.ns / 1e9 for joint in joints]
        for wheel, name in enumerate(WHEELS):
            speed = [joint.velocity[wheel] for joint in joints]
            speeds.plot(joint_s, speed, label=name.replace("_", " "), linewidth=1.0)
        speeds.set(title="wheel speed [rad/s]", ylim=(-15.0, 25.0))
        for axes in (errors, angles, speeds):
            axes.set(xlim=(at_s - PLOTTED_S, at_s), xlabel="t [s]")
            axes.legend(loc="upper left", ncols=2, fontsize="small")
        file = io.BytesIO()
        figure.savefig(file, format="png", dpi=DPI)
    return Image.open(file).convert("RGB")


def _save(picture: Image.Image, file: Path) -> None:
    picture.point(lambda level: level | DROPPED_BITS).save(file, optimize=True)


PICTURES: dict[str, Callable[[Path], None]] = {
    "figures/convoy.png": partial(scene, scenario="convoy", at_s=6.0),
    "figures/places.png": partial(scene, scenario="tug", at_s=3.0, world="clinic_corridor"),
    "senses.png": partial(scene, scenario="senses", at_s=7.0),
    "viewer.png": partial(views, scenario="side", at_s=37.0),
}
"""The function that draws each picture, by its path in docs/."""


def main(names: list[str]) -> None:
    """Draw pictures by their names without suffix, or all."""
    known = {Path(place).stem: place for place in PICTURES}
    if unknown := sorted({*names} - {*known}):
        sys.exit(f"no picture {unknown[0]!r}; pictures: {', '.join(known)}")
    for name in names or known:
        file = DOCS / known[name]
        PICTURES[known[name]](file)
        print(f"docs/{known[name]}: {file.stat().st_size / 1000:.0f} kB", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
