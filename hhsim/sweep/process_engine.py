"""Cells in processes of this machine: a pool of one process for each, so that a crash is known to be of its cell."""

import contextlib
import os
import signal
import threading
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection, get_context, parent_process

from hhsim.sweep.cell_run import CellEnd, CellTask, run_cell

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Read by the linear algebra that numpy brings: its threads would take the cores of other cells."""
CRASHED = "its process ended by itself: a crash, or killed for want of memory"


def run_in_processes(tasks: Sequence[CellTask], jobs: int) -> Generator[CellEnd, None, None]:
    """Run cells, `jobs` of them at a time; they end in any order.

    Whatever ends this generator ends its processes.
    """
    waiting = deque(tasks)
    running: dict[Future[CellEnd], tuple[_Worker, CellTask]] = {}
    workers: list[_Worker] = []

    def begin(worker: "_Worker") -> None:
        if waiting:
            task = waiting.popleft()
            running[worker.pool.submit(run_cell, task)] = worker, task

    with _one_thread():
        try:
            for _ in range(min(jobs, len(tasks))):
                workers.append(_Worker())
                begin(workers[-1])
            while running:
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    worker, task = running.pop(future)
                    try:
                        end = future.result()
                    except BrokenProcessPool:
                        end = CellEnd(task.digest, CRASHED)
                        worker.stop()
                        workers.remove(worker)
                        if waiting:
                            worker = _Worker()
                            workers.append(worker)
                    begin(worker)
                    yield end
        finally:
            for worker in workers:
                worker.stop()


class _Worker:
    """A process that runs one cell after the other."""

    def __init__(self) -> None:
        # Spawned, not forked: a fork of a process with threads copies locks that nobody will release.
        self.pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_begin)
        self.process = self.pool.submit(os.getpid)

    def stop(self) -> None:
        """End it now, in the middle of a cell too."""
        self.pool.shutdown(wait=False, cancel_futures=True)
        if self.process.done() and not self.process.cancelled() and self.process.exception() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.process.result(), signal.SIGTERM)
        self.pool.shutdown()


def _begin() -> None:
    """In a worker: Ctrl-C is for the parent, and when that is gone, however it went, there is nobody to work for."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
