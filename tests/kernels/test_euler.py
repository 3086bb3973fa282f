"""Euler angles against scipy's, their axes against finite differences, the nearest branch against all branches."""

import itertools
import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.kernels.euler import euler_axes, euler_quaternion, nearest_euler
from hhsim.kernels.rotation import quaternion_to_matrix

ANGLES = st.tuples(*[st.floats(-7.0, 7.0)] * 3).map(np.array)


def paper_matrix(euler: FloatArray) -> FloatArray:
    """R_L^W as the paper prints it."""
    (ca, sa), (cb, sb), (cc, sc) = ((math.cos(angle), math.sin(angle)) for angle in euler)
    return np.array(
        [
            [cc * cb, cc * sb * sa - sc * ca, cc * sb * ca + sc * sa],
            [sc * cb, sc * sb * sa + cc * ca, sc * sb * ca - cc * sa],
            [-sb, cb * sa, cb * ca],
        ]
    )


def matrix_of(euler: FloatArray) -> FloatArray:
    quaternion, matrix = np.empty(4), np.empty((3, 3))
    euler_quaternion(euler, quaternion)
    assert abs(np.linalg.norm(quaternion) - 1.0) < 1e-15
    quaternion_to_matrix(quaternion, matrix)
    return matrix


def nearest(matrix: FloatArray, near: FloatArray) -> FloatArray:
    out = np.empty(3)
    nearest_euler(matrix, near, out)
    return out


@given(ANGLES)
def test_the_quaternion_is_the_printed_matrix(euler: FloatArray) -> None:
    np.testing.assert_allclose(matrix_of(euler), paper_matrix(euler), atol=1e-14)
    np.testing.assert_allclose(Rotation.from_euler("xyz", euler).as_matrix(), paper_matrix(euler), atol=1e-14)


@given(ANGLES)
def test_the_axes_are_the_derivatives(euler: FloatArray) -> None:
    axes = np.empty((3, 3))
    euler_axes(euler, axes)
    for j, unit in enumerate(np.eye(3)):
        step = 1e-6 * unit
        rate = (paper_matrix(euler + step) - paper_matrix(euler - step)) / 2e-6 @ paper_matrix(euler).T
        np.testing.assert_allclose(rate, np.cross(axes[j], np.eye(3)).T, atol=1e-8)


WHOLE_TURNS = 2.0 * math.pi * np.array(list(itertools.product(range(-5, 6), repeat=3)))


@given(ANGLES, ANGLES)
def test_the_nearest_angles_are_the_same_rotation_and_no_branch_is_nearer(euler: FloatArray, near: FloatArray) -> None:
    matrix = paper_matrix(euler)
    found = nearest(matrix, near)
    # Near the lock rounding of the matrix is divided by cos β.
    np.testing.assert_allclose(paper_matrix(found), matrix, atol=1e-8)
    if abs(math.cos(euler[1])) < 1e-6:
        return
    other = np.array([euler[0] + math.pi, math.pi - euler[1], euler[2] + math.pi])
    best = min(np.linalg.norm(branch + WHOLE_TURNS - near, axis=1).min() for branch in (euler, other))
    assert np.linalg.norm(found - near) <= best + 1e-9


def test_a_hand_that_turns_through_ninety_degrees_or_half_a_turn_keeps_its_branch() -> None:
    for axis in range(3):
        angles = np.zeros((2000, 3))
        angles[:, axis] = np.linspace(-7.0, 7.0, 2000)
        angles[:, (axis + 1) % 3] = 0.1
        at = angles[0].copy()
        for wanted in angles:
            at = nearest(paper_matrix(wanted), at)
            if axis != 1 or abs(math.cos(wanted[1])) > 0.02:
                np.testing.assert_allclose(at, wanted, atol=1e-9)


def test_locked_angles_keep_gamma() -> None:
    for b in (0.5 * math.pi, -0.5 * math.pi):
        matrix = np.round(paper_matrix(np.array([0.3, b, 0.0])), 15)
        matrix[0, 0] = matrix[1, 0] = 0.0
        found = nearest(matrix, np.array([0.0, b, 0.4]))
        assert found[2] == 0.4
        np.testing.assert_allclose(paper_matrix(found), matrix, atol=1e-14)
