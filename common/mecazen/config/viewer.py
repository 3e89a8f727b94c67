"""`[viewer]`: the ports and windows of the viewer."""

from __future__ import annotations

from typing import Annotated

import msgspec

from mecazen.schema import Section

Port = Annotated[int, msgspec.Meta(ge=0, le=65535)]


class ViewerConfig(Section):
    """Ports, address and window of the viewer; port 0 takes a free port."""

    web_port: Port = 9090
    data_port: Port = 9876
    """Port of the data, to which the web page and native viewers connect."""
    listen: Annotated[str, msgspec.Meta(min_length=1)] = "127.0.0.1"
    """Address to listen on; 0.0.0.0 in a container, whose host publishes the ports."""
    native: bool = False
    """Whether to open Rerun's own window as well."""

    def __post_init__(self) -> None:
        if self.web_port == self.data_port != 0:
            raise ValueError(f"web_port and data_port must differ: both are {self.web_port}")
