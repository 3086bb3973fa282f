"""Borders in the plane of other triangles: which are none."""

import numpy as np
import pytest

from hhsim.arrays import FloatArray
from hhsim.kernels.mesh.covered_borders import BEYOND
from hhsim.kernels.mesh.features import MeshFeatures
from hhsim.mesh.features import mesh_features

FLOOR = ((-0.1, -0.1), (0.3, -0.1), (-0.1, 0.3))
"""A triangle, its long side along x + y = 0.2."""
WITHIN = ((0.0, 0.0), (0.05, 0.0), (0.0, 0.05))


def features(*triangles: tuple[tuple[float, ...], ...]) -> MeshFeatures:
    corners = np.array([[(*p, 0.0)[:3] for p in triangle] for triangle in triangles])
    return mesh_features(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), closed=False)[0]


def kept(mesh: MeshFeatures) -> tuple[set[tuple[float, ...]], set[tuple[float, ...]]]:
    """Middles of the edges, and the vertices, that can be touched; in the plane [m], to a nanometre."""
    edge = mesh.edge[mesh.face_edge[mesh.face_edge >= 0]]
    middle = edge[:, :2] + 0.5 * edge[:, 6:] * edge[:, 3:5]
    vertex = mesh.vertex[mesh.face_vertex[mesh.face_vertex >= 0], :2]
    return rounded(middle), rounded(vertex)


def rounded(places: FloatArray) -> set[tuple[float, ...]]:
    return {tuple((np.round(place, 9) + 0.0).tolist()) for place in places}


def sides(triangle: tuple[tuple[float, float], ...]) -> set[tuple[float, ...]]:
    """Their middles."""
    ends = np.array(triangle)
    return rounded(0.5 * (ends + np.roll(ends, -1, axis=0)))


@pytest.mark.parametrize("turned", [False, True])
def test_a_triangle_in_the_plane_of_another_is_nothing_of_its_own(turned: bool) -> None:
    within = WITHIN[::-1] if turned else WITHIN
    assert kept(features(FLOOR, within)) == kept(features(FLOOR)) == (sides(FLOOR), set(FLOOR))


def test_one_that_juts_out_keeps_what_is_beyond() -> None:
    jutting = ((0.0, 0.0), (0.0, -0.05), (0.25, -0.15))
    edges, vertices = kept(features(FLOOR, jutting))
    # A side of which a part is beyond is left whole.
    assert edges == (sides(FLOOR) | sides(jutting)) - {(0.0, -0.025)}
    assert vertices == {*FLOOR, jutting[2]}


def test_a_border_along_another_s_is_one_where_both_end_there() -> None:
    # On the same side of the line x + y = 0.2 both end; from the other side the plane goes on beyond the short one's.
    inner = ((0.15, 0.05), (0.05, 0.15), (0.05, 0.05))
    outer = ((0.15, 0.05), (0.15, 0.15), (0.05, 0.15))
    edges, vertices = kept(features(FLOOR, inner))
    # Both have their middle at (0.1, 0.1).
    assert edges == sides(FLOOR)
    assert (features(FLOOR, inner).face_edge >= 0).sum() == 4
    assert set(FLOOR) <= vertices
    both = features(FLOOR, outer)
    assert kept(both)[0] == sides(FLOOR) | sides(outer)
    assert (both.face_edge >= 0).sum() == 5


def test_a_row_of_triangles_covers_together() -> None:
    strip = [((x, -0.01), (x + 0.02, -0.01), (x, 0.03)) for x in np.arange(0.0, 0.1, 0.02)]
    strip += [((x + 0.02, -0.01), (x + 0.02, 0.03), (x, 0.03)) for x in np.arange(0.0, 0.1, 0.02)]
    lying = ((0.011, 0.001), (0.091, 0.002), (0.05, 0.02))
    edges, vertices = kept(features(*strip, lying))
    assert not edges & sides(lying) and not vertices & set(lying)
    # With one of them away there is a gap under it.
    edges, vertices = kept(features(*strip[:2], *strip[3:], lying))
    assert edges & sides(lying)


@pytest.mark.parametrize(("height", "tilt"), [(2e-9, 0.0), (0.0, 1e-6)])
def test_another_plane_is_no_cover(height: float, tilt: float) -> None:
    raised = tuple((x, y, height + tilt * x) for x, y in WITHIN)
    assert sides(WITHIN) <= kept(features(FLOOR, raised))[0]
    assert height > 0.0 or BEYOND * tilt < 1e-9
