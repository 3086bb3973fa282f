"""Detection and constraints of method `paper`: the paper's Eq. 3 to 13, transcribed and asked of every pair.

Rows are held against finite differences of the constraints' values as the paper prints them.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sphere_scenes import cloud, random_hand, set_pose, tick_state

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.hand_shape import frustum_shapes
from hhsim.kernels.rotation import euler_axes
from hhsim.kernels.tick.paper import PAPER_STATE, finger_program
from hhsim.kernels.tick.paper_contacts import ON_FRUSTUM, ON_SPHERE, detect, palm_rows
from hhsim.solver.options import Stiffness
from hhsim.solver.workspace import zeroed
from hhsim.trees.sphere_tree import SphereTree

RIGHT = HandModel.default("right")
LEFT = HandModel.default("left")
ROOT = np.sqrt(Stiffness().diagonal())
GROWTH = 2e-3
STEP = 1e-6
"""Of the central differences [m, rad]."""
ACCURACY = 1e-8
"""Rounding of a squared distance of 0.1 m over the step; rows are compared as squared distances [m², m²/rad]."""
SEEDS = st.integers(0, 2**32 - 1)
ANGLES = st.tuples(*[st.floats(-3.1, 3.1)] * 3).map(np.array)


class Frustum(NamedTuple):
    """The paper's symbols for a phalanx [m]: its thick bottom D, r₁, its thin one E, r₂."""

    d: FloatArray
    e: FloatArray
    r1: float
    r2: float


def frustum_of(hand: HandModel, joints: FloatArray, f: int, k: int) -> Frustum:
    """The cone between the circles where it touches the two joint spheres, constructed by their tangent."""
    a, b = joints[f, k], joints[f, k + 1]
    ra, rb = hand.radius[f, k], hand.radius[f, k + 1]
    u = (b - a) / np.linalg.norm(b - a)
    sine = (ra - rb) / np.linalg.norm(b - a)
    cosine = math.sqrt(1.0 - sine**2)
    return Frustum(a + ra * sine * u, b + rb * sine * u, ra * cosine, rb * cosine)


def frustum_excess(cone: Frustum, centers: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
    """|OC| - |OC|_Γ (Eq. 4, 5) and k (Eq. 6) of spheres, shapes (L,)."""
    de = cone.e - cone.d
    length = np.linalg.norm(de)
    distance = np.linalg.norm(np.cross(cone.d - centers, de), axis=1) / length
    k = (centers - cone.e) @ (cone.d - cone.e) / length**2
    phi = math.atan2(cone.r1 - cone.r2, length)
    return distance - (radius / math.cos(phi) + k * (cone.r1 - cone.r2) + cone.r2), k


def states(hand: HandModel, at: HandConfiguration, closed: bool) -> tuple[Any, Any]:
    """What a tick and the method keep of a hand in a place."""
    state, paper = tick_state(ROOT**2), zeroed(PAPER_STATE)[0]
    paper.closed = closed
    set_pose(hand, state.pose, at)
    frustum_shapes(hand.arrays(), paper.shapes)
    paper.lowest[:], paper.highest[:] = hand.flexion_min, hand.flexion_max
    return state, paper


def detected(hand: HandModel, tree: SphereTree, growth: float, state: Any, paper: Any) -> None:
    detect(hand.arrays(), hand.palm_tree.arrays(), tree.arrays(), growth, state, paper)


def scene(
    seed: int, closed: bool = True, angles: FloatArray | None = None
) -> tuple[HandModel, SphereTree, HandConfiguration, Any, Any]:
    """A hand, at these Euler angles if they are given, among spheres, its pairs detected; some penetrate."""
    random = np.random.default_rng(seed)
    hand = RIGHT if seed % 2 else LEFT
    tree = cloud(random, int(random.integers(1, 400)), spread=0.12)
    at = random_hand(random, hand, 0.03)
    if angles is not None:
        at = at._replace(orientation=Rotation.from_euler("xyz", angles[None]).as_quat(scalar_first=True))
    state, paper = states(hand, at, closed)
    detected(hand, tree, GROWTH, state, paper)
    return hand, tree, at, state, paper


@given(SEEDS, ANGLES)
@settings(max_examples=15)
def test_palm_rows_are_the_first_order_of_eq_8_in_position_and_euler_angles(seed: int, angles: FloatArray) -> None:
    _, _, at, state, paper = scene(seed, angles=angles)
    count = int(state.candidates.count[15])
    euler_axes(angles, paper.axes)
    palm_rows(count, state, paper)
    common, rhs, normal = state.problem.common, state.problem.rhs, paper.normal
    hand_center = np.stack([paper.hand_x, paper.hand_y, paper.hand_z], axis=1)[:count]
    object_center = np.stack([paper.object_x, paper.object_y, paper.object_z], axis=1)[:count]
    total = paper.hand_radius[:count] + paper.object_radius[:count]

    def away(q: FloatArray) -> FloatArray:
        return np.asarray(q[:3] + hand_center @ Rotation.from_euler("xyz", q[3:]).as_matrix().T - object_center)

    def constraint(q: FloatArray) -> FloatArray:
        return np.asarray((away(q) ** 2).sum(axis=1) - total**2)

    q = np.concatenate([at.position[0], angles])
    value = constraint(q)
    np.testing.assert_allclose(-2.0 * total * rhs[:count], value, atol=1e-14)
    for j, unit in enumerate(np.eye(6)):
        rate = (constraint(q + STEP * unit) - constraint(q - STEP * unit)) / (2.0 * STEP)
        np.testing.assert_allclose(2.0 * total * common[j, :count] * ROOT[j], rate, atol=ACCURACY)
    length = np.linalg.norm(away(q), axis=1)
    np.testing.assert_allclose(np.linalg.norm(normal[:, :count], axis=0), length / total, rtol=1e-12)


@given(SEEDS, ANGLES, st.integers(0, 4))
@settings(max_examples=25)
def test_finger_rows_are_the_first_order_of_eq_10_and_13_in_joint_angles(seed: int, angles: FloatArray, f: int) -> None:
    hand, _, at, state, paper = scene(seed, angles=angles)
    state.haptic.flexion[f] = at.flexion[0, f] + [0.1, -0.2, 0.3]
    rows = finger_program(f, state, paper)

    def constraints(flexion: FloatArray) -> tuple[FloatArray, FloatArray]:
        angles = at.flexion[0].copy()
        angles[f] = flexion
        joints = hand.joints(at.position[0], at.orientation[0], angles, at.abduction[0])
        values, sizes = [], []
        for k in range(3):
            body, count = 3 * f + k, state.candidates.count[3 * f + k]
            center = np.stack([paper.x[body], paper.y[body], paper.z[body]], axis=1)[:count]
            radius = paper.radius[body, :count]
            cone = frustum_of(hand, joints, f, k)
            excess, along = frustum_excess(cone, center, radius)
            cosine = np.linalg.norm(cone.e - cone.d) / np.hypot(np.linalg.norm(cone.e - cone.d), cone.r1 - cone.r2)
            limit = radius / cosine + along * (cone.r1 - cone.r2) + cone.r2
            total = hand.radius[f, k + 1] + radius
            apart = np.linalg.norm(center - joints[f, k + 1], axis=1)
            for i in range(count):
                if paper.kind[body, i] & ON_FRUSTUM:
                    values.append((excess[i] + limit[i]) ** 2 - limit[i] ** 2)
                    sizes.append(2.0 * limit[i] / cosine)
                if paper.kind[body, i] & ON_SPHERE:
                    values.append(apart[i] ** 2 - total[i] ** 2)
                    sizes.append(2.0 * total[i])
        return np.array(values), np.array(sizes)

    value, size = constraints(at.flexion[0, f])
    assert rows == len(value)
    if rows == 0:
        return
    np.testing.assert_allclose(-size * state.problem.rhs[:rows], value, atol=1e-13)
    for j, unit in enumerate(np.eye(3)):
        ahead, behind = (constraints(at.flexion[0, f] + sign * STEP * unit)[0] for sign in (1.0, -1.0))
        row = size * state.problem.block[j, :rows] * ROOT[6 + 3 * f + j]
        np.testing.assert_allclose(row, (ahead - behind) / (2.0 * STEP), atol=ACCURACY)
    np.testing.assert_allclose(paper.target[:3] / ROOT[6], [0.1, -0.2, 0.3], atol=1e-12)
