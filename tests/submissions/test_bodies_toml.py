"""The bodies of a scene's folder, read again: what `hhsim scene` writes, `hhsim replay` reads."""

from pathlib import Path

import numpy as np
import pytest

from hhsim.scene.body import Body, Driven, Free
from hhsim.scene.scene import open_scene
from hhsim.submissions.scene_folder import write_scene_folder


@pytest.mark.parametrize(
    ("object_", "motion"),
    [("cube", "grasp"), ("laptop", "close"), ("drawer", "shut"), ("chest", "lift"), ("peg", "insert")],
)
def test_bodies_come_back_as_they_were(tmp_path: Path, object_: str, motion: str) -> None:
    written = open_scene(object_, motion, level=1)
    write_scene_folder(written, tmp_path / "folder")
    read = open_scene(tmp_path / "folder" / "bodies.toml", tmp_path / "folder" / "motion.csv", level=1)
    assert [body.name for body in read.bodies] == [body.name for body in written.bodies]
    np.testing.assert_allclose(read.hands[0].ticks.position, written.hands[0].ticks.position, atol=1e-12)
    for was, one in zip(written.bodies, read.bodies):
        if not isinstance(was, Body):
            assert one == was
            continue
        assert isinstance(one, Body) and type(one.motion) is type(was.motion) and one.joint == was.joint
        assert (one.friction, one.torsion) == (was.friction, was.torsion)
        apart = np.linalg.norm(one.placed_mesh.vertices[:, None] - was.placed_mesh.vertices[None], axis=2)
        assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-12
        if isinstance(was.motion, Free) and isinstance(one.motion, Free):
            np.testing.assert_allclose(one.motion.mass, was.motion.mass, rtol=1e-12)
            np.testing.assert_allclose(one.motion.center, was.motion.center, atol=1e-12)
            np.testing.assert_allclose(one.motion.inertia, was.motion.inertia, atol=1e-12)
        if isinstance(was.motion, Driven) and isinstance(one.motion, Driven):
            assert was.motion.values is not None and one.motion.values is not None
            np.testing.assert_allclose(one.motion.values, was.motion.values, atol=1e-12)


def test_a_hinge_that_begins_open_comes_back_at_its_value(tmp_path: Path) -> None:
    path = tmp_path / "door.toml"
    path.write_text(
        '[[body]]\nname = "post"\nbox = [0.05, 0.05, 0.3]\nfixed = true\n'
        '[[body]]\nname = "leaf"\nbox = [0.2, 0.01, 0.3]\nposition = [0.2, 0.0, 0.0]\nmass = 0.5\n'
        'joint = { type = "hinge", on = "post", axis = [0, 0, 2], origin = [0.05, 0, 0], limits = [0, 2], '
        "start = 0.7 }\n"
    )
    written = open_scene(path, "grasp", level=1)
    write_scene_folder(written, tmp_path / "folder")
    read = open_scene(tmp_path / "folder" / "bodies.toml", tmp_path / "folder" / "motion.csv", level=1)
    was, leaf = written.solids[1], read.solids[1]
    assert was.joint is not None and leaf.joint is not None
    assert (leaf.joint.value, leaf.joint.limits, leaf.joint.on) == (0.7, (0.0, 2.0), "post")
    np.testing.assert_allclose(leaf.joint.axis, [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(leaf.joint.origin, was.joint.origin, atol=1e-12)
    np.testing.assert_allclose(leaf.placed_mesh.bounds, was.placed_mesh.bounds, atol=1e-12)
