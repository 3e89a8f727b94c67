"""Follow-Bench as an experiment: which episodes, who plays, and what the tables show."""

import msgspec
import pytest
from mecazen.errors import ConfigError
from mecazen_experiments.cli import app
from mecazen_experiments.followbench import kind as bench
from mecazen_experiments.followbench.episodes import SAMPLE, Density, read_folder
from mecazen_experiments.followbench.generate import SETTINGS, generate
from typer.testing import CliRunner

EPISODE = generate("Parallel", "back", Density(5), 1)


def test_all_cells_of_the_benchmark_are_drawn_and_each_track_once():
    todo = bench.drawn(["social"], range(1000, 1002), [])
    people = [one for one in todo if one.labels["class"] in SETTINGS]
    assert len(people) == 52 * 2
    assert {len(one.jobs) for one in people} == {2}
    assert sum(len(one.jobs) for one in todo if one not in people) == 15
    keys = [job.key for one in todo for job in one.jobs]
    assert len(set(keys)) == len(keys)


def test_some_classes_may_be_chosen():
    todo = bench.drawn(["social"], [1], ["Doorway"])
    assert {one.labels["class"] for one in todo} == {"Doorway"}


def test_a_class_that_does_not_exist_is_one_line():
    with pytest.raises(ConfigError, match=r"^--only Dorway: no such class; known: .*Doorway"):
        bench.drawn(["social"], [1], ["Dorway"])
    files, _ = read_folder(SAMPLE / "dynamic")
    with pytest.raises(ConfigError, match=r"^--only Doorway: no such class; known: .*Crowd"):
        bench.read_from(["social"], files, ["Doorway"])


def test_our_robot_takes_no_other_follower():
    arguments = ["followbench", "--own-robot", "--follower", "social"]
    with pytest.raises(ConfigError, match="--own-robot has its own follower"):
        CliRunner().invoke(app, arguments, catch_exceptions=False)


def test_a_folder_has_a_row_for_each_class_density_and_place():
    files, _ = read_folder(SAMPLE)
    todo = bench.read_from(["social", "window"], files, [])
    assert sum(len(one.jobs) for one in todo) == 2 * len(files)
    labels = {tuple(one.labels.values()) for one in todo}
    assert ("window", "Doorway", "left_side", "2 people, 2.8 m wide") in labels


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
