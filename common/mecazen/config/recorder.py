"""`[recorder]`: file, keys and encoding of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec

from mecazen.schema import Output, Section

Encoding = Literal["cdr", "json"]


class RecorderConfig(Section):
    """File, keys and encoding of a recording."""

    file: Output | None = None
    """The MCAP file; left out: `run.mcap` in the working directory. In lockstep it must not exist;
    in real time, where a recorder may be restarted, the next free name is used."""
    keys: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)] = ("**",)
    """Zenoh key expressions of the samples to record."""
    encoding: Encoding = "cdr"
    """cdr: ROS 2's messages, for tools that read ROS bags; json: with JSON schemas."""
    backlog_mib: Annotated[float, msgspec.Meta(ge=0.001, le=4096.0)] = 64.0
    """Size of the queue of samples to write; samples beyond it are dropped and counted."""

    @property
    def path(self) -> Path:
        """The file, or its default."""
        return self.file or Path("run.mcap")
