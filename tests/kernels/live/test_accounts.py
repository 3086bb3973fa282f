"""What compiled code reads of the system is what Python reads, and its causes are those of the file."""

from collections.abc import Callable

import numpy as np

from hhsim.kernels.live.deadlines import COMPUTED, DEVICE, HOST, WOKEN_LATE, read_run_delay, read_steal
from hhsim.live.session.loop import system_files
from hhsim.result.miss_cause import CAUSES
from hhsim.system.cpu_accounts import CpuAccounts


def test_compiled_code_reads_the_accounts_that_python_reads() -> None:
    accounts = CpuAccounts()
    files = system_files(accounts, [-1, -1])
    schedule, stat, *_ = map(int, files.descriptors)
    pairs: list[tuple[Callable[[], int], Callable[[], int]]] = [
        (lambda: read_run_delay(schedule, files.line), accounts.run_delay_ns),
        (lambda: read_steal(stat, files.lines, files.allowed, int(files.step[0])), accounts.steal_ns),
    ]
    for read, own in pairs:
        before, found, after = own(), read(), own()
        assert before <= found <= after
    accounts.close()
    nothing = np.zeros(3, np.uint8)
    assert read_run_delay(-1, nothing) == read_steal(-1, nothing, files.allowed, 1) == -1


def test_the_causes_are_those_of_the_file() -> None:
    assert (COMPUTED, WOKEN_LATE, HOST, DEVICE) == CAUSES
