"""Meshes in each other, by the scene's way and by the referee's: against boxes' separating axes, and known shapes."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.shapes import box_mesh
from hhsim.scene.declared_bodies import load_object
from hhsim.scene.overlap import Solid, overlap
from hhsim.verify.free_object_checks import _Solid

FALSE_DEPTH = 1e-12
"""Rounding of a depth [m]."""
SHARE = 0.25
"""Least share of a depth that is found of boxes in each other."""


def of_scene(one: Mesh, two: Mesh) -> float:
    return overlap(Solid(one), Solid(two))


def of_referee(one: Mesh, two: Mesh) -> float:
    here, there = _Solid(one), _Solid(two)
    still = np.eye(3)[None], np.zeros((1, 3))
    return float(max(here.depths_of(there, *still)[0], there.depths_of(here, *still)[0]))


WAYS = pytest.mark.parametrize("depth", [of_scene, of_referee])


def shift_of_boxes(one: Mesh, two: Mesh) -> float:
    """Least shift that takes two boxes apart [m], along the axes that separate boxes; negative apart."""
    corners = one.vertices, two.vertices
    edges = [[at[4] - at[0], at[2] - at[0], at[1] - at[0]] for at in corners]
    axes = [*edges[0], *edges[1], *(np.cross(a, b) for a in edges[0] for b in edges[1])]
    least = np.inf
    for axis in axes:
        if np.linalg.norm(axis) > 1e-12:
            here, there = (at @ axis / np.linalg.norm(axis) for at in corners)
            least = min(least, here.max() - there.min(), there.max() - here.min())
    return float(least)


def turned_boxes(rng: np.random.Generator) -> tuple[Mesh, Mesh]:
    """Two boxes anywhere near each other."""
    one, two = (
        box_mesh(rng.uniform(0.002, 0.1, 3).tolist()).transformed(
            Rotation.random(random_state=rng).as_matrix(), 0.02 * rng.normal(size=3)
        )
        for _ in range(2)
    )
    return one, two


def boxes_that_touch(rng: np.random.Generator) -> tuple[Mesh, Mesh]:
    """Two boxes that enter each other by 10 µm to 3 mm with a face each."""
    (a, b), depth, turn = rng.uniform(0.01, 0.1, (2, 3)), 10.0 ** rng.uniform(-5.0, -2.5), Rotation.random(None, rng)
    place = [0.5 * (a[0] + b[0]) - depth, *rng.uniform(-0.01, 0.01, 2)]
    one, two = box_mesh(a), box_mesh(b).transformed(np.eye(3), place)
    return one.transformed(turn.as_matrix(), np.zeros(3)), two.transformed(turn.as_matrix(), np.zeros(3))


@WAYS
@pytest.mark.parametrize("made", [turned_boxes, boxes_that_touch])
def test_no_more_is_found_than_separates_boxes_and_always_a_share_of_it(
    made: Callable[[np.random.Generator], tuple[Mesh, Mesh]], depth: Callable[[Mesh, Mesh], float]
) -> None:
    rng, deep = np.random.default_rng(3), 0
    for _ in range(10):
        pair = made(rng)
        wanted, found = shift_of_boxes(*pair), depth(*pair)
        assert found <= max(wanted, 0.0) + FALSE_DEPTH
        if wanted > FALSE_DEPTH:
            deep += 1
            assert found > (0.999 if made is boxes_that_touch else SHARE) * wanted
    assert deep >= 4


def solid(shape: trimesh.Trimesh, place: ArrayLike = (0.0, 0.0, 0.0)) -> Mesh:
    return Mesh(shape.vertices + np.asarray(place), np.asarray(shape.faces), name="solid")


PLATE, CROSSED = box_mesh([2.0, 3e-5, 2.0]), np.array([0.0153, 0.011, 0.0])
RING = solid(trimesh.creation.annulus(0.0101, 0.02, 0.03, sections=24))
NUT = solid(trimesh.creation.annulus(0.0101, 0.02, 0.03, sections=6))
KNOWN: dict[str, tuple[Mesh, Mesh, float, float]] = {
    # Two meshes, and between what their depth is [m].
    "one in the middle of another": (box_mesh([0.1] * 3), solid(trimesh.creation.icosphere(1, 0.01)), 0.049, 0.06),
    "one in its own place": (NUT, NUT, 0.004, 0.01),
    "thin plates that cross": (PLATE, box_mesh([3e-5, 2.0, 2.0]).transformed(np.eye(3), CROSSED), 0.01, 1.0),
    "a peg in a hole": (RING, solid(trimesh.creation.cylinder(0.01, 0.05, 24)), 0.0, 0.0),
    "a peg too thick for it by 0.1 mm": (RING, solid(trimesh.creation.cylinder(0.0102, 0.05, 24)), 5e-5, 2e-4),
    "a sheet through a block": (
        Mesh(np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.5, 0.0]]), np.array([[0, 1, 2]])),
        box_mesh([0.02] * 3),
        0.009,
        0.011,
    ),
}


@WAYS
@pytest.mark.parametrize("name", KNOWN)
def test_shapes_whose_depth_is_known(name: str, depth: Callable[[Mesh, Mesh], float]) -> None:
    one, two, least, most = KNOWN[name]
    for given in ((one, two), (two, one)):
        assert least <= depth(*given) <= most + FALSE_DEPTH


@pytest.mark.parametrize(
    ("name", "depth"), [("identical", 50), ("cross", 20), ("cross2", 19), ("half", 25), ("plates", 700)]
)
def test_scenes_whose_bodies_are_in_each_other_are_refused(
    shared_data: Path, name: str, depth: float, tmp_path: Path
) -> None:
    path = tmp_path / f"{name}.toml"
    path.write_text((shared_data / "field" / "overlap" / path.name).read_text().replace("[[thing]]", "[[body]]"))
    with pytest.raises(
        InputError, match=rf"body 'b' begins in body 'a': a shift of {depth:g} mm .*; expected at most 0.1 mm"
    ):
        load_object(path)


def test_bodies_that_touch_are_apart() -> None:
    # As near as rounding has it, at the sizes and places that scenes have.
    found: list[float] = []
    for edge in (0.01, 0.1, 0.3, 1.0 / 3.0):
        turn: FloatArray = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
        pair = [box_mesh([edge] * 3).transformed(turn, turn @ [0.1 + k * edge, 0.2, 0.3]) for k in range(2)]
        found += [of_scene(*pair), of_referee(*pair)]
    assert max(found) < FALSE_DEPTH
