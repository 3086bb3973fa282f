"""Ctrl-C is noted in a block and raised between two; in a call of foreign code it is no error of that code."""

import os
import signal
import sys
import threading
from pathlib import Path

import pytest

from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.foreign_call import ForeignError, foreign_call


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


def test_other_threads_are_left_alone() -> None:
    seen = []

    def work() -> None:
        with interruptible_between() as check:
            check()
        seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]


def raise_interrupt() -> None:
    raise KeyboardInterrupt


def press_ctrl_c() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def test_ctrl_c_is_no_error_of_the_code_that_it_stops() -> None:
    with pytest.raises(KeyboardInterrupt):
        foreign_call(press_ctrl_c)
    # Nothing of it is left over.
    with pytest.raises(ForeignError, match="KeyboardInterrupt"):
        foreign_call(raise_interrupt)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_held_back_ctrl_c_lets_the_call_end() -> None:
    with interruptible_between() as check:
        foreign_call(press_ctrl_c)
        with pytest.raises(KeyboardInterrupt):
            check()


def test_streams_and_folder_are_as_they_were_after_an_error(tmp_path: Path) -> None:
    here, stdout = Path.cwd(), sys.stdout

    def leave() -> None:
        os.chdir(tmp_path)
        sys.exit("gone")

    with pytest.raises(ForeignError, match=r"^SystemExit: gone$"):
        foreign_call(leave)
    assert (Path.cwd(), sys.stdout) == (here, stdout)
