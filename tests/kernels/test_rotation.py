"""Rotations and Euler angles against scipy: tiny angles, half turns, both signs of a quaternion, all branches."""

import math

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.kernels.rotation import euler_quaternion, quaternion_to_matrix, rotate_quaternion, rotation_vector_between


def unit(seed: int) -> FloatArray:
    values = np.random.default_rng(seed).normal(size=4)
    return values / np.linalg.norm(values)


def scipy_rotation(quaternion: FloatArray) -> Rotation:
    return Rotation.from_quat(quaternion, scalar_first=True)


def matrix(quaternion: FloatArray) -> FloatArray:
    out = np.empty((3, 3))
    quaternion_to_matrix(quaternion, out)
    return out


def between(source: FloatArray, target: FloatArray) -> FloatArray:
    out = np.empty(3)
    rotation_vector_between(source, target, out)
    return out


def rotated(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    out = np.empty(4)
    rotate_quaternion(quaternion, float(vector[0]), float(vector[1]), float(vector[2]), out)
    return out


quaternions = st.integers(0, 2**32 - 1).map(unit)
axes = st.integers(0, 2**32 - 1).map(lambda seed: unit(seed)[:3] / np.linalg.norm(unit(seed)[:3]))
angles = st.one_of(
    st.floats(0.0, 4.0 * math.pi),
    st.sampled_from([0.0, 1e-300, 1e-12, 0.9e-8, 1.1e-8, 1e-6, math.pi, math.nextafter(math.pi, 0.0), 2.0 * math.pi]),
)


@given(quaternions)
@example(np.array([1.0, 0.0, 0.0, 0.0]))
@example(np.array([0.0, 0.0, 0.0, -1.0]))
@settings(max_examples=50)
def test_matrix_is_scipys(quaternion: FloatArray) -> None:
    np.testing.assert_allclose(matrix(quaternion), scipy_rotation(quaternion).as_matrix(), atol=4e-16)
    np.testing.assert_array_equal(matrix(-quaternion), matrix(quaternion))


@given(quaternions, axes, angles)
@settings(max_examples=100)
def test_left_increment_is_scipys(quaternion: FloatArray, axis: FloatArray, angle: float) -> None:
    moved = rotated(quaternion, angle * axis)
    expected = Rotation.from_rotvec(angle * axis) * scipy_rotation(quaternion)
    np.testing.assert_allclose(matrix(moved), expected.as_matrix(), atol=4e-15)
    assert abs(np.linalg.norm(moved) - 1.0) <= 4e-16


@given(quaternions, quaternions)
@settings(max_examples=100)
def test_vector_between_is_scipys(source: FloatArray, target: FloatArray) -> None:
    expected = scipy_rotation(target) * scipy_rotation(source).inv()
    vector = between(source, target)
    assert np.linalg.norm(vector) <= math.pi * (1.0 + 1e-15)
    np.testing.assert_allclose(Rotation.from_rotvec(vector).as_matrix(), expected.as_matrix(), atol=4e-15)
    if expected.magnitude() < math.pi - 1e-6:
        np.testing.assert_allclose(vector, expected.as_rotvec(), atol=1e-9)


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


@given(ANGLES)
def test_the_quaternion_is_the_printed_matrix(euler: FloatArray) -> None:
    np.testing.assert_allclose(matrix_of(euler), paper_matrix(euler), atol=1e-14)
    np.testing.assert_allclose(Rotation.from_euler("xyz", euler).as_matrix(), paper_matrix(euler), atol=1e-14)
