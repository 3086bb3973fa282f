"""Features of meshes: whose they are, which are left out and why, and meshes that are no neat surface."""

import numpy as np
import pytest
import trimesh

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.mesh.features import mesh_features

TRIANGLE = np.array([[0.0, 0.0, 0.0], [0.04, 0.0, 0.0], [0.0, 0.03, 0.0]])


def owned(owner: IntArray) -> list[int]:
    return sorted(owner[owner >= 0].tolist())


def test_of_triangles_on_the_same_corners_one_is_kept() -> None:
    place = np.concatenate([TRIANGLE, [[-0.0, 0.0, -0.0], [0.0, 0.0, 1.0]]])
    # The last names its corners by other vertices at the same places, one of them with zeros below zero.
    mesh, repeated = mesh_features(place, np.array([[0, 1, 2], [2, 0, 1], [1, 0, 2], [3, 1, 2]]), closed=False)
    assert repeated == 3
    alone, _ = mesh_features(TRIANGLE, np.array([[0, 1, 2]]), closed=False)
    np.testing.assert_array_equal(mesh.corner, alone.corner)
    np.testing.assert_array_equal(mesh.face, alone.face)
    assert len(owned(mesh.face_edge)) == len(owned(mesh.face_vertex)) == 3
    # What no face uses is nowhere to be touched.
    assert not (mesh.vertex[owned(mesh.face_vertex)] == [0.0, 0.0, 1.0]).all(axis=1).any()


def test_triangles_without_area_alone_are_refused() -> None:
    place = np.concatenate([TRIANGLE, [[0.02, 0.0, 0.0]]])
    with pytest.raises(MeshError, match="none of 2 triangles has an area"):
        mesh_features(place, np.array([[0, 3, 1], [2, 2, 1]]), closed=False)


def box(size: float = 0.04, away: float = 0.0) -> tuple[FloatArray, IntArray]:
    shape = trimesh.creation.box((size, size, size))
    return np.asarray(shape.vertices, np.float64) + [away, 0.0, 0.0], np.asarray(shape.faces, np.int64)


def joined(*parts: tuple[FloatArray, IntArray]) -> tuple[FloatArray, IntArray]:
    first = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    faces = [faces + start for (_, faces), start in zip(parts, first)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def inside_out(part: tuple[FloatArray, IntArray]) -> tuple[FloatArray, IntArray]:
    return part[0], part[1][:, ::-1]


FLAP = np.array([[0.02, 0.02, 0.02], [0.02, -0.02, 0.02], [0.05, 0.0, 0.03]]), np.array([[0, 1, 2], [2, 1, 0]])
BOUNDARIES: dict[str, tuple[tuple[FloatArray, IntArray], bool]] = {
    "a box": (box(), True),
    "two boxes": (joined(box(), box(away=0.1)), True),
    "a box in a box": (joined(box(), box(0.01)), True),
    "a box with a cavity": (joined(box(), inside_out(box(0.01))), True),
    "a box inside out beside a larger one": (joined(box(), inside_out(box(0.01, 0.1))), False),
    "boxes through each other": (joined(box(), box(away=0.01)), False),
    "boxes that share a face": (joined(box(), box(away=0.04)), False),
    "a box and one nearly on it": (joined(box(), box(0.04 + 1e-11)), False),
    "a box with a flap of no thickness": (joined(box(), FLAP), False),
    "a box with a box inside out on a corner of it": (joined(box(), inside_out(box(0.04, 0.02))), False),
}


@pytest.mark.parametrize("name", BOUNDARIES)
def test_only_the_boundary_of_a_solid_is_touched_from_one_side_alone(name: str) -> None:
    (vertices, faces), one_sided = BOUNDARIES[name]
    mesh, repeated = mesh_features(vertices, faces, closed=True)
    assert (len(mesh.pseudonormal) > 0) == one_sided
    # A pair that is wound both ways goes around nothing.
    assert mesh.multiplicity.tolist().count(0) == repeated
