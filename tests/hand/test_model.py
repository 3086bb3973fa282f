"""The hand's sizes against their sources, what a hand can do, its mirror, and what a hand file may say."""

import hashlib
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

import hhsim.hand.model
from hhsim.errors import InputError, UnknownNameError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel, default_fingers, format_hand_file
from hhsim.hand.palm_mesh import CENTER_HEIGHT, palm_mesh
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.topology import undirected_edges

IDENTITY = (1.0, 0.0, 0.0, 0.0)
RIGHT = HandModel.default()
LEFT = HandModel.default("left")


def test_lengths_are_the_published_shares() -> None:
    length, radius = RIGHT.length, RIGHT.radius
    middle = 0.19 * np.array([0.277, 0.170, 0.108])
    np.testing.assert_allclose(length[2] + [0.0, 0.0, radius[2, 3]], middle, rtol=1e-12)
    np.testing.assert_allclose((length.sum(axis=1) + radius[:, 3])[0], 0.19 * 0.605, rtol=1e-12)
    # An et al.: proximal to middle phalanx.
    ratios = np.array([2.39 / 1.29, 1.99 / 1.22, 1.90 / 1.21, 2.27 / 1.29])
    np.testing.assert_allclose(length[1:, 0] / length[1:, 1], ratios, rtol=0.02)


def test_hand_length_is_wrist_to_middle_fingertip() -> None:
    joints = RIGHT.joints(np.zeros(3), IDENTITY, np.zeros((5, 3)), np.zeros(5))
    tip = joints[2, 3, 1] + RIGHT.radius[2, 3]
    assert tip - RIGHT.palm_mesh.bounds[0, 1] == pytest.approx(RIGHT.hand_length, rel=0.03)
    assert tip + 0.223 * RIGHT.hand_length == pytest.approx(RIGHT.hand_length, rel=0.005)
    knuckles = RIGHT.base[1:]
    reach = joints[1:, 3, 1] + RIGHT.radius[1:, 3]
    assert int(reach.argmax()) == 1
    assert reach[3] == reach.min()
    assert int(knuckles[:, 1].argmax()) == 0 or knuckles[1, 1] >= knuckles[:, 1].max() - 0.001
    assert int(knuckles[:, 2].argmax()) == 1
    assert (np.diff(knuckles[:, 0]) > 0.0).all()
    # Fingers side by side neither float apart nor lie in each other.
    gap = np.linalg.norm(np.diff(knuckles, axis=0), axis=1) - RIGHT.radius[1:-1, 0] - RIGHT.radius[2:, 0]
    assert (np.abs(gap) < 0.005).all()


def test_left_is_the_mirror() -> None:
    random = np.random.default_rng(1)
    mirror = np.array([-1.0, 1.0, 1.0])
    flexion, abduction = random.uniform(-0.3, 1.5, (5, 3)), random.uniform(-0.3, 0.3, 5)
    position = random.uniform(-1.0, 1.0, 3)
    turn = random.normal(size=4)
    turn /= np.linalg.norm(turn)
    right = RIGHT.joints(position, turn, flexion, abduction)
    # Mirrored in x, a rotation keeps its x part and turns the other way about y and z.
    left = LEFT.joints(position * mirror, turn * np.array([1.0, 1.0, -1.0, -1.0]), flexion, abduction)
    np.testing.assert_allclose(left, right * mirror, atol=1e-15)
    np.testing.assert_array_equal(LEFT.palm_tree.leaf_center, RIGHT.palm_tree.leaf_center * mirror)
    np.testing.assert_array_equal(LEFT.palm_mesh.vertices, RIGHT.palm_mesh.vertices * mirror)
    assert LEFT.palm_mesh.volume == pytest.approx(RIGHT.palm_mesh.volume, rel=1e-12)
    assert LEFT.palm_tree.mesh_sha256 == LEFT.palm_mesh.sha256
    assert RIGHT.palm_tree.mesh_sha256 == RIGHT.palm_mesh.sha256


def test_palm_spheres_cover_the_palm_and_join_the_fingers() -> None:
    center, radius = RIGHT.palm_tree.leaf_center, RIGHT.palm_tree.leaf_radius
    gap = np.linalg.norm(RIGHT.palm_mesh.vertices[:, None] - center, axis=2) - radius
    assert gap.min(axis=1).max() <= 1e-9
    for finger in range(5):
        to_spheres = np.linalg.norm(RIGHT.base[finger] - center, axis=1) - radius
        assert to_spheres.min() < 0.0, FINGERS[finger]
    # Spheres stand out of the palm by less than a finger's radius.
    assert RIGHT.palm_tree.errors[-1].protrusion_max < RIGHT.radius[1:, 0].min()


def written(folder: Path, text: str) -> Path:
    path = folder / "hand.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_example_of_the_docstring_is_a_hand(tmp_path: Path) -> None:
    block = re.search(r"mirror::\n\n((?:    .*\n|\n)+)", hhsim.hand.model.__doc__)
    text = "".join(line.removeprefix("    ") for line in block[1].splitlines(keepends=True))
    hand = HandModel.from_toml(written(tmp_path, text))
    assert (hand.hand_length, hand.hand_breadth) == (0.18, 0.080)
    np.testing.assert_array_equal(hand.base[1], [-0.026, 0.041, 0.003])
    np.testing.assert_array_equal(hand.radius[1], [0.009, 0.0085, 0.0075, 0.006])
    assert hand.abduction_max[1] == 0.73
    others = default_fingers(0.18, 0.080)
    np.testing.assert_array_equal(hand.length[2:], others["length"][2:])


def test_directions_of_a_file_are_made_orthonormal(tmp_path: Path) -> None:
    hand = HandModel.from_toml(written(tmp_path, "[middle]\ndistal = [0.0, 2.0, 0.0]\ndorsal = [0.0, 1.0, 1.0]"))
    np.testing.assert_allclose(hand.distal[2], [0.0, 1.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(hand.dorsal[2], [0.0, 0.0, 1.0], atol=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('<?xml version="1.0"?>\n<robot name="r"/>', "a URDF, which is of a robot's hand"),
        ("<mujoco/>", "a MJCF, which is of a robot's hand"),
        ("hand_length = 190.0", "hand_length = 190.0; expected a number from 0.05 to 0.4 m"),
        ("hand_breadth = 0.5", "hand_breadth = 0.5; expected 0.0475 to"),
        ("palm_level = 9", "palm_level = 9; expected a whole number from 1 to 5"),
        ("[index]\nlength = [0.05, 0.03]", "index.length = [0.05, 0.03]; expected a list of 3"),
        ("[index]\nbase = [1e300, 0, 0]", "index.base[1] = 1e+300; expected a number from -0.5 to 0.5 m"),
        ("[ring]\nradius = [0.01, 0.009, 0.008, -0.007]", "ring.radius[4] = -0.007; expected a number from 0.0001"),
        ("[ring]\nradius = [0.008, 0.009, 0.008, 0.007]", "ring: radius = [0.008, 0.009, 0.008, 0.007]: must not grow"),
        ("[thumb]\nflexion_min = [1.0, 0.0, 0.0]", "thumb.flexion_min [1, 0, 0] must lie below flexion_max"),
        ("[little]\nabduction_max = -2.0", "little.abduction_min -0.698132 must lie below abduction_max -2"),
        ("[middle]\ndorsal = [0.0, 1.0, 0.0]", "middle.distal [0, 1, 0] and middle.dorsal [0, 1, 0]: expected two"),
        ("[middle]\ndistal = [0.0, 0.0, 0.0]", "middle.distal [0, 0, 0] and middle.dorsal"),
        ("\n".join(f"[{finger}]\nbase = [0, 0, 0.3]" for finger in FINGERS), "the finger bases leave the palm's"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(InputError) as caught:
        HandModel.from_toml(path)
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_missing_file_and_unknown_side() -> None:
    with pytest.raises(InputError, match=r"nowhere\.toml: no such file"):
        HandModel.from_toml("nowhere.toml")
    with pytest.raises(UnknownNameError, match="unknown hand side 'rigth': did you mean right"):
        HandModel.default("rigth")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("flexion", "words"),
    [
        (np.zeros((3, 5)), r"flexion has shape \(3, 5\): expected \(5, 3\)"),
        (np.full((5, 3), np.nan), "flexion .*: expected finite"),
        ([["x"]], "flexion is .*: expected numbers"),
    ],
)
def test_joints_refuse_other_arrays(flexion: ArrayLike, words: str) -> None:
    with pytest.raises(InputError, match=words):
        RIGHT.joints(np.zeros(3), IDENTITY, flexion, np.zeros(5))


def test_a_sphere_of_a_group_encloses_the_spheres_of_the_group() -> None:
    hand = RIGHT.arrays()
    center = np.stack([hand.palm_x, hand.palm_y, hand.palm_z])
    assert hand.palm_group_start[0] == 0 and hand.palm_group_start[-1] == len(hand.palm_radius)
    for group, (first, last) in enumerate(zip(hand.palm_group_start, hand.palm_group_start[1:])):
        assert first < last
        away = np.linalg.norm(center[:, first:last] - hand.palm_group[:3, group, None], axis=0)
        assert (away + hand.palm_radius[first:last]).max() <= hand.palm_group[3, group] + 1e-12
    np.testing.assert_array_equal(hand.palm_box.min(axis=0), center.min(axis=1))
    np.testing.assert_array_equal(hand.palm_box.max(axis=0), center.max(axis=1))
    assert len(np.unique(hand.palm_box, axis=0)) == 8


def test_joints_are_those_of_the_model() -> None:
    rng = np.random.default_rng(0)
    position = rng.normal(size=(4, 3))
    orientation = Rotation.random(4, rng=1).as_quat(scalar_first=True)
    flexion, abduction = rng.uniform(0.0, 1.0, (4, 5, 3)), rng.uniform(-0.1, 0.1, (4, 5))
    placed = forward_kinematics(RIGHT, position, orientation, flexion, abduction)
    for t, pose in enumerate(zip(position, orientation, flexion, abduction)):
        assert np.array_equal(placed.joints[t], RIGHT.joints(*pose))
    assert np.array_equal(placed.points[:, 20], position)
    assert np.array_equal(placed.points[2, 7], placed.joints[2, 1, 3])
    assert np.array_equal(placed.ends[1, :5], placed.joints[1, :, 3])
    assert np.array_equal(placed.ends[1, 5], position[1])


def test_a_hand_is_read_as_it_was_written(tmp_path: Path) -> None:
    hand = HandModel.default(hand_length=0.175)
    keys = ("base", "distal", "dorsal", "length", "radius", "flexion_min", "abduction_max")
    fingers = {finger: {key: getattr(hand, key)[f] for key in keys} for f, finger in enumerate(FINGERS)}
    text = format_hand_file(hand.hand_length, hand.hand_breadth, fingers, "a remark\nof two lines")
    assert text.startswith("# a remark of two lines\nhand_length = 0.175\n") and text.isascii()
    again = HandModel.from_toml(written(tmp_path, text))
    for key in keys:
        assert np.abs(getattr(again, key) - getattr(hand, key)).max() < 1e-6, key
    assert again.hand_breadth == round(hand.hand_breadth, 6)


LENGTH, BREADTH = 0.19, 0.085


def palm(length: float = LENGTH, breadth: float = BREADTH) -> Mesh:
    fingers = default_fingers(length, breadth)
    return palm_mesh(length, breadth, fingers["base"][1:], fingers["radius"][1:, 0])


@given(st.floats(0.05, 0.4), st.floats(0.36, 0.55))
@settings(max_examples=12)
def test_closed_and_star_shaped_at_any_size(length: float, share: float) -> None:
    mesh = palm(length, share * length)
    _, count, balance = undirected_edges(mesh.faces)
    assert (count == 2).all() and not balance.any()
    assert len(mesh.vertices) - len(count) + len(mesh.faces) == 2
    # Every triangle turns its back to the middle: no two of them can overlap.
    middle = np.array([0.0, 0.0, CENTER_HEIGHT * share * length])
    assert (np.linalg.det(mesh.triangles - middle) > 0.0).all()
    assert 1000 <= len(mesh.faces) <= 3000


def test_the_default_palm_has_the_same_bits_on_every_machine() -> None:
    assert hashlib.sha256(palm().vertices.tobytes()).hexdigest().startswith("f3ac66c6f5c58545")
