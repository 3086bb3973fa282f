"""Engines that run tasks: processes of this machine, or a Dask cluster (one that runs already, or a local one).

Tasks write in a folder, which is locked against a second run.
"""

import contextlib
import json
import os
import signal
import threading
import uuid
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass
from multiprocessing import connection, get_context, parent_process
from pathlib import Path
from typing import Any

from hhsim.errors import HhsimError, InputError, OutputError
from hhsim.sweep.input_files import source_digest
from hhsim.system import posix
from hhsim.system.atomic_write import write_atomically
from hhsim.system.output_path import holds
from hhsim.system.progress import Progress

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that keep the threads of numpy's linear algebra off the cores of other tasks."""
CRASHED = "its process ended by itself: a crash, or killed for want of memory"
LOCAL = "local"
"""Word for a cluster of this machine, in the place of a scheduler's address."""
ONE_AT_A_TIME = threading.Lock()
"""Lock of the process: the threads of a cluster's worker must not disturb each other's times."""
LOCK = ".lock"
PATIENCE = 10
"""Longest wait for a scheduler [s]."""


@dataclass(frozen=True)
class TaskEnd:
    """Outcome of a task."""

    digest: str
    reason: str = ""  # reason of its failure; "" if what it makes is written
    ticks: int = 0  # number of ticks in all its runs


@dataclass(frozen=True, kw_only=True)
class Task:
    """Work of which a worker gets a copy; it writes in a folder which every process that runs such tasks sees."""

    digest: str  # tells it from the others
    folder: str  # absolute
    sources: str  # digest of the hhsim that planned it

    def run(self) -> TaskEnd:
        """Do the work, unless the process has another hhsim or does not see the folder; any error is an end."""
        if source_digest() != self.sources:
            return TaskEnd(self.digest, "the hhsim of this worker is another one: install the same there")
        if not Path(self.folder).is_dir():
            return TaskEnd(self.digest, f"the worker sees no folder {self.folder}: all workers need to share one")
        try:
            with ONE_AT_A_TIME:
                return self.work()
        except Exception as error:
            # A method from outside may raise anything; the other tasks go on.
            return TaskEnd(self.digest, error_line(error))

    def work(self) -> TaskEnd:
        """Do the work and write what it makes."""
        raise NotImplementedError


class TaskFolder:
    """Folder that tasks write in, of a `what` such as a sweep; it may not exist yet.

    A JSON file, `mark`, of a format tells it from others. Raises OutputError where another file or folder is.
    """

    def __init__(self, path: Path, what: str, mark: str, form: str) -> None:
        self.path, self.what, self.mark, self.form = path, what, path / mark, form
        if path.exists() and not path.is_dir():
            raise OutputError(f"{path} is a file, not a folder: name another with --out")
        is_own = self.mark.is_file() and holds(f'"format": "{form}"'.encode())(self.mark)
        if path.is_dir() and any(path.iterdir()) and not is_own:
            raise OutputError(f"{path} holds other files, and no {what}: name a new folder with --out")

    @contextlib.contextmanager
    def locked(self, inner: str = "", **content: Any) -> Iterator[None]:
        """Make the folder, and `inner` in it, lock it, and write the `content` of its mark.

        Raises OutputError if it is not writable, or another one works in it.
        """
        try:
            (self.path / inner).mkdir(parents=True, exist_ok=True)
            lock = os.open(self.path / LOCK, posix.CREATE_FLAGS, 0o644)
        except OSError as error:
            raise OutputError(f"cannot write in {self.path}: {error.strerror or error}") from error
        try:
            try:
                posix.lock(lock)
            except BlockingIOError:
                why = f"another {self.what} works in {self.path}: wait for it, or name another folder"
                raise OutputError(why) from None
            except OSError:
                # A file system without locks: two runs do each other's work twice, and no harm.
                pass
            write_atomically(self.mark, f"{json.dumps({'format': self.form, **content}, indent=1)}\n".encode())
            yield
        finally:
            os.close(lock)


def error_line(error: Exception) -> str:
    """Return an error in one line, with its type if it is none of hhsim's or the system's."""
    text = " ".join(str(error).split())
    kind = "" if isinstance(error, HhsimError | OSError) and text else type(error).__name__
    return ": ".join(part for part in (kind, text) if part)


def run_to_end(
    tasks: Sequence[Task],
    stage: str,
    on_end: Callable[[TaskEnd], None],
    progress: Progress,
    *,
    scheduler: str = "",
    jobs: int,
    done: int = 0,
) -> None:
    """Run tasks in `jobs` processes, or on a cluster if a scheduler is given.

    `on_end` is called at each end. `done` tasks were done before. A note on an interrupt says how many are done.
    """
    total = done + len(tasks)
    progress(stage, done, total)
    try:
        ends = run_on_dask(tasks, scheduler, jobs) if scheduler else run_in_processes(tasks, jobs)
        with closing(ends):
            for end in ends:
                on_end(end)
                done += 1
                progress(stage, done, total)
    except KeyboardInterrupt as interrupt:
        interrupt.add_note(f"{done:,} of {total:,} {stage} are done, and the same command goes on")
        raise


def run_in_processes(tasks: Sequence[Task], jobs: int) -> Generator[TaskEnd, None, None]:
    """Run tasks, `jobs` at a time; they end in any order. The end of this generator ends its processes."""
    waiting = deque(tasks)
    running: dict[Future[TaskEnd], tuple[_Worker, Task]] = {}
    workers: list[_Worker] = []

    def begin(worker: "_Worker") -> None:
        if waiting:
            task = waiting.popleft()
            running[worker.pool.submit(task.run)] = worker, task

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
                        end = TaskEnd(task.digest, CRASHED)
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
    """Process that runs one task after the other."""

    def __init__(self) -> None:
        # Spawned, not forked: a fork of a process with threads copies locks that nobody will release.
        self.pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_begin)
        self.process = self.pool.submit(os.getpid)

    def stop(self) -> None:
        """End it now, also within a task."""
        self.pool.shutdown(wait=False, cancel_futures=True)
        if self.process.done() and not self.process.cancelled() and self.process.exception() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.process.result(), signal.SIGTERM)
        self.pool.shutdown()


def _begin() -> None:
    """Start a worker, which ignores Ctrl-C and ends with its parent."""
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
    before = {name: os.environ[name] for name in ONE_THREAD if name in os.environ}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name in ONE_THREAD:
            os.environ.pop(name, None)
        os.environ.update(before)


def require_dask() -> None:
    """Raise InputError if Dask is not installed."""
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise InputError(
            "--scheduler needs Dask, which is not installed: pip install 'hhsim[sweep]'; without it, --jobs N runs "
            "them in processes of this machine"
        ) from None


def run_on_dask(tasks: Sequence[Task], scheduler: str, jobs: int) -> Generator[TaskEnd, None, None]:
    """Run tasks on a scheduler, such as tcp://10.0.0.1:8786, or `LOCAL` with `jobs` processes; they end in any order.

    Raises InputError without Dask, or a scheduler at that address.
    """
    require_dask()
    from distributed import Client

    how: dict[str, Any] = {"address": scheduler, "timeout": PATIENCE}
    if scheduler == LOCAL:
        # A client without an address starts a cluster of its own, and ends it.
        how = {"n_workers": jobs, "threads_per_worker": 1, "dashboard_address": None}
    try:
        client = Client(**how)
    except (OSError, ValueError, TypeError) as error:
        why = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"no Dask scheduler at {scheduler}: {why}; dask scheduler starts one") from None
    with client:
        yield from run_with_client(client, tasks)


def run_with_client(client: Any, tasks: Sequence[Task]) -> Generator[TaskEnd, None, None]:
    """Run tasks by a client of any cluster."""
    from distributed import as_completed

    # A name of its own for each attempt: one that failed before would be answered from memory.
    attempt = uuid.uuid4().hex[:8]
    futures = {client.submit(task.run, key=f"hhsim-{task.digest}-{attempt}", pure=False): task for task in tasks}
    try:
        for future in as_completed(list(futures)):
            error = future.exception()
            if error is None:
                yield future.result()
            else:
                why = " ".join(str(error).split())
                yield TaskEnd(futures[future].digest, f"its worker was lost: {type(error).__name__}: {why}")
            # The scheduler keeps every answer until its future is released.
            del futures[future]
            future.release()
    finally:
        for future in futures:
            future.cancel()
