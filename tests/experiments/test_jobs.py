"""From cases to runs, and the keys under which results are found again."""

from pathlib import Path
from typing import Any

import pytest
from mecazen.errors import ConfigError
from mecazen.graph import GRAPH
from mecazen.loading import load_scenario, parse_settings
from mecazen_experiments import jobs
from mecazen_experiments.config import Case, Experiment
from mecazen_experiments.jobs import Job, fingerprint, version

WALK = "t_s,x_m,y_m\n0,0,0\n1,0.5,0\n2.003,1,0\n"


def case(folder: Any, name: str = "short", **more: Any) -> Case:
    return Case(name, folder.path / "short.toml", **more)


def expand(cases, *arguments: Any, **options: Any) -> list[jobs.Series]:
    return jobs.expand(Experiment(cases=tuple(cases)), *arguments, **options)


def key_of(folder: Any, *settings: str) -> str:
    return fingerprint(load_scenario(folder.path / "short.toml", parse_settings(settings)))


def recorded(walk: Path) -> str:
    return f'target.path={{kind="recorded", file="{walk}"}}'


def test_each_case_runs_with_each_seed(folder):
    rows = expand([case(folder), case(folder, "other")], [1, 2, 3])
    assert [row.row for row in rows] == ["short", "other"]
    assert [job.key.seed for job in rows[0].jobs] == [1, 2, 3]
    assert str(rows[1].jobs[0]) == "other, seed 1"


def test_sweeps_run_every_combination_over_all_settings(folder):
    swept = case(folder, settings=("seed=9",), sweep={"sim.tick_s": (0.01, 0.02)})
    rows = expand([swept], [5], ("start.x_m=-2",), {"follower.estimator": ("kf_cv", "none")})
    assert [row.row for row in rows] == [
        "short, sim.tick_s=0.01, follower.estimator=kf_cv",
        "short, sim.tick_s=0.01, follower.estimator=none",
        "short, sim.tick_s=0.02, follower.estimator=kf_cv",
        "short, sim.tick_s=0.02, follower.estimator=none",
    ]
    scenario = load_scenario(rows[3].jobs[0].scenario, parse_settings(rows[3].jobs[0].settings))
    assert (scenario.seed, scenario.start.x_m, scenario.sim.tick_s) == (5, -2.0, 0.02)
    assert len({row.jobs[0].key for row in rows}) == 4


def test_a_grid_runs_every_choice_and_names_it(folder):
    view = {"left": ("follower.view=side_left",), "back": ("follower.view=back",)}
    place = ("start={ x_m = $x_m, y_m = $y_m, yaw_deg = $yaw_deg }", "follower.standoff_m=2.0")
    swept = {"sim.tick_s": (0.01, 0.02)}
    experiment = Experiment(cases=(case(folder),), settings=place, grid={"view": view}, sweep=swept)
    rows = jobs.expand(experiment, [1])
    assert [row.row for row in rows][1:3] == [
        "short, left, sim.tick_s=0.02",
        "short, back, sim.tick_s=0.01",
    ]
    assert rows[2].labels == {"case": "short", "view": "back", "sim.tick_s": 0.01}
    scenarios = [
        load_scenario(row.jobs[0].scenario, parse_settings(row.jobs[0].settings)) for row in rows
    ]
    left, back = scenarios[0].start, scenarios[2].start
    # beside a person at the origin, whom the robot faces from their left
    assert (left.x_m, left.y_m, left.yaw_deg) == pytest.approx((0.0, 2.0, -90.0), abs=1e-12)
    assert (back.x_m, back.y_m, back.yaw_deg) == pytest.approx((-2.0, 0.0, 0.0), abs=1e-12)


def test_a_value_that_nothing_gives_is_named(folder):
    wrong = case(folder, settings=("sim.duration_s=$none",), vary={"speed": (0.5, 1.0)})
    with pytest.raises(ConfigError, match=r"'short'.*'none'.*bearing_deg, .*speed"):
        expand([wrong], [1])


def test_a_recorded_case_runs_each_walk_to_its_end(folder):
    walks = [folder.write(f"walks/{name}.csv", WALK) for name in ("eth_1", "eth_2")]
    walker = case(folder, settings=(recorded(walks[0]), "target.path.start_after_s=1"))
    plain, walked = expand([case(folder, "plain"), walker], [1, 2], walks=walks)
    assert [job.walk for job in plain.jobs] == [None, None]
    assert [job.walk for job in walked.jobs] == ["eth_1", "eth_1", "eth_2", "eth_2"]
    assert str(walked.jobs[2]) == "short / eth_2, seed 1"
    scenario = load_scenario(walked.jobs[0].scenario, parse_settings(walked.jobs[0].settings))
    assert scenario.sim.ticks == 301  # 1 s and 2.003 s are 300.3 ticks


def test_walks_that_nobody_walks_are_refused(folder):
    walk = folder.write("eth_1.csv", WALK)
    with pytest.raises(ConfigError, match=r"--walks: .*recorded"):
        expand([case(folder)], [1], walks=[walk])


def test_a_walk_that_can_t_be_read_is_named(folder):
    good, wrong = folder.write("good.csv", WALK), folder.write("wrong.csv", "x")
    with pytest.raises(ConfigError, match=r"wrong\.csv"):
        expand([case(folder, settings=(recorded(good),))], [1], walks=[wrong])


def test_the_fingerprint_is_of_what_is_simulated(folder):
    assert key_of(folder) == key_of(folder)
    assert key_of(folder, "seed=7") == key_of(folder)
    assert key_of(folder, "sim.mode=lockstep") == key_of(folder, "sim.mode=real_time")
    assert key_of(folder, "follower.standoff_m=1.1") != key_of(folder)
    assert key_of(folder, "robot.rollers.mass_kg=0.03") != key_of(folder)


def test_the_fingerprint_has_what_a_walk_and_a_program_say_and_not_their_names(folder, monkeypatch):
    def of(name, text, setting):
        return key_of(folder, setting(folder.write(name, text)))

    def program(file):
        return f'programs.follower="{file}:A"'

    other = WALK.replace("0.5", "0.6")
    for suffix, one, two, setting in (
        ("csv", WALK, other, recorded),
        ("py", "A = 1", "A = 2", program),
    ):
        first = of(f"a.{suffix}", one, setting)
        assert first == of(f"deep/b.{suffix}", one, setting)
        assert first != of(f"c.{suffix}", two, setting)
    folder.write("a_module.py", "A = 1")
    monkeypatch.syspath_prepend(folder.path)
    assert key_of(folder, program("a_module")) == first
    with pytest.raises(ConfigError, match="no_module"):
        key_of(folder, program("no_module"))


def test_the_version_changes_with_what_a_run_loads_and_with_nothing_else(folder, monkeypatch):
    libraries = {"numpy": "1", "mujoco": "1"}
    monkeypatch.setattr(jobs, "PACKAGES", ("mecazen_more",))
    monkeypatch.setattr(jobs, "LIBRARIES", tuple(libraries))
    monkeypatch.setattr(jobs, "version_of", lambda name: libraries[name])
    monkeypatch.syspath_prepend(folder.path)
    changes = {"more/a.py": "A", "more/walk.npz": "1", "more/norm.csv": "1", "more/a.yaml": "b"}
    written = {name: folder.write(f"mecazen_{name}", text) for name, text in changes.items()}
    folder.write("mecazen_more/__init__.py", "")
    viewer = folder.write("mecazen_viewer/__init__.py", "A = 1")
    found = [version.__wrapped__()]
    for file in written.values():
        file.write_text("another")
        found.append(version.__wrapped__())
    for name in libraries:
        libraries[name] = "2"
        found.append(version.__wrapped__())
    assert len(set(found)) == 1 + len(written) + len(libraries)
    viewer.write_text("A = 2")
    folder.write("mecazen_more/__pycache__/a.pyc", "built")
    assert version.__wrapped__() == found[-1]


def test_the_version_covers_every_service_of_a_run_and_the_rays_of_its_sensors():
    # the crowd is in the package of the target; the others change no result
    others = {"crowd", "viewer", "recorder", "hardware", "collector"}
    services = {row.part_of for row in GRAPH} - others
    assert {f"mecazen_{service}" for service in services} <= set(jobs.PACKAGES)
    assert "mujoco" in jobs.LIBRARIES


def test_a_worker_with_another_version_refuses(folder):
    job = expand([case(folder)], [1])[0].jobs[0]
    jobs.check_version(job)
    other = jobs.Key(job.key.scenario_sha256, 1, "0")
    with pytest.raises(jobs.MecazenError, match="other versions"):
        jobs.check_version(Job("short", None, job.scenario, (), other))
