"""Replays at triangles, of solids and of skins that are none: the file, the figures, a second run, the report."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace
from sampled import sampled
from short_grasp import short_grasp, short_scene

from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.linkage.file import resolve_object
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.run_ticks import PLACED
from hhsim.replay.repeat import run_again
from hhsim.replay.replay import replay_scene
from hhsim.replay.summary import ReplaySummary
from hhsim.result.reader import Result, load_result
from hhsim.scene.described_scene import SceneWords, load_words
from hhsim.scene.scene import Scene, open_scene
from hhsim.solver.options import SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.file import save_tree
from hhsim.trees.options import TreeOptions
from hhsim.verify.claim import HOLDS
from hhsim.verify.verify import verify

pytestmark = pytest.mark.slow
METHODS = ("coupled", "progressive")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return short_scene(short_grasp())


@pytest.fixture(scope="module", params=METHODS)
def run(
    request: pytest.FixtureRequest, scene: Scene, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Result, ReplaySummary]:
    path = tmp_path_factory.mktemp("mesh") / f"{request.param}.h5"
    summary = replay_scene(
        scene, SolverOptions(method=request.param, surface="mesh"), path, description={"hand_file": None}
    )
    return load_result(path), summary


def test_the_hand_touches_the_mesh_to_a_micrometre_and_is_nowhere_inside(run: tuple[Result, ReplaySummary]) -> None:
    result, summary = run
    figures = summary.attributes()
    assert figures["penetration_max"] == 0.0 and figures["stuck_ticks"] == 0
    assert 4e-7 < figures["contact_error_max"] <= 1e-6
    assert figures["force_contact_max"] > 1.0
    assert summary.verdict.line == "within limits. The shown hand stays out of the object's mesh in every tick."
    # The joints' and the palm's spheres by an independent library: outside, and some of them on the mesh.
    surface = trimesh.Trimesh(result.body.vertices, result.body.faces, process=False)
    placed = PlacedHand(*(np.array(result[name]) for name in PLACED))
    signed_distance: Any = trimesh.proximity.signed_distance
    least = np.inf
    for tick in range(0, result.ticks, 20):
        centers = placed.joints[tick].reshape(-1, 3)
        away = np.abs(signed_distance(surface, centers)) - result.static["hand/phalanx_radius"].reshape(-1)
        assert away.min() > 0.0
        least = min(least, float(away.min()))
    assert least < 1e-3


@pytest.mark.parametrize(
    "name",
    sampled(
        [
            "nasty_soup_100_triangles.stl",
            "nasty_bunny_5_holes.obj",
            "nasty_bunny_94_components.ply",
            "nasty_teapot_open_shells.obj",
            "nasty_ycb_mug_nonmanifold.obj",
        ],
        lambda place, name: place == 0,
    ),
)
def test_meshes_that_enclose_nothing_are_grasped(name: str, shared_data: Path, tmp_path: Path) -> None:
    found = open_scene(shared_data / "meshes" / name, short_grasp(), size=0.1, solid=False, level=3)
    summary = replay_scene(found, SolverOptions(surface="mesh"), tmp_path / "nasty.h5")
    figures = summary.attributes()
    assert figures["penetration_max"] == 0.0 and figures["stuck_ticks"] == 0
    assert figures["force_contact_max"] > 0.1 and figures["contact_error_max"] <= 1e-6
    assert any("both sides can be touched" in note for note in summary.notes)


BOX = trimesh.creation.box((0.05, 0.05, 0.1))
BALL = trimesh.creation.icosphere(3, 0.04)
SHAPES = {
    "half a ball": BALL.submesh([BALL.triangles_center[:, 2] > 0.0])[0],
    "boxes that cross": trimesh.util.concatenate([BOX, BOX.copy().apply_translation((0.02, 0.01, 0.03))]),
}


@pytest.mark.parametrize("name", sampled(list(SHAPES), lambda place, name: place == 0))
@pytest.mark.soak
def test_a_skin_is_touched_judged_and_run_again(name: str, tmp_path: Path) -> None:
    path, shape = tmp_path / "thing.obj", SHAPES[name]
    path.write_text(Mesh(np.asarray(shape.vertices), np.asarray(shape.faces)).obj())
    words = SceneWords(object=str(path), trajectory="grasp", level=2)
    scene = load_words(words).placed().scene
    summary = replay_scene(scene, SolverOptions(), tmp_path / "own.h5")
    result = load_result(tmp_path / "own.h5")
    assert len(result.body.faces) == len(shape.faces)
    assert summary.attributes()["penetration_max"] == 0.0 and summary.attributes()["force_contact_max"] > 1.0
    found = verify(result)
    assert found.passed
    verdicts = {claim.name: claim.verdict for claim in found.claims}
    assert [verdicts[each] for each in ("cover", "second run")] == 2 * [HOLDS]
    assert run_again(result).identical

    # The tree that hhsim build-tree writes is that of the replay.
    mesh, _ = resolve_object(path, solid=None)
    save_tree(cached_sphere_tree(mesh, TreeOptions(level=2)), tmp_path / "tree.h5")
    other = load_words(replace(words, level=None, tree=str(tmp_path / "tree.h5"))).placed().scene
    assert np.array_equal(other.solids[0].tree.leaf_radius, scene.solids[0].tree.leaf_radius)


def test_a_solid_is_made_where_asked_or_free(tmp_path: Path) -> None:
    path, shape = tmp_path / "thing.obj", SHAPES["boxes that cross"]
    path.write_text(Mesh(np.asarray(shape.vertices), np.asarray(shape.faces)).obj())
    toml = tmp_path / "two.toml"
    bodies = 'name = "free"', 'name = "fixed"\nfixed = true\nposition = [0.3, 0.0, 0.0]'
    toml.write_text("".join(f'[[body]]\nmesh = "thing.obj"\n{each}\n' for each in bodies))
    words = SceneWords(object=str(path), trajectory="never", level=1)
    own, asked = (load_words(one).placed().scene for one in (words, replace(words, solid=True)))
    free, fixed = load_words(replace(words, object=str(toml))).placed().scene.solids
    assert len(own.solids[0].mesh.faces) == len(fixed.mesh.faces) == len(shape.faces) < len(asked.solids[0].mesh.faces)
    assert np.array_equal(free.mesh.faces, asked.solids[0].mesh.faces)
