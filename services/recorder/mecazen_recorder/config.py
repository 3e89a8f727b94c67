"""The section `[recorder]` of a scenario."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from mecazen.schema import Section

Encoding = Literal["cdr", "json"]


class RecorderConfig(Section):
    """What is recorded, and where."""

    file: Annotated[str, msgspec.Meta(min_length=1)] = "run.mcap"
    """The MCAP file, relative to where the recorder is started. In lockstep it must not exist yet;
    in real time, where a recorder may be started again, the next free name is taken."""
    keys: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)] = ("**",)
    """Zenoh key expressions."""
    encoding: Encoding = "cdr"
    """cdr: ROS 2's own messages, for tools that read ROS bags; json: with JSON schemas."""
    backlog_mib: Annotated[float, msgspec.Meta(ge=0.001, le=4096.0)] = 64.0
    """Samples that wait to be written; those beyond it are dropped and counted."""
