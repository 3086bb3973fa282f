"""Methods from outside: what they are given, what is taken of them, what is refused; and in a process of their own."""

import os
import signal
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Run
from sampled import sampled
from short_grasp import short_grasp, short_scene

from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.tick.state import STATUS_INPUT_INVALID, STATUS_START_INSIDE, WORK_CANDIDATES, WORK_TOUCHING
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.isolated_method import IsolatedMethod
from hhsim.solver.options import SolverOptions
from hhsim.solver.outside_method import MethodHere, MethodScene, OutsideEngine
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.trees.contact_surface import contact_surface

SCENE = short_scene(short_grasp())
HAPTIC = HandConfiguration.of(SCENE.hands[0].ticks).copy()
SURFACE = contact_surface("spheres", SCENE.solids[0].placed_mesh, SCENE.solids[0].placed_tree)


def solver_of(name: str) -> HandSolver:
    return HandSolver(SCENE.hands[0].model, SURFACE, SolverOptions(method=f"outside_methods:{name}"))


def test_our_own_method_from_outside_is_our_own() -> None:
    ours = HandSolver(SCENE.hands[0].model, SURFACE, SolverOptions()).run(*HAPTIC)
    theirs = solver_of("OurOwn").run(*HAPTIC)
    for name in (*HandConfiguration._fields, "joints", "phalanx", "palm_wrench"):
        np.testing.assert_allclose(getattr(theirs, name), getattr(ours, name), atol=1e-12, err_msg=name)
    np.testing.assert_allclose(theirs.total, ours.total, atol=1e-12)
    # A pair counts as touching where the tick ends; within the margin ours counts where the program begins.
    np.testing.assert_array_equal(theirs.work[:, WORK_TOUCHING], ours.work[:, WORK_TOUCHING])


def test_the_time_that_a_method_reports_is_kept_as_it_reports_it() -> None:
    record = solver_of("Modest").run(*HAPTIC.part(0, 3))
    np.testing.assert_array_equal(record.duration, np.tile([0, 123, 0, 0], (3, 1)))


def test_it_is_told_of_the_scene_and_where_to_begin() -> None:
    solver = solver_of("Follow")
    solver.run(*HAPTIC.part(0, 1))
    engine = solver.engine
    assert isinstance(engine, OutsideEngine)
    assert isinstance(engine.runner, MethodHere)
    method: Any = engine.runner.method
    scene = method.scene
    assert scene.period == 1e-3
    for theirs, ours in (
        (scene.mesh, SCENE.solids[0].placed_mesh),
        (scene.tree, SCENE.solids[0].placed_tree),
        (scene.hand, SCENE.hands[0].model),
    ):
        arrays = {name: values for name, values in vars(ours).items() if isinstance(values, np.ndarray)}
        for name, values in arrays.items():
            np.testing.assert_array_equal(getattr(theirs, name), values)
            assert not np.shares_memory(getattr(theirs, name), values), name
        assert arrays
    begun: list[HandConfiguration] = method.begun
    np.testing.assert_array_equal(begun[0].position, HAPTIC.position[0])
    solver.place(*HAPTIC.at(5))
    np.testing.assert_array_equal(begun[1].flexion, HAPTIC.flexion[5])


def test_what_it_does_to_its_input_is_its_own_business() -> None:
    kept = HAPTIC.copy()
    record = solver_of("Writes").run(*HAPTIC)
    for one, other, shown in zip(HAPTIC, kept, HandConfiguration.of(record)):
        np.testing.assert_array_equal(one, other)
        np.testing.assert_allclose(shown, other, atol=1e-15)


def test_without_forces_there_are_none_and_the_pull_is_eq_1() -> None:
    record = solver_of("Follow").run(*HAPTIC)
    for values in (record.phalanx, record.total, record.fingertip_normal):
        assert np.isnan(values).all()
    assert np.abs(record.palm_wrench).max() < 1e-9, "the shown hand is the user's"
    assert record.work[:, WORK_CANDIDATES].max() > record.work[0, WORK_CANDIDATES]


def test_input_that_is_not_finite_is_held() -> None:
    broken = HAPTIC.copy()
    broken.position[10] = np.nan
    record = solver_of("Follow").run(*broken)
    assert record.status[10] == STATUS_INPUT_INVALID and not record.status[[9, 11]].any()
    np.testing.assert_array_equal(record.position[10], HAPTIC.position[9])


def test_a_hand_that_begins_inside_begins_at_a_free_place() -> None:
    inside = HAPTIC.part(0, 2).copy()
    inside.position[:] = SCENE.solids[0].placed_mesh.vertices.mean(axis=0)
    solver = solver_of("Follow")
    record = solver.run(*inside)
    assert record.status[0] & STATUS_START_INSIDE
    begun: list[HandConfiguration] = solver.engine.runner.method.begun  # type: ignore[attr-defined]
    assert np.linalg.norm(begun[-1].position - inside.position[0]) > 0.01


HERE = [
    ("Raises", r"fails: ZeroDivisionError: of no\nuse \(tick 2\)"),
    ("CannotBeMade", "cannot be made: FileNotFoundError: no weights"),
    ("NotUnit", r"orientation of length 2: expected a unit quaternion w x y z \(tick 0\)"),
    ("WrongShape", r"flexion of shape \(15,\): expected \(5, 3\)"),
    ("NotFinite", "position that is not finite"),
    ("NoNumbers", "abduction that is no array of numbers"),
    ("NoHand", "answers with NoneType: expected a HandConfiguration"),
    ("Boasts", r"native_ns of 1000000000000000: expected 0 to the .* ns that the tick took \(tick 0\)"),
    ("Owes", "native_ns of -1000000000000000000: expected 0 to"),
    ("Leaves", r"fails: SystemExit: 0 \(tick 0\)"),
    ("Interrupts", r"fails: KeyboardInterrupt:  \(tick 0\)"),
    ("NoForces", r"promises forces \(gives_forces\) and gives none"),
]
IN_A_PROCESS = [
    ("Dies", r"method 'outside_methods:Dies' died by signal 11 \(SIGSEGV\) in tick 2"),
    ("Exits", "method 'outside_methods:Exits' ended its process with exit code 0 in tick 0"),
    ("Leaves", r"method 'outside_methods:Leaves' fails: SystemExit: 0 \(tick 0\)"),
    ("Grows", r"method 'outside_methods:Grows' fails: MemoryError: Unable to allocate .*\(tick 0\)"),
    ("NotUnit", "orientation of length 2: expected a unit quaternion"),
    ("CannotBeMade", "cannot be made: FileNotFoundError: no weights"),
]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        *((f"outside_methods:{name}", message) for name, message in HERE),
        *sampled(
            [(f"isolated:outside_methods:{name}", message) for name, message in IN_A_PROCESS],
            lambda place, _: place == 0,
        ),
    ],
)
def test_what_is_no_hand_is_refused_by_name_and_tick(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        played(name, 5)


def test_what_it_prints_goes_to_stderr_and_its_folder_is_its_own(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    here = Path.cwd()
    solver_of("Talks").run(*HAPTIC.part(0, 2))
    shown = capfd.readouterr()
    assert shown.out == ""
    assert [shown.err.count(word) for word in ("printed", "written", "by C")] == [3, 3, 3]
    assert Path.cwd() == here


def test_the_time_of_a_tick_is_taken_by_a_clock_that_no_method_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("perf_counter_ns", "process_time_ns", "perf_counter", "process_time"):
        monkeypatch.setattr(time, name, getattr(time, name))
    record = solver_of("StopsTheClock").run(*HAPTIC.part(0, 3))
    assert (record.duration_cpu >= 2_000_000).all() and (record.duration_total >= 2_000_000).all()


def test_what_it_does_to_its_scene_is_its_own_business() -> None:
    kept = SCENE.solids[0].placed_mesh.vertices.copy(), SCENE.hands[0].model.length.copy()
    solver_of("Rewrites").run(*HAPTIC.part(0, 1))
    np.testing.assert_array_equal(SCENE.solids[0].placed_mesh.vertices, kept[0])
    np.testing.assert_array_equal(SCENE.hands[0].model.length, kept[1])


def played(name: str, ticks: int) -> Any:
    return HandSolver(SCENE.hands[0].model, SURFACE, SolverOptions(method=name)).run(*HAPTIC.part(0, ticks))


def made(name: str) -> IsolatedMethod:
    scene = MethodScene(SCENE.hands[0].model, SCENE.solids[0].placed_mesh, SCENE.solids[0].placed_tree, SolverOptions())
    return IsolatedMethod(f"outside_methods:{name}").make(scene)


def test_it_answers_with_the_same_hands_and_forces() -> None:
    here, there = (played(f"{prefix}outside_methods:OurOwn", 40) for prefix in ("", "isolated:"))
    for name in (*HandConfiguration._fields, "joints", "phalanx", "total", "palm_wrench", "work", "status"):
        np.testing.assert_array_equal(getattr(there, name), getattr(here, name), err_msg=name)
    assert (there.duration_cpu > 0).all() and (there.duration[:, 1] <= there.duration_total).all()


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
