"""The palm's mesh: closed, star-shaped, of a palm's size, and joined to the fingers without a gap."""

import hashlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.hand.model import default_fingers
from hhsim.hand.palm_mesh import CENTER_HEIGHT, RoundCones, palm_mesh, palm_parts
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.topology import undirected_edges

LENGTH, BREADTH = 0.19, 0.085


def palm(length: float = LENGTH, breadth: float = BREADTH) -> Mesh:
    fingers = default_fingers(length, breadth)
    return palm_mesh(length, breadth, fingers["base"][1:], fingers["radius"][1:, 0])


@given(st.floats(0.05, 0.4), st.floats(0.36, 0.55))
@settings(max_examples=12)
def test_closed_and_star_shaped_at_any_size(length: float, share: float) -> None:
    mesh = palm(length, share * length)
    _, count, balance = undirected_edges(mesh.faces)
    assert (count == 2).all() and not balance.any()
    assert len(mesh.vertices) - len(count) + len(mesh.faces) == 2
    # Every triangle turns its back to the middle: no two of them can overlap.
    middle = np.array([0.0, 0.0, CENTER_HEIGHT * share * length])
    assert (np.linalg.det(mesh.triangles - middle) > 0.0).all()
    assert 1000 <= len(mesh.faces) <= 3000


def test_the_default_palm_has_the_same_bits_on_every_machine() -> None:
    assert hashlib.sha256(palm().vertices.tobytes()).hexdigest().startswith("f3ac66c6f5c58545")


def test_surface_is_the_blended_parts() -> None:
    """The vertices lie on the union of the parts, pushed out by the blend only."""
    fingers = default_fingers(LENGTH, BREADTH)
    parts = palm_parts(LENGTH, BREADTH, fingers["base"][1:], fingers["radius"][1:, 0])
    least = parts.distance(palm().vertices).min(axis=1)
    assert least.min() >= -1e-9
    assert least.max() <= 0.12 * BREADTH


@pytest.mark.parametrize(
    ("point", "expected"),
    [((0.0, 3.0, 0.0), 2.0), ((1.0, 3.0, 0.0), 2.25), ((3.0, 0.0, 0.0), 0.5), ((0.0, 0.0, 0.0), -1.0)],
)
def test_part_distance(point: tuple[float, float, float], expected: float) -> None:
    cone = RoundCones(np.zeros((1, 3)), np.array([[2.0, 0.0, 0.0]]), np.array([1.0]), np.array([0.5]))
    assert cone.distance(np.array([point]))[0, 0] == pytest.approx(expected, abs=1e-15)
