"""The referee's own forces: what the stored configurations demand, solved by other means than the solver's.

Notation: q the 21 variables (palm 6, flexion 15), G the coupling, w = G (q_g − q_h) what the coupling pulls with. At
the optimum w = Jᵀλ + μ with λ ≥ 0 at what touches and μ at joint limits only. The multipliers need not be unique, w
is; so the stored forces are right if some λ ≥ 0 gives both them and w, which a nonnegative least squares decides.
Residuals are in N, in the metric of the coupling: moments divided by √(k_r / k_t), joint torques by √(k_θ / k_t).
"""

from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.verify.contacts import PALM, Pairs
from hhsim.verify.kinematics import OwnHand, Posed

AT_LIMIT = 1e-9
"""A joint this near to its limit [rad] can bear on it."""
BODY_COLUMNS = 3 * (PALM + 1)


class Moment(NamedTuple):
    """One tick: what touches, and the coupling there.

    | field | meaning | shape |
    |---|---|---|
    | jacobian | of the touching pairs' distances by q | (N, 21) |
    | limits | rows of the joints that are at a limit | (M, 21) |
    | room | how far each joint may still go down and up [rad] | (2, 15) |
    | bodies | 1 · normal of each pair in its body's three columns | (N, 48) |
    | pull | w, [N] and [N·m] | (21,) |
    | distance | of the pairs [m] | (N,) |
    | body | of the pairs | (N,) |
    """

    jacobian: FloatArray
    limits: FloatArray
    room: FloatArray
    bodies: FloatArray
    pull: FloatArray
    distance: FloatArray
    body: IntArray


def moment(hand: OwnHand, posed: Posed, flexion: FloatArray, pairs: Pairs, i: int, pull: FloatArray) -> Moment:
    """The tick `i` of `posed`, whose touching pairs are `pairs`; flexion (5, 3) [rad], pull (21,)."""
    count = len(pairs.body)
    jacobian, bodies = np.zeros((count, 21)), np.zeros((count, BODY_COLUMNS))
    jacobian[:, :3] = pairs.normal
    jacobian[:, 3:6] = _cross(pairs.point - posed.position[i], pairs.normal)
    bodies[np.arange(count)[:, None], 3 * pairs.body[:, None] + np.arange(3)] = pairs.normal
    rows = np.flatnonzero(pairs.body != PALM)
    finger, last = np.divmod(pairs.body[rows], 3)
    arm = pairs.point[rows, None] - posed.joints[i, finger, :3]
    torque = (_cross(posed.axes[i, finger][:, None], arm) * pairs.normal[rows, None]).sum(axis=2)
    columns = 6 + 3 * finger[:, None] + np.arange(3)
    jacobian[rows[:, None], columns] = np.where(np.arange(3) <= last[:, None], torque, 0.0)
    unit = np.eye(21)[6:]
    room = np.stack([(flexion - hand.flexion_min).ravel(), (hand.flexion_max - flexion).ravel()])
    limits = np.concatenate([unit[room[0] <= AT_LIMIT], -unit[room[1] <= AT_LIMIT]])
    return Moment(jacobian, limits, room, bodies, pull, pairs.distance, pairs.body)


def balance(at: Moment, scale: FloatArray, pull: FloatArray | None = None) -> float:
    """How far [N] the coupling is from being balanced by pushes at what touches and joints at their limits.

    Args:
        scale: Of the 21 rows, to N.
        pull: Another one than the coupling's, shape (21,).
    """
    wanted = (at.pull if pull is None else pull) * scale
    return _residual((np.concatenate([at.jacobian, at.limits]) * scale).T, wanted)


def explained(at: Moment, scale: FloatArray, stored: FloatArray, pull: FloatArray, apart: bool) -> float:
    """How far [N] stored forces are from pushes at what touches that also balance a pull.

    Args:
        scale: Of the 21 rows, to N.
        stored: Force of each body [N], the palm's last, shape (48,).
        pull: Shape (21,).
        apart: Palm and fingers each bear their own: contacts of a finger do not push the palm.
    """
    jacobian = at.jacobian
    if apart:
        jacobian = jacobian.copy()
        jacobian[at.body != PALM, :6] = 0.0
    limits = at.limits * scale
    rows = np.concatenate([jacobian * scale, limits]).T
    forces = np.concatenate([at.bodies, np.zeros((len(limits), BODY_COLUMNS))]).T
    return _residual(np.concatenate([rows, forces]), np.concatenate([pull * scale, stored]))


def pushes_alone(at: Moment, stored: FloatArray) -> float:
    """How far [N] stored forces, shape (48,), are from pushes at what touches, whatever they balance."""
    return _residual(at.bodies.T, stored)


def on_its_way(at: Moment, diagonal: FloatArray, offset: float) -> FloatArray:
    """What bears the coupling of a hand that is not where it wants to be, shape (21,), by clarabel.

    Of the step δ that comes nearest to the user's hand, δ*, without coming nearer to anything that touches and without
    leaving a joint's range, G (δ − δ*) is borne by what touches and by the limits that the step would meet; this is the
    part of what touches. Nothing is asked of contacts nearer than `offset` [m] but not to come nearer.
    """
    import clarabel
    from scipy.sparse import csc_matrix

    count = len(at.jacobian)
    if count == 0:
        return np.zeros(21)
    joints = np.eye(21)[6:]
    rows = np.concatenate([at.jacobian, joints, -joints])
    bound = np.concatenate([np.minimum(offset - at.distance, 0.0), -np.maximum(at.room, 0.0).ravel()])
    root = np.sqrt(diagonal)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    solution = clarabel.DefaultSolver(
        csc_matrix(np.eye(21)),
        at.pull / root,
        csc_matrix(-rows / root),
        -bound,
        [clarabel.NonnegativeConeT(len(rows))],
        settings,
    ).solve()
    return np.asarray(at.jacobian.T @ np.array(solution.z)[:count], np.float64)


def proxy_forces(pairs: Pairs, graphic: Posed, haptic: Posed, turn: FloatArray, i: int, stiffness: float) -> FloatArray:
    """Eq. 14 summed over pairs, each body's force [N], shape (16, 3).

    Args:
        turn: Graphic to haptic palm, shape (3, 3).
        i: The tick, of both hands.
        stiffness: k [N/m].
    """
    found = np.zeros((PALM + 1, 3))
    for body, point, normal in zip(pairs.body, pairs.point, pairs.normal):
        if body == PALM:
            there = haptic.position[i] + turn @ (point - graphic.position[i])
        else:
            f, k = divmod(int(body), 3)
            ours, theirs = (_phalanx_frame(posed, i, f, k) for posed in (graphic, haptic))
            there = haptic.joints[i, f, k] + theirs @ ours.T @ (point - graphic.joints[i, f, k])
        found[body] += stiffness * np.linalg.norm(point - there) * normal
    return found


def fingertip_normals(graphic: Posed, haptic: Posed, bears: BoolArray, stiffness: float) -> FloatArray:
    """Fig. 9: k |E E₁| across the distal phalanx, of the fingers that bear a force (T, 5); shape (T, 5, 3) [N]."""
    off = graphic.joints[:, :, 3] - haptic.joints[:, :, 3]
    along = graphic.joints[:, :, 3] - graphic.joints[:, :, 2]
    along = along / np.linalg.norm(along, axis=2, keepdims=True)
    across = np.cross(along, np.cross(off, along))
    size = np.linalg.norm(across, axis=2, keepdims=True)
    unit = across / np.where(size > 0.0, size, 1.0)
    return np.asarray(np.where(bears[..., None], stiffness * np.linalg.norm(off, axis=2, keepdims=True) * unit, 0.0))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products along the last axis: numpy's takes longer to begin than a tick's takes."""
    (x, y, z), (u, v, w) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def _phalanx_frame(posed: Posed, i: int, f: int, k: int) -> FloatArray:
    along = posed.joints[i, f, k + 1] - posed.joints[i, f, k]
    along = along / np.linalg.norm(along)
    axis = posed.axes[i, f]
    return np.stack([axis, along, np.cross(axis, along)], axis=1)


def _residual(matrix: FloatArray, wanted: FloatArray) -> float:
    from scipy.optimize import nnls

    if matrix.shape[1] == 0 or not np.isfinite(wanted).all():
        return float(np.linalg.norm(wanted))
    return float(nnls(matrix, wanted)[1])
