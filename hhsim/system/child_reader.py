"""Reading of foreign data in a child process with limits of time and memory, so that no reader takes hhsim with it.

A library that reads a stranger's file can spin for ever, crash, or ask for all memory. The child is a fork, which has
the library already, so that it takes milliseconds; its answer is what it has read, or the reason why it refused.
"""

import pickle
import signal
from collections.abc import Callable
from typing import TypeVar

from hhsim.errors import DamagedFileError, HhsimError
from hhsim.system.posix import call_in_child, memory_file

SECONDS, BYTES_PER_SECOND = 10.0, 1e6
"""Processor time for reading a file: so many seconds, and one more for so many bytes."""
PATIENCE = 10.0
"""Ratio of wall-clock limit to processor time: at a third of that a sound mesh was called damaged on a busy machine."""
MEMORY, MEMORY_PER_BYTE = 4 << 30, 16
"""Address space that reading a file may add to the process [byte]: so much, and so many more for each byte."""

Read = TypeVar("Read")
_in_a_child = False


def read_in_child(
    read: Callable[[], Read],
    refusal: str,
    size: int = 0,
    *,
    seconds: float = SECONDS,
    rate: float = BYTES_PER_SECOND,
    patience: float = PATIENCE,
) -> Read:
    """Call a reader in a child process, and return what it returns, which has to be of kinds that pickle can hold.

    Args:
        read: Imports what takes long before: what it loads itself is lost with the child.
        refusal: Beginning of the message for a file that cannot be read, such as "a damaged mesh".
        size: Number of bytes that it reads, unpacked, which its limits grow with.
        seconds: Limit of processor time for a small file [s].
        rate: Rate of the additional time for a larger one [byte/s].
        patience: Ratio of the wall-clock limit to that time.

    Raises:
        HhsimError, BlockingIOError: As `read`.
        DamagedFileError: It raised anything else, broke down, or reached a limit.
    """
    if _in_a_child:
        return read()
    limit = int(seconds + size / rate) + 1
    memory = MEMORY + MEMORY_PER_BYTE * size

    def answer(kind: type[Exception] | None, value: object) -> None:
        out.seek(0)
        pickle.dump((kind, value), out, protocol=5)
        out.flush()

    def work() -> None:
        global _in_a_child
        _in_a_child = True
        try:
            answer(None, read())
        except (HhsimError, BlockingIOError) as error:
            answer(type(error), str(error))
        except MemoryError:
            answer(DamagedFileError, f"{refusal}: reading it takes more than {memory / 2**30:.3g} GB of memory")
        except Exception as error:
            # Whatever the library raises over wrong bytes: it has no list of them.
            told = " ".join(str(error).split()) or type(error).__name__
            answer(DamagedFileError, f"{refusal}: {told[:200]}")
        finally:
            _in_a_child = False

    with memory_file() as out:
        code = call_in_child(work, limit, patience * limit, memory)
        if code:
            timed_out = -code in (signal.SIGXCPU, signal.SIGALRM)
            why = f"reading it does not end within {limit} s" if timed_out else "its reader breaks down"
            raise DamagedFileError(f"{refusal}: {why}")
        out.seek(0)
        kind, value = pickle.load(out)
    if kind is not None:
        # Some kinds make their message of several arguments: this one is made already.
        raise kind.__new__(kind, value)
    found: Read = value
    return found
