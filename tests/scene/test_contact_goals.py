"""Demanded touches: reading them, and their distances against other ways to compute them."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, UnknownNameError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.mesh.catalogue import load_object
from hhsim.metrics.brute_force_distance import round_cone_contact, round_cone_distance, sphere_contact
from hhsim.scene.contact_goals import Touch, TouchTable, touch_distances, touches_of
from hhsim.scene.finger_closure import body_distances, make_work
from hhsim.scene.object_regions import object_region
from hhsim.system.settings_file import typed
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions

HAND = HandModel.default()
TREE = cached_sphere_tree(load_object("cup").mesh, TreeOptions(level=3))
COARSE = cached_sphere_tree(load_object("cup").mesh, TreeOptions(level=2))

coordinate = st.floats(-0.05, 0.05)
point = st.tuples(coordinate, coordinate, coordinate).map(np.array)


def test_a_table_names_a_region_or_several() -> None:
    found = touches_of({"thumb": "handle", "index": ("inside", "rim"), "palm": "anywhere"})
    assert found == (Touch("thumb", "handle"), Touch("index", "inside"), Touch("index", "rim"), Touch("palm"))
    assert [str(touch) for touch in found] == ["thumb at handle", "index at inside", "index at rim", "palm"]


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("handle", "expected a table"),
        ({"pinky": "handle"}, "unknown key 'pinky'"),
        ({"thumb": 3}, "expected the name of a region, or several"),
        ({"thumb": []}, "expected the name of a region, or several"),
        ({"thumb": ["handle", ""]}, r"thumb\[2\] = ''"),
    ],
)
def test_what_is_no_touch_is_refused(table: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        typed(table, TouchTable, "x")


@given(point, point, st.floats(0.004, 0.02), st.floats(0.0, 1.0), point, st.floats(0.0, 0.01))
def test_the_contact_point_lies_on_the_leaf_and_as_far_from_the_hull_as_stated(
    a: FloatArray, b: FloatArray, thick: float, share: float, leaf: FloatArray, radius: float
) -> None:
    length = float(np.linalg.norm(b - a))
    thin = thick - share * min(thick, 0.9 * length)
    if length < 1e-3:
        b = a + [0.01, 0.0, 0.0]
    s = np.linspace(0.0, 1.0, 20001)
    places = a + s[:, None] * (b - a)
    # A leaf that is centred on the axis is as near to all sides.
    assume(np.linalg.norm(leaf - places, axis=1).min() > 1e-3)
    leaves, radii = leaf[None], np.array([radius])
    distance, points = round_cone_contact(leaves, radii, a, b, thick, thin)
    assert distance[0] == round_cone_distance(leaves, a, b, thick, thin)[0] - radius
    assert np.linalg.norm(points[0] - leaf) == pytest.approx(radius, abs=1e-9)
    # Distance along a straight way to the nearest place falls one to one.
    away = np.linalg.norm(leaf - places, axis=1) - (thick + s * (thin - thick))
    if distance[0] > 1e-6 and radius > 1e-6:
        assert np.linalg.norm(points[0] - places[away.argmin()]) - (
            thick + s[away.argmin()] * (thin - thick)
        ) == pytest.approx(distance[0], abs=1e-6)


def test_a_sphere_meets_a_leaf_on_the_line_between_the_centres() -> None:
    leaves, radii = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]]), np.array([0.5, 1.0])
    distance, points = sphere_contact(leaves, radii, np.array([2.0, 0.0, 0.0]), 0.25)
    assert distance == pytest.approx([1.25, np.sqrt(17.0) - 1.25])
    assert points[0] == pytest.approx([0.5, 0.0, 0.0])
    assert np.linalg.norm(points[1] - [2.0, 0.0, 0.0]) == pytest.approx(np.sqrt(17.0) - 1.0)
    distance, points = sphere_contact(leaves[:1], radii[:1], np.zeros(3), 0.25)
    assert distance[0] == -0.75 and np.array_equal(points[0], np.zeros(3))


def pose(seed: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Near the cup: position, rotation, flexion and the distance of each body by the tree."""
    random = np.random.default_rng(seed)
    rotation = np.ascontiguousarray(Rotation.random(rng=random).as_matrix())
    position, flexion = random.uniform(-0.1, 0.1, 3), random.uniform(0.0, 1.0, (5, 3))
    work = make_work()
    distance = body_distances(HAND.arrays(), TREE.arrays(), position, rotation, flexion, np.zeros(5), work)
    return position, rotation, work.joints.copy(), distance


@pytest.mark.parametrize("seed", range(6))
def test_anywhere_is_the_least_distance_that_the_tree_finds(seed: int) -> None:
    position, rotation, joints, distance = pose(seed)
    touches = [*(Touch(finger) for finger in FINGERS), Touch("palm")]
    found = touch_distances(touches, "cup", HAND, TREE, joints, position, rotation)
    fingers = distance[:PALM_BODY].reshape(5, 3).min(axis=1)
    assert found == pytest.approx([*fingers, distance[PALM_BODY]], abs=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_a_region_counts_only_leaves_that_would_be_touched_within_it(seed: int) -> None:
    position, rotation, joints, _ = pose(seed)
    touch, coarse = Touch("middle", "inside"), COARSE
    (found,) = touch_distances([touch], "cup", HAND, coarse, joints, position, rotation)
    best = np.inf
    for k in range(3):
        for center, radius in zip(coarse.leaf_center, coarse.leaf_radius):
            distance, places = round_cone_contact(
                center[None], np.array([radius]), joints[2, k], joints[2, k + 1], *HAND.radius[2, k : k + 2]
            )
            if object_region("cup", "inside").holds(places)[0]:
                best = min(best, float(distance[0]))
    assert found == pytest.approx(best, abs=1e-12)
    (anywhere,) = touch_distances([Touch("middle")], "cup", HAND, coarse, joints, position, rotation)
    assert anywhere <= found


def test_a_region_that_the_object_lacks_is_refused() -> None:
    position, rotation, joints, _ = pose(0)
    with pytest.raises(UnknownNameError, match="unknown region of the cup 'spout'"):
        touch_distances([Touch("thumb", "spout")], "cup", HAND, TREE, joints, position, rotation)
