"""A core of its own: kept there, given to one thread at a time, and waited for."""

import os
import tempfile
import threading
from pathlib import Path

import pytest

from hhsim.system import thread_pool as own_core
from hhsim.system.thread_pool import on_own_core, physical_cores

pytestmark = pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system keeps no thread on a core")


@pytest.fixture(autouse=True)
def own_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Other tests may hold cores."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


def test_a_thread_has_one_core_and_the_process_all_of_them() -> None:
    before = os.sched_getaffinity(os.getpid())

    def look() -> tuple[set[int], set[int]]:
        return os.sched_getaffinity(0), os.sched_getaffinity(os.getpid())

    (mine, all_of_them), kept = on_own_core(look)
    assert kept and len(mine) == 1 and mine <= set(physical_cores())
    assert all_of_them == before == os.sched_getaffinity(0)


def test_two_have_two_and_a_third_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    (core,) = os.sched_getaffinity(0) & set(physical_cores()[:1])
    monkeypatch.setattr(own_core, "physical_cores", lambda: [core])
    entered, leave, order = threading.Event(), threading.Event(), []

    def first() -> None:
        entered.set()
        leave.wait(30.0)
        order.append("first")

    one = threading.Thread(target=on_own_core, args=(first,))
    other = threading.Thread(target=on_own_core, args=(lambda: order.append("second"),))
    one.start()
    entered.wait(30.0)
    other.start()
    other.join(3.0 * own_core.LOOK_AGAIN)
    assert order == [] and other.is_alive()
    leave.set()
    one.join(30.0)
    other.join(30.0)
    assert order == ["first", "second"]


def test_what_raises_gives_its_core_back() -> None:
    for _ in range(1 + len(physical_cores())):
        with pytest.raises(ZeroDivisionError):
            on_own_core(lambda: 1 // 0)
    assert on_own_core(lambda: 7) == (7, True)


def test_where_no_lock_can_be_made_nothing_is_claimed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    assert on_own_core(lambda: 7) == (7, False)
