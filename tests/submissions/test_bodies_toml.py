"""The bodies of a scene's folder, read again: what `hhsim scene` writes, `hhsim replay` reads."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from body_tables import TABLE, body, body_file, joint

from hhsim.scene.body import Body, Driven, Fixed, Free
from hhsim.scene.described_scene import FreeWords, SceneWords, load_words
from hhsim.scene.scene import open_scene
from hhsim.submissions.scene_folder import write_scene_folder

ALONE = (body("tool", [0.05, 0.05, 0.05], poses={"file": "poses.csv"}),)
DRIVEN = (*ALONE, body("block", [0.06, 0.06, 0.06]), TABLE)
"""Bodies that are driven by poses, alone and beside a free one."""


@pytest.mark.parametrize(
    ("object_", "motion"),
    [
        *(("cube", "grasp"), ("cube", "carry"), ("laptop", "close"), ("laptop", "carry"), ("drawer", "shut")),
        *(("chest", "lift"), ("peg", "insert"), (DRIVEN, "lift"), (ALONE, "grasp")),
    ],
)
@pytest.mark.quick("cube-carry", "laptop-close", "object_7-lift")
def test_bodies_come_back_as_they_were(tmp_path: Path, object_: str | tuple[str, ...], motion: str) -> None:
    """Carried ones do in the frame that is carried."""
    if isinstance(object_, tuple):
        columns = "time,px,py,pz,qw,qx,qy,qz\n"
        (tmp_path / "poses.csv").write_text(f"{columns}0,0.3,0,0.2,1,0,0,0\n2,0.4,0.1,0.2,0.8,0,0.6,0\n")
        object_ = body_file(tmp_path, *object_)
    written = open_scene(object_, motion, level=1, rate=200.0)
    write_scene_folder(written, tmp_path / "folder")
    read = open_scene(tmp_path / "folder" / "bodies.toml", tmp_path / "folder" / "motion.csv", level=1, rate=200.0)
    carrier = written.hands[0].ticks.object_motion
    assert [body.name for body in read.bodies] == [body.name for body in written.bodies]
    hand = written.hands[0].ticks.seen_from_object().position
    np.testing.assert_allclose(read.hands[0].ticks.position, hand, atol=1e-12)
    for was, one in zip(written.bodies, read.bodies):
        if not isinstance(was, Body):
            assert one == was
            continue
        assert isinstance(one, Body)
        kind = type(was.motion)
        if carrier is not None and isinstance(was.motion, Driven) and was.motion.values is None:
            kind = Fixed
        assert type(one.motion) is kind
        np.testing.assert_allclose(
            [*one.joint.axis, *one.joint.origin] if one.joint else [],
            [*was.joint.axis, *was.joint.origin] if was.joint else [],
            atol=1e-12,
        )
        assert (one.friction, one.torsion) == (was.friction, was.torsion)
        apart = np.linalg.norm(one.placed_mesh.vertices[:, None] - was.placed_mesh.vertices[None], axis=2)
        assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-12
        if isinstance(was.motion, Free) and isinstance(one.motion, Free):
            np.testing.assert_allclose(one.motion.mass, was.motion.mass, rtol=1e-12)
            np.testing.assert_allclose(one.motion.center, was.motion.center, atol=1e-12)
            np.testing.assert_allclose(one.motion.inertia, was.motion.inertia, atol=1e-12)
        if isinstance(was.motion, Driven) and isinstance(one.motion, Driven):
            if was.motion.values is not None and one.motion.values is not None:
                np.testing.assert_allclose(one.motion.values, was.motion.values, atol=1e-12)
                continue
            moved = [of.since(*of.at(0)) for of in (one.motion.poses, was.motion.poses)]
            assert np.ptp(was.motion.poses.position, axis=0).max() > 0.05
            for found, wanted in zip(*moved):
                np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_two_hands_come_back_from_the_folder(tmp_path: Path) -> None:
    of_both = partial(SceneWords, hand="both", level=1, rate=200.0)
    written = load_words(of_both(object="cube", trajectory="lift-both", free=FreeWords(mass=0.5))).placed()
    folder = tmp_path / "folder"
    write_scene_folder(written.scene, folder)
    read = load_words(of_both(object=str(folder / "bodies.toml"), trajectory=str(folder))).placed()
    assert [hand.model.side for hand in read.scene.hands] == ["right", "left"]
    for was, one in zip(written.scene.hands, read.scene.hands, strict=True):
        np.testing.assert_allclose(one.ticks.position, was.ticks.position, atol=1e-12)
        np.testing.assert_allclose(one.ticks.flexion, was.ticks.flexion, atol=1e-12)


@pytest.mark.soak
def test_a_hinge_that_begins_open_comes_back_at_its_value(tmp_path: Path) -> None:
    post = body("post", [0.05, 0.05, 0.3], fixed=True)
    hinge = joint("hinge", [0, 0, 2], on="post", origin=[0.05, 0, 0], limits=[0, 2], start=0.7)
    path = body_file(tmp_path, post, body("leaf", [0.2, 0.01, 0.3], position=[0.2, 0.0, 0.0], mass=0.5, joint=hinge))
    written = open_scene(path, "grasp", level=1)
    write_scene_folder(written, tmp_path / "folder")
    read = open_scene(tmp_path / "folder" / "bodies.toml", tmp_path / "folder" / "motion.csv", level=1)
    was, leaf = written.solids[1], read.solids[1]
    assert was.joint is not None and leaf.joint is not None
    assert (leaf.joint.value, leaf.joint.limits, leaf.joint.on) == (0.7, (0.0, 2.0), "post")
    np.testing.assert_allclose(leaf.joint.axis, [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(leaf.joint.origin, was.joint.origin, atol=1e-12)
    np.testing.assert_allclose(leaf.placed_mesh.bounds, was.placed_mesh.bounds, atol=1e-12)
