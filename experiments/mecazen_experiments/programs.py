"""The programs of studies: what a run does and measures.

A program is a function of a job that returns the columns of its row: numbers, texts, true or
false, or None where there is nothing to measure. Each run returns the same columns.
"""

from __future__ import annotations

Value = bool | int | float | str | None

PACKAGE = __name__.rpartition(".")[0]
PROGRAMS = {
    "followbench": f"{PACKAGE}.followbench.program",
    "followbench_rules": f"{PACKAGE}.followbench.program",
    "following": f"{PACKAGE}.scores",
    "fuzz": f"{PACKAGE}.fuzz",
    "mocap": f"{PACKAGE}.mocap",
    "safety": f"{PACKAGE}.safety",
    "walkers": f"{PACKAGE}.limit",
}
"""Modules of the programs, by the names of their functions, which are those in studies."""
