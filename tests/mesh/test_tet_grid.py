"""Tetrahedra that are halved here and there: they fill the box, fit each other, and cut closed surfaces."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.mesh.isosurface import TetGrid
from hhsim.mesh.topology import is_closed, signed_volume, undirected_edges


def refined(seed: int, rounds: int) -> TetGrid:
    """A grid refined at random places."""
    rng = np.random.default_rng(seed)
    grid = TetGrid(np.zeros(3), np.array([1.0, 0.7, 1.2]), 0.5)
    for _ in range(rounds):
        grid.refine(np.unique(rng.choice(grid.leaves, 3)), int(rng.integers(1, 6)))
    return grid


def assert_fits(grid: TetGrid) -> None:
    """The tetrahedra fill the box, and each of their faces is on the border or is that of one neighbour."""
    tet = grid.tets[grid.leaves]
    corner = grid.points[tet]
    volume = np.abs(np.linalg.det(corner[:, 1:] - corner[:, :1])) / 6.0
    assert volume.min() > 0.0
    assert volume.sum() == pytest.approx(float(np.prod(grid.cubes * grid.edge)), rel=1e-12)
    triangle = np.sort(np.concatenate([np.delete(tet, k, axis=1) for k in range(4)]), axis=1)
    faces, count = np.unique(triangle, axis=0, return_counts=True)
    assert count.max() == 2
    vertex = np.round((grid.points - grid.low) / grid.edge * 2048.0)
    outer = vertex[faces[count == 1]]
    flat = (outer == 0.0).all(axis=1) | (outer == grid.cubes * 2048.0).all(axis=1)
    assert flat.any(axis=1).all()


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), rounds=st.integers(0, 6))
def test_tetrahedra_fit_each_other_however_they_are_halved(seed: int, rounds: int) -> None:
    assert_fits(refined(seed, rounds))


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_points_are_found_in_the_tetrahedron_that_holds_them(seed: int) -> None:
    grid = refined(seed, 5)
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, grid.cubes * grid.edge, size=(200, 3))
    found = grid.locate(points)
    assert np.isin(found, grid.leaves).all()
    corner = grid.points[grid.tets[found]]
    weight = np.linalg.solve(np.swapaxes(corner[:, 1:] - corner[:, :1], 1, 2), (points - corner[:, 0])[:, :, None])
    assert weight.min() > -1e-9
    assert weight.sum(axis=1).max() < 1.0 + 1e-9
    assert (grid.locate(np.array([[-0.1, 0.1, 0.1], [0.1, 9.0, 0.1]])) == -1).all()


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), radius=st.floats(0.05, 0.4))
def test_the_surface_of_a_ball_is_closed_manifold_and_wound_outward(seed: int, radius: float) -> None:
    grid = refined(seed, 4)
    center = np.array([0.45, 0.4, 0.55])
    near = np.linalg.norm(grid.points[grid.tets].mean(axis=1) - center, axis=1) < 2.0 * radius
    grid.refine(np.intersect1d(np.flatnonzero(near), grid.leaves), 3)
    inside = (np.linalg.norm(grid.points - center, axis=1) < radius) & ~grid.on_border()
    edges, faces, owner = grid.surface(inside)
    assert inside[edges[:, 0]].all()
    assert not inside[edges[:, 1]].any()
    if not inside.any():
        assert len(faces) == 0
        return
    _, count, _ = undirected_edges(faces)
    assert (count == 2).all()
    assert is_closed(faces)
    # A corner anywhere on its edge: the surface is the same but for its shape, and never turns inside out.
    share = np.random.default_rng(seed).uniform(0.01, 0.99, size=(len(edges), 1))
    start, end = grid.points[edges[:, 0]], grid.points[edges[:, 1]]
    vertices = start + share * (end - start)
    assert signed_volume(vertices, faces) > 0.0
    assert len(owner) == len(faces)
    assert np.isin(owner, grid.leaves).all()
