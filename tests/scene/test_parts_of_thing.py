"""Things of several parts as scenes: meshes, trees, poses in the scene, and faults told in one line."""

from pathlib import Path

import numpy as np
import pytest

from hhsim.errors import HhsimError, InputError
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.catalogue import names_a_body_file, body_file_names
from hhsim.scene.jointed_thing import JointedThing
from hhsim.scene.motion_catalogue import resolve_trajectory
from hhsim.scene.parts_of_thing import box_mesh, load_thing, require_no_joints
from hhsim.scene.scene import open_scene
from hhsim.scene.things import names_things

BOOK = """[[part]]
name = "back"
box = [0.1, 0.1, 0.01]

[[part]]
name = "front"
box = [0.1, 0.1, 0.01]
position = [0.0, 0.0, {height}]
parent = "back"
joint.type = "slider"
joint.axis = [0.0, 0.0, 1.0]
joint.limits = [0.0, 0.1]
joint.motion = [[0.0, 0.0], [1.0, 0.05]]
"""
FAULTS = {
    "overlap": (BOOK.format(height=0.007), "part 'front' begins 3 mm inside part 'back'; expected at most 1 mm"),
    "crossing": (
        # No corner of one is in the other.
        BOOK.format(height=0.0).replace("[0.1, 0.1, 0.01]", "[0.3, 0.01, 0.01]", 1),
        "begins 10 mm inside part",
    ),
    "no shape": (BOOK.format(height=0.01).replace("box = [0.1, 0.1, 0.01]\n", "", 1), "no mesh and no box"),
    "two shapes": (BOOK.format(height=0.01).replace("box =", 'mesh = "cube"\nbox =', 1), "both a mesh and a box"),
    "missing mesh": (BOOK.format(height=0.01).replace("box = [0.1, 0.1, 0.01]", 'mesh = "b.ply"', 1), "b.ply"),
    "size": (BOOK.format(height=0.01).replace("[0.1, 0.1, 0.01]", "[0.1, 0.1, 0.0]", 1), "box[3]"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_one_line_that_names_the_file_and_what_is_wrong(fault: str, tmp_path: Path) -> None:
    text, expected = FAULTS[fault]
    path = tmp_path / "book.toml"
    path.write_text(text)
    with pytest.raises(HhsimError) as told:
        load_thing(path)
    assert expected in str(told.value)
    assert str(path) in str(told.value)
    assert "\n" not in str(told.value)


def test_joints_that_a_script_moves_are_those_of_the_thing() -> None:
    close = resolve_trajectory("close")
    with pytest.raises(InputError, match="close moves the joint lid; cube has none"):
        require_no_joints(close, "cube")
    with pytest.raises(HhsimError, match="lid"):
        load_thing("book", close)


def test_the_catalogue_has_things_that_open_and_close() -> None:
    jointed = [name for name in body_file_names() if not names_things(name)]
    assert jointed == ["book", "laptop", "scissors"]
    assert names_a_body_file("laptop")
    assert names_a_body_file("my/thing.toml")
    assert not names_a_body_file("cube")
    for name in jointed:
        assert load_thing(name).mesh.volume > 0.0


def test_parts_are_where_their_joints_bring_them_in_the_scene() -> None:
    scene = open_scene("laptop", "open", solid=False, level=2)
    parts = scene.parts
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
    assert scene.mesh.vertices == pytest.approx(corners, abs=1e-12)
    assert scene.tree.leaf_count == sum(tree.leaf_count for tree in parts.trees)


def test_values_beyond_the_limits_are_told() -> None:
    thing = load_thing("laptop").thing
    assert isinstance(thing, JointedThing)
    with pytest.raises(InputError, match=r"joint lid: motion\[1\] has the value 3, beyond the limits"):
        thing.moved({"lid": [(0.0, 3.0)]})


def test_a_box_is_closed_and_wound_outward() -> None:
    assert box_mesh((1.0, 2.0, 3.0)).volume == pytest.approx(6.0)
