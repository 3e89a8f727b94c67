"""Health and tracking as text, and when it is logged."""

from harness import load_robot
from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.geometry import Pose2D
from mecazen_viewer import entities as e
from mecazen_viewer.health import Health
from mecazen_viewer.picture import Picture
from viewer.pictures import following, physics_says, picture


def test_tracking_and_health_are_logged_when_they_change():
    shown = picture()
    lines = []
    for entities in (
        shown.on_follower_state(m.FollowerState(tracking="waiting"), 0),
        shown.on_follower_state(m.FollowerState(tracking="waiting"), 0),
        shown.on_follower_state(following(Pose2D(), Pose2D(), "coasting"), 0),
        shown.on_diagnostics(physics_says("1.0"), 0, "physics"),
        shown.on_diagnostics(physics_says("1.1"), 0, "physics"),
        shown.on_diagnostics(physics_says("1.2", 1, "refused payloads"), 0, "physics"),
    ):
        for path, archetype in entities:
            if path.startswith(f"{e.LOG}/"):
                (text,) = archetype.text.as_arrow_array().to_pylist()
                (level,) = archetype.level.as_arrow_array().to_pylist()
                lines.append(f"{level} {text}")
    assert lines == [
        "INFO tracking: waiting",
        "WARN tracking: coasting",
        "INFO physics: ok",
        "WARN physics: refused payloads",
    ]


def test_the_end_of_a_walk_is_logged_once():
    shown = picture()
    ended = m.KeyValue(key="walk_ended", value="True")
    walking, standing = (
        m.DiagnosticArray(status=(m.DiagnosticStatus(name="target", message="ok", values=values),))
        for values in ((), (ended,))
    )
    logged = [
        entity.text.as_arrow_array()[0].as_py()
        for report in (walking, walking, standing, standing)
        for path, entity in shown.on_diagnostics(report, 0, "target")
        if path != e.HEALTH
    ]
    assert logged == ["target: ok", "target: the walk has ended"]


def test_of_several_robots_health_and_tracking_are_told_with_their_names():
    health, scenario = Health(), Scenario(robot=load_robot())
    pictures = [Picture(scenario, health, robot) for robot in ("", "one", "two")]
    report = m.DiagnosticArray(status=(m.DiagnosticStatus(name="follower", message="ok"),))
    lines = []
    for shown in pictures[1:]:
        tracking = shown.on_follower_state(m.FollowerState(tracking="lost"), 0)
        said = [*tracking, *shown.on_diagnostics(report, 0, "follower")]
        lines += [text.text.as_arrow_array()[0].as_py() for path, text in said if path != e.HEALTH]
    assert lines == [
        f"{robot}/{line}" for robot in ("one", "two") for line in ("tracking: lost", "follower: ok")
    ]
    shown = dict(pictures[0].on_diagnostics(physics_says("1.0"), 0, "physics"))[e.HEALTH]
    (text,) = shown.text.as_arrow_array().to_pylist()
    names = [paragraph.split()[0] for paragraph in text.split("\n\n")]
    assert names == ["**one/follower**", "**physics**", "**two/follower**"]


def test_health_is_the_newest_of_the_newest_of_every_service_in_four_digits():
    shown = picture()
    list(shown.on_diagnostics(physics_says("0.123456"), 0, "physics"))
    text_shown = dict(shown.on_diagnostics(physics_says("0.987654"), 0, "physics"))[e.HEALTH]
    (text,) = text_shown.text.as_arrow_array().to_pylist()
    assert "**physics** ok: rtf 0.9877" in text
    assert "0.1235" not in text


def test_what_a_stranger_says_is_text_in_the_table_and_counts_under_the_name_of_its_key():
    value = m.KeyValue(key="[x](http://y)", value="a | <b> \x1b[2J\n| physics | ok |")
    status = m.DiagnosticStatus(level=1, name="physics", message="\x1b]0;", values=(value,))
    drawn = list(picture().on_diagnostics(m.DiagnosticArray(status=(status,)), 0, "viewer"))
    (path, line), (_, table) = drawn
    assert path == f"{e.LOG}/viewer"
    assert line.text.as_arrow_array().to_pylist() == ["viewer: \\u001b]0;"]
    text = table.text.as_arrow_array()[0].as_py()
    shown = r"\[x\]\(http://y\) a \| \<b\> \\u001b\[2J\\n\| physics \| ok \|"
    assert text == f"**viewer** warning: {shown}"
