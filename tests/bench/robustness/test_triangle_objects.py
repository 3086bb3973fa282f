"""The triangles of the hard cases are what they are said to be."""

import numpy as np

from hhsim.bench.robustness import triangle_cases
from hhsim.bench.robustness.triangle_objects import (
    ball_mesh,
    box_mesh,
    cone_mesh,
    disc_mesh,
    globe_mesh,
    joined_mesh,
    ring_mesh,
    roof_mesh,
    sheet_mesh,
    strips_mesh,
    tube_mesh,
)
from hhsim.mesh.features import mesh_features
from hhsim.mesh.topology import face_areas
from hhsim.trees.contact_surface import encloses


def test_solids_enclose_their_volume() -> None:
    ball, disc = ball_mesh(0.038), disc_mesh(0.045, 1e-3)
    assert len(ball.faces) == 5120
    np.testing.assert_allclose(np.linalg.norm(ball.vertices, axis=1), 0.038, atol=1e-15)
    for mesh, volume in (
        (ball, 4.0 / 3.0 * np.pi * 0.038**3),
        (disc, np.pi * 0.045**2 * 1e-3),
        (box_mesh(0.3, 0.2, 1e-9), 0.3 * 0.2 * 1e-9),
        (roof_mesh(0.2, 0.05, 0.04), 0.2 * 0.05 * 0.04),
        (ring_mesh(np.zeros(3), [0.0, 0.0, 1.0], 0.01, 2e-3), 2.0 * np.pi**2 * 0.012 * 2e-3**2),
    ):
        assert encloses(mesh), mesh.name
        np.testing.assert_allclose(mesh.volume, volume, rtol=0.02)


def test_a_ring_leaves_its_hole_about_its_axis() -> None:
    axis = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    center = np.array([0.1, 0.2, 0.3])
    away = ring_mesh(center, axis, 0.01, 2e-3).vertices - center
    along = away @ axis
    across = np.linalg.norm(away - along[:, None] * axis, axis=1)
    np.testing.assert_allclose([across.min(), across.max()], [0.01, 0.014], atol=1e-9)
    np.testing.assert_allclose([along.min(), along.max()], [-2e-3, 2e-3], atol=1e-5)


def test_a_ridge_and_an_apex_are_at_the_origin() -> None:
    roof = roof_mesh(0.2, 0.05, 0.04)
    np.testing.assert_allclose(roof.bounds, [[-0.1, -0.05, -0.04], [0.1, 0.05, 0.0]])
    assert (roof.vertices[roof.vertices[:, 2] == 0.0][:, 1] == 0.0).all()
    for height in (0.03, -0.03):
        cone = cone_mesh(0.06, height, 100)
        assert len(cone.faces) == 100 and (cone.faces[:, 0] == 0).all()
        assert (cone.vertices[0] == 0.0).all() and not encloses(cone)
        np.testing.assert_allclose(cone.vertices[1:, 2], -height)


def test_what_is_round_has_the_facets_that_it_is_asked_for_where_it_is_touched() -> None:
    for count in (64, 256):
        tube = tube_mesh(0.04, 0.08, count)
        assert encloses(tube)
        rim = tube.vertices[tube.vertices[:, 0] == 0.04]
        np.testing.assert_allclose(np.linalg.norm(rim[:-1, 1:], axis=1), 0.04)
        turn = np.sort(np.arctan2(rim[:-1, 1], rim[:-1, 2]))
        upper = turn[np.abs(turn) < 0.4]
        np.testing.assert_allclose(np.diff(upper), 2.0 * np.pi / count)
        assert len(upper) > 0.7 * 0.8 * count / (2.0 * np.pi)
        globe = globe_mesh(0.04, count)
        assert encloses(globe)
        np.testing.assert_allclose(np.linalg.norm(globe.vertices, axis=1), 0.04)
        np.testing.assert_allclose(globe.vertices[:, 0].max(), 0.04)
        level = globe.vertices[:, 0][np.argmin(np.abs(globe.vertices[:, 0]))]
        assert (np.abs(globe.vertices[:, 0] - level) < 1e-9).sum() == count


def test_floors_cover_their_square_and_nothing_else() -> None:
    random = np.random.default_rng(0)
    area = triangle_cases.SHEET**2
    for make in (triangle_cases._slivers, triangle_cases._t_junctions):
        mesh = make(random)
        np.testing.assert_allclose(face_areas(mesh.vertices, mesh.faces).sum(), area, rtol=1e-12)
        assert (mesh.vertices[:, 2] == 0.0).all()
    sheet = sheet_mesh(0.3, 0.2)
    assert len(sheet.faces) == 2 and np.array_equal(sheet.bounds, [[-0.15, -0.1, 0.0], [0.15, 0.1, 0.0]])
    assert len(joined_mesh([sheet, sheet]).faces) == 4
    assert len(strips_mesh([0.0, 1.0, 2.0], [[0.0, 1.0], [0.0, 0.3, 1.0]]).faces) == 6


def test_slivers_are_slivers_and_can_be_touched() -> None:
    mesh = triangle_cases._slivers(np.random.default_rng(0))
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    longest = np.max([np.linalg.norm(side, axis=1) for side in (b - a, c - b, a - c)], axis=0)
    aspect = longest**2 / (2.0 * face_areas(mesh.vertices, mesh.faces))
    assert (aspect > 1e6).sum() > 200
    assert mesh_features(mesh.vertices, mesh.faces, closed=False)[1] == 0
