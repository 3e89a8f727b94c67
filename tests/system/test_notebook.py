"""Simulations in a notebook: the run in Rerun's widget, and the notebook of the examples."""

import re
import subprocess
import sys

import nbformat
from harness import COMMAND_GUARD_S, ROOT
from mecazen import Simulation
from rerun.notebook import Viewer

NUMBER = re.compile(r"-?\d+\.\d+(?:e-?\d+)?")
NOTEBOOK = ROOT / "examples" / "notebook.ipynb"


def rrd_of(widget):
    """Return the data that the widget's page has not received yet, in Rerun's format."""
    return b"".join(b for _, buffers in widget._viewer._event_queue for b in buffers or ())


def test_the_widget_shows_the_run_from_its_start_and_as_it_goes_on():
    with Simulation("side", duration_s=0.4, view=True) as sim:
        sim.run(0.2)
        widget = sim.view()
        assert isinstance(widget, Viewer)
        so_far = rrd_of(widget)
        for entity in (b"/world/follow", b"/world/robot", b"/world/person", b"/plots/distance"):
            assert entity in so_far
        sim.run()
    assert len(rrd_of(widget)) > len(so_far)


def test_the_notebook_prints_the_numbers_that_it_shows(tmp_path):
    copy = tmp_path / "notebook.ipynb"
    copy.write_bytes(NOTEBOOK.read_bytes())
    make = [sys.executable, str(ROOT / "docs" / "make_notebook.py"), str(copy)]
    subprocess.run(make, check=True, timeout=COMMAND_GUARD_S, capture_output=True)
    stored, made = printed(NOTEBOOK), printed(copy)
    assert NUMBER.sub("#", stored) == NUMBER.sub("#", made)
    numbers = [float(number) for number in NUMBER.findall(stored)]
    assert len(numbers) > 40
    assert [float(number) for number in NUMBER.findall(made)] == numbers


def printed(file):
    """The text that all cells show."""
    cells = nbformat.read(file, as_version=4).cells
    outputs = [output for cell in cells for output in cell.get("outputs", ())]
    return "\n".join(output.get("text") or output.data["text/plain"] for output in outputs)
