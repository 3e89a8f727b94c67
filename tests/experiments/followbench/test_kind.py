"""Follow-Bench as an experiment: which episodes, who plays, and what the tables show."""

import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from mecazen.errors import ConfigError
from mecazen_experiments.cli import app
from mecazen_experiments.followbench import kind as bench
from mecazen_experiments.followbench.entrants import entrant, observation
from mecazen_experiments.followbench.episodes import SAMPLE, Density, read_folder
from mecazen_experiments.followbench.generate import generate
from mecazen_experiments.followbench.play import World, play
from mecazen_experiments.followbench.scenario import scenario_of
from mecazen_experiments.safety_scores import safety
from mecazen_experiments.watch import watch
from typer.testing import CliRunner

FULL_SPEED = """
from mecazen.keys import CMD_VEL, ODOM, PEOPLE, SCAN
from mecazen.messages import Twist
from mecazen.geometry import Twist2D
from mecazen.node import Node, Row, every

class Mine(Node):
    ROW = Row("follower", inputs=(every(ODOM),), outputs=(CMD_VEL,))

    def reset(self, seed):
        self.target = None

    def step(self, tick, inputs):
        names = [one.id for one in inputs[PEOPLE].persons]
        assert ("target" in names) == (len(inputs[SCAN].ranges) == 200)
        return {CMD_VEL: Twist.planar(Twist2D(1.0, 0.0, 0.5))}

class Policy:
    def predict(self, observation):
        assert observation.shape == (234,)
        return (1.0, 0.5), None

class Pure:
    def reset(self, seed):
        pass

    def command(self, view):
        return 1.0, 0.5

class Neither:
    pass
"""
DOCUMENT = Path(__file__).parents[3] / "docs" / "followbench.md"
EPISODE = generate("Parallel", "back", Density(5), 1)


def test_all_cells_of_the_benchmark_are_drawn_and_each_track_once():
    todo = bench.drawn(["social"], range(1000, 1002), [])
    people = [one for one in todo if one.labels["class"] in (*bench.CROWDS, *bench.LAYOUTS)]
    assert len(people) == 52 * 2
    assert {len(one.jobs) for one in people} == {2}
    assert sum(len(one.jobs) for one in todo if one not in people) == 15
    keys = [job.key for one in todo for job in one.jobs]
    assert len(set(keys)) == len(keys)


def test_some_classes_may_be_chosen():
    todo = bench.drawn(["social"], [1], ["Doorway"])
    assert {one.labels["class"] for one in todo} == {"Doorway"}


def test_a_folder_has_a_row_for_each_class_density_and_place():
    files, _ = read_folder(SAMPLE)
    todo = bench.read_from(["social", "window"], files)
    assert sum(len(one.jobs) for one in todo) == 2 * len(files)
    labels = {tuple(one.labels.values()) for one in todo}
    assert ("window", "Doorway", "left_side", "2 people, 2.8 m wide") in labels


@pytest.mark.parametrize("name", ["Mine", "Policy", "Pure"])
def test_a_node_a_policy_and_a_pure_class_may_enter(tmp_path, name):
    file = tmp_path / "mine.py"
    file.write_text(FULL_SPEED)
    short = msgspec.structs.replace(EPISODE, max_steps=10)
    record = play(short, entrant(f"{file}:{name}")(), 1)
    # a twentieth of a turn in 1 s; the heading before each step counts
    assert record.robot[-1, 2] - record.robot[0, 2] == pytest.approx(0.5)
    assert np.hypot(*(record.robot[-1, :2] - record.robot[0, :2])) == pytest.approx(1.0, rel=0.02)


def test_the_planner_of_the_documents_follows_the_target(tmp_path):
    (code,) = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
    file = tmp_path / "mine.py"
    file.write_text(code)
    alone = msgspec.structs.replace(EPISODE, humans=())
    record = play(alone, entrant(f"{file}:Mine")(), 1)
    assert not record.collided
    assert record.visible.all()


@pytest.mark.parametrize(
    ("name", "says"),
    [("mine", "no such planner; known: social"), ("{file}:Neither", "must be a class with")],
)
def test_who_can_not_play_is_one_line(tmp_path, name, says):
    file = tmp_path / "mine.py"
    file.write_text(FULL_SPEED)
    with pytest.raises(ConfigError, match=says):
        entrant(name.format(file=file))


def test_an_unseen_target_is_zeros_in_the_observation_of_a_policy():
    world = World(EPISODE)
    seen = world.sees()
    shown = observation(world.view(seen))
    hidden = observation(world.view([False] * len(seen)))
    assert shown[4] == 1.0
    assert not hidden[4:34].any()
    assert np.array_equal(shown[34:], hidden[34:])


def test_the_same_episode_is_a_scenario_with_our_robot():
    scenario = scenario_of(EPISODE, 3)
    assert scenario.start.pose.x == pytest.approx(EPISODE.robot.x + 0.25)  # its middle
    assert len(scenario.crowd.walkers) == len(EPISODE.humans)
    short = msgspec.structs.replace(
        scenario, sim=msgspec.structs.replace(scenario.sim, duration_s=1.0)
    )
    seen = watch(short)
    assert len(seen.others) == len(EPISODE.humans)
    assert not safety(seen, short).contacts_person_all


def test_the_command_prints_tables_and_writes_all_runs(tmp_path):
    arguments = ["followbench", "--follower", "social", "--follower", "braking"]
    arguments += ["--only", "uTurn", "--jobs", "1"]
    arguments += ["--store", str(tmp_path / "s.sqlite"), "--json", str(tmp_path / "r.json")]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    assert "By the rules of Follow-Bench" in result.output
    rows = msgspec.json.decode((tmp_path / "r.json").read_bytes())["rows"]
    assert [len(row["runs"]) for row in rows] == [1, 1, 1, 1]


def test_the_command_reports_files_that_it_can_not_read(tmp_path):
    good = next(SAMPLE.rglob("uTurn_back_1.yaml"))
    (tmp_path / good.name).write_bytes(good.read_bytes())
    (tmp_path / "uTurn_back_2.yaml").write_text("world: [")
    arguments = ["followbench", str(tmp_path), "--follower", "social", "--jobs", "1"]
    arguments += ["--store", str(tmp_path / "s.sqlite")]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    assert "left out: " in result.output
    assert "uTurn_back_2.yaml" in result.output


def test_results_of_several_entries_make_one_table_and_a_figure(tmp_path):
    runner, store = CliRunner(), ["--store", str(tmp_path / "s.sqlite"), "--jobs", "1"]
    results = []
    for name in ("social", "braking"):
        file = tmp_path / f"{name}.json"
        chosen = ["--follower", name, "--only", "uTurn", "--json", str(file)]
        runner.invoke(app, ["followbench", *chosen, *store], catch_exceptions=False)
        results += ["--leaderboard", str(file)]
    arguments = ["followbench", *results, "--figures", str(tmp_path / "figures")]
    result = runner.invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    assert "social" in result.output
    assert "braking" in result.output
    assert (tmp_path / "figures" / "followbench.png").stat().st_size


def test_a_leaderboard_of_another_file_is_one_line(tmp_path):
    other = tmp_path / "other.json"
    other.write_text("{}")
    with pytest.raises(ConfigError, match=r"other\.json: no result of followbench"):
        bench.rows_of(other)


def test_the_film_of_a_row_is_its_first_failure(tmp_path):
    # beside the target, their reference does not look where it turns
    arguments = ["followbench", "--follower", "social", "--only", "uTurn", "--jobs", "1"]
    arguments += ["--store", str(tmp_path / "s.sqlite"), "--films", str(tmp_path / "films")]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    films = sorted(file.name for file in (tmp_path / "films").iterdir())
    assert films == ["social-uTurn-back-0_people.gif", "social-uTurn-left_side-0_people.gif"]
