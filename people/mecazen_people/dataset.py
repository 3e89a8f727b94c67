"""Files of recorded people: a track for each."""

from __future__ import annotations

import math
import re
from pathlib import Path
from statistics import median, mode

import numpy as np
from mecazen.config.people import FASTEST_M_S
from mecazen.errors import ConfigError
from mecazen.files import read_text
from mecazen.portable import Floats
from mecazen.text import printable

TIMES, XS, YS = ("t_s", "time", "frame"), ("x_m", "x"), ("y_m", "y")
"""Names of the columns of time, x and y; that of several people is `id`."""
HEADERS = {4: "frame id x y", 8: "frame id x z y v_x v_z v_y"}
"""Columns of text without a header, by their number: 4 in datasets for the prediction of
trajectories, 8 in `obsmat.txt` of ETH Walking Pedestrians, whose z is up."""
FIRST_LINE = (
    "must name the columns time, x, y, and id of several people, or have the 4 numbers frame, id, "
    "x, y or the 8 of obsmat.txt"
)
SAMPLE_S = 0.4
"""Usual time between annotated frames [s]."""
MIN_STEP_S = 0.001
"""Shortest time between two samples."""
MAX_DURATION_S = 4 * 3600.0
"""Longest track that is read; a longer one is most likely in the wrong unit."""


def read_track(file: Path) -> Floats:
    """Read the track (n, 3) of the only person in a file; see `read_people`."""
    (track, *others) = read_people(file).values()
    if others:
        raise ConfigError(
            f"{file}: has {len(others) + 1} people: `mecazen people import` makes a file of each"
        )
    return track


def read_people(file: Path, sample_s: float = SAMPLE_S) -> dict[str, Floats]:
    """Read the tracks (n, 3) of all people by id: time [s], x and y [m] of each sample.

    People with a single sample are left out.

    Args:
        file: CSV with a header, or text with the columns of `HEADERS`.
        sample_s: Time between annotated frames [s], for a file with frames in place of times.

    Raises:
        ConfigError: One line with the file, the line and what is allowed.
    """
    text = read_text(file)
    try:
        people, has_frames = _read(text)
    except ConfigError as error:
        raise ConfigError(printable(f"{file}: {error}")) from None
    tracks = {person: np.array(samples) for person, samples in people.items() if len(samples) > 1}
    if not tracks:
        raise ConfigError(f"{file}: no person has two samples")
    if has_frames:
        frames = np.unique(np.concatenate([track[:, 0] for track in tracks.values()]))
        scale = sample_s / mode(np.diff(frames).tolist())
        tracks = {person: track * (scale, 1.0, 1.0) for person, track in tracks.items()}
    duration = max(float(np.ptp(track[:, 0])) for track in tracks.values())
    if duration > MAX_DURATION_S:
        raise ConfigError(
            f"{file}: the times must span at most {MAX_DURATION_S:g} s, span {duration:g} s"
        )
    speed = median(walked_m(track) / float(np.ptp(track[:, 0])) for track in tracks.values())
    if speed > FASTEST_M_S:
        raise ConfigError(f"{file}: people move at {speed:.0f} m/s; x and y must be in metres")
    return tracks


def walked_m(track: Floats) -> float:
    """Return the length of a track (n, 3) of time, x and y [m]."""
    return float(np.hypot(*np.diff(track[:, 1:], axis=0).T).sum())


def _read(text: str) -> tuple[dict[str, list[list[float]]], bool]:
    """Return the samples (time, x, y) of each person, and whether the times are frames."""
    people: dict[str, list[list[float]]] = {}
    names: list[str] = []
    has_header, time = False, ""
    for number, row in enumerate(text.splitlines(), start=1):
        line, cells = f"line {number}", re.split(r"\s*[,;]\s*|\s+", row.strip())
        if cells == [""]:
            continue
        if not names:
            has_header = not re.match(r"[-+.]?\d", cells[0])
            names = cells if has_header else HEADERS.get(len(cells), "").split()
            time, x, y = (
                next((name for name in known if name in names), "") for known in (TIMES, XS, YS)
            )
            if not (time and x and y):
                raise ConfigError(f"{line}: {FIRST_LINE}; is {row.strip()!r}")
            if has_header:
                continue
        if len(cells) != len(names):
            raise ConfigError(f"{line}: must have {len(names)} columns, has {len(cells)}")
        cell = dict(zip(names, cells, strict=True))
        name = cell.get("id", "1")
        if not has_header:
            name = f"{_number(line, 'id', name):.0f}"
        if not re.fullmatch(r"[\w.-]+", name):
            raise ConfigError(f"{line}: id must be of letters, digits, _, . and -, is {name!r}")
        samples = people.setdefault(name, [])
        sample = [_number(line, column, cell[column]) for column in (time, x, y)]
        if samples and sample[0] - samples[-1][0] < MIN_STEP_S:
            raise ConfigError(
                f"{line}: {time} of person {name} must grow by at least "
                f"{MIN_STEP_S} s; {sample[0]:g} follows {samples[-1][0]:g}"
            )
        samples.append(sample)
    return people, time == "frame"


def _number(line: str, name: str, text: str) -> float:
    """Return the number in a cell of a file; the error begins with `line` and names the cell."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= 1e9:
        raise ConfigError(f"{line}: {name} must be a number from -1e9 to 1e9, is {text!r}")
    return value
