"""Claims of the forces: the wrench at all ticks, balance and complementarity at the chosen ones.

Notation: q are the 21 variables (palm 6, flexion 15), G the coupling, w = G (q_g − q_h) its pull. At the optimum
w = Jᵀλ + μ with λ ≥ 0 at contacts and μ at joint limits. λ need not be unique, so stored forces are right if some
λ ≥ 0 gives both them and w. Residuals are in N: moments are divided by √(k_r / k_t), joint torques by √(k_θ / k_t).
"""

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.verify.claim import NOT_JUDGED, Claim, judged
from hhsim.verify.contacts import PALM, Pairs, joined
from hhsim.verify.kinematics import OwnHand, Posed
from hhsim.verify.tick_data import CAPACITY_EXCEEDED, LAG, LENGTH, NO_PLACE, SNAP, STUCK, JudgedTicks, left_out

FORCE = 1e-6
"""Relative tolerance of forces, and absolute one [N]: a ten-thousandth of the least force that has a rate."""
WHY_FORCE = "a millionth: a ten-thousandth of the least force that has a rate"
TURN = 4.0
"""Factor of the turn of the normals in a tick's last step, which is the step over the rolling radii; it covers the
levers of moments and both bodies of a contact."""
WHY_SLACK = "a millionth, and how far normals turn in the tick's last step, after which the program is not solved again"
AT_LIMIT = 1e-9
"""Distance to a joint's limit [rad] within which the limit can bear a torque."""
BODY_COLUMNS = 3 * (PALM + 1)
OF_PALM = np.arange(21) < 6
"""True for the variables of the palm."""
UNSETTLED = STUCK | LAG | CAPACITY_EXCEEDED | NO_PLACE | SNAP
"""Flags of ticks whose forces are no program's, or of one that was not at an end."""


def limit_rows(hand: OwnHand, flexion: FloatArray) -> FloatArray:
    """Rows of the joints at a limit, shape (M, 21), of angles (5, 3) [rad]."""
    unit = np.eye(21)[6:]
    down, up = (flexion - hand.flexion_min).ravel(), (hand.flexion_max - flexion).ravel()
    return np.concatenate([unit[down <= AT_LIMIT], -unit[up <= AT_LIMIT]])


def pushes(
    posed: Posed, i: int, body: IntArray, point: FloatArray, force: FloatArray, twist: FloatArray | float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Generalised forces (N, 21) of forces at points of bodies of tick `i`, and each in its body's columns (N, 48).

    `force` [N], `point` [m] and the moments `twist` [N·m] have shape (N, 3).
    """
    rows, parts = np.arange(len(body))[:, None], np.arange(3)
    jacobian, bodies = np.zeros((len(body), 21)), np.zeros((len(body), BODY_COLUMNS))
    twist = np.broadcast_to(twist, force.shape)
    jacobian[:, :3], jacobian[:, 3:6] = force, np.cross(point - posed.position[i], force) + twist
    bodies[rows, 3 * body[:, None] + parts] = force
    rows = np.flatnonzero(body != PALM)[:, None]
    finger, last = np.divmod(body[rows], 3)
    turned = np.cross(point[rows] - posed.joints[i, finger[:, 0], :3], force[rows]) + twist[rows]
    torque = (posed.axes[i, finger[:, 0], None] * turned).sum(axis=2)
    jacobian[rows, 6 + 3 * finger + parts] = np.where(parts <= last, torque, 0.0)
    return jacobian, bodies


def unit_pushes(posed: Posed, i: int, pairs: Pairs, own: Pairs) -> tuple[FloatArray, FloatArray]:
    """Generalised forces of 1 N at pairs of tick `i`, and of 1 N that pushes each pair of `own` parts apart; `pushes`.

    Between two parts of the hand nothing acts on the whole of it.
    """
    jacobian, bodies = pushes(posed, i, pairs.body, pairs.point, pairs.normal)
    first = pushes(posed, i, own.body, own.point, own.normal)
    second = pushes(posed, i, own.leaf, own.point, -own.normal)
    jacobian = np.concatenate([jacobian, np.where(OF_PALM, 0.0, first[0] + second[0])])
    return jacobian, np.concatenate([bodies, first[1] + second[1]])


def residual(matrix: FloatArray, wanted: FloatArray) -> float:
    """Residual of the nonnegative least squares matrix · x = wanted, x ≥ 0."""
    from scipy.optimize import nnls

    if matrix.shape[1] == 0 or not np.isfinite(wanted).all():
        return float(np.linalg.norm(wanted))
    return float(nnls(matrix, wanted)[1])


def force_claims(judge: JudgedTicks) -> list[Claim]:
    """Judge the forces that the method and its force model claim."""
    claims, method, force = [_wrench(judge)], judge.options["method"], judge.options["force"]
    if not judge.result.gives("work"):
        given = judge.result.gives("forces")
        note = "the method is not hhsim's, " + ("and these are what it said" if given else "and said none")
    elif judge.result.body.is_free:
        # Friction has other claims: `hhsim.verify.free_object_checks`.
        return claims
    elif method == "coupled" and force == "paper":
        note = "those of Eq. 14 follow from contacts that the file does not hold; the coupling's balance is judged"
        claims.append(_balance(judge, stored=False))
    elif judge.safe and force == "kkt":
        return [*claims, _complementarity(judge), _balance(judge, stored=True)]
    else:
        note = f"of method {method} they do not follow from the configuration: its programs are gone"
    return [*claims, Claim("forces", "contact forces follow from the configuration", NOT_JUDGED, note=note)]


def _wrench(judge: JudgedTicks) -> Claim:
    # The torque of method `paper` is of Euler angles of one of two branches, which no single tick tells.
    parts, note = (slice(3), "its forces alone") if judge.options["method"] == "paper" else (slice(6), "")
    pull, stored = judge.pull[:, parts], np.asarray(judge.result["force/palm_wrench"])[:, parts]
    off, tolerance = np.abs(pull - stored).max(axis=1), FORCE * (1.0 + np.abs(pull).max(axis=1))
    says = "Eq. 1: G (q_g − q_h)"
    return judged("palm wrench", says, off, tolerance, "N", WHY_FORCE, ticks=judge.numbers, note=note)


def _complementarity(judge: JudgedTicks) -> Claim:
    ticks, own = np.flatnonzero(judge.status & UNSETTLED == 0), judge.meetings
    found = [of.nearest(len(judge.status)) for of in (judge.against_other_hand, own, own._replace(body=own.leaf))]
    nearest = np.minimum.reduce([judge.nearest, *found])[ticks]
    says, note = "what does not touch bears no force", left_out(judge.status, UNSETTLED)
    return bears_where_near(judge, ticks, nearest, judge.bearing_within[ticks], says, note)


def bears_where_near(
    judge: JudgedTicks, ticks: IntArray, nearest: FloatArray, within: FloatArray, says: str, note: str
) -> Claim:
    """Judge how far from everything (n, 16) [m] bodies are that bear a force, at some ticks."""
    bears = np.linalg.norm(judge.forces[ticks], axis=2) > FORCE
    gap, within = np.where(bears, np.maximum(nearest, 0.0), 0.0), np.broadcast_to(within + LENGTH, bears.shape)
    worst = np.arange(len(ticks)), (gap / within).argmax(axis=1)
    why = "what the last step of a tick leaves between what bears more than a micronewton"
    return judged("complementarity", says, gap[worst], within[worst], "m", why, ticks=ticks, note=note)


def _balance(judge: JudgedTicks, *, stored: bool) -> Claim:
    """Judge that contacts and joint limits balance the coupling, by the `stored` forces or by any."""
    ticks, progressive = np.flatnonzero(judge.status & UNSETTLED == 0), judge.options["method"] == "progressive"
    # Normals of all contacts turn, and what they leave adds up.
    of_contacts, of_coupling = np.linalg.norm(judge.forces, axis=2).sum(axis=1), judge.pull * judge.scale
    size = of_contacts if stored else np.linalg.norm(of_coupling, axis=1)
    # Multipliers belong to the program one step earlier.
    slack, within = FORCE * (1.0 + size) + TURN * size * judge.last_step / judge.rolling, judge.bearing_within
    # What can bear a force: pairs with the object or the other hand, and of the hand's own parts.
    pairs, own, off = joined([judge.pairs, judge.against_other_hand]), judge.meetings, np.zeros(len(ticks))
    pairs = pairs.at(np.flatnonzero(pairs.distance <= within[pairs.tick, pairs.body]))
    own_within = np.maximum(within[own.tick, own.body], within[own.tick, own.leaf])
    own = own.at(np.flatnonzero(own.distance <= own_within))
    for n, i in enumerate(ticks.tolist()):
        near, met = pairs.of(i), own.of(i)
        jacobian, bodies = unit_pushes(judge.posed, i, near, met)
        jacobian, limits = jacobian * judge.scale, limit_rows(judge.hand, judge.shown.flexion[i]) * judge.scale
        if not stored:
            off[n] = residual(np.concatenate([jacobian, limits]).T, of_coupling[i])
            continue
        # Pushes that balance the coupling and are the stored forces; limits bear none of these.
        forces, of_finger = judge.forces[i].ravel(), np.append(near.body, met.body)[:, None] != PALM
        borne = np.append(bodies, np.zeros((len(limits), BODY_COLUMNS)), axis=0)
        off[n], wanted = np.inf, np.append(of_coupling[i], forces)
        for apart in {False, progressive}:
            # Apart, palm and fingers balance separately: contacts of a finger do not push the palm.
            rows = np.concatenate([np.where(apart & of_finger & OF_PALM, 0.0, jacobian), limits])
            off[n] = min(off[n], residual(np.append(rows, borne, axis=1).T, wanted))
        if progressive and off[n] > slack[i]:
            # Where the palm yields to a finger, contacts bear what they can.
            off[n] = min(off[n], residual(bodies.T, forces))
    says = "forces push along the normals of what touches, and balance the coupling: w = Jᵀλ + μ with λ ≥ 0"
    note = left_out(judge.status, UNSETTLED)
    return judged("force balance", says, off, slack[ticks], "N", WHY_SLACK, ticks=ticks, note=note)
