"""Processes that are forked from one parent."""

import os
import socket
import subprocess
import sys

import msgspec
from mecazen.config import Process
from mecazen.runtime.report import Report
from mecazen_tools.forking import Start


def test_a_parent_with_another_thread_does_not_fork():
    threaded = (
        "import threading\n"
        "from mecazen_tools import forking\n"
        "threading.Thread(target=threading.Event().wait, daemon=True).start()\n"
        "forking.serve(lambda: None)\n"
    )
    requests, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    _, report_end = pipe = os.pipe()
    request = Start(Process(("toy",)), (0,), os.SCHED_OTHER, 0)
    with requests, subprocess.Popen([sys.executable, "-c", threaded], stdin=theirs.fileno()):
        theirs.close()
        socket.send_fds(requests, [msgspec.json.encode(request)], [2, report_end])
        report = msgspec.json.decode(requests.recv(1000), type=Report)
        requests.close()
    for end in pipe:
        os.close(end)
    assert (report.kind, report.text) == ("failed", "a process of 2 threads can't be forked")


def test_a_parent_ends_without_a_traceback_if_its_client_left_an_answer_unread():
    requests, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    theirs.send(b"answer")
    command = [sys.executable, "-c", "from mecazen_tools import forking; forking.serve(None)"]
    requests.close()
    with theirs:
        ended = subprocess.run(command, stdin=theirs.fileno(), capture_output=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, b"")
