"""Scores of policies: computed from episodes, compared in a table; a failure is one line."""

from itertools import product

import msgspec
import pytest
from harness import SCENARIOS
from mecazen.errors import ConfigError, NodeError
from mecazen.loading import load_scenario, parse_settings
from mecazen_gym.policies import POLICIES
from mecazen_gym.score import Score, episode, score, table_of


def test_scores_are_those_of_an_episode_in_this_process_and_as_json(capsys):
    settings = ["sim.duration_s=0.5"]
    score("back", seeds=2, jobs=2, as_json=True, settings=settings)
    scores = msgspec.json.decode(capsys.readouterr().out, type=list[Score])
    scenario = load_scenario(SCENARIOS / "back.toml", parse_settings(settings))
    assert [(score.policy, score.seed) for score in scores] == [*product(POLICIES, (1, 2))]
    assert scores[3] == episode(scenario, "pid", 2)


def test_the_table_tells_means_and_deviations_and_who_got_to_the_end():
    scores = [Score("pid", n, -1.0 - n, 9.0, n == 1, None, 2.0 * n) for n in (0, 1)]
    (row,) = zip(*(column.cells for column in table_of(scores).columns), strict=True)
    assert row == ("pid", "-1.50 ± 0.50", "-", "1.0 ± 1.0", "1 of 2")


STANDING = """
class Standing:
    def __init__(self, env, seed):
        pass

    def __call__(self, observation):
        return [0.0, 0.0, 0.0]
"""


def test_a_policy_of_one_s_own_is_scored_beside_those_that_ship(tmp_path, capsys):
    file = tmp_path / "mine.py"
    file.write_text(STANDING)
    own = f"{file}:Standing"
    score("back", ["pid", own, own], 1, 1, as_json=True, settings=["sim.duration_s=0.5"])
    scores = msgspec.json.decode(capsys.readouterr().out, type=list[Score])
    assert [found.policy for found in scores] == ["pid", own]
    assert scores[1].followed_s == 0.49  # the last tick: time begins at 0


@pytest.mark.parametrize("name", ["pit", "nowhere.py:Mine", "FILE:Missing", "FILE:STANDING"])
def test_what_is_no_policy_is_refused_in_one_line(tmp_path, name):
    file = tmp_path / "mine.py"
    file.write_text(f"STANDING = 1\n{STANDING}")
    with pytest.raises(ConfigError) as refused:
        score("back", [name.replace("FILE", str(file))])
    assert "\n" not in str(refused.value)


def test_what_fails_in_a_policy_of_one_s_own_is_told_in_one_line_with_the_place(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(STANDING.replace("[0.0, 0.0, 0.0]", "1 / 0"))
    with pytest.raises(NodeError, match=r"Standing: ZeroDivisionError: .* mine\.py:7 __call__\)$"):
        score("back", [f"{file}:Standing"], 1, 1)
