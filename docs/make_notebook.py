"""Runs every cell of examples/notebook.ipynb, or of other notebooks, and keeps the outputs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parents[1] / "examples" / "notebook.ipynb"
NOT_KEPT = "output-not-kept"
"""The tag of a cell whose output is megabytes."""


def executed(file: Path) -> Any:
    """Return the notebook with the outputs of a run in a new kernel, without times and names.

    Raises:
        CellExecutionError: A cell raised.
    """
    notebook = nbformat.read(file, as_version=4)  # type: ignore[no-untyped-call]
    # a busy machine splits the output of a cell
    NotebookClient(notebook, timeout=120, kernel_name="python3", coalesce_streams=True).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if NOT_KEPT in cell.metadata.get("tags", ()):
            cell.outputs = []
    notebook.metadata = {"kernelspec": notebook.metadata.kernelspec}
    return notebook


if __name__ == "__main__":
    files = [Path(name) for name in sys.argv[1:]] or [NOTEBOOK]
    for file in files:
        nbformat.write(executed(file), file)  # type: ignore[no-untyped-call]
