"""Demanded touches: reading them, and their distances against other ways to compute them."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sphere_scenes import object_tree

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, UnknownNameError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.metrics.brute_force_distance import round_cone_contact, round_cone_distance, sphere_contact
from hhsim.scene.contact_goals import (
    Region,
    Touch,
    TouchTable,
    holds,
    object_region,
    object_regions,
    touch_distances,
    touches_of,
)
from hhsim.scene.finger_closure import body_distances, make_work
from hhsim.system.settings_file import typed

HAND = HandModel.default()
TREE, COARSE = object_tree("cup", 3), object_tree("cup", 2)

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
    work = make_work(HAND.arrays(), TREE.arrays())
    distance = body_distances(position, rotation, flexion, np.zeros(5), work)
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
            if holds(object_region("cup", "inside"), places)[0]:
                best = min(best, float(distance[0]))
    assert found == pytest.approx(best, abs=1e-12)
    (anywhere,) = touch_distances([Touch("middle")], "cup", HAND, coarse, joints, position, rotation)
    assert anywhere <= found


RANDOM = np.random.default_rng(7)
POINTS = RANDOM.uniform(-1.0, 1.0, (4000, 3))

NAMED = [(name, region) for name in object_names() for region in object_regions(name)]


def held(*shapes: object) -> np.ndarray:
    return holds(typed(list(shapes), Region, "x.toml"), POINTS)


def test_a_box_holds_what_is_between_its_corners() -> None:
    expected = [all(low <= v <= high for v, low, high in zip(p, (-0.5, 0, -1), (0.5, 1, 0.2))) for p in POINTS]
    assert np.array_equal(held({"box": [[-0.5, 0.0, -1.0], [0.5, 1.0, 0.2]]}), expected)


def test_a_sphere_holds_what_is_near_its_centre() -> None:
    expected = ((POINTS - [0.2, 0.0, -0.3]) ** 2).sum(axis=1) <= 0.49
    assert np.array_equal(held({"sphere": [0.2, 0.0, -0.3], "radius": 0.7}), expected)


def test_a_tapered_cylinder_along_z_holds_what_is_nearer_to_its_axis_than_its_radius_there() -> None:
    x, y, z = POINTS.T
    expected = (z >= -0.5) & (z <= 0.5) & (np.hypot(x - 0.1, y) <= 0.6 + 0.4 * (z + 0.5))
    shape = {"cylinder": [[0.1, 0.0, -0.5], [0.1, 0.0, 0.5]], "radius": [0.6, 1.0]}
    assert np.array_equal(held(shape), expected)
    assert np.array_equal(held(shape | {"outside": True}), ~expected)


def test_a_region_is_what_all_of_its_shapes_hold() -> None:
    box, ball = {"box": [[-1, -1, 0], [1, 1, 1]]}, {"sphere": [0, 0, 0], "radius": 0.5}
    assert np.array_equal(held(box, ball), held(box) & held(ball))


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        ([], "expected a list such as"),
        ([{"cone": [0, 0, 0]}], "unknown key 'cone': did you mean cylinder"),
        ([{"box": [[1, 0, 0], [0, 1, 1]]}], "holds no point"),
        ([{"box": [[0, 0, 0], [1, 1, 1]], "radius": 1}], "expected a box, a cylinder and its radius"),
        ([{"sphere": [0, 0, 0]}], "a sphere and its radius"),
        ([{"cylinder": [[0, 0, 0], [0, 0, 0]], "radius": [1, 1]}], "two different ends"),
    ],
)
def test_what_is_no_region_is_refused(shapes: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        typed(shapes, Region, "x.toml")


@pytest.mark.parametrize(("name", "region"), NAMED)
def test_every_shipped_region_holds_some_of_the_surface_and_not_most_of_it(name: str, region: str) -> None:
    triangles = load_object(name).mesh.triangles
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    share = area[holds(object_region(name, region), triangles.mean(axis=1))].sum() / area.sum()
    assert 0.005 < share < 0.75


def test_an_unknown_region_lists_the_near_ones() -> None:
    with pytest.raises(UnknownNameError, match="unknown region of the bunny 'ear': did you mean"):
        object_region("bunny", "ear")
