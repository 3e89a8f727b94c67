"""`mecazen keys`: certificates for services and tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mecazen_tools import certificates

app = typer.Typer(no_args_is_help=True, help="Certificates, for TLS and access control.")


@app.callback()
def _group() -> None:
    """Keep `create` a command of its own, although it is the only one."""


@app.command()
def create(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="A new folder; keep it to yourself.")
    ] = Path("keys"),
    host: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME_OR_IP",
            help="A host that services listen on, besides loopback. May be given several times.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Create a certificate authority, and a certificate and a key for each service.

    The operator's are for the tools: `--tls DIR`.

    Examples: mecazen keys create · mecazen keys create keys --host robot.local --host 192.168.1.7
    """
    certificates.create(folder, host or ())
    typer.echo(f"{folder}: the authority and {len(certificates.NAMES)} certificates with keys")
