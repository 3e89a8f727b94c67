"""Parts of the commands, each by itself; whole command lines: tests/system/test_cli.py."""

import resource
import signal
import subprocess
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import msgspec
from harness import command
from mecazen_tools.cli import app, sim, talk
from typer.testing import CliRunner


def test_the_clock_receives_what_a_command_asks(monkeypatch):
    requests = []

    def call(call, request, *_):
        requests.append((call.key, request))
        return request

    monkeypatch.setattr(sim, "tool_bus", lambda _: nullcontext(SimpleNamespace(call=call)))
    for line in ("sim step 3", "sim reset", "sim reset --seed 7", "sim speed 2", "sim pause"):
        assert CliRunner().invoke(app.app, line.split()).exit_code == 0
    assert [(key, msgspec.to_builtins(request)) for key, request in requests] == [
        ("sim/step", {"ticks": 3}),
        ("sim/reset", {"seed": None}),
        ("sim/reset", {"seed": 7}),
        ("sim/speed", {"speed": 2.0}),
        ("sim/pause", {}),
    ]


def test_samples_are_written_and_read_as_json(monkeypatch):
    samples, handlers = [], []

    def spin_once(timeout_s=None):
        for handler in handlers:
            handler("my/key", b"[1, 2]", "", None)
            handler("odom", b"{", "application/json", None)
        return True

    bus = SimpleNamespace(
        put_bytes=lambda *sample: samples.append(sample),
        subscribe_bytes=lambda _, handler: handlers.append(handler),
        spin_once=spin_once,
    )
    monkeypatch.setattr(talk, "tool_bus", lambda _: nullcontext(bus))
    drive = 'pub cmd_vel {"linear":{"x":0.5}} --rate 1000 --duration 0.003'
    published = CliRunner().invoke(app.app, drive.split())
    assert samples == [("cmd_vel", b'{"linear":{"x":0.5}}', "application/json")] * 3
    assert not published.stderr
    shown = CliRunner().invoke(app.app, ["echo", "my/key", "--count", "1"])
    assert shown.stdout == "[1,2]\n"
    unknown, broken = shown.stderr.splitlines()
    assert unknown == "warning: my/key: not among `mecazen topics`"
    assert broken.startswith("odom: 1 bytes that are no message: ")


def test_a_full_disk_is_one_line(tmp_path):
    def run(target, *arguments):
        """Run a command whose output may have 2000 bytes."""

        def limit():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))

        with Path(target).open("wb") as output:
            pipes = {"stdout": output, "stderr": subprocess.PIPE}
            # Python would truncate its caches of modules as well
            starts = command(arguments, PYTHONDONTWRITEBYTECODE="1")
            done = subprocess.run(**starts, **pipes, check=False, preexec_fn=limit)
        return done.returncode, done.stderr

    begin = "error: the output is incomplete: "
    assert run("/dev/full", "topics") == (1, f"{begin}No space left on device\n")
    assert run(tmp_path / "back.toml", "config", "back") == (1, f"{begin}File too large\n")
