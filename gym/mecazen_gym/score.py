"""`python -m mecazen_gym.score`: policies scored in `mecazen/Follow-v0`, over seeds."""

from __future__ import annotations

import os
import signal
import statistics
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Annotated

import msgspec
import typer
from mecazen.config import Scenario
from mecazen.errors import NodeError, explained
from mecazen_tools.cli import main
from mecazen_tools.cli.options import ScenarioArgument, Settings, console, load
from rich.markup import escape
from rich.table import Table

from mecazen_gym import policies
from mecazen_gym.follow import FollowEnv
from mecazen_gym.policies import POLICIES

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


class Score(msgspec.Struct, frozen=True):
    """The score of an episode."""

    policy: str
    seed: int
    reward: float
    """Sum of the rewards."""
    followed_s: float
    """Simulated time until the episode ended."""
    terminated: bool
    """Whether the episode ended because the robot was too far or touched the person."""
    d_err_m: float | None
    """Published measures of following until the end; None if the person stood."""
    theta_err_deg: float | None


def episode(scenario: Scenario, policy: str, seed: int) -> Score:
    """Return the score of a policy in one episode.

    Raises:
        NodeError: A user policy failed, or its action is invalid.
    """
    env = FollowEnv(scenario)
    total, terminated, truncated = 0.0, False, False
    with _named(policy):
        act = policies.policy(policy)(env, seed)
    observation, info = env.reset(seed=seed)
    while not (terminated or truncated):
        with _named(policy):
            action = env.valid(act(observation))
        observation, reward, terminated, truncated, info = env.step(action)
        total += reward
    measures = env.sim.scores()
    return Score(
        policy, seed, total, info["time_s"], terminated, measures.d_err_m, measures.theta_err_deg
    )


@contextmanager
def _named(policy: str) -> Iterator[None]:
    """Report an error of a policy's code by the policy's name and the place in the code."""
    try:
        yield
    except Exception as error:
        raise NodeError(f"{policy}: {explained(error)}") from error


def table_of(scores: Sequence[Score]) -> Table:
    """Return a row for each policy: means and standard deviations over the seeds."""
    table = Table("policy", "reward", r"distance error \[m]", "heading error [°]", "to the end")
    for policy in dict.fromkeys(score.policy for score in scores):
        own = [score for score in scores if score.policy == policy]
        table.add_row(
            escape(policy),
            _spread((score.reward for score in own), 2),
            _spread((score.d_err_m for score in own), 3),
            _spread((score.theta_err_deg for score in own), 1),
            f"{sum(not score.terminated for score in own)} of {len(own)}",
        )
    return table


def _spread(values: Iterable[float | None], digits: int) -> str:
    known = [value for value in values if value is not None]
    if not known:
        return "-"
    return f"{statistics.mean(known):.{digits}f} ± {statistics.pstdev(known):.{digits}f}"


@app.command()
def score(
    scenario: ScenarioArgument = "back",
    policy: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help=f"{', '.join(POLICIES)}, or file.py:Class of your own; repeatable.",
            show_default="the three",
        ),
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Episodes of each: seeds 1, 2, …")] = 5,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Processes.", show_default="one for each core")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print every score as JSON.")] = False,
    settings: Settings = None,
) -> None:
    """Score policies in the environment mecazen/Follow-v0.

    Example: python -m mecazen_gym.score side --policy follower --policy mine.py:Mine --seeds 20
    """
    names = dict.fromkeys(policy or POLICIES)
    for name in names:
        policies.policy(name)  # refuses unknown policies
    run = partial(episode, load(scenario, settings))
    work = [(name, 1 + n) for name in names for n in range(seeds)]
    # Ctrl-C ends the workers at once, without a message
    quiet = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    with ProcessPoolExecutor(jobs or os.cpu_count(), initializer=quiet) as pool:
        scores = list(pool.map(run, *zip(*work, strict=True)))
    if as_json:
        typer.echo(msgspec.json.format(msgspec.json.encode(scores)).decode())
    else:
        console(100).print(table_of(scores))


if __name__ == "__main__":
    main(app)
