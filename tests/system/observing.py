"""An observer in a process of its own that is slow."""

import multiprocessing
import threading
import time
from contextlib import contextmanager

import zenoh
from harness import COMMAND_GUARD_S
from mecazen.bus.session import open_session

SAMPLE_S = 0.05


def hear_slowly(config, mode, heard, hears) -> None:
    """Take 50 ms for each sample on Zenoh's own thread, as a client that knows no better."""

    def take(_: zenoh.Sample) -> None:
        time.sleep(SAMPLE_S)
        heard.value += 1

    with open_session(config, mode, "viewer") as session:
        session.declare_subscriber("**", zenoh.handlers.Callback(take, indirect=False))
        hears.set()
        threading.Event().wait()


@contextmanager
def slow_observer(config, mode):
    """Observe slowly, from another process; yield the number of samples that it has taken."""
    context = multiprocessing.get_context("spawn")
    heard, hears = context.Value("q", 0), context.Event()
    process = context.Process(target=hear_slowly, args=(config, mode, heard, hears), daemon=True)
    process.start()
    assert hears.wait(COMMAND_GUARD_S)
    try:
        yield heard
    finally:
        process.kill()
        process.join()
