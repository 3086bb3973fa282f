"""Second derivatives of the pairs of each hand's own parts, in a program of hands and bodies.

Two fingers that cross meet with a small radius of curvature. Where they are pressed together, force times curvature can
exceed the coupling's stiffness several times over: steps of a program of flat contacts then go too far, to and fro.
See `kernels.tick.second_order`; contacts with bodies count as flat here.
"""

import math
from typing import NamedTuple

from hhsim.kernels.contact.own_parts import OwnParts, add_own_bends
from hhsim.kernels.copy import copy_values
from hhsim.kernels.free.columns import (
    States,
    common_count,
    first_finger,
    hand_count,
    palm_column,
    variable_count,
    wide_rows,
)
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.jit import Array, Record, as_bool, as_int64, jit
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.qp.qr_update import project
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.second_order import correct_for_curvature, curvature

SPANNED = 1e-10
"""Squared length of a column's part outside the active rows below which they hold it."""
FAR = 4.0
"""Steps longer than this many longest corrections are not corrected: they end elsewhere, and the hand gets on less."""
FINGERS = PHALANX_COUNT * FINGER_COUNT


class OwnLagrangian(NamedTuple):
    """Curved part of a program of hands and bodies: each hand's own pairs that carry a multiplier."""

    own: OwnParts
    states: States
    problem: Record
    loaded: Record  # rows with a multiplier [N]
    inverse_root: Array  # 1 / √G of the fingers' variables, 0 for all others, (>= n,)
    offset: int  # 0
    n: int  # number of variables


@curvature.of(OwnLagrangian)
@jit
def _curvature(lagrangian: OwnLagrangian, step: Array, product_out: Array) -> None:
    problem, loaded = lagrangian.problem, lagrangian.loaded
    row, force = loaded.row[: loaded.count], loaded.multiplier[: loaded.count]
    product_out[:] = 0.0
    for h in range(hand_count(problem)):
        each, fingers = lagrangian.states[h], first_finger(problem, h)
        if not each.self_contact.bends:
            continue
        whole, product = each.correction.whole, each.correction.product
        whole[:6], product[:] = 0.0, 0.0
        copy_values(step[fingers : fingers + FINGERS], whole[6:])
        given, root = (each.pose, each.self_contact, problem.own_row[h]), problem.inverse_root[:]
        add_own_bends(lagrangian.own, *given, row, force, root, whole[:], product[:])
        copy_values(product[6:], product_out[fingers : fingers + FINGERS])


@jit
def _hold_bodies(n: int, problem: Record, qp: QpWork) -> int:
    """Add the bodies' columns to the basis of the active rows; return the number of its rows.

    What moves a body is what the program's multipliers put on it, by Newton's equation.
    """
    k = qp.counts[0]
    for j in range(common_count(problem)):
        is_palm = False
        for h in range(hand_count(problem)):
            is_palm = is_palm or 0 <= j - palm_column(problem, h) < 6
        if is_palm or k >= n:
            continue
        qp.normal[:] = 0.0
        qp.normal[j] = 1.0
        square = project(n, k, qp)
        if square > SPANNED:
            scale = 1.0 / math.sqrt(square)
            for i in range(qp.direction.shape[0]):
                qp.basis[k, i] = scale * qp.direction[i]
            k += 1
    return as_int64(k)


@jit
def correct_own(options: TickOptions, states: States, world: Record, qp: QpWork) -> bool:
    """Move a program's solution to second order in the hands' own pairs; return whether it is another."""
    problem, work, n, bends = world.problem, world.correction, variable_count(world.problem), False
    for h in range(hand_count(problem)):
        for r in range(states[h].self_contact.count if states[h].self_contact.bends else 0):
            bends = bends or problem.own_multiplier[h, r] > 0.0
    square = 0.0
    for j in range(n):
        square += qp.x[j] * qp.x[j]
    if not bends or square > (FAR * options.longest_correction) ** 2:
        return as_bool(False)
    root = world.finger_root
    root[:] = 0.0
    for h in range(hand_count(problem)):
        first = first_finger(problem, h)
        copy_values(problem.inverse_root[6:DOF], root[first : first + FINGERS])
    lagrangian = OwnLagrangian(options.own, states, problem, world.loaded, root, as_int64(0), n)
    longest = options.longest_correction
    held = _hold_bodies(n, problem, qp)
    correct_for_curvature(lagrangian, held, problem.delta[:], wide_rows(problem), options.tolerance, longest, work, qp)
    return as_bool(True)
