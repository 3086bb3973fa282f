"""Shapes by formula: closed, outward, centred, of the stated size, and the same bytes each time."""

from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from hhsim.errors import InputError
from hhsim.mesh.mesh import Mesh
from tools.shapes.generators import (
    cube,
    cup,
    cylinder,
    hexagonal_prism,
    rock,
    shamrock,
    sphere,
    triangular_prism,
)

pytestmark = pytest.mark.soak


def as_trimesh(mesh: Mesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


@pytest.mark.parametrize(
    ("mesh", "extent", "volume", "tolerance"),
    [
        (cube(0.07), (0.07, 0.07, 0.07), 0.07**3, 1e-6),
        (cylinder(0.06, 0.12), (0.06, 0.06, 0.12), np.pi * 0.03**2 * 0.12, 1e-3),
        (triangular_prism(0.08, 0.1), (0.08, 0.08 * 3**0.5 / 2, 0.1), 3**0.5 / 4 * 0.08**2 * 0.1, 1e-6),
        (hexagonal_prism(0.04, 0.1), (0.08, 0.04 * 3**0.5, 0.1), 3 * 3**0.5 / 2 * 0.04**2 * 0.1, 1e-6),
        (sphere(0.076), (0.076, 0.076, 0.076), np.pi / 6 * 0.076**3, 3e-3),
    ],
    ids=["cube", "cylinder", "triangular-prism", "hexagonal-prism", "sphere"],
)
def test_size_and_volume_by_formula(
    mesh: Mesh, extent: tuple[float, float, float], volume: float, tolerance: float
) -> None:
    np.testing.assert_allclose(mesh.extent, extent, atol=5e-9)
    assert mesh.volume == pytest.approx(volume, rel=tolerance)


def test_sphere_vertices_lie_on_the_sphere_and_refine_towards_it() -> None:
    np.testing.assert_allclose(np.linalg.norm(sphere(0.076).vertices, axis=1), 0.038, atol=2e-9)
    exact = np.pi / 6 * 0.076**3
    missing = [exact - sphere(0.076, subdivisions=level).volume for level in range(5)]
    assert [len(sphere(0.076, subdivisions=level).faces) for level in range(3)] == [20, 80, 320]
    assert missing[4] > 0.0
    # Second order: each split quarters what is missing.
    assert missing[3] / missing[4] == pytest.approx(4.0, rel=0.03)


def test_rock_is_uneven_and_changes_with_its_seed() -> None:
    mesh = rock()
    hull = as_trimesh(mesh).convex_hull
    assert 0.9 < mesh.volume / hull.volume < 0.99
    assert rock(seed=8).sha256 != mesh.sha256
    assert rock(size=0.12).extent.max() == pytest.approx(0.12, abs=2e-9)
    # Star-shaped: each face looks away from the inside point that the radii start from.
    triangles = mesh.triangles
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    assert (np.einsum("fi,fi->f", normal, triangles.mean(axis=1) - as_trimesh(mesh).center_mass) > 0.0).mean() > 0.999


def test_shamrock_is_a_concave_plate_of_three_leaves() -> None:
    mesh = shamrock()
    assert mesh.extent[1] == pytest.approx(0.013, abs=2e-9)
    assert mesh.volume / as_trimesh(mesh).convex_hull.volume < 0.75
    # Front and back mirror each other.
    mirrored = mesh.vertices * np.array([1.0, -1.0, 1.0])
    assert {tuple(vertex) for vertex in mirrored.tolist()} == {tuple(vertex) for vertex in mesh.vertices.tolist()}
    # The rim between the flat sides counts leaves: a circle around the leaves' meeting point crosses all three and the
    # stem.
    center = np.array([0.0, 0.0, mesh.bounds[1, 2] - 0.0434 * 105.0 / 106.45])
    angle = np.radians(np.arange(0.0, 360.0, 1.0))
    circle = center + 0.026 * np.stack([np.cos(angle), 0.0 * angle, np.sin(angle)], axis=1)
    inside = as_trimesh(mesh).contains(circle + np.array([0.0, 1e-5, 0.0]))
    assert np.count_nonzero(inside & ~np.roll(inside, 1)) == 4


def test_cup_holds_something_and_its_handle_has_a_hole_for_a_finger() -> None:
    mesh = cup()
    other = as_trimesh(mesh)
    axis = mesh.bounds[0, 0] + 0.04
    hollow = np.array([[axis, 0.0, 0.0], [axis + 0.03, 0.0, 0.02], [axis, 0.0, mesh.bounds[1, 2] - 1e-4]])
    assert not other.contains(hollow).any()
    # Along +x at half height: wall, gap, handle. The gap takes a finger of 18 mm.
    x = np.linspace(axis, mesh.bounds[1, 0] + 0.001, 800)
    inside = other.contains(np.column_stack([x, np.full_like(x, 1e-5), np.full_like(x, 1e-5)]))
    edges = x[1:][inside[1:] != inside[:-1]]
    assert len(edges) == 4
    wall_in, wall_out, handle_in, handle_out = edges
    assert 0.003 <= wall_out - wall_in <= 0.004
    assert handle_in - wall_out > 0.022
    assert 0.006 < handle_out - handle_in < 0.012


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: sphere(-1.0), "sphere: diameter -1.0 m"),
        (lambda: sphere(subdivisions=9), "subdivisions 9; expected 0 to 7"),
        (lambda: cylinder(segments=2), "2 segments"),
        (lambda: cube(float("nan")), "cube: side nan m"),
        (lambda: rock(0.0), "rock: size 0.0 m"),
        (lambda: shamrock(0.1, 0.2), "expected 0 < thickness < size"),
        (lambda: cup(wall=0.02), "expected a wall"),
    ],
)
def test_impossible_sizes_are_refused(make: Callable[[], Mesh], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()
