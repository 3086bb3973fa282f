"""Key strokes from a terminal, which is as it was on every way out."""

import os
import signal
import subprocess
import sys
import termios
from collections.abc import Callable, Iterator

import pytest
from live_peers import PATIENCE
from own_command import Terminal

PROGRAM = """
import os, signal, sys, time
from hhsim.cli.live.session import terminal_keys
from hhsim.live.processes import stop_signals
with stop_signals() as stop_signal, terminal_keys() as read:
    if read is None:
        print("no terminal", flush=True)
        sys.exit()
    print("ready", flush=True)
    while True:
        keys = read()
        if keys is None:
            sys.exit(7)
        if keys:
            print(repr(keys), flush=True)
        if "x" in keys:
            raise RuntimeError("an error of the program")
        if "e" in keys:
            sys.exit(3)
        if stop_signal():
            print("stopped by", stop_signal(), flush=True)
            break
        time.sleep(0.005)
"""


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    held = Terminal(sys.executable, "-c", PROGRAM)
    held.until("ready")
    assert termios.tcgetattr(held.line)[3] & (termios.ICANON | termios.ECHO) == 0
    yield held
    held.close()


WAYS_OUT: dict[str, tuple[Callable[[Terminal], None], int]] = {
    "Ctrl-C": (lambda terminal: terminal.type(b"\x03"), 0),
    "Ctrl-Z": (lambda terminal: terminal.type(b"\x1a"), 0),
    "Ctrl-backslash": (lambda terminal: terminal.type(b"\x1c"), 0),
    "SIGTERM": (lambda terminal: terminal.process.send_signal(signal.SIGTERM), 0),
    "SIGHUP": (lambda terminal: terminal.process.send_signal(signal.SIGHUP), 0),
    "an exit": (lambda terminal: terminal.type(b"e"), 3),
    "an error": (lambda terminal: terminal.type(b"x"), 1),
}


@pytest.mark.parametrize("way", WAYS_OUT)
@pytest.mark.quick("Ctrl-C", "an error")
def test_the_terminal_is_as_it_was_on_every_way_out(terminal: Terminal, way: str) -> None:
    leave, code = WAYS_OUT[way]
    leave(terminal)
    assert terminal.process.wait(PATIENCE) == code
    assert termios.tcgetattr(terminal.line) == terminal.before
    if code == 0:
        terminal.until("stopped by ")


def test_keys_come_at_once_and_arrows_are_no_escape(terminal: Terminal) -> None:
    terminal.type(b"w")
    terminal.until("'w'")
    terminal.type(b"\x1b[A\x1b[1;5Ca\x1bOP")
    terminal.until("'a'")
    terminal.type("ü".encode())
    assert "stopped by" not in terminal.until("'ü'")
    assert terminal.process.poll() is None


def test_a_terminal_that_is_gone_is_noticed(terminal: Terminal) -> None:
    os.close(terminal.line)
    os.close(terminal.end)
    # The program is told by SIGHUP, or finds nothing more to read; what it prints then goes nowhere.
    assert terminal.process.wait(PATIENCE) is not None


def test_without_a_terminal_there_are_no_keys() -> None:
    answer = subprocess.run([sys.executable, "-c", PROGRAM], stdin=subprocess.DEVNULL, capture_output=True, text=True)
    assert (answer.returncode, answer.stdout) == (0, "no terminal\n")
