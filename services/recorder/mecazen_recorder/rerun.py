"""Rerun's format, converted from a finished recording by Rerun."""

from __future__ import annotations

import os
import subprocess
import sysconfig
from pathlib import Path

from mecazen_recorder.writer import RecordingError


def converter() -> Path:
    """Return the path of Rerun's command.

    Raises:
        RecordingError: Rerun is not installed.
    """
    command = Path(sysconfig.get_path("scripts")) / "rerun"
    if not command.exists():
        raise RecordingError("--rrd needs Rerun: pip install 'mecazen[viewer]'")
    return command


def convert(path: Path) -> Path:
    """Convert a recording in CDR to a `.rrd` beside it, in simulated time; return its path.

    Raises:
        RecordingError: Rerun can't convert the recording.
    """
    target = path.with_suffix(".rrd")
    done = subprocess.run(
        [converter(), "mcap", "convert", "--timeline-type", "duration", "-o", target, path],
        capture_output=True,
        text=True,
        check=False,
        # CI disables its telemetry
        env={**os.environ, "CI": "1"},
    )
    if done.returncode != 0:
        reason = (done.stderr.strip() or f"ended with code {done.returncode}").splitlines()[-1]
        raise RecordingError(f"{target}: Rerun can't write it: {reason}")
    return target
