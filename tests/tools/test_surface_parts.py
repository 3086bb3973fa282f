"""Rings, bands, fans and the icosphere that the generators build from."""

import numpy as np
import pytest

from hhsim.mesh.topology import is_closed, signed_volume
from tools.shapes.surface_parts import band, circle, fan, finished_mesh, icosphere


@pytest.mark.parametrize("subdivisions", [0, 1, 3])
def test_icosphere_is_a_closed_outward_surface_on_the_unit_sphere(subdivisions: int) -> None:
    vertices, faces = icosphere(subdivisions)
    assert (len(vertices), len(faces)) == (10 * 4**subdivisions + 2, 20 * 4**subdivisions)
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 1.0, rtol=1e-14)
    assert is_closed(faces)
    assert 0.0 < signed_volume(vertices, faces) < 4.0 / 3.0 * np.pi


def test_icosahedron_has_equal_edges() -> None:
    vertices, faces = icosphere(0)
    length = np.linalg.norm(vertices[faces] - vertices[np.roll(faces, -1, axis=1)], axis=2)
    np.testing.assert_allclose(length, 1.0 / np.sin(2.0 * np.pi / 5.0), rtol=1e-12)


def test_band_and_fans_make_an_outward_prism() -> None:
    ring = circle(5)
    np.testing.assert_allclose(ring[0], [1.0, 0.0])
    vertices = np.concatenate(
        [np.column_stack([ring, np.full(5, z)]) for z in (0.0, 2.0)] + [np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])]
    )
    lower, upper = np.arange(5), np.arange(5, 10)
    faces = np.concatenate([band(lower, upper), fan(10, lower)[:, ::-1], fan(11, upper)])
    assert is_closed(faces)
    assert signed_volume(vertices, faces) == pytest.approx(2.0 * 2.5 * np.sin(2.0 * np.pi / 5.0))


def test_finished_mesh_has_one_order_and_a_centred_box() -> None:
    vertices, faces = icosphere(1)
    order = np.random.default_rng(3).permutation(len(vertices))
    extra = np.array([[0.1, 0.2, 0.3]])
    shuffled = np.concatenate([vertices[order], extra]) + 7.0
    first = finished_mesh(vertices, faces, "sphere", "test")
    second = finished_mesh(shuffled, [np.argsort(order)[faces[::-1]]], "sphere", "test")
    # Adding 7 rounds the last bits, which the grid of a nanometre hides.
    assert first.sha256 == second.sha256
    np.testing.assert_allclose(first.bounds.mean(axis=0), 0.0, atol=1e-9)
    assert not np.signbit(first.vertices[first.vertices == 0.0]).any()
