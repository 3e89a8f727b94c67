"""Workers of this machine and of Dask are measured."""

from mecazen_bench import experiments


def test_experiments_run_with_one_worker_and_with_two_also_of_dask(monkeypatch, figures):
    monkeypatch.setattr(experiments, "NOTHINGS", 60)
    rows = figures(experiments.run(duration_s=0.5))
    assert list(rows) == ["1 worker", "2 workers", "Dask, 1 worker", "Dask, 2 workers"]
    assert all(row["runs/min"].value > 0.0 for row in rows.values())
    assert rows["Dask, 1 worker"]["efficiency"].value == 1.0
    assert rows["Dask, 2 workers"]["scheduler ms/run"].value > 0.0
