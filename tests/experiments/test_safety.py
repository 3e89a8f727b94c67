"""`mecazen experiment safety`: its situations, its scores, and its options, of short runs."""

import msgspec
import pytest
from harness import ROOT, error_of
from mecazen.errors import ConfigError, MecazenError
from mecazen.loading import load_table
from mecazen_experiments.safety import SafetyConfig, configured, expand
from mecazen_tools.cli.app import app

FILE = ROOT / "configs/experiments/safety.toml"
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
