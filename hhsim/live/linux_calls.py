"""The calls of Linux that Python has no name for."""

import ctypes
import errno
import os
import signal

CLOCK_MONOTONIC = 1
TIMER_ABSTIME = 1
MCL_CURRENT, MCL_FUTURE = 1, 2
PR_SET_PDEATHSIG, PR_SET_TIMERSLACK, PR_GET_TIMERSLACK = 1, 29, 30


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


_libc = ctypes.CDLL(None, use_errno=True)
_prctl = _libc.prctl
_prctl.argtypes = (ctypes.c_int, ctypes.c_ulong, ctypes.c_ulong, ctypes.c_ulong, ctypes.c_ulong)
_mlockall = _libc.mlockall
_mlockall.argtypes = (ctypes.c_int,)
_nanosleep = ctypes.CDLL(None).clock_nanosleep
_nanosleep.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.POINTER(_Timespec), ctypes.c_void_p)


class AbsoluteSleep:
    """Sleeps until a moment instead of for a time, so that what happens before the call is not added to it."""

    def __init__(self) -> None:
        """Allocate what every call uses."""
        self._time = _Timespec()
        self._pointer = ctypes.byref(self._time)

    def until(self, time_ns: int) -> None:
        """Sleep until CLOCK_MONOTONIC is `time_ns`, or until a signal has been handled.

        Raises:
            OSError: the system takes no such time.
        """
        self._time.seconds, self._time.nanoseconds = divmod(time_ns, 1_000_000_000)
        failure = _nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, self._pointer, None)
        if failure not in (0, errno.EINTR):
            raise OSError(failure, os.strerror(failure))


def lock_memory() -> None:
    """Keep every page that the process has, and will have, in memory.

    Raises:
        OSError: not allowed, or more than the limit of locked memory.
    """
    _check(_mlockall(MCL_CURRENT | MCL_FUTURE))


def set_timer_slack(slack_ns: int) -> None:
    """How late a wake-up of this thread may be made in order to put it together with others [ns].

    Raises:
        OSError: not allowed.
    """
    _check(_prctl(PR_SET_TIMERSLACK, slack_ns, 0, 0, 0))


def timer_slack() -> int:
    """What `set_timer_slack` sets [ns]."""
    return int(_check(_prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0)))


def end_with(parent: int, number: int = signal.SIGTERM) -> bool:
    """Be sent a signal when the parent ends, or rather the thread of it that started this process.

    Args:
        parent: its process id.
        number: the signal.

    Returns:
        False where it has ended already: no signal will come.

    Raises:
        OSError: not allowed.
    """
    _check(_prctl(PR_SET_PDEATHSIG, number, 0, 0, 0))
    return os.getppid() == parent


def _check(returned: int) -> int:
    if returned < 0:
        failure = ctypes.get_errno()
        raise OSError(failure, os.strerror(failure))
    return returned
