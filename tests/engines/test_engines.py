"""The engines themselves: how the missing ones are refused, and that those here stop at a ball and push back."""

import json
from typing import Any

import numpy as np
import pytest
from conftest import Run

from hhsim.bench.suites.peers import capsule_hand
from hhsim.engines.rigid_hand import lack_of
from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.tick.block import TickRecord
from hhsim.mesh.catalogue import load_object
from hhsim.scene.scene import open_scene
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.known_methods import find_method
from hhsim.solver.method_names import declared_methods
from hhsim.solver.options import SolverOptions
from hhsim.solver.outside_method import MethodScene
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
        solver = HandSolver(
            capsule_hand(), contact_surface("mesh", scene.solids[0].placed_mesh, scene.solids[0].placed_tree), options
        )
        return solver.run(*haptic)

    shown, ours = played(name), played("coupled")
    # The same springs and no friction: the same rest, but for the engine's own surface and its softness.
    off = np.linalg.norm(shown.joints[-1] - ours.joints[-1], axis=-1)
    assert off.max() < 2e-3
    assert np.linalg.norm(shown.total[-1] - ours.total[-1]) < 0.3 * np.linalg.norm(ours.total[-1])
    assert np.linalg.norm(ours.total[-1]) > 0.1
    assert (shown.duration[:, 1] > 0).all()


def test_large_triangles_are_split_since_mujoco_misses_contacts_of_them() -> None:
    pytest.importorskip("mujoco")
    from hhsim.engines.mujoco import LONGEST, MuJoCoTriangles

    mesh = load_object("cube").mesh
    model: Any = MuJoCoTriangles(MethodScene(capsule_hand(), mesh, None, SolverOptions(surface="mesh")))._model
    corners = model.flex_vert[model.flex_elem.reshape(-1, 3)]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert np.linalg.norm(np.diff(mesh.triangles, axis=1), axis=2).max() > LONGEST >= edges.max()
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    np.testing.assert_allclose(area, 6.0 * mesh.extent[0] ** 2)
