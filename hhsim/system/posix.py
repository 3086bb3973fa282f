"""Calls that Linux alone has, and what stands in for them on other POSIX systems; processes, files, output.

A live session and `hhsim doctor` need Linux and call it themselves. So does the cache folder of the kernels, which
import nothing else of hhsim. All other code asks here.
"""

import contextlib
import faulthandler
import fcntl
import gc
import os
import resource
import signal
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, cast

READ_FLAGS = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC
"""Flags to open a file that may turn out to be a pipe, which must not block."""
CREATE_FLAGS = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC
"""Flags to open a file for a lock."""


def own_processors() -> list[int]:
    """Return the processors that this process may use; all of the machine where the system does not tell."""
    if sys.platform == "linux":
        return sorted(os.sched_getaffinity(os.getpid()))
    return list(range(os.cpu_count() or 1))


def pin(processor: int) -> None:
    """Pin the calling thread to a processor; without effect but on Linux."""
    if sys.platform == "linux":
        os.sched_setaffinity(0, {processor})


def lock(descriptor: int) -> None:
    """Lock a file until its descriptor is closed; BlockingIOError if another process has it, OSError without locks."""
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def allocate(path: Path, end: int, size: int) -> None:
    """Allocate `size` bytes behind the end of a file; a full disk is an OSError. Without effect but on Linux."""
    if sys.platform == "linux":
        descriptor = os.open(path, os.O_RDWR)
        try:
            os.posix_fallocate(descriptor, end, size)
        finally:
            os.close(descriptor)


def used_memory() -> tuple[float, float]:
    """Return this process's resident memory and the most that it has been [byte]."""
    with contextlib.suppress(OSError):
        # The system's own counters: `getrusage` counts the memory of the parent process too.
        lines = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text("ascii").splitlines())
        return 1024.0 * float(lines["VmRSS"].split()[0]), 1024.0 * float(lines["VmHWM"].split()[0])
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1.0 if sys.platform == "darwin" else 1024.0)
    return most, most


def thread_clock() -> int:
    """Return the number of the calling thread's CPU clock, for any thread to read; that of the reader elsewhere."""
    if sys.platform == "linux":
        return time.pthread_getcpuclockid(threading.get_ident())
    return time.CLOCK_THREAD_CPUTIME_ID


def memory_file() -> BinaryIO:
    """Open an empty file that a forked child shares, in memory where the system can."""
    if sys.platform == "linux":
        return os.fdopen(os.memfd_create("hhsim"), "w+b")
    return cast(BinaryIO, tempfile.TemporaryFile())


def call_in_child(work: Callable[[], None], seconds: int, patience: float, memory: int) -> int:
    """Call a function, which leaves its answer in a `memory_file`, in a forked child with limits; return its exit code.

    The limits are processor time and wall-clock time, both [s], which end it by SIGXCPU and SIGALRM, and the address
    space that it may take besides what it has [byte], on Linux alone.
    """
    with warnings.catch_warnings():
        # Python warns of threads, whose locks a child may find held: `work` takes none of them.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        _be_the_child(work, seconds, patience, memory)
    try:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    except BaseException:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        raise


def _be_the_child(work: Callable[[], None], seconds: int, patience: float, memory: int) -> None:
    """Call the function, and exit with 0 if it returns; the output of libraries is discarded."""

    def limit(what: int, value: int) -> None:
        most = resource.getrlimit(what)[1]
        resource.setrlimit(what, (value if most == resource.RLIM_INFINITY else min(value, most), most))

    code = 1
    try:
        # Finalisers of the parent's garbage would remove its folders and close its files.
        gc.disable()
        faulthandler.disable()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGXCPU, signal.SIGALRM):
            signal.signal(number, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
        signal.setitimer(signal.ITIMER_REAL, patience)
        limit(resource.RLIMIT_CORE, 0)
        limit(resource.RLIMIT_CPU, seconds)
        if sys.platform == "linux":
            pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
            limit(resource.RLIMIT_AS, pages * resource.getpagesize() + memory)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        work()
        code = 0
    finally:
        os._exit(code)
