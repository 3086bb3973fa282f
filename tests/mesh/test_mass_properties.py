"""Mass properties against closed forms."""

import numpy as np
import pytest
import trimesh

from hhsim.errors import MeshError
from hhsim.mesh.mass_properties import mass_properties
from hhsim.mesh.mesh import Mesh


def test_a_box_anywhere_has_the_moments_of_a_box() -> None:
    a, b, c = 0.1, 0.2, 0.3
    solid = trimesh.creation.box((a, b, c))
    found = mass_properties(Mesh(solid.vertices + (1.0, -2.0, 3.0), solid.faces))
    volume = a * b * c
    expected = volume / 12.0 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b])
    assert found.volume == pytest.approx(volume, rel=1e-12)
    assert found.center == pytest.approx((1.0, -2.0, 3.0), abs=1e-12)
    assert found.inertia == pytest.approx(expected, abs=1e-9 * expected.max())


def test_a_sheet_has_no_mass() -> None:
    with pytest.raises(MeshError, match="enclose nothing"):
        mass_properties(Mesh(np.eye(3), np.array([[0, 1, 2]])))
