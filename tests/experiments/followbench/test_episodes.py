"""Episodes of Follow-Bench: those of the sample, and files that are not one."""

import os
from pathlib import Path

import pytest
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen_experiments.followbench.episodes import (
    SAMPLE,
    Box,
    Density,
    Walk,
    episode_lengths,
    read,
    read_folder,
)

CORRIDOR = SAMPLE / "layout" / "CorridorOrcaH4W5.6_back_1.yaml"


@pytest.fixture
def broken(tmp_path):
    """Write the corridor with a text replaced, and return its path."""

    def write(old, new, name=CORRIDOR.name):
        text = CORRIDOR.read_text(encoding="utf-8")
        assert old in text
        path = tmp_path / name
        path.write_text(text.replace(old, new), encoding="utf-8")
        return path

    return write


def test_a_corridor_is_read_whole():
    episode = read(CORRIDOR)

    assert episode.name == "CorridorOrcaH4W5.6_back_1"
    assert (episode.cls, episode.manners, episode.place) == ("Corridor", "orca", "back")
    assert episode.density == Density(humans=4, width=5.6)
    assert episode.robot == Pose2D(6.7, 5.0, 0.0)
    assert episode.target == Walk(Pose2D(8.0, 5.0, 0.0), ((38.5, 5.0),), True, 2.0, 0.5)
    assert episode.humans[0] == Walk(Pose2D(11.89, 5.17, 0.515), ((29.58, 3.48),), True, 2.0, 0.5)
    assert episode.boxes[1] == Box(20.0, 8.9, 0.0, 40.0, 2.2)
    assert episode.size == (40.0, 10.0)
    assert (episode.step_s, episode.inflation_cells) == (0.1, 8)
    assert (episode.max_steps, episode.max_search_steps) == (408, 102)


def test_a_goal_may_be_a_single_state():
    episode = read(SAMPLE / "layout" / "DoorwayOrcaH2W2.8_left_side_1.yaml")

    assert episode.humans[0].goals == ((10.941380642444084, 16.0),)
    assert episode.place == "left_side"


def test_a_track_names_its_own_class_and_plans_no_way():
    episode = read(SAMPLE / "target_trajectory" / "uTurn_back_1.yaml")

    assert episode.cls == "uTurn"
    assert episode.target.goals == ((25.0, 10.0), (25.0, 13.0), (5.0, 13.0))
    assert not episode.target.plans
    assert episode.target.goal_threshold == 0.1
    assert (episode.max_steps, episode.max_search_steps) == (520, 260)


def test_clutter_has_boxes_and_people_with_many_goals():
    episode = read(SAMPLE / "layout" / "ClutterOrcaObs30H10_left_side_1.yaml")

    assert episode.density == Density(humans=10, obstacles=30)
    assert len(episode.boxes) == 4 + 30  # the edges of the map are boxes too
    assert {len(one.goals) for one in episode.humans} == {19}


def test_a_file_says_whether_people_use_social_forces():
    assert read(SAMPLE / "dynamic" / "NormalPerpendicularSfmH5W0_back_1.yaml").manners == "sfm"


def test_the_whole_sample_is_readable_and_as_dense_as_its_names_say():
    episodes, problems = read_folder(SAMPLE)

    assert problems == []
    assert len(episodes) == 32
    for one in episodes.values():
        assert f"H{len(one.humans)}" in one.name or not one.humans
        assert one.density.humans == len(one.humans)
        assert all(len(walk.goals) >= 1 for walk in one.humans)


def test_every_scenario_has_a_length():
    lengths = episode_lengths()

    assert len(lengths) == 8 + 2 * 24 + 28
    assert all(one.max_search_steps <= one.max_steps / 2 for one in lengths.values())


def test_the_sample_has_a_licence():
    assert "MIT License" in (SAMPLE / "LICENSE").read_text(encoding="utf-8")


def test_a_folder_reports_what_it_can_not_read_and_goes_on(tmp_path, broken):
    good = tmp_path / "CorridorOrcaH4W5.6_back_2.yaml"
    good.write_bytes(CORRIDOR.read_bytes())
    broken("width: 40.0\n", "width: wide\n")

    episodes, problems = read_folder(tmp_path)

    assert [one.name for one in episodes.values()] == ["CorridorOrcaH4W5.6_back_2"]
    assert len(problems) == 1
    assert "world.width" in problems[0]


def test_a_folder_without_episodes_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="must be a folder with episodes"):
        read_folder(tmp_path / "nothing")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("height: 10.0", "height: -1", r"world\.height: Expected `float` > 0"),
        ("height: 10.0", "height: .nan", r"world\.height: Expected `float`"),
        ("height: 10.0", "height: nan", r"world\.height: Expected `float`"),
        ("  step_time: 0.1\n", "", r"world: Object missing required field `step_time`"),
        ("state: [8.0, 5.0, 0]", "state: [8.0, 5.0]", r"target\[0\]\.state: .*length 3"),
        ("state: [8.0, 5.0, 0]", "state: [8.0, inf, 0]", r"target\[0\]\.state\[1\]: Expected"),
        ("goal: [38.5, 5.0, 0.0]", "goal: [a, b, c]", r"target\[0\]\.goal\[0\]: Expected `float`"),
        ("goal: [38.5, 5.0, 0.0]", "goal: []", r"target\[0\]\.goal: .*length 3"),
        ("goal: [38.5, 5.0, 0.0]", "goal: [[[8, 5, 0]]]", r"goal\[0\]: must have a state after"),
        ("goal: [38.5, 5.0, 0.0]", "goal: [[[8, 5, 0]], []]", r"goal: must have one list"),
        ('name: "orca"', "name: boids", r"target\[0\]\.behavior\.name: Invalid enum value 'boids'"),
        ("{name: rectangle, length: 0.7,", "{name: rectangle, length: 0.8,", r"0\.70 x 0\.55 m"),
        ("{name: rectangle, length: 40.0", "{name: circle, length: 40.0", r"obstacle\[0\]\.shape"),
        ("skip_num: 5", "skip_num: 0", r"world\.planner\.skip_num: "),
        ("world:", "world: [", r"not YAML: line \d+"),
        ("world:", "w\0rld:", r"not YAML"),
        ("height: 10.0", "height: &a 10.0\n  more: *a", r"references \(\*name\) are not allowed"),
        ("height: 10.0", "deep: " + "[" * 5000 + "]" * 5000, r"nested more than 32 deep"),
        ("height: 10.0", "? [a]\n  : b", r"not YAML: line \d+: found unhashable key"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(broken, old, new, message):
    path = broken(old, new)

    with pytest.raises(ConfigError, match=message) as error:
        read(path)

    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


def test_people_of_one_episode_have_one_manner(tmp_path):
    text = CORRIDOR.read_text(encoding="utf-8")
    head, _, tail = text.rpartition('name: "orca"')
    path = tmp_path / CORRIDOR.name
    path.write_text(f'{head}name: "sfm"{tail}', encoding="utf-8")

    with pytest.raises(ConfigError, match=r"human\[3\]\.behavior\.name: must be orca"):
        read(path)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("CorridorOrcaH4W5.6.yaml", "the file's name must be"),
        ("CorridorOrcaH5W5.6_back_1.yaml", "no length is known"),
        ("../x_back_1.yaml", "no length is known for an episode of 'x'"),
    ],
)
def test_a_name_says_scenario_place_and_number(name, message):
    with pytest.raises(ConfigError, match=message):
        read(Path(name))


def test_a_pipe_is_refused(tmp_path):
    pipe = tmp_path / CORRIDOR.name
    os.mkfifo(pipe)
    with pytest.raises(ConfigError, match="must be a regular file"):
        read(pipe)


def test_tags_run_no_code(broken):
    path = broken("height: 10.0", "height: !!python/object/apply:os.system ['false']")

    with pytest.raises(ConfigError, match=r"world\.height: Expected `float`"):
        read(path)
