"""Meshes that are no solid, touched by their spheres: as a skin of their own triangles, in replay, verify and again."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace
from sampled import sampled

from hhsim.linkage.file import resolve_object
from hhsim.mesh.mesh import Mesh
from hhsim.replay.repeat import run_again
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import load_result
from hhsim.scene.described_scene import SceneWords, load_words
from hhsim.solver.options import SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.file import save_tree
from hhsim.trees.options import TreeOptions
from hhsim.verify.claim import HOLDS
from hhsim.verify.verify import verify

pytestmark = pytest.mark.slow

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
