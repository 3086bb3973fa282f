"""Files that appear whole or not at all, and Ctrl-C that waits for them."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from hhsim.errors import OutputError
from hhsim.system.atomic_write import write_together
from hhsim.system.deferred_sigint import interruptible_between


def test_a_full_disk_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    path.write_bytes(b"old")
    script = """
import resource, sys
from pathlib import Path
from hhsim.errors import OutputError
from hhsim.system.atomic_write import sealed_hdf5, write_atomically, write_together
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
try:
    write_atomically(Path(sys.argv[1]), sealed_hdf5(lambda file: file.create_dataset("a", data=[0.0] * 9_000)))
except OutputError as error:
    print(error)
"""
    run = subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout.startswith(f"cannot write {path}: ")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_files_appear_together_or_not_at_all(tmp_path: Path) -> None:
    first, last = tmp_path / "first", tmp_path / "last"
    write_together({first: b"1", last: b"2"})
    with pytest.raises(OutputError, match=r"cannot write .*none/last"):
        write_together({first: b"3", tmp_path / "none" / "last": b"4"})
    assert (first.read_bytes(), last.read_bytes()) == (b"1", b"2")
    assert sorted(tmp_path.iterdir()) == [first, last]


def test_an_interrupt_waits_for_the_end_of_the_block() -> None:
    done = []
    with pytest.raises(KeyboardInterrupt), interruptible_between() as check:
        for block in range(3):
            if block == 1:
                signal.raise_signal(signal.SIGINT)
            done.append(block)
            check()
    assert done == [0, 1]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_second_interrupt_does_not_wait() -> None:
    done = False
    with pytest.raises(KeyboardInterrupt), interruptible_between():
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        done = True
    assert not done


def test_an_ignored_interrupt_stays_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interruptible_between() as check:
            signal.raise_signal(signal.SIGINT)
            check()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
