"""Named parts of objects: the shapes by closed form, and that the shipped regions are where their names say."""

import numpy as np
import pytest

from hhsim.errors import InputError, UnknownNameError
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.scene.object_regions import Region, Shapes, object_region, object_regions
from hhsim.system.settings_file import typed

RANDOM = np.random.default_rng(7)
POINTS = RANDOM.uniform(-1.0, 1.0, (4000, 3))

NAMED = [(name, region) for name in object_names() for region in object_regions(name)]


def holds(*shapes: object) -> np.ndarray:
    return Region("part", typed(list(shapes), Shapes, "x.toml")).holds(POINTS)


def test_a_box_holds_what_is_between_its_corners() -> None:
    expected = [all(low <= v <= high for v, low, high in zip(p, (-0.5, 0, -1), (0.5, 1, 0.2))) for p in POINTS]
    assert np.array_equal(holds({"box": [[-0.5, 0.0, -1.0], [0.5, 1.0, 0.2]]}), expected)


def test_a_sphere_holds_what_is_near_its_centre() -> None:
    expected = ((POINTS - [0.2, 0.0, -0.3]) ** 2).sum(axis=1) <= 0.49
    assert np.array_equal(holds({"sphere": [0.2, 0.0, -0.3], "radius": 0.7}), expected)


def test_a_tapered_cylinder_along_z_holds_what_is_nearer_to_its_axis_than_its_radius_there() -> None:
    x, y, z = POINTS.T
    expected = (z >= -0.5) & (z <= 0.5) & (np.hypot(x - 0.1, y) <= 0.6 + 0.4 * (z + 0.5))
    shape = {"cylinder": [[0.1, 0.0, -0.5], [0.1, 0.0, 0.5]], "radius": [0.6, 1.0]}
    assert np.array_equal(holds(shape), expected)
    assert np.array_equal(holds(shape | {"outside": True}), ~expected)


def test_a_region_is_what_all_of_its_shapes_hold() -> None:
    box, ball = {"box": [[-1, -1, 0], [1, 1, 1]]}, {"sphere": [0, 0, 0], "radius": 0.5}
    assert np.array_equal(holds(box, ball), holds(box) & holds(ball))


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        ([], "expected a list such as"),
        ({"box": 1}, "expected a list such as"),
        ([{"cone": [0, 0, 0]}], "unknown key 'cone': did you mean cylinder"),
        ([{"box": [[0, 0, 0], [1, 1]]}], r"\[1\].box\[2\] = \[1, 1\]; expected a list of 3"),
        ([{"box": [[0, 0, 0], [1, 1, "x"]]}], r"\[1\].box\[2\]\[3\] = 'x'; expected a number"),
        ([{"box": [[1, 0, 0], [0, 1, 1]]}], "holds no point"),
        ([{"box": [[0, 0, 0], [1, 1, 1]], "radius": 1}], "expected a box, a cylinder and its radius"),
        ([{"sphere": [0, 0, 0]}], "a sphere and its radius"),
        ([{"sphere": [0, 0, 0], "radius": -1}], "radius = -1; expected"),
        ([{"sphere": [0, 0, float("nan")], "radius": 1}], r"sphere\[3\] = nan; expected a number"),
        ([{"cylinder": [[0, 0, 0], [0, 0, 0]], "radius": [1, 1]}], "two different ends"),
    ],
)
def test_what_is_no_region_is_refused(shapes: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        typed(shapes, Shapes, "x.toml")


@pytest.mark.parametrize(("name", "region"), NAMED)
def test_every_shipped_region_holds_some_of_the_surface_and_not_most_of_it(name: str, region: str) -> None:
    triangles = load_object(name).mesh.triangles
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    share = area[object_region(name, region).holds(triangles.mean(axis=1))].sum() / area.sum()
    assert 0.005 < share < 0.75


@pytest.mark.parametrize(
    ("name", "one", "other"),
    [
        ("bunny", "ear_left", "ear_right"),
        ("bunny", "ear_left", "head"),
        ("bunny", "ear_right", "head"),
        ("bunny", "head", "body"),
        ("cup", "inside", "outside"),
        ("cup", "handle", "outside"),
        ("cup", "handle", "rim"),
        ("teapot", "spout", "edge"),
        ("teapot", "spout", "handle"),
        ("teapot", "knob", "edge"),
        ("shamrock", "leaf_right", "leaf_left"),
        ("shamrock", "leaf_right", "stem"),
        ("shamrock", "leaf_top", "leaf_right"),
        ("rock", "front", "rear"),
        ("rock", "upper", "lower"),
    ],
)
def test_parts_that_are_apart_share_no_surface(name: str, one: str, other: str) -> None:
    triangles = load_object(name).mesh.triangles
    weights = RANDOM.dirichlet((1.0, 1.0, 1.0), len(triangles))
    points = np.concatenate([triangles.reshape(-1, 3), np.einsum("tk,tki->ti", weights, triangles)])
    regions = object_regions(name)
    assert not (regions[one].holds(points) & regions[other].holds(points)).any()


def test_an_unknown_region_lists_the_near_ones() -> None:
    with pytest.raises(UnknownNameError, match="unknown region of the bunny 'ear': did you mean"):
        object_region("bunny", "ear")
