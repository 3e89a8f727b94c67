"""Run a process of a scenario: `python -m mecazen.runtime NAME SCENARIO [--set KEY=VALUE]`."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from mecazen.config import Process, Scenario
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario, parse_settings, scenario_path
from mecazen.runtime.process import end_with_stdin, run_process, run_router
from mecazen.runtime.report import Report, Reporter

ROUTER = "router"


def run(name: str, scenario: Scenario, robot: str = "", reporter: Reporter | None = None) -> None:
    """Run a service, several joined by `+`, or the router, until a signal.

    Raises:
        MecazenError: The service does not exist, or it failed.
    """
    reporter = reporter or Reporter(None)
    if name == ROUTER:
        run_router(scenario, reporter)
    else:
        run_process(Process(tuple(name.split("+")), robot), scenario, reporter)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the process that the command line names; report errors in one line."""
    parser = argparse.ArgumentParser(description="Run a process of a mecazen scenario.")
    parser.add_argument("name", help="a service, several joined by +, or router")
    parser.add_argument("scenario", help="a scenario's name or its TOML file")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="settings")
    parser.add_argument("--robot", default="", metavar="NAME", help="of several, whose service")
    parser.add_argument("--until-orphaned", action="store_true", help="end with standard input")
    parser.add_argument("--report", type=int, metavar="FD", help="where to write what happens")
    options = parser.parse_args(arguments)
    reporter = Reporter(options.report)
    if options.report is not None:
        os.set_inheritable(options.report, False)
    if options.until_orphaned:
        end_with_stdin()
    with ending_in_one_line(reporter):
        scenario = load_scenario(scenario_path(options.scenario), parse_settings(options.settings))
        run(options.name, scenario, options.robot, reporter)


@contextmanager
def ending_in_one_line(reporter: Reporter) -> Iterator[None]:
    """Exit on a `MecazenError`, after reporting it to the parent process or on standard error."""
    try:
        yield
    except MecazenError as error:
        reporter.tell(Report("failed", str(error)))
        if reporter.descriptor is None:
            sys.stderr.write(f"error: {error}\n")
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
