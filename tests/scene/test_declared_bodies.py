"""Bodies of a file as scenes: meshes, trees, poses in the scene, and faults told in one line."""

from types import SimpleNamespace

import numpy as np
import pytest

from hhsim.errors import HhsimError, InputError
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.catalogue import body_file_names, names_a_body_file
from hhsim.mesh.shapes import box_mesh
from hhsim.scene.declared_bodies import load_object
from hhsim.scene.motion_catalogue import resolve_trajectory
from hhsim.scene.scene import open_scene
from hhsim.solver.scene_solver import seen_scene


def test_joints_that_a_script_moves_are_those_of_the_bodies() -> None:
    close = resolve_trajectory("close")
    with pytest.raises(InputError, match="close moves the joint lid; cube has none"):
        load_object("cube", close)
    with pytest.raises(HhsimError, match="lid"):
        load_object("book", close)


def test_the_catalogue_has_bodies_that_open_and_close_and_others_that_are_free() -> None:
    assert names_a_body_file("laptop")
    assert names_a_body_file("my/bodies.toml")
    assert not names_a_body_file("cube")
    loaded = {name: load_object(name) for name in body_file_names()}
    driven = [name for name, bodies in loaded.items() if not any(body.is_free for body in bodies.settings)]
    assert driven == ["book", "laptop", "scissors"]
    assert sorted(loaded.keys() - driven) == ["blocks", "chest", "door", "drawer", "peg", "pot"]
    assert all(bodies.mesh.volume > 0.0 and len(bodies.meshes) > 1 for bodies in loaded.values())


def test_bodies_are_where_their_joints_bring_them_in_the_scene() -> None:
    scene = open_scene("laptop", "open", solid=False, level=2)
    seen = seen_scene(scene)
    parts = seen.parts
    assert parts is not None
    lid = parts.values["lid"]
    assert parts.path.shape == (scene.ticks.tick_count, 2, 7)
    assert lid[0] == 0.35
    turned = rotation_matrix(parts.path[:, 1, 3:])[:, 2]
    assert turned[:, 1] == pytest.approx(-np.sin(lid), abs=1e-12)
    still = np.flatnonzero(np.diff(lid) == 0.0)
    assert np.array_equal(parts.path[still], parts.path[still + 1])
    # Mesh and tree of the scene are those of the first tick.
    first = [rotation_matrix(pose[None, 3:])[0] @ mesh.vertices.T for pose, mesh in zip(parts.path[0], parts.meshes)]
    corners = np.concatenate([turned.T + pose[:3] for turned, pose in zip(first, parts.path[0])])
    assert seen.mesh.vertices == pytest.approx(corners, abs=1e-12)
    assert seen.tree.leaf_count == sum(tree.leaf_count for tree in parts.trees)


def test_values_beyond_the_limits_are_told() -> None:
    script = SimpleNamespace(name="", joints=(("lid", ((0.0, 3.0),)),))
    with pytest.raises(InputError, match=r"joint lid: motion\[1\] has the value 3, beyond the limits"):
        load_object("laptop", script)


def test_a_box_is_closed_and_wound_outward() -> None:
    assert box_mesh((1.0, 2.0, 3.0)).volume == pytest.approx(6.0)
