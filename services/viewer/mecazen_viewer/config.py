"""The viewer's section of a scenario."""

from __future__ import annotations

from typing import Annotated

import msgspec
from mecazen.schema import Section

Port = Annotated[int, msgspec.Meta(ge=0, le=65535)]


class ViewerConfig(Section):
    """Where the picture is served; port 0 takes a free one."""

    web_port: Port = 9090
    """Port of the page that a browser opens."""
    data_port: Port = 9876
    """Port from which that page, or a native viewer, takes the data."""
    listen: Annotated[str, msgspec.Meta(min_length=1)] = "127.0.0.1"
    """Address to serve at; 0.0.0.0 in a container, whose ports its host publishes."""
    native: bool = False
    """Whether to open Rerun's own window as well."""
