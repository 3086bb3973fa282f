"""The mesh as a surface: lists and rows against brute force, fingers on all kinds of features, and whole motions."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sphere_scenes import set_pose, still

from hhsim.hand.model import HandModel
from hhsim.kernels.contact.detection import evaluate, find_contacts
from hhsim.kernels.hand.kinematics import DOF
from hhsim.kernels.mesh.features import MeshFeatures
from hhsim.mesh.features import mesh_features
from hhsim.solver.surface import SURFACES
from hhsim.solver.workspace import tick_state

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

HAND = HandModel.default("right")
ARRAYS = HAND.arrays()
MARGIN, SKIN = 1e-3, 3e-3
INDEX_MIDDLE = 4
"""The body that fingers' own scenes are built around."""
RADIUS, END_RADIUS, LENGTH = float(HAND.radius[1, 1]), float(HAND.radius[1, 2]), float(HAND.length[1, 1])


def new_state() -> Any:
    return tick_state(np.ones(DOF), surface=SURFACES["mesh"])[0]


def under_the_finger(place: Array, faces: Any, *, closed: bool = False) -> MeshFeatures:
    """A mesh given about the middle phalanx of the index: x along its axis, from the joint on, z towards it."""
    joints = HAND.joints(np.zeros(3), [1.0, 0.0, 0.0, 0.0], np.zeros((5, 3)), np.zeros(5))[1]
    along = (joints[2] - joints[1]) / LENGTH
    up = np.array([0.0, 0.0, 1.0]) - along[2] * along
    up /= np.linalg.norm(up)
    frame = np.stack([along, np.cross(up, along), up])
    return mesh_features(joints[1] + place @ frame, np.asarray(faces, np.int64), closed=closed)[0]


def finger_rows(mesh: MeshFeatures) -> dict[str, Array]:
    """Rows of the middle phalanx of the index of a straight hand at the origin; points in the frame of its axis."""
    state = new_state()
    set_pose(HAND, state.pose, still(1, np.zeros(3)))
    assert evaluate(ARRAYS, state.pose, mesh, MARGIN, SKIN, state.candidates, state.work) == 0
    assert find_contacts(mesh, ARRAYS, state.pose, state.candidates, MARGIN, state.contacts) == 0
    contacts = state.contacts
    rows = np.flatnonzero(contacts.body[: contacts.start[-1]] == INDEX_MIDDLE)
    along = (contacts.point[:, rows].T - state.pose.joints[1, 1]) @ state.pose.direction[1, 1]
    return {
        "along": along,
        "distance": contacts.distance[rows].copy(),
        "slides": contacts.slides[rows].copy(),
        "straight": contacts.straight[:, rows].T.copy(),
        "normal": contacts.normal[:, rows].T.copy(),
        "radius": contacts.hand_radius[rows].copy(),
        "key": contacts.key[rows].copy(),
    }


GAP = 2e-4
SINE = (RADIUS - END_RADIUS) / LENGTH
"""Of the angle between the axis and the side of the round cone."""


def beside(x: float, gap: float = GAP) -> float:
    """Height of a line along the side of the finger, at a place along its axis, in the frame of the axis."""
    # At a right angle to the line: radius + gap = -z cosine + x sine at x = 0, z = 0, and the same at the other end.
    cosine = math.sqrt(1.0 - SINE**2)
    return -(RADIUS + gap - x * SINE) / cosine


def test_a_finger_flat_on_a_large_face_has_a_row_at_each_end() -> None:
    far = [[-0.3, -0.3], [0.5, -0.3], [0.0, 0.6]]
    rows = finger_rows(under_the_finger(np.array([[x, y, beside(x)] for x, y in far]), [[0, 1, 2]]))
    assert len(rows["key"]) == 2
    np.testing.assert_allclose(rows["distance"], GAP, atol=1e-12)
    np.testing.assert_allclose(rows["radius"], [RADIUS, END_RADIUS], atol=1e-15)
    assert not rows["slides"].any()


def test_a_ridge_across_the_middle_of_a_finger_has_one_row_that_slides() -> None:
    middle = 0.5 * LENGTH
    top = beside(middle)
    roof = [
        [middle, -0.03, top],
        [middle, 0.03, top],
        [middle - 0.02, 0.0, top - 0.04],
        [middle + 0.02, 0.0, top - 0.04],
    ]
    rows = finger_rows(under_the_finger(np.array(roof), [[0, 1, 2], [1, 0, 3]]))
    assert len(rows["key"]) == 1
    assert rows["distance"] == pytest.approx(GAP, abs=1e-12)
    assert rows["slides"] == 1
    assert 0.2 * LENGTH < rows["along"][0] < 0.8 * LENGTH


@pytest.mark.parametrize("start", [-0.5, 0.2, 0.7])
@pytest.mark.parametrize("end", [0.8, 1.5])
def test_a_finger_along_a_ridge_is_held_where_the_ridge_and_the_finger_end(start: float, end: float) -> None:
    first, last = start * LENGTH, end * LENGTH
    ridge = [[first, 0.0, beside(first)], [last, 0.0, beside(last)]]
    wings = [[0.5 * (first + last), side * 0.01, beside(0.0) - 0.03] for side in (-1.0, 1.0)]
    rows = finger_rows(under_the_finger(np.array(ridge + wings), [[0, 1, 2], [1, 0, 3]]))
    # The two ends of the stretch that finger and ridge share; the feet lie beside them by the slope of the side.
    for x in (max(first, 0.0), min(last, LENGTH)):
        assert np.abs(rows["along"] - x).min() < 1e-3
    np.testing.assert_allclose(rows["distance"], GAP, atol=1e-9)
