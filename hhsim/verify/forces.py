"""Forces that the stored configurations demand, by nonnegative least squares and clarabel.

Notation: q are the 21 variables (palm 6, flexion 15), G the coupling, w = G (q_g − q_h) its pull. At the optimum
w = Jᵀλ + μ with λ ≥ 0 at contacts and μ at joint limits. λ need not be unique, so stored forces are right if some
λ ≥ 0 gives both them and w. Residuals are in N: moments are divided by √(k_r / k_t), joint torques by √(k_θ / k_t).
"""

from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.verify.contacts import PALM, Meetings, Pairs, axis_places
from hhsim.verify.kinematics import OwnHand, Posed, phalanx_axes

AT_LIMIT = 1e-9
"""Distance to a joint's limit [rad] within which the limit can bear a torque."""
BODY_COLUMNS = 3 * (PALM + 1)
END_OF_AXIS = 1e-12
"""Tolerance of the end of an axis, as a ratio of its length."""


class Moment(NamedTuple):
    """Contacts, joint limits and pull of the coupling at one tick."""

    jacobian: FloatArray  # derivative of the contacts' distances by q (N, 21)
    bodies: FloatArray  # normal of each contact in its body's three columns (N, 48)
    limits: FloatArray  # rows of the joints at a limit (M, 21)
    range_left: FloatArray  # range of each joint down and up [rad] (2, 15)
    pull: FloatArray  # w [N, N·m] (21,)
    distance: FloatArray  # of the contacts [m] (N,)
    body: IntArray  # of the contacts (N,)


def moment(hand: OwnHand, posed: Posed, flexion: FloatArray, pairs: Pairs, i: int, pull: FloatArray) -> Moment:
    """Build the `Moment` of tick `i` of `posed` from its contacts, flexion (5, 3) [rad] and pull (21,)."""
    pushed = pushes(posed, i, pairs.body, pairs.point, pairs.normal)
    return Moment(*pushed, *limit_rows(hand, flexion), pull, pairs.distance, pairs.body)


def limit_rows(hand: OwnHand, flexion: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rows of the joints at a limit, shape (M, 21), and the range of each joint down and up [rad], shape (2, 15)."""
    unit = np.eye(21)[6:]
    left = np.stack([(flexion - hand.flexion_min).ravel(), (hand.flexion_max - flexion).ravel()])
    return np.concatenate([unit[left[0] <= AT_LIMIT], -unit[left[1] <= AT_LIMIT]]), left


def pushes(
    posed: Posed, i: int, body: IntArray, point: FloatArray, force: FloatArray, twist: FloatArray | float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Generalised forces (N, 21) of forces at points of bodies of tick `i`, and each in its body's columns (N, 48).

    `force` [N], `point` [m] and the moments `twist` [N·m] have shape (N, 3).
    """
    rows, parts = np.arange(len(body))[:, None], np.arange(3)
    jacobian, bodies = np.zeros((len(body), 21)), np.zeros((len(body), BODY_COLUMNS))
    twist = np.broadcast_to(twist, force.shape)
    jacobian[:, :3], jacobian[:, 3:6] = force, _cross(point - posed.position[i], force) + twist
    bodies[rows, 3 * body[:, None] + parts] = force
    rows = np.flatnonzero(body != PALM)[:, None]
    finger, last = np.divmod(body[rows], 3)
    turned = _cross(point[rows] - posed.joints[i, finger[:, 0], :3], force[rows]) + twist[rows]
    torque = (posed.axes[i, finger[:, 0], None] * turned).sum(axis=2)
    jacobian[rows, 6 + 3 * finger + parts] = np.where(parts <= last, torque, 0.0)
    return jacobian, bodies


def balance(at: Moment, scale: FloatArray) -> float:
    """Residual [N] of balancing the coupling by contacts and joint limits; `scale` takes the 21 rows to N."""
    return residual((np.concatenate([at.jacobian, at.limits]) * scale).T, at.pull * scale)


def explained(at: Moment, scale: FloatArray, stored: FloatArray, pull: FloatArray, apart: bool) -> float:
    """Residual [N] of explaining stored forces by contact pushes that also balance a pull, shape (21,).

    `scale` has the factors of the 21 rows, to N; `stored` the force of each body [N], the palm's last, shape (48,). If
    `apart`, palm and fingers balance separately: contacts of a finger do not push the palm.
    """
    jacobian = at.jacobian
    if apart:
        jacobian = jacobian.copy()
        jacobian[at.body != PALM, :6] = 0.0
    limits = at.limits * scale
    rows = np.concatenate([jacobian * scale, limits]).T
    forces = np.concatenate([at.bodies, np.zeros((len(limits), BODY_COLUMNS))]).T
    return residual(np.concatenate([rows, forces]), np.concatenate([pull * scale, stored]))


def on_its_way(at: Moment, diagonal: FloatArray, offset: float) -> FloatArray:
    """Contact forces of a hand that is still on its way, as generalised forces (21,), by clarabel.

    They are the contacts' part of G (δ − δ*): δ is the step nearest to the wanted step δ* that keeps all contacts at
    their distance, or at `offset` [m] if that is less, and all joints within their range.
    """
    import clarabel
    from scipy.sparse import csc_matrix

    count = len(at.jacobian)
    if count == 0:
        return np.zeros(21)
    joints = np.eye(21)[6:]
    rows = np.concatenate([at.jacobian, joints, -joints])
    bound = np.concatenate([np.minimum(offset - at.distance, 0.0), -np.maximum(at.range_left, 0.0).ravel()])
    root = np.sqrt(diagonal)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    cones = [clarabel.NonnegativeConeT(len(rows))]
    quadratic, constraints = csc_matrix(np.eye(21)), csc_matrix(-rows / root)
    solution = clarabel.DefaultSolver(quadratic, at.pull / root, constraints, -bound, cones, settings).solve()
    return np.asarray(at.jacobian.T @ np.array(solution.z)[:count], np.float64)


def proxy_forces(pairs: Pairs, graphic: Posed, haptic: Posed, turn: FloatArray, i: int, stiffness: float) -> FloatArray:
    """Forces [N] of each body by Eq. 14, the sum of k |p_g − p_h| n over contacts, shape (16, 3).

    `turn` (3, 3) rotates the graphic to the haptic palm at tick `i`, `stiffness` is k [N/m].
    """
    found = np.zeros((PALM + 1, 3))
    for body, point, normal in zip(pairs.body, pairs.point, pairs.normal):
        if body == PALM:
            there = haptic.position[i] + turn @ (point - graphic.position[i])
        else:
            f, k = divmod(int(body), 3)
            ours, theirs = (phalanx_axes(posed.at(slice(i, i + 1)), f, k)[0] for posed in (graphic, haptic))
            there = haptic.joints[i, f, k] + theirs @ ours.T @ (point - graphic.joints[i, f, k])
        found[body] += stiffness * np.linalg.norm(point - there) * normal
    return found


def on_another_part(
    hand: OwnHand, posed: Posed, pairs: Pairs, center: FloatArray, radius: FloatArray, closed: bool, moved: FloatArray
) -> BoolArray:
    """True for pairs that method `paper` may have on another feature than the nearest point's, shape (N,).

    Its phalanx is a cone frustum with a sphere at its thin end, and the foot of a leaf's centre decides between the
    two, as the tick before left the hand, which has `moved` since [m], (n,) by tick. That is the nearest feature while
    the two only touch; with deep penetration feature and normal may differ. The sphere at a finger's first joint
    belongs to the palm. Leaf spheres [m], world, have shapes (L, 3) and (L,); if `closed`, spheres close both ends of
    every frustum, not the fingertip's alone.
    """
    found = np.zeros(len(pairs.body), bool)
    of_phalanx = np.flatnonzero(pairs.body != PALM)
    finger, phalanx = np.divmod(pairs.body[of_phalanx], 3)
    tick, leaf = pairs.tick[of_phalanx], pairs.leaf[of_phalanx]
    a, b = posed.joints[tick, finger, phalanx], posed.joints[tick, finger, phalanx + 1]
    radius_a, radius_b = hand.radius[finger, phalanx], hand.radius[finger, phalanx + 1]
    length = np.linalg.norm(b - a, axis=1)
    along = (b - a) / length[:, None]
    nearest, _ = axis_places(a, b, radius_a, radius_b, center[leaf])
    place = np.einsum("ni,ni->n", nearest - a, along)
    at_thick_end, at_thin_end = place <= END_OF_AXIS * length, place >= (1.0 - END_OF_AXIS) * length

    # Eq. 6 and 13: the foot's way from the thin bottom towards the thick one, and how far the frustum's part goes.
    sine = (radius_a - radius_b) / length
    foot = np.einsum("ni,ni->n", b - center[leaf], along) + radius_b * sine
    bottom, reach = length * (1.0 - sine**2), radius[leaf]
    lowest = np.where(closed | (phalanx == 2), -reach * sine, -reach)
    highest = bottom - reach * sine if closed else bottom + reach
    on_frustum = (foot >= lowest) & (foot <= highest)
    was_elsewhere = np.minimum(np.abs(foot - lowest), np.abs(foot - highest)) <= moved[tick]

    first_joint = np.linalg.norm(center[leaf] - a, axis=1) - reach - radius_a
    of_palm = (phalanx == 0) & (first_joint <= pairs.distance.max(initial=0.0))
    found[of_phalanx] = at_thick_end | of_palm | was_elsewhere | (on_frustum == at_thin_end)
    return found


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products along the last axis; numpy's are slower for one tick's few."""
    (x, y, z), (u, v, w) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def residual(matrix: FloatArray, wanted: FloatArray) -> float:
    """Residual of the nonnegative least squares matrix · x = wanted, x ≥ 0."""
    from scipy.optimize import nnls

    if matrix.shape[1] == 0 or not np.isfinite(wanted).all():
        return float(np.linalg.norm(wanted))
    return float(nnls(matrix, wanted)[1])


def with_meetings(at: Moment, posed: Posed, pairs: Meetings, i: int) -> Moment:
    """Add the pairs of tick `i` of `posed` to what can push there: each pushes its parts, one against the other."""
    first = pushes(posed, i, pairs.first, pairs.place, pairs.normal)
    second = pushes(posed, i, pairs.second, pairs.other, -pairs.normal)
    # Between two parts of the hand nothing acts on the whole of it.
    jacobian = np.where(np.arange(21) < 6, 0.0, first[0] + second[0])
    return at._replace(
        jacobian=np.concatenate([at.jacobian, jacobian]),
        bodies=np.concatenate([at.bodies, first[1] + second[1]]),
        distance=np.concatenate([at.distance, pairs.distance]),
        body=np.concatenate([at.body, pairs.first]),
    )
