"""Result files and the documents that show them: edits by hand and stale results are found."""

import json
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from mecazen_bench import results
from mecazen_bench.harness import ResultsError
from mecazen_bench.results import problems, stale
from mecazen_tools.cli.app import app
from typer.testing import CliRunner

CODE = "common/mecazen"
TABLE = "| case | error |\n| --- | --- |\n| door | {} |\n"


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A project with one stage, its result, a document and a figure that show it."""
    for folder in ("docs", "results", CODE):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / CODE / "code.py").write_text("1")
    (tmp_path / "results" / "stages.toml").write_text(
        '[walk]\ncommand = "experiment run walk"\ninputs = ["experiments"]\n'
    )
    (tmp_path / "README.md").touch()
    (tmp_path / "docs" / "figure.png").write_bytes(b"drawn")
    figure = results._sha256(tmp_path / "docs" / "figure.png")
    stage = results.stages(tmp_path)["walk"]
    result = {
        "version": "1.2",
        "commit": "abc",
        "date": "2026-01-02",
        "machine": "some machine.",
        "command": stage.command,
        "seeds": [1, 2, 3],
        "inputs": results.inputs_sha256(stage, tmp_path),
        "figures": {"docs/figure.png": figure},
        "tables": [
            {"title": "Walk", "caption": "so", "head": ["case", "error"], "rows": [["door", "0.1"]]}
        ],
    }
    (tmp_path / "results" / "walk.json").write_text(json.dumps(result))
    monkeypatch.setattr(results, "ROOT", tmp_path)
    document = tmp_path / "docs" / "walk.md"
    document.write_text(
        "Text.\n\n![a picture](figure.png)\n\n<!-- results: walk -->\n<!-- /results -->\n"
    )
    results.write_tables(tmp_path)
    return tmp_path


def edit(path, old, new):
    """Replace a text that is there."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_a_table_is_written_with_its_commit_seeds_and_machine(root):
    text = (root / "docs" / "walk.md").read_text()
    assert f"**Walk.** So.\n\n{TABLE.format('0.1')}" in text
    assert "Commit abc of version 1.2, 2026-01-02, seeds 1 to 3: some machine." in text
    assert list(problems(root)) == list(stale(root)) == []


def test_a_table_that_was_edited_by_hand_is_found(root):
    edit(root / "docs" / "walk.md", "| door | 0.1 |", "| door | 0.01 |")
    (found,) = problems(root)
    assert found.startswith("docs/walk.md: a table differs from its result file")


def test_the_link_to_a_table_without_a_title_has_the_name_of_its_stage(root):
    edit(root / "results" / "walk.json", '"title": "Walk"', '"title": ""')
    document = root / "docs" / "walk.md"
    document.write_text("<!-- csv: walk -->\n<!-- /csv -->\n")
    results.write_tables(root)
    assert "- [walk](tables/walk.csv), 1 rows. So.\n" in document.read_text()


def test_a_page_links_to_a_table_in_csv_and_an_edited_or_unknown_file_is_found(root):
    document = root / "docs" / "walk.md"
    document.write_text("Text.\n\n<!-- csv: walk Walk -->\n<!-- /csv -->\n")
    file = root / "docs" / "tables" / "walk-walk.csv"
    assert len(list(problems(root))) == 2  # neither the link nor the file
    results.write_tables(root)
    assert "- [Walk](tables/walk-walk.csv), 1 rows. So.\n\nCommit abc" in document.read_text()
    assert file.read_text() == "case,error\ndoor,0.1\n"
    assert list(problems(root)) == []
    edit(file, "0.1", "0.01")
    (file.parent / "other.csv").touch()
    assert [found.partition(":")[0] for found in problems(root)] == [
        "docs/tables/other.csv",
        "docs/tables/walk-walk.csv",
    ]
    results.write_tables(root)
    assert [one.name for one in file.parent.iterdir()] == ["walk-walk.csv"]


@pytest.mark.parametrize("reason", ["", "<!-- by hand: -->\n"])
def test_a_table_of_no_result_needs_a_reason(reason, root):
    (root / "README.md").write_text(f"Text.\n\n{reason}{TABLE.format(1)}")
    (found,) = problems(root)
    assert found.startswith(f"README.md:{4 if reason else 3}: this table needs")
    (root / "README.md").write_text(f"Text.\n\n<!-- by hand: literature -->\n{TABLE.format(1)}")
    assert list(problems(root)) == []


def test_a_table_that_the_graph_makes_or_that_is_an_example_needs_no_reason(root):
    table = TABLE.format(1)
    (root / "README.md").write_text(
        f"<!-- graph: keys -->\n{table}<!-- /graph -->\n```\n{table}```\n"
    )
    assert list(problems(root)) == []


def test_a_table_whose_stage_has_no_result_yet_stays_and_needs_a_reason(root):
    (root / "results" / "walk.json").unlink()
    results.write_tables(root)
    assert TABLE.format("0.1") in (root / "docs" / "walk.md").read_text()
    table, picture = sorted(problems(root), reverse=True)
    assert "this table needs" in table or "this table needs" in picture
    assert list(stale(root)) == ["walk: has no result yet"]


def test_a_figure_that_is_not_of_its_result_is_found(root):
    (root / "docs" / "figure.png").write_bytes(b"other")
    assert list(problems(root)) == [
        "docs/walk.md:3: figure.png is not the figure of its result file"
    ]


def test_a_stage_without_a_place_and_a_place_without_a_stage_are_found(root):
    edit(root / "docs" / "walk.md", "results: walk", "results: run")
    assert list(problems(root))[-2:] == [
        "stage run is not in results/stages.toml",
        "stage walk is shown nowhere",
    ]


def test_a_result_is_stale_once_code_that_its_project_needs_has_changed(root):
    (root / CODE / "code.py").write_text("2")
    assert list(stale(root)) == ["walk: inputs have changed since commit abc"]
    check = partial(CliRunner().invoke, app)
    assert check(["bench", "check"]).exit_code == 0
    assert check(["bench", "check", "--release"]).exit_code == 1


def test_words_about_code_make_no_result_stale(root):
    stage, code = results.stages(root)["walk"], root / CODE / "code.py"
    code.write_text('def a():\n    return "x # y"\n')
    before = results.inputs_sha256(stage, root)
    code.write_text('"""A module."""\n\ndef a():\n    """Say."""\n    return "x # y"  # so\n')
    assert results.inputs_sha256(stage, root) == before
    code.write_text('def a():\n    return "x # z"\n')
    assert results.inputs_sha256(stage, root) != before


@pytest.mark.parametrize("name", ["norm.csv", "walk.npz", "deep/episode.yaml"])
def test_changed_data_make_a_result_stale(name, root):
    file = root / CODE / name
    file.parent.mkdir(exist_ok=True)
    file.write_text("1")
    assert list(stale(root)) == ["walk: inputs have changed since commit abc"]


def test_only_stages_that_are_not_up_to_date_run(root, monkeypatch):
    ran, said = [], []
    monkeypatch.setattr(results, "_run", lambda _, name, *__: ran.append(name))
    results.run(root, (), {}, said.append)
    assert ran == []
    (root / CODE / "code.py").write_text("2")
    results.run(root, ["walk"], {}, said.append)
    assert ran == ["walk"]
    assert said == ["walk: up to date", "walk: mecazen experiment run walk"]
    with pytest.raises(ResultsError, match="fast: no such stage; there are walk"):
        results.run(root, ["fast"], {}, said.append)


def test_a_stage_whose_command_needs_a_variable_is_named_and_others_go_on(root, monkeypatch):
    edit(root / "results" / "stages.toml", "run walk", "run walk --walks $NOWHERE")
    said = []
    with pytest.raises(ResultsError, match="no result of walk"):
        results.run(root, (), {}, said.append)
    assert said[-1] == "walk: needs NOWHERE in the environment"


def test_a_stage_leaves_its_result_without_single_runs_and_its_figures(root, monkeypatch):
    def run(seed):
        return {"record": {"key": {"seed": seed}}}

    rows = [{"name": "a", "runs": [run(2), run(1)]}, {"name": "b", "runs": [run(2)]}]

    def call(command, **_):
        if command[0] != "git":
            calls.append(command)
            json_file, folder = (command[command.index(o) + 1] for o in ("--json", "--figures"))
            Path(json_file).write_text(json.dumps({"rows": rows, "tables": []}))
            Path(folder, "figure.png").write_bytes(b"new")
        return SimpleNamespace(returncode=0, stdout="abc" if "rev-parse" in command else "")

    calls = []
    monkeypatch.setattr(results.subprocess, "run", call)
    edit(root / "results" / "stages.toml", "run walk", "run walk --walks $WALKS")
    with (root / "results" / "stages.toml").open("a") as file:
        file.write('figures = ["docs/figure.png"]')
    edit(root / "docs" / "walk.md", "<!-- results: walk -->", "<!-- results: walk Walk -->")
    monkeypatch.setenv("WALKS", "some folder")
    with pytest.raises(ResultsError, match="walk: no table 'Walk'"):
        results.run(root, (), {"--scheduler": "tcp://host"}, print)
    assert calls[0][3:8] == ["experiment", "run", "walk", "--walks", "some folder"]
    assert calls[0][8:10] == ["--scheduler", "tcp://host"]
    found = json.loads((root / "results" / "walk.json").read_text())
    assert found["rows"] == [{"name": "a"}, {"name": "b"}]
    assert (found["commit"], found["seeds"]) == ("abc", [1, 2])
    assert found["command"] == "experiment run walk --walks $WALKS"
    assert (root / "docs" / "figure.png").read_bytes() == b"new"
    assert list(stale(root)) == []


def test_every_table_of_our_documents_is_what_its_origin_says():
    assert list(problems(results.ROOT)) == []  # `make results`, or `mecazen bench tables`
