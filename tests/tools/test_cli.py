"""Parts of the commands, each by itself; whole command lines: tests/system/test_cli.py."""

import resource
import signal
import subprocess
import time
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest
import typer
from harness import command, error_of
from mecazen import keys
from mecazen.errors import ConfigError
from mecazen.geometry import Twist2D
from mecazen.messages import Parameter, Parameters, Twist
from mecazen_tools.cli import app, options, param, sim, talk, teleop
from mecazen_tools.driving import Hand
from mecazen_tools.strays import mistake
from mecazen_tools.trajectory import Scores
from rich.console import Console
from rich.text import Text


@pytest.mark.parametrize(
    ("argument", "told"),
    [
        ("fly", "No such command 'fly'; it needs pip install 'mecazen[wings]'"),
        ("pubs", "No such command 'pubs'; it needs pip install 'mecazen[studies]'"),
        ("sim", ""),  # which shows its help
        (
            "simulate back --seed -1",
            "Invalid value for '--seed': Input should be greater than or equal to 0",
        ),
        ("\udcff", "'\\udcff': not UTF-8, as all arguments must be"),
    ],
)
def test_what_is_wrong_with_a_command_line_is_one_line(argument, told, capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["mecazen", *argument.split()])
    monkeypatch.setattr(app, "EXTRAS", {"wings": {"fly": ""}, "studies": {"pubs": ""}})
    with pytest.raises(SystemExit) as ended:
        app.main()
    assert ended.value.code == 2
    assert capsys.readouterr().err.partition("; `")[0].rstrip() == (told and f"error: {told}")


def test_a_run_without_a_person_has_no_measures():
    assert app._measures(Scores(0.12345, 6.789)) == ("0.1235 m", "6.79°")
    assert app._measures(Scores(None, None)) == ("-", "-")


def test_a_table_is_as_wide_as_asked_where_there_is_no_terminal():
    assert options.console(123).width == 123


def test_a_namespace_that_is_no_key_is_one_line():
    def open_bus():
        with options.tool_bus(namespace="a//b"):
            pytest.fail("it opened")

    assert error_of(ConfigError, open_bus).startswith("--namespace a//b: ")


@pytest.fixture
def asked(monkeypatch):
    """Return the list of requests on a bus that answers with the request itself."""
    asked = []

    def call(call, request, *_):
        asked.append((call.key, request))
        return request

    for module in (param, sim):
        monkeypatch.setattr(module, "tool_bus", lambda *_: nullcontext(SimpleNamespace(call=call)))
    return asked


def test_parameters_are_set_in_pairs(asked, capsys):
    param.set_(["follower.standoff_m=1.5", "seed=-1"])
    ((key, request),) = asked
    wanted = Parameter(name="follower.standoff_m", value="1.5"), Parameter(name="seed", value="-1")
    assert (key, request) == ("sim/set_parameters", Parameters(parameters=wanted))
    assert capsys.readouterr().out.splitlines() == [
        "follower.standoff_m=1.5 from t = 0 s on",
        "seed=-1 from t = 0 s on",
    ]


def test_simulated_time_is_asked_for_what_the_command_says(asked):
    sim.step(3)
    sim.reset()
    sim.reset(7)
    told = [(key, msgspec.to_builtins(request)) for key, request in asked]
    assert [key for key, _ in told] == ["sim/step", "sim/reset", "sim/reset"]
    assert told[0][1]["ticks"] == 3
    assert told[2][1]["seed"] == 7
    said = error_of(ConfigError, lambda: sim.speed("fast"))
    assert said.startswith("sim/speed: ")


def test_a_key_of_the_table_holds_its_message_and_another_any_json():
    assert talk._read("cmd_vel", b'{"linear":{"x":0.5}}', "application/json") == Twist.planar(
        Twist2D(0.5)
    )
    assert talk._read("my/key", b"[1, 2]", "") == [1, 2]


def test_a_mistyped_key_is_told_of(capsys):
    for key in ("cmd_vle", "cmd_vel", "target/*"):
        talk._warn(mistake(key))
    (line,) = capsys.readouterr().err.splitlines()
    assert "cmd_vel" in line
    assert error_of(ConfigError, lambda: talk.pub("my/*", "{}")).startswith("my/*: an expression")


def test_a_message_that_every_service_would_refuse_is_not_published():
    told = error_of(ConfigError, lambda: talk.pub("cmd_vel", '{"linear":{"x":1e30}}'))
    assert told == "cmd_vel: linear velocity 1e+30 is out of range, at most 1e+06 m/s"


def commands(group, name="mecazen"):
    """Yield every command of a group with its whole name."""
    for part in (group, *getattr(group, "commands", {}).values()):
        if part is not group:
            yield from commands(part, f"{name} {part.name}")
    yield name, group


def test_the_help_of_every_command_shows_what_is_in_brackets():
    for name, one in commands(typer.main.get_command(app.app)):
        for part in one.params:
            text = getattr(part, "help", None) or ""
            shown = Text.from_markup(text).plain
            assert shown == text.replace(r"\[", "["), f"{name} {part.name}"


@pytest.mark.parametrize("width", [50, 80])
def test_in_narrow_terminals_keys_are_whole(width, monkeypatch, capsys):
    monkeypatch.setattr(talk, "console", lambda _: Console(width=width))
    for show in (talk.topics, talk.graph):
        show()
        shown = capsys.readouterr().out
        assert "…" not in shown
        assert max(map(len, shown.splitlines())) <= width
        assert len(shown.splitlines()) < 300  # else columns of some letters
        words = {word.rstrip("?,") for word in shown.replace("│", " ").split()}
        assert {one.key for one in (*keys.TOPICS[:-1], *keys.CALLS)} <= words
        assert "25 Hz" in shown
        assert "rate_hz" not in shown


FULL = "error: the output is incomplete: "


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_output_that_does_not_fit_on_the_disk_is_one_line(tmp_path, unbuffered):
    def run(target, *arguments):
        """Run a command whose output may have 2000 bytes."""

        def limit():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))

        told = command(arguments, PYTHONUNBUFFERED=unbuffered)
        with Path(target).open("wb") as output:
            pipes = {"stdout": output, "stderr": subprocess.PIPE}
            done = subprocess.run(**told, **pipes, check=False, preexec_fn=limit)
        return done.returncode, done.stderr

    assert run("/dev/full", "config", "back") == (1, f"{FULL}No space left on device\n")
    assert run("/dev/full", "topics") == (1, f"{FULL}No space left on device\n")
    assert run(tmp_path / "back.toml", "config", "back") == (1, f"{FULL}File too large\n")
    assert run(tmp_path / "version", "--version") == (0, "")


class Key(str):
    """A keystroke as blessed has it; it is empty if none came in time."""

    def __new__(cls, text="", *, key_name=None, released=False):
        key = super().__new__(cls, text)
        key.key_name, key.released, key.repeated = key_name, released, False
        return key


@pytest.mark.parametrize(
    ("code", "name"),
    [
        (("KEY_SHIFT_LEFT", ""), "left"),
        ((None, " "), "space"),
        ((None, "W"), "w"),
        ((None, "+"), "+"),
    ],
)
def test_a_key_has_one_name_in_either_protocol(code, name):
    assert teleop._name(Key(code[1], key_name=code[0])) == name


def test_who_is_driven_moves_while_a_key_is_held_until_q():
    sent, shown = [], []
    driven = SimpleNamespace(
        send=sent.append, update=lambda: None, moves=False, text=lambda: "x 1", note=lambda: ""
    )
    presses = [Key("w"), Key(), Key("w", released=True), Key(), Key("q")]

    def read(timeout_s):
        press = presses.pop(0)
        if not press:
            time.sleep(timeout_s)
        return press

    hand = Hand(0.3, 0.6, tells_release=True)
    teleop._drive(driven, hand, None, read, lambda group: shown.append(str(group.renderables[0])))
    assert sent == [Twist2D(0.3)]
    assert [line.partition(" m/s")[0] for line in shown] == [
        "vx +0.30 vy +0.00",
        "vx +0.00 vy +0.00",
    ]
