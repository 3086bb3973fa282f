"""Calls of foreign code: what is an error of its own, and what is Ctrl-C."""

import os
import signal
import sys
from pathlib import Path

import pytest

from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.foreign_call import ForeignError, foreign_call


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
