"""A method in a process of its own: the same hands, and whatever that process does is a named error here."""

import os
import signal
import threading
from functools import partial
from typing import Any

import numpy as np
import pytest
from conftest import Run
from sampled import sampled
from short_grasp import short_grasp, short_scene

from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.isolated_method import IsolatedMethod
from hhsim.solver.options import SolverOptions
from hhsim.solver.outside_method import MethodScene
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.trees.contact_surface import contact_surface

SCENE = short_scene(short_grasp())
HAPTIC = HandConfiguration.of(SCENE.ticks).copy()
SURFACE = contact_surface("spheres", SCENE.mesh, SCENE.tree)


def played(name: str, ticks: int) -> Any:
    return HandSolver(SCENE.hand, SURFACE, SolverOptions(method=name)).run(*HAPTIC.part(0, ticks))


def made(name: str) -> IsolatedMethod:
    scene = MethodScene(SCENE.hand, SCENE.mesh, SCENE.tree, SolverOptions())
    return IsolatedMethod(f"outside_methods:{name}").make(scene)


def test_it_answers_with_the_same_hands_and_forces() -> None:
    here, there = (played(f"{prefix}outside_methods:OurOwn", 40) for prefix in ("", "isolated:"))
    for name in (*HandConfiguration._fields, "joints", "phalanx", "total", "palm_wrench", "work", "status"):
        np.testing.assert_array_equal(getattr(there, name), getattr(here, name), err_msg=name)
    assert (there.duration_cpu > 0).all() and (there.duration[:, 1] <= there.duration_total).all()


@pytest.mark.parametrize(
    ("name", "message"),
    sampled(
        [
            ("Dies", r"method 'outside_methods:Dies' died by signal 11 \(SIGSEGV\) in tick 2"),
            ("Exits", "method 'outside_methods:Exits' ended its process with exit code 0 in tick 0"),
            ("Leaves", r"method 'outside_methods:Leaves' fails: SystemExit: 0 \(tick 0\)"),
            ("Grows", r"method 'outside_methods:Grows' fails: MemoryError: Unable to allocate .*\(tick 0\)"),
            ("NotUnit", "orientation of length 2: expected a unit quaternion"),
            ("CannotBeMade", "cannot be made: FileNotFoundError: no weights"),
        ],
        lambda place, _: place == 0,
    ),
)
def test_its_end_is_an_error_with_its_name(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        played(f"isolated:outside_methods:{name}", 5)


def test_ctrl_c_ends_a_tick_that_never_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hhsim.solver.isolated_method.PATIENCE", 0.0)
    method = made("NeverEnds")
    method.tick(HAPTIC.at(0))
    timer = threading.Timer(0.2, partial(os.kill, os.getpid(), signal.SIGINT))
    with interruptible_between():
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            method.tick(HAPTIC.at(1))
    assert method._process.returncode == -signal.SIGKILL


@pytest.mark.parametrize(
    ("times", "lies"),
    [
        ((0, 0, 0), False),
        ((-1, 0, 0), True),
        ((10**12, 0, 0), True),
        ((0, 10**12, 0), True),
        ((1000, 1000, 2000), True),
        ((1000, 1000, -1), True),
    ],
)
def test_times_that_cannot_be_are_refused(
    monkeypatch: pytest.MonkeyPatch, times: tuple[int, int, int], lies: bool
) -> None:
    method = silent(monkeypatch, times, cpu=[0, 400_000])
    if lies:
        with pytest.raises(InputError, match=r"(states|native_ns of).*\(tick 0\)"):
            method.tick(HAPTIC.at(0))
    else:
        assert method.tick(HAPTIC.at(0))[1:] == times[:2]


def test_a_method_that_hides_its_time_is_found_by_what_the_system_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    # Each tick claims 1 µs, and the system counts 300 ms.
    method = silent(monkeypatch, (1000, 1000, 0), cpu=[300_000_000 * (i // 2 + i % 2) for i in range(20)])
    for _ in range(3):
        method.tick(HAPTIC.at(0))
    with pytest.raises(InputError, match=r"states 1,000 ns and 1,000 ns of CPU time, of .* 300,000,000"):
        method.tick(HAPTIC.at(0))


def silent(monkeypatch: pytest.MonkeyPatch, times: tuple[int, int, int], cpu: list[int]) -> IsolatedMethod:
    """A method whose process answers each tick with the user's hand and these times, and takes so much CPU time."""
    from hhsim.solver import isolated_method

    method = object.__new__(IsolatedMethod)
    method.name, method.ticks, method._counted, method.facts = "a:B", 0, 0, {"forces": False}
    counts = iter(cpu)
    monkeypatch.setattr(IsolatedMethod, "_cpu", lambda self: next(counts))
    answer = isolated_method.TIMES.pack(*times, 0) + isolated_method._packed(HAPTIC.at(0))
    monkeypatch.setattr(IsolatedMethod, "_ask", lambda self, message, where: answer)
    monkeypatch.setattr(isolated_method, "perf_counter_ns", iter(range(0, 10**12, 10**9)).__next__)
    return method


def test_only_a_method_from_outside_is_isolated(run: Run) -> None:
    answer = run("replay", "cube", "pinch", "--isolate")
    assert answer.code == 2 and "method 'coupled' is hhsim's own" in answer.err
    answer = run("replay", "cube", "pinch", "--isolate", "--method", "outside_methods:NoTick")
    assert answer.code == 2 and "method 'outside_methods:NoTick' is no method" in answer.err
