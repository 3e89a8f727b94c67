"""Processes for runs that do not depend on each other."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context, resource_tracker

CORES = len(os.sched_getaffinity(0))


@contextmanager
def processes(count: int) -> Iterator[Executor]:
    """Yield an executor of processes that ignore Ctrl-C; leaving it by an error kills them.

    A terminal sends Ctrl-C to all processes, and this process reports it.
    """
    # Python's cleanup process starts with the first worker, and its start would unblock Ctrl-C
    resource_tracker.ensure_running()
    earlier = {*active_children()}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        pool = ProcessPoolExecutor(count, get_context("spawn"))
        for _ in range(count):
            pool.submit(os.getpid)  # starts a process, which inherits the blocked signal
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    try:
        yield pool
    except BaseException:
        for process in {*active_children()} - earlier:
            process.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
