"""`mecazen people`: recorded people, as the person whom the robot follows and as a crowd."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomli_w
import typer
from mecazen.errors import ConfigError
from mecazen.explain import suggestion
from mecazen.geometry import Pose2D
from mecazen.portable import Floats
from mecazen_people.dataset import read_people, walked_m
from typer import Argument, Option

from mecazen_tools import files
from mecazen_tools.cli.options import output

STANDOFF_M = 1.2
"""Standoff behind the person, also at the start [m]."""
SMOOTHING_S = 0.8
"""Shortest window of the moving average, the default of a recorded path [s]."""

app = typer.Typer(no_args_is_help=True, help="Recorded people, to follow and as a crowd.")


@app.command("import")
def import_(
    file: Annotated[
        Path,
        Argument(
            metavar="FILE",
            help="CSV with id, time, x and y; text of frame, id, x, y; or ETH's obsmat.txt.",
        ),
    ],
    target: Annotated[
        str | None,
        Option(
            metavar="ID",
            help="The person whom the robot follows.",
            show_default="the one who walks farthest",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        output(
            "The scenario to write; the tracks are written to a folder beside it.",
            "FILE's name, with .toml",
        ),
    ] = None,
    sample: Annotated[
        float,
        Option(
            metavar="SECONDS",
            help="Time between annotated frames, for files with frames instead of times.",
            min=0.001,
        ),
    ] = 0.4,
) -> None:
    """Write a scenario of recorded people: the robot follows one person, the others are the crowd.

    Examples: mecazen people import obsmat.txt --target 171 ·
    mecazen people import hall.csv -o hall.toml
    """
    tracks = read_people(file, sample)
    if target is None:
        target = max(tracks, key=lambda person: walked_m(tracks[person]))
    if target not in tracks:
        raise ConfigError(
            f"--target {target}: no such person; {suggestion(target, tracks)}{file} has "
            f"{len(tracks)}, such as {', '.join([*tracks][:3])}"
        )
    scenario = output or Path(f"{file.stem}.toml")
    if scenario.suffix != ".toml":
        raise ConfigError(f"--output {scenario}: must end in .toml")
    folder = scenario.with_suffix("")
    for path in (scenario, folder):
        if path.exists():
            raise ConfigError(f"{path}: exists already, and is not overwritten")
    walked, (begin, end) = walked_m(tracks[target]), tracks[target][[0, -1], 0].tolist()
    tracks = {
        person: track[(track[:, 0] >= begin) & (track[:, 0] <= end)] - (begin, 0.0, 0.0)
        for person, track in tracks.items()
    }
    tracks = {person: track for person, track in tracks.items() if len(track) > 1}
    files.make_folder(folder, "--output")
    for person, track in tracks.items():
        rows = [f"{t:.3f},{x:.4f},{y:.4f}\n" for t, x, y in track.tolist()]
        files.write(folder / f"{person}.csv", "".join(["t_s,x_m,y_m\n", *rows]).encode())
    first = f"# The robot follows person {target} of {file.name} among all who were there then.\n"
    tables = _scenario(tracks, target, folder)
    files.write(scenario, (first + tomli_w.dumps(tables)).encode(), "--output")
    typer.echo(
        f"{scenario}: written, and {len(tracks)} tracks in {folder}: person {target} walks "
        f"{walked:.1f} m in {end - begin:.1f} s; next:\n"
        f"  mecazen simulate {scenario}\n"
        f"  mecazen simulate {scenario} --set 'crowd.walkers=[]'    # the person alone"
    )


def _scenario(tracks: dict[str, Floats], target: str, folder: Path) -> dict[str, Any]:
    """Return the tables of a scenario with the tracks of people, which begin after time 0."""
    from mecazen_people.recorded import recorded_walk  # noqa: PLC0415  # imports SciPy

    paths = {}
    for person, track in tracks.items():
        smoothing = max(SMOOTHING_S, 2.0 * float(np.median(np.diff(track[:, 0]))))
        pose = recorded_walk(track, smoothing).at(0.0).pose
        paths[person] = {
            "kind": "recorded",
            "file": f"{folder.name}/{person}.csv",
            "smoothing_s": round(smoothing, 3),
            "start_after_s": round(float(track[0, 0]), 3),
            **_place(pose),
        }
        if person == target:
            start = pose.compose(Pose2D(-STANDOFF_M, 0.0))
    followed = paths.pop(target)
    return {
        "robot": "nexus",
        "seed": 1,
        "sim": {"duration_s": float(math.ceil(round(tracks[target][-1, 0], 3)))},
        "start": _place(start),
        "sensor": {"kind": "fused"},
        "target": {"path": followed},
        "follower": {"view": "back", "standoff_m": STANDOFF_M},
        "crowd": {
            "walkers": [{"enters_and_leaves": True, "path": path} for path in paths.values()]
        },
    }


def _place(pose: Pose2D) -> dict[str, float]:
    x, y, yaw = pose
    return {"x_m": round(x, 4), "y_m": round(y, 4), "yaw_deg": round(math.degrees(yaw), 3)}
