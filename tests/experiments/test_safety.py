"""The experiment of safety: its scores, its tables and its films, of short runs."""

import msgspec
import pytest
from experiments.conftest import experiment
from harness import ROOT
from mecazen.loading import load_table
from mecazen_experiments.config import Experiment, chosen
from mecazen_experiments.jobs import expand

FILE = ROOT / "configs/experiments/safety.toml"
SHORT = f"""
kind = "safety"
seeds = 1
set = ["follower.standoff_m=1.0"]
[[cases]]
name = "hard stop"
scenario = "{ROOT}/configs/scenarios/safety.toml"
vary = {{ walks = [3.5, 3.5] }}
set = [
    "sim.duration_s=5.0",
    "start={{ x_m = $x_m, y_m = $y_m, yaw_deg = $yaw_deg }}",
    "target.path={{ kind = 'script', steps = [{{ duration_s = $walks, speed_m_s = 1.8 }}] }}",
]
[grid.driver]
follower = ["guard.enabled=false"]
guard = []
[grid.view]
back = ["follower.view=back"]
"""


def test_a_hard_stop_touches_without_a_guard_and_not_with_it(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.toml").write_text(SHORT)
    options = ("run", "short.toml", "--jobs", 1, "--json", "out.json")
    experiment(*options, "--only", "driver=guard", "--films", "films")
    assert "films/hard_stop-guard-back.mcap" in capsys.readouterr().out
    assert (tmp_path / "films" / "hard_stop-guard-back.mcap").stat().st_size > 100_000
    experiment(*options)
    written = msgspec.json.decode((tmp_path / "out.json").read_bytes())
    alone, guarded = written["rows"]
    assert alone["labels"] == {"case": "hard stop", "driver": "follower", "view": "back"}
    assert alone["sums"]["contacts_person"] == 1
    assert guarded["sums"]["contacts_person"] == 0
    assert guarded["sums"]["time_s"] == pytest.approx(5.0, abs=0.02)  # a tick less
    assert guarded["least"]["gap_person_m"] > 0.15
    assert alone["least"]["gap_person_m"] < 0.0
    out = capsys.readouterr().out
    assert [word for word in ("hard stop", "all") if word in out] == ["hard stop", "all"]
    (shown,) = written["tables"]
    most = float(shown["rows"][1][-1])
    # after no contact in 5 s: 2.996 / 5 s, in 1/h; the run may be a tick shorter
    assert most == pytest.approx(2.996 / 5.0 * 3600.0, rel=0.004)


def test_there_are_twelve_situations_and_all_can_be_loaded_from_each_view():
    config = chosen(load_table(FILE, Experiment), ["driver=planner"])
    assert len(config.cases) == 12
    assert len(expand(config, (1,))) == 12 * len(config.grid["view"])


def test_people_who_break_the_guards_assumptions_can_be_loaded_from_each_view():
    config = load_table(FILE.with_name("unpromised.toml"), Experiment)
    assert len(expand(config, (1,))) == 3 * 2 * 2


def test_all_drivers_and_views_meet_the_same_values_of_a_seed():
    config = load_table(FILE, Experiment)
    config = chosen(config, ["case=door", "driver=guard", "driver=planner"])
    first, *others = (
        [setting for job in one.jobs for setting in job.settings if "target.path" in setting]
        for one in expand(config, (1, 2))
    )
    assert first[0] != first[1]
    assert others == [first] * 7
