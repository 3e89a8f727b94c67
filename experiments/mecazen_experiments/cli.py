"""`mecazen experiment`: many runs, their scores, tables and figures."""

from __future__ import annotations

import typer

app = typer.Typer(no_args_is_help=True, help="Run scenarios many times and score them.")


@app.callback()
def experiment() -> None:
    """Run scenarios many times and score them."""
