"""Films: of each row the first failure, else its first episode."""

from mecazen_experiments.cli import app
from PIL import Image
from typer.testing import CliRunner


def test_the_film_of_a_row_is_its_first_failure(tmp_path):
    # beside the target, their reference does not look where it turns
    arguments = ["followbench", "--follower", "social", "--only", "uTurn", "--jobs", "1"]
    arguments += ["--store", str(tmp_path / "s.sqlite"), "--films", str(tmp_path / "films")]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    films = sorted(file.name for file in (tmp_path / "films").iterdir())
    assert films == ["social-uTurn-back-0_people.gif", "social-uTurn-left_side-0_people.gif"]
    with Image.open(tmp_path / "films" / films[1]) as picture:
        assert picture.n_frames > 10
