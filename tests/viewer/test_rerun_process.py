"""Rerun as a child process: its end, and ports."""

import os
import select
import socket
import subprocess
import sys

import psutil
import pytest
from mecazen.config import ViewerConfig
from mecazen_viewer.layout import blueprint
from mecazen_viewer.rerun_process import RerunError
from mecazen_viewer.server import serving

ANYWHERE = ViewerConfig(web_port=0, data_port=0)
LAYOUT = blueprint(("",))


@pytest.mark.parametrize("key", ["web_port", "data_port"])
def test_a_taken_port_is_one_line_that_names_its_key(key):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        config = ViewerConfig(**{"web_port": 0, "data_port": 0, key: port})
        with pytest.raises(RerunError) as caught, serving(config, LAYOUT):
            pass
    assert str(caught.value).startswith(f"viewer.{key} = {port}: address already in use")
    assert "\n" not in str(caught.value)


def test_an_address_that_is_none_is_named():
    config = ViewerConfig(web_port=0, data_port=0, listen="nowhere")
    with pytest.raises(RerunError, match="invalid value 'nowhere'"), serving(config, LAYOUT):
        pass


def test_a_server_that_ends_is_an_error():
    with serving(ANYWHERE, LAYOUT) as server:
        server.check()
        (rerun,) = psutil.Process().children()
        rerun.kill()
        rerun.wait()
        with pytest.raises(RerunError, match="rerun has ended"):
            server.check()


def test_when_the_viewer_is_killed_the_server_ends_too():
    code = (
        "from mecazen_viewer.server import serving\n"
        "from mecazen.config import ViewerConfig\n"
        "from mecazen_viewer.layout import blueprint\n"
        "import psutil, sys\n"
        "with serving(ViewerConfig(web_port=0, data_port=0), blueprint([''])):\n"
        "    print(psutil.Process().children()[0].pid, flush=True)\n"
        "    sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as viewer:
        server = os.pidfd_open(int(viewer.stdout.readline()))
        viewer.kill()
        assert select.select([server], [], [], 60.0)[0]
        os.close(server)
