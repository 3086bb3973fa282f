"""The seams of methods and surfaces: what is registered, one more entry, and what a method from outside may give."""

import importlib
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import Run
from contact_scenes import in_contact
from short_grasp import short_grasp, short_scene
from sphere_scenes import bumpy_ball

import hhsim.kernels.surfaces
from hhsim.errors import InputError, UnknownNameError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.kernels.tick.state import STATUS_START_INSIDE, WORK_CANDIDATES, WORK_TOUCHING
from hhsim.kernels.world.record import WorldRecord
from hhsim.motion.analytic_motion import still
from hhsim.solver.method import EVERYTHING, METHODS, OWN, SURFACES, Method, find_method, method_names, surface_of
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import HandSolver
from hhsim.solver.workspace import TickWorkspace
from hhsim.trees.contact_surface import contact_surface


class FollowEngine:
    """The graphic hand is the user's, wherever that is: what a method without contact comes to."""

    def __init__(self, workspace: TickWorkspace) -> None:
        self.workspace = workspace

    def begin(self) -> None: ...

    def run(self, haptic: HapticBlock, record: TickRecord, bodies: WorldRecord) -> int:
        for name in haptic._fields:
            getattr(record, name)[:] = getattr(haptic, name)
        record.joints[0] = [self.workspace.model.joints(*sample) for sample in zip(*(values[0] for values in haptic))]
        return haptic.position.shape[1]


@pytest.fixture
def follow(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """One more of our own methods."""
    monkeypatch.setitem(OWN, "follow", Method(summary="the user's hand, through everything", engine=FollowEngine))
    # They list the methods once.
    for package, name in (("hhsim.cli.arguments", "scene_options"), ("hhsim.cli", "replay")):
        monkeypatch.delitem(sys.modules, f"{package}.{name}", raising=False)
        monkeypatch.delattr(importlib.import_module(package), name, raising=False)
    yield
    for module in ("hhsim.cli.arguments.scene_options", "hhsim.cli.replay"):
        sys.modules.pop(module, None)


def test_a_method_is_added_by_one_entry(follow: None, run: Run, tmp_path: Path) -> None:
    answer = run("replay", "cube", "touch", "--method", "follow", "--out", str(tmp_path / "follow.h5"))
    assert answer.code == 0, answer.err
    assert answer.out.startswith("cube, touch, follow")
    with h5py.File(tmp_path / "follow.h5") as file:
        for name in ("position", "orientation", "flexion", "abduction"):
            np.testing.assert_array_equal(
                file[f"hands/right/tick/graphic/{name}"][()], file[f"hands/right/tick/haptic/{name}"][()]
            )
        assert file["hands/right/tick/penetration_depth"][()].max() > 1e-3, "nothing kept the hand out of the cube"
        assert not file["hands/right/tick/force/total"][()].any()
    assert "follow" in run("replay", "--help").out
    refused = run("replay", "cube", "touch", "--method", "folow")
    assert refused.code == 2 and "follow" in refused.err


@pytest.fixture
def declared(installed: Callable[..., None]) -> None:
    """An installed package that declares two methods, one of which takes a name of ours, and one that is broken."""
    lines = ("theirs = outside_methods:Follow", "coupled = outside_methods:Follow", "broken = not_there:Follow")
    installed("hhsim.methods", *lines)


def test_ours_come_first_and_keep_their_names(declared: None) -> None:
    names = method_names()
    assert names[: len(METHODS)] == list(METHODS) and {"theirs", "broken"} <= set(names)
    assert names.count("coupled") == 1
    assert find_method("coupled") is METHODS["coupled"]


def test_what_a_package_declares_can_be_named(declared: None, run: Run) -> None:
    method = find_method("theirs")
    assert method.summary == "The user's hand, through everything"
    assert SolverOptions(method="theirs").margin == SolverOptions().margin
    shown = run("methods").out
    assert "theirs" in shown and "others" in shown
    assert "method 'broken' cannot be imported" in shown
    with pytest.raises(UnknownNameError, match="did you mean theirs"):
        find_method("their")


def test_a_class_of_any_module_can_be_named() -> None:
    method = find_method("outside_methods:OurOwn")
    assert method.never_penetrates and not method.compiled and not method.takes_threads
    assert method.gives == {"forces", "times", "runs"} < EVERYTHING
    assert find_method("outside_methods:Follow").gives == {"times", "runs"}


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nowhere:Method", "No module named 'nowhere'"),
        ("outside_methods:Nothing", "AttributeError"),
        ("outside_methods:NoTick", "lacks tick"),
        ("outside_methods:INSTANCE", "is an instance"),
        ("outside_methods:itertools", "lacks begin and tick"),
        (":", "cannot be imported"),
    ],
)
def test_what_is_no_method_is_told_in_one_line(name: str, message: str, run: Run) -> None:
    with pytest.raises(InputError, match=message):
        find_method(name)
    answer = run("replay", "cube", "touch", "--method", name)
    assert answer.code == 2 and message in answer.err and answer.err.count("\n") == 1


def test_a_file_beside_the_data_is_found_and_takes_nobodys_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "beside_the_data.py").write_text("from outside_methods import Follow\n")
    (tmp_path / "numpy.py").write_text("raise SystemError\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    assert find_method("beside_the_data:Follow").summary
    assert sys.path.index(str(tmp_path)) == len(sys.path) - 1


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


def test_it_is_told_of_the_scene_and_where_to_begin() -> None:
    solver = solver_of("Follow")
    solver.run(*HAPTIC.part(0, 1))
    method: Any = solver.engine.method
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


def test_a_hand_that_begins_inside_begins_at_a_free_place() -> None:
    inside = HAPTIC.part(0, 2).copy()
    inside.position[:] = SCENE.solids[0].placed_mesh.vertices.mean(axis=0)
    solver = solver_of("Follow")
    record = solver.run(*inside)
    assert record.status[0] & STATUS_START_INSIDE
    begun: list[HandConfiguration] = solver.engine.method.begun  # type: ignore[attr-defined]
    assert np.linalg.norm(begun[-1].position - inside.position[0]) > 0.01


REFUSED = [
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
    ("Grows", r"fails: MemoryError: Unable to allocate .*\(tick 0\)"),
    ("NoForces", r"promises forces \(gives_forces\) and gives none"),
]


@pytest.mark.parametrize(("name", "message"), REFUSED)
def test_what_is_no_hand_is_refused_by_name_and_tick(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        solver_of(name).run(*HAPTIC.part(0, 5))


def test_ctrl_c_is_no_error_of_the_method() -> None:
    with pytest.raises(KeyboardInterrupt):
        solver_of("Interrupts").run(*HAPTIC.part(0, 1))


def test_the_time_of_a_tick_is_taken_by_a_clock_that_no_method_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("perf_counter_ns", "process_time_ns", "perf_counter", "process_time"):
        monkeypatch.setattr(time, name, getattr(time, name))
    record = solver_of("StopsTheClock").run(*HAPTIC.part(0, 3))
    assert (record.duration_cpu >= 2_000_000).all() and (record.duration_total >= 2_000_000).all()


BALLS = """
from typing import NamedTuple

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels import sphere_tree
from hhsim.kernels.contact import surface
from hhsim.kernels.jit import Array, Indices
from hhsim.kernels.surfaces import spheres


@by_reference
class BallArrays(NamedTuple):
    x: Array
    y: Array
    z: Array
    radius: Array
    first_child: Indices
    child_count: Indices


sphere_tree.tree_of.of(BallArrays)(sphere_tree._tree_of)
surface.list_pieces.of(BallArrays)(spheres._list)
surface.measure_pieces.of(BallArrays)(spheres._measure)
surface.record_pieces.of(BallArrays)(spheres._record)
surface.cone_distance.of(BallArrays)(spheres._cone_distance)
SURFACE = spheres.SURFACE._replace(summary="balls", arrays=BallArrays)
"""
"""A module of a surface: another type of arrays, to whose kernels those of the spheres are enough."""


@pytest.fixture
def balls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """One more file in the package of surfaces."""
    (tmp_path / "balls.py").write_text(BALLS)
    monkeypatch.setattr(hhsim.kernels.surfaces, "__path__", [*hhsim.kernels.surfaces.__path__, str(tmp_path)])
    importlib.invalidate_caches()
    yield SURFACES["balls"]
    sys.modules.pop("hhsim.kernels.surfaces.balls", None)


def test_the_spheres_are_a_surface() -> None:
    assert list(SURFACES) == ["spheres", "mesh"]
    tree = bumpy_ball(20).arrays()
    assert surface_of(tree) is SURFACES["spheres"]
    np.testing.assert_array_equal(SURFACES["spheres"].center(tree), [tree.x[0], tree.y[0], tree.z[0]])
    with pytest.raises(InputError, match="is no surface of an object"):
        surface_of((1.0,))
    with pytest.raises(InputError, match=r"'mesh'.*TreeArrays"):
        HandSolver(HandModel.default(), tree, SolverOptions(surface="mesh"))


def test_a_surface_is_added_by_one_file(balls: Any) -> None:
    tree, at = bumpy_ball(300).arrays(), still([0.0, -0.045, 0.058], flexion=0.4)
    ours = balls.arrays(*tree)
    assert SolverOptions(surface="balls").surface == "balls" and surface_of(ours) is SURFACES["balls"]
    found, expected = (in_contact(HandModel.default(), each, at, 1e-3).contacts for each in (ours, tree))
    count = int(expected.start[-1])
    assert count > 0
    for name in ("key", "distance", "normal", "point"):
        np.testing.assert_array_equal(found[name][..., :count], expected[name][..., :count])
