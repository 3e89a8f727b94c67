"""Run a process of a scenario: `python -m mecazen.runtime NAME SCENARIO [--set KEY=VALUE]`."""

import argparse

from mecazen.config import Process
from mecazen.runtime.process import run_to_exit


def main() -> None:
    """Run the process that the command line names; print an expected error in one line."""
    parser = argparse.ArgumentParser(description="Run a process of a mecazen scenario.")
    parser.add_argument("name", help="a service, several joined by +, or router")
    parser.add_argument("scenario", help="a scenario's name or its TOML file")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="settings")
    parser.add_argument("--robot", default="", metavar="NAME", help="the robot, of several")
    options = parser.parse_args()
    process = Process(tuple(options.name.split("+")), options.robot)
    run_to_exit(process, options.scenario, options.settings)


if __name__ == "__main__":
    main()
