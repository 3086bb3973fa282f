"""MuJoCo and its convex parts: how the missing ones are refused, and that those here stop at a ball and push back."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Run

from hhsim.bench.suites.peers import capsule_hand
from hhsim.engines import mujoco as module
from hhsim.engines.mujoco import MuJoCoFast, convex_parts, lack_of
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel, Side
from hhsim.hand.quaternion import quaternion, quaternion_product, rotation_matrix
from hhsim.kernels.tick.block import TickRecord
from hhsim.mesh.catalogue import load_object
from hhsim.scene.scene import open_scene
from hhsim.solver.method import declared_methods, find_method
from hhsim.solver.options import SolverOptions
from hhsim.solver.outside_method import MethodScene
from hhsim.solver.solver import HandSolver
from hhsim.trees.contact_surface import contact_surface

ENGINES = sorted(name for name, entry in declared_methods().items() if entry.value.startswith("hhsim.engines."))


@pytest.mark.parametrize("name", ENGINES)
def test_a_missing_engine_is_one_line(name: str, monkeypatch: pytest.MonkeyPatch, run: Run) -> None:
    made: Any = declared_methods()[name].load()
    extra = name.partition("-")[0]
    monkeypatch.setattr(made, "missing", lack_of(extra, "no_such_engine"))
    line = f"needs no_such_engine, which is not installed: pip install 'hhsim[{extra}]'"
    assert find_method(name).missing == line
    answer = run("replay", "sphere", "touch", "--method", name, "--out", "never.h5")
    assert (answer.code, answer.out) == (2, "")
    assert answer.err.strip().count("\n") == 0 and line in answer.err
    listed = json.loads(run("methods", "--json").out)["methods"]
    assert [one["missing"] for one in listed if one["name"] == name] == [line]


@pytest.mark.parametrize("name", ENGINES)
def test_an_engine_stops_at_a_ball_and_pushes_the_hand_back(name: str) -> None:
    if find_method(name).missing:
        pytest.skip(f"{name} {find_method(name).missing}")
    scene = open_scene("sphere", "touch", rate=1000.0)
    hold = next(phase for phase in scene.ticks.phases if phase.name == "hold")
    haptic = HandConfiguration.of(scene.hands[0].ticks).part(hold.first_tick - 250, hold.first_tick + 50)

    def played(method: str) -> TickRecord:
        options = SolverOptions(method=method, surface="mesh")
        surface = contact_surface("mesh", scene.solids[0].placed_mesh, scene.solids[0].placed_tree)
        return HandSolver(capsule_hand(), surface, options).run(*haptic)

    shown, ours = played(name), played("coupled")
    # The same springs and no friction: the same rest, but for the engine's own surface and its softness.
    off = np.linalg.norm(shown.joints[-1] - ours.joints[-1], axis=-1)
    assert off.max() < 2e-3
    assert np.linalg.norm(shown.total[-1] - ours.total[-1]) < 0.3 * np.linalg.norm(ours.total[-1])
    assert np.linalg.norm(ours.total[-1]) > 0.1
    assert (shown.duration[:, 1] > 0).all()


def beside_a_ball(hand: HandModel) -> Any:
    return MuJoCoFast(MethodScene(hand, load_object("sphere").mesh, None, SolverOptions(surface="mesh")))


@pytest.mark.parametrize("side", ["right", "left"])
def test_its_joints_are_those_of_the_hand_and_its_coupling_is_critically_damped(side: Side) -> None:
    pytest.importorskip("mujoco")
    random, hand = np.random.default_rng(1), HandModel.default(side)
    made = beside_a_ball(hand)
    palm = random.normal(size=3), quaternion(random.normal(size=3))
    pose = HandConfiguration(*palm, random.uniform(0.0, 1.0, (5, 3)), random.uniform(-0.2, 0.3, 5))
    made.begin(pose)
    made._mujoco.mj_forward(made._model, made._data)
    found = [[made._data.body(f"{finger} {k}").xpos for k in range(3)] for finger in FINGERS]
    np.testing.assert_allclose(found, hand.joints(*pose)[:, :3], atol=1e-12)
    # The damping of a mass m on a spring k is 2 sqrt(k m).
    spring, damper = made._model.actuator_gainprm[:, 0], -made._model.actuator_biasprm[:, 2]
    masses = np.repeat([made._model.body("palm").mass[0], made._model.body("palm").inertia[0]], 3)
    np.testing.assert_allclose(damper[:6], 2.0 * np.sqrt(spring[:6] * masses))
    np.testing.assert_allclose(damper[6:], 2.0 * np.sqrt(spring[6:] * made._model.dof_armature[6:]))


def test_dampers_get_the_speed_of_the_hand_in_its_palm() -> None:
    pytest.importorskip("mujoco")
    made = beside_a_ball(HandModel.default())
    turn, way = np.array([0.3, -0.2, 0.5]), np.array([0.01, 0.02, -0.03])
    first = quaternion(np.array([0.4, 0.1, -0.7]))
    before = HandConfiguration(np.zeros(3), first, np.full((5, 3), 0.2), np.zeros(5))
    second = quaternion_product(quaternion(turn), first)
    now = HandConfiguration(way, second, np.full((5, 3), 0.3), np.zeros(5))
    made.begin(before)
    made.command(before)
    made.command(now)
    ahead = (made._damping / made._stiffness - made._ahead) / made._scene.period
    palm = rotation_matrix(second)
    np.testing.assert_allclose(made._data.ctrl[:3], ahead[0] * way @ palm, rtol=1e-12)
    np.testing.assert_allclose(made._data.ctrl[3:6], ahead[1] * turn @ palm, rtol=1e-9)
    np.testing.assert_allclose(made._data.ctrl[6:], 0.3 + ahead[2] * 0.1, rtol=1e-12)


def test_a_sphere_is_a_ball_and_a_cube_a_box() -> None:
    (ball,) = convex_parts(load_object("sphere").mesh)
    assert ball.kind == "sphere"
    away = np.linalg.norm(load_object("sphere").mesh.vertices - ball.center, axis=1)
    assert abs(ball.size[0] - away.max()) < 2e-3 * ball.size[0]
    cube = load_object("cube").mesh
    (box,) = convex_parts(cube)
    assert box.kind == "box"
    np.testing.assert_allclose(2.0 * box.size, cube.extent)


def test_what_is_convex_is_one_hull_and_needs_no_decomposition(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_decompose", None)
    mesh = load_object("hexagonal-prism").mesh
    (hull,) = convex_parts(mesh)
    assert hull.kind == "mesh"
    assert {tuple(point) for point in hull.points} == {tuple(vertex) for vertex in mesh.vertices[np.unique(mesh.faces)]}


def test_parts_are_found_once_and_a_damaged_file_is_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, made = load_object("cup").mesh, []

    def decompose(given: object) -> list[np.ndarray]:
        made.append(given)
        return [mesh.vertices[:5], mesh.vertices[5:9]]

    monkeypatch.setattr(module, "_decompose", decompose)
    monkeypatch.setattr(module, "cache_root", lambda: tmp_path)
    first, again = convex_parts(mesh), convex_parts(mesh)
    assert made == [mesh]
    for one, other in zip(first, again, strict=True):
        assert one.kind == other.kind == "mesh"
        np.testing.assert_array_equal(one.points, other.points)
    (file,) = (tmp_path / "convex-parts").iterdir()
    file.write_bytes(b"not a file of numpy's")
    convex_parts(mesh)
    assert len(made) == 2


def test_a_closed_mesh_is_not_remeshed() -> None:
    mesh = load_object("cup").mesh
    assert module._preparation(mesh) == "off"
    assert module._preparation(replace(mesh, faces=mesh.faces[1:])) == "auto"
