"""Measure everything: `python -m bench [--only NAME] [--json FILE]`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import msgspec
from rich.console import Console

from bench import (
    containers,
    experiments,
    flood,
    latency,
    loop,
    malformed,
    physics,
    recorder,
    viewer,
)
from bench.figures import Group
from bench.machine import Machine

PARTS: dict[str, Callable[[], list[Group]]] = {
    "physics": lambda: physics.run(physics.engines()),
    "loop": loop.run,
    "latency": latency.run,
    "flood": flood.run,
    "malformed": malformed.run,
    "experiments": experiments.run,
    "recorder": recorder.run,
    "viewer": viewer.run,
    "containers": containers.run,
}
ON_DEMAND = ("containers",)
"""Parts that are measured only with `--only`: this one builds images first."""
WIDTH = 120
"""Of the tables [characters] where the output is no terminal."""


class Report(msgspec.Struct, frozen=True):
    """What `--json` writes."""

    machine: Machine
    groups: tuple[Group, ...]


def main() -> None:
    """Run the parts that are asked for; print a table of each as soon as it is done."""
    parser = argparse.ArgumentParser(
        prog="python -m bench", description="Measure speed, accuracy and latency of mecazen."
    )
    parser.add_argument("--only", choices=PARTS, action="append", help="one part; repeatable")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures")
    options = parser.parse_args()
    console = Console()
    if not console.is_terminal:
        console = Console(width=WIDTH)
    machine = Machine.here()
    console.print(machine.table())
    groups: list[Group] = []
    for name in options.only or [part for part in PARTS if part not in ON_DEMAND]:
        with console.status(f"measuring {name} …"):
            measured = PARTS[name]()
        for group in measured:
            console.print(group.table())
        groups += measured
    if options.json is not None:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        report = msgspec.json.encode(Report(machine, tuple(groups)))
        options.json.write_bytes(msgspec.json.format(report) + b"\n")
        console.print(f"figures: {options.json}")


if __name__ == "__main__":
    main()
