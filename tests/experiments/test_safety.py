"""`mecazen experiment safety`: its situations, its scores, and its options, of short runs."""

import math

import msgspec
import numpy as np
import pytest
from harness import ROOT, error_of
from mecazen.errors import ConfigError, MecazenError
from mecazen.loading import load_scenario, load_table
from mecazen_experiments.safety import SafetyConfig, configured, expand
from mecazen_experiments.safety_scores import safety
from mecazen_experiments.table import Poses
from mecazen_experiments.watch import Body, Watched
from mecazen_tools.cli.app import app
from people import HEIGHT, body

from experiments import made_up

FILE = ROOT / "configs/experiments/safety.toml"
SCENARIO = load_scenario(ROOT / "configs/scenarios/safety.toml")
STEP_S = 0.02
SHORT = f"""
scenario = "{ROOT}/configs/scenarios/safety.toml"
standoff_m = 1.0
seeds = 1
views = ["back"]
[drivers]
follower = ["guard.enabled=false"]
guard = []
[[situations]]
name = "hard stop"
vary = {{ walks = [3.5, 3.5] }}
set = [
    "sim.duration_s=5.0",
    "target.path={{ kind = 'script', steps = [{{ duration_s = $walks, speed_m_s = 1.8 }}] }}",
]
"""


@pytest.fixture
def _in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.toml").write_text(SHORT)


def experiment(*arguments):
    app(["experiment", "safety", *map(str, arguments)], standalone_mode=False)


@pytest.mark.usefixtures("_in_folder")
def test_a_hard_stop_touches_without_a_guard_and_not_with_it(tmp_path, capsys):
    options = ("short.toml", "--jobs", 1, "--json", "out.json")
    experiment(*options, "--driver", "guard", "--films", "films")
    experiment(*options)
    rows = msgspec.json.decode((tmp_path / "out.json").read_bytes())["rows"]
    alone, guarded, *both = rows
    assert alone["labels"] == {"situation": "hard stop", "driver": "follower"}
    assert alone["sums"]["contacts_person"] == 1
    assert guarded["sums"]["contacts_person"] == 0
    assert guarded["least"]["gap_person_m"] > 0.15
    assert alone["least"]["gap_person_m"] < 0.0
    assert [row["labels"]["situation"] for row in both] == ["all", "all"]
    assert (tmp_path / "films" / "hard_stop-guard-back.mcap").stat().st_size > 100_000
    assert "hard stop" in capsys.readouterr().out


WRONG = [
    (("--situation", "flood"), ("--situation flood", "hard stop")),
    (("--driver", "nobody"), ("--driver nobody", "follower, guard")),
    (("--driver", "guard", "--set", "sensor.kind=pose"), ("hard stop, guard, back", "sensor.kind")),
    (("--films", "short.toml/films"), ("--films short.toml/films",)),
]


@pytest.mark.usefixtures("_in_folder")
@pytest.mark.parametrize(("arguments", "words"), WRONG)
def test_what_a_user_gets_wrong_is_one_line(arguments, words):
    text = error_of(MecazenError, lambda: experiment("short.toml", "--jobs", 1, *arguments))
    for word in words:
        assert word in text


def test_there_are_twelve_situations_and_all_can_be_loaded_from_each_view():
    config = configured(str(FILE), [], ["planner"], [])
    assert len(config.situations) == 12
    todo = expand(config, 1, ())
    assert len(todo) == 12 * len(config.views)


def test_all_drivers_and_views_meet_the_same_values_of_a_seed():
    config = configured(str(FILE), ["door"], ["guard", "planner"], [])
    first, *others = (
        [setting for job in one.jobs for setting in job.settings if "target.path" in setting]
        for one in expand(config, 2, ())
    )
    assert first[0] != first[1]
    assert others == [first] * 7


def test_a_value_that_nothing_gives_is_named():
    config = load_table(FILE, SafetyConfig)
    wrong = msgspec.structs.replace(config.situations[0], settings=("sim.duration_s=$none",))
    config = msgspec.structs.replace(config, situations=(wrong,))
    with pytest.raises(ConfigError, match=r"corridor.*'none'.*bearing_deg, speed"):
        expand(config, 1, ())


def watched(robot_x, person_x, other_y=None):
    """A robot and a person along x, and somebody else along y at x = 0, over time."""
    n = len(robot_x)
    still = np.zeros(n)
    ticks = made_up.run(n, robot=(robot_x, 0.0, 0.0), target=(person_x, 0.0, 0.0))
    step = np.array([body(pose=(x, 0.0, 0.0)) for x in np.broadcast_to(person_x, n)])
    others = ()
    if other_y is not None:
        others = (Body(np.array([body(pose=(0.0, y, 0.0)) for y in other_y]), HEIGHT),)
    t = np.arange(n) * made_up.TICK_S
    seen = np.arange(n) % 4 != 3
    return Watched(ticks, t, Poses(robot_x, still, still), Body(step, HEIGHT), others, t, seen)


def test_who_walks_into_a_standing_robot_is_a_contact_that_it_did_not_cause():
    n = 200
    found = safety(
        watched(np.zeros(n), np.linspace(3.0, 3.1, n), np.linspace(-2.0, 0.0, n)), SCENARIO
    )
    assert (found.contacts_others, found.contacts_others_all) == (0, 1)
    assert found.contacts_person == 0
    assert found.gap_others_m < 0.0 < found.gap_person_m


def test_a_person_who_walks_into_a_standing_robot_is_a_contact_that_it_did_not_cause():
    n = 200
    walks = np.linspace(2.0, 0.0, n)
    found = safety(watched(np.zeros(n), walks), SCENARIO)
    assert (found.contacts_person, found.contacts_person_all) == (0, 1)
    found = safety(watched(2.0 - walks, np.linspace(2.0, 1.9, n)), SCENARIO)
    assert (found.contacts_person, found.contacts_person_all) == (1, 1)


def test_a_robot_that_drives_at_somebody_has_caused_it():
    n = 200
    found = safety(
        watched(np.linspace(-2.0, 0.0, n), np.linspace(3.0, 3.1, n), np.zeros(n)), SCENARIO
    )
    assert (found.contacts_others, found.contacts_others_all) == (1, 1)
    assert found.conflict_s > 0.0


def test_three_frames_of_four_show_the_person():
    n = 200
    found = safety(watched(np.zeros(n), np.linspace(1.2, 1.3, n)), SCENARIO)
    assert found.view_percent == pytest.approx(75.0, abs=1.0)
    assert found.regain_s == pytest.approx(made_up.TICK_S)
    assert math.isnan(found.gap_person_m) is False
