"""Follow-Bench: its files, its metrics, and our robot and the reference in its episodes."""

import math

import msgspec
import numpy as np
import pytest
from mecazen.config.people import Goal
from mecazen.config.world import Box
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario, scenario_path
from mecazen_experiments.expansion import expand
from mecazen_experiments.followbench.episodes import SAMPLE, read
from mecazen_experiments.followbench.program import followbench, metrics, scenario_of
from mecazen_experiments.study import load_study
from mecazen_tools.observe import PersonOverTime, Watched
from mecazen_tools.table import Poses

from experiments import made_up

OPEN = read(SAMPLE / "dynamic" / "NormalParallelOrcaH5W0_back_2.yaml")
CORRIDOR_FILE = SAMPLE / "layout" / "CorridorOrcaH4W5.6_back_1.yaml"
CORRIDOR = read(CORRIDOR_FILE)
TRACK = read(SAMPLE / "target_trajectory" / "uTurn_back_1.yaml")


# ---- files


def test_episodes_are_read_whole():
    assert (CORRIDOR.name, CORRIDOR.cls, CORRIDOR.place) == (CORRIDOR_FILE.stem, "Corridor", "back")
    assert CORRIDOR.robot == Pose2D(6.7, 5.0, 0.0)
    person = CORRIDOR.humans[0]
    assert (person.x_m, person.y_m, person.goal_m) == (11.89, 5.17, (29.58, 3.48))
    assert (len(CORRIDOR.humans), person.speed_m_s) == (4, 1.5)
    assert CORRIDOR.boxes[1] == Box(size_m=(40.0, 2.2, 2.0), position_m=(20.0, 8.9))
    path = TRACK.target
    assert TRACK.cls == "uTurn"
    assert (*path.via_m, path.goal_m) == ((25.0, 10.0), (25.0, 13.0), (5.0, 13.0))
    assert (TRACK.max_steps, TRACK.max_search_steps) == (520, 260)


def changed(tmp_path, old, new):
    """Return a copy of the corridor's file with another text."""
    text = CORRIDOR_FILE.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / CORRIDOR_FILE.name
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def test_without_a_free_path_a_person_walks_straight_on(tmp_path):
    wall = "obstacle:\n  - {shape: {name: rectangle, length: 0.4, width: 30}, state: [20, 5, 0]}\n"
    closed = read(changed(tmp_path, "obstacle:\n", wall))
    assert closed.target == Goal(x_m=8.0, y_m=5.0, goal_m=(38.5, 5.0), speed_m_s=1.5)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("height: 10.0", "height: -1", r"world\.height: Expected `float` > 0"),
        (
            "height: 10.0",
            "height: !!python/object/apply:os.system ['false']",
            r"world\.height: Expected `float`",
        ),
        ("  step_time: 0.1\n", "", r"world: Object missing required field `step_time`"),
        ("state: [8.0, 5.0, 0]", "state: [8.0, 5.0]", r"target\[0\]\.state: .*length 3"),
        ("goal: [38.5, 5.0, 0.0]", "goal: [[[8, 5, 0]]]", r"goal: must have a state after"),
        ("{name: rectangle, length: 40.0", "{name: circle, length: 40.0", r"obstacle\[0\]\.shape"),
        ("world:", "world: [", r"not YAML: line \d+"),
        ("height: 10.0", "deep: " + "[" * 600 + "]" * 600, r"not YAML: .*recursion"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, old, new, message):
    path = changed(tmp_path, old, new)
    with pytest.raises(ConfigError, match=message) as error:
        read(path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


# ---- metrics


def bodies(places):
    """Return a person whose joints are all at places (n, 2)."""
    return PersonOverTime(np.repeat(np.array(places)[:, None], 20, axis=1), 1.7)


def test_metrics_are_those_of_the_steps():
    # along x at 1 m/s, then at 1.2 m/s for a tenth of a second, then at rest
    x = np.concatenate((np.linspace(0.0, 0.1, 11), np.linspace(0.112, 0.22, 10), np.full(10, 0.22)))
    table = made_up.run(len(x), robot=(x, 0.0, 0.0), target=(x, 0.0, 0.0))
    scenario = load_scenario(scenario_path("safety"))
    reach = math.hypot(*scenario.robot.footprint) + 0.3
    t, robot = np.arange(4) * 0.1, Poses(*np.zeros((3, 4)))
    person = bodies([(reach + gap, 0.0, 1.0) for gap in (0.4, 0.5, 1.1, 1.3)])
    stranger = bodies([(reach + gap, 0.0, 1.0) for gap in (0.4, 0.5, 1.1, np.nan)])
    result = metrics(Watched(table, t, robot, person, (stranger,), (), ()), scenario)
    assert (result["tin_tperson"], result["tin_private"]) == (50.0, 25.0)
    assert result["pl_m"] == pytest.approx(0.22)
    assert result["avg_vel_m_s"] == pytest.approx((1.0 + 1.2 + 0.0) / 3)
    assert result["avg_acc_m_s2"] == pytest.approx((2.0 + 12.0) / 2)
    assert result["jerk_m_s3"] == pytest.approx(140.0)


# ---- our robot, and the reference on it


def jobs(*settings, file="NormalParallelOrcaH5W0_back_2", follower="ours"):
    """Return the jobs of the study for an episode."""
    files = sorted(SAMPLE.rglob(f"{file}.yaml"))
    return expand(
        load_study("followbench"), [1], settings, files=files, only=[f"follower={follower}"]
    )


def test_an_episode_is_a_scenario_with_our_robot():
    scenario = scenario_of(CORRIDOR, 3)
    assert scenario.start.pose.x == pytest.approx(CORRIDOR.robot.x + 0.25)  # its middle
    assert [walker.path for walker in scenario.crowd.walkers] == [*CORRIDOR.humans]
    assert scenario.world.obstacles == CORRIDOR.boxes
    assert scenario.target.path == CORRIDOR.target


@pytest.mark.parametrize(("beside", "view"), [(1.5, "side_left"), (-1.5, "side_right")])
def test_our_robot_remains_on_its_side_of_the_target(beside, view):
    target = OPEN.target
    left = beside if target.goal_m[0] > target.x_m else -beside
    start = Pose2D(target.x_m - 0.25, target.y_m + left)
    scenario = scenario_of(msgspec.structs.replace(OPEN, place="left_side", robot=start), 1)
    assert scenario.follower.view == view
    assert scenario.start.yaw_deg == pytest.approx(math.degrees(math.copysign(math.pi / 2, -left)))


def test_our_follower_follows_in_a_crowd_without_contact():
    (job,) = jobs("sim.duration_s=4.0")
    columns = followbench(job)
    labels = [columns[name] for name in ("kind", "class", "place", "people")]
    assert labels == ["open", "Parallel", "back", 5]
    assert (columns["sr"], columns["asr"], columns["contacts_others_all"]) == (True, True, 0)
    assert columns["time_s"] == pytest.approx(4.0, abs=0.02)
    assert columns["pl_m"] > 2.0


def test_the_reference_keeps_to_its_side_and_off_the_walls():
    (job,) = jobs("sim.duration_s=6.0", file="DoorwayOrcaH2W2.8_left_side_1", follower="social")
    columns = followbench(job)
    assert columns["contacts_walls"] == 0
    assert columns["gap_person_m"] > 0.2
