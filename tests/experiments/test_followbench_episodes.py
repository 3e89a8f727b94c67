"""Episodes of Follow-Bench: those of the sample, and files that are not one."""

import pytest
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen_experiments.followbench.episodes import SAMPLE, Box, Walk, episode_lengths, read

CORRIDOR = SAMPLE / "layout" / "CorridorOrcaH4W5.6_back_1.yaml"


def test_a_corridor_is_read_whole():
    episode = read(CORRIDOR)
    assert (episode.name, episode.scenario) == ("CorridorOrcaH4W5.6_back_1", "CorridorOrcaH4W5.6")
    assert (episode.cls, episode.place) == ("Corridor", "back")
    assert episode.robot == Pose2D(6.7, 5.0, 0.0)
    assert episode.target == Walk(Pose2D(8.0, 5.0, 0.0), ((38.5, 5.0),), True, 2.0, 0.5)
    assert episode.humans[0] == Walk(Pose2D(11.89, 5.17, 0.515), ((29.58, 3.48),), True, 2.0, 0.5)
    assert len(episode.humans) == 4
    assert episode.boxes[1] == Box(20.0, 8.9, 0.0, 40.0, 2.2)
    assert (episode.size, episode.inflation_cells) == ((40.0, 10.0), 8)
    assert (episode.max_steps, episode.max_search_steps) == (408, 102)


def test_a_track_is_a_class_without_planned_paths():
    episode = read(SAMPLE / "target_trajectory" / "uTurn_back_1.yaml")
    assert episode.cls == "uTurn"
    assert episode.target.goals == ((25.0, 10.0), (25.0, 13.0), (5.0, 13.0))
    assert not episode.target.plans
    assert episode.target.goal_threshold == 0.1
    assert (episode.max_steps, episode.max_search_steps) == (520, 260)


def test_the_whole_sample_is_readable_and_has_a_licence():
    episodes = [read(file) for file in sorted(SAMPLE.rglob("*.yaml"))]
    assert len(episodes) == 31
    for episode in episodes:
        assert f"H{len(episode.humans)}" in episode.name or not episode.humans
    assert "MIT License" in (SAMPLE / "LICENSE").read_text(encoding="utf-8")


def test_every_scenario_has_a_length():
    lengths = episode_lengths()
    assert len(lengths) == 8 + 2 * 24 + 28
    assert all(search <= steps / 2 for steps, search in lengths.values())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("height: 10.0", "height: -1", r"world\.height: Expected `float` > 0"),
        ("height: 10.0", "height: nan", r"world\.height: Expected `float`"),
        (
            "height: 10.0",
            "height: !!python/object/apply:os.system ['false']",
            r"world\.height: Expected `float`",
        ),
        ("step_time: 0.1", "step_time: 0.2", r"world\.step_time: Expected `float` <= 0\.1"),
        ("  step_time: 0.1\n", "", r"world: Object missing required field `step_time`"),
        ("state: [8.0, 5.0, 0]", "state: [8.0, 5.0]", r"target\[0\]\.state: .*length 3"),
        ("state: [8.0, 5.0, 0]", "state: [8.0, inf, 0]", r"target\[0\]\.state\[1\]: Expected"),
        ("goal: [38.5, 5.0, 0.0]", "goal: [a, b, c]", r"target\[0\]: goal: Expected `float`"),
        ("goal: [38.5, 5.0, 0.0]", "goal: []", r"target\[0\]: goal: .*length 3"),
        ("goal: [38.5, 5.0, 0.0]", "goal: [[[8, 5, 0]]]", r"goal: must have a state after"),
        ("goal: [38.5, 5.0, 0.0]", "goal: [[[8, 5, 0]], []]", r"target\[0\]: goal: "),
        ('name: "orca"', "name: sfm", r"target\[0\]\.behavior\.name: Invalid enum value 'sfm'"),
        ("{name: rectangle, length: 0.7,", "{name: rectangle, length: 0.8,", r"0\.70 x 0\.55 m"),
        ("{name: rectangle, length: 40.0", "{name: circle, length: 40.0", r"obstacle\[0\]\.shape"),
        ("skip_num: 5", "skip_num: 0", r"world\.planner\.skip_num: "),
        ("world:", "world: [", r"not YAML: line \d+"),
        ("world:", "w\0rld:", r"not YAML"),
        ("height: 10.0", "deep: " + "[" * 5000 + "]" * 5000, r"not YAML: .*recursion"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, old, new, message):
    text = CORRIDOR.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / CORRIDOR.name
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigError, match=message) as error:
        read(path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("CorridorOrcaH4W5.6.yaml", "the file's name must be"),
        ("CorridorOrcaH5W5.6_back_1.yaml", "no length is known for an episode of 'CorridorOrcaH5"),
    ],
)
def test_a_name_contains_scenario_place_and_number(tmp_path, name, message):
    with pytest.raises(ConfigError, match=message):
        read(tmp_path / name)
