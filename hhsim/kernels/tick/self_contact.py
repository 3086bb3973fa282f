"""Contacts of the hand with itself in a tick: rows for the pairs that its step would break, and their forces.

A program is first solved without them. Only where its step brings two parts together it gets their rows, and is solved
again, until it breaks no other: a step that no pair is in the way of is that of a hand whose parts go through each
other, to the bit.
"""

from typing import Any

from hhsim.kernels.contact.linearise import build_rows, clamp_to_limits, limit_start
from hhsim.kernels.contact.self_pairs import (
    BROKEN,
    NoPairs,
    SelfPairs,
    add_rows,
    as_it_is,
    nothing,
    row_key,
    scale_rows,
)
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, HandArrays
from hhsim.kernels.jit import Record, as_int64, generic, jit, jit_noinline
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork
from hhsim.kernels.tick.linearisation import step_to_haptic
from hhsim.kernels.tick.method import solve_program
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.step import ACTIVE_CAPACITY


@generic
def keep_apart(own: Any, status: int, method: Any, hand: HandArrays, state: Record, qp: QpWork) -> int:
    """Solve a solved program again until its step brings no two of the hand's own parts together; return its status."""


@keep_apart.of(SelfPairs)
@jit_noinline
def _keep_apart(own: SelfPairs, status: int, method: Any, hand: HandArrays, state: Record, qp: QpWork) -> int:
    options = method.options
    while status == OPTIMAL and add_rows(own, hand, BROKEN, options, state):
        _aim_apart(hand, options, state)
        status = solve_program(method, state, qp)
    return status


@jit
def _aim_apart(hand: HandArrays, options: TickOptions, state: Record) -> None:
    """Build the program anew, with the rows of the hand's own parts and what abduction they have room for."""
    own, problem, start = state.self_contact, state.problem, state.contacts.start
    step_to_haptic(state, problem.target[:], problem.abduction_step[:])
    for f in range(FINGER_COUNT):
        problem.abduction_step[f] *= own.share[f]
        if start[f + 2] == start[f + 1] and own.meets[f] == 0:
            clamp_to_limits(hand, state.pose, f, problem.target[:])
    build_rows(hand, state.pose, state.contacts, options.offset, state.program.is_relaxed, problem)
    scale_rows(options.own, options.offset, state.program.is_relaxed, state)
    for j in range(DOF):
        problem.target[j] /= problem.inverse_root[j]


@generic
def store_meeting(own: Any, state: Record, active: Record) -> None:
    """Name the parts of rows of the hand's own parts in a set of active contacts, each of both with its force."""


@store_meeting.of(SelfPairs)
@jit
def _store_meeting(own: SelfPairs, state: Record, active: Record) -> None:
    step, rows = state.step, state.self_contact
    first = limit_start(state.contacts, as_int64(FINGER_COUNT))
    for i in range(step.count):
        row = step.row[i] - first
        if row < 0:
            continue
        pair, other = rows.pair[row], active.count
        active.key[i] = row_key(rows, row)
        active.body[i] = own.first[pair]
        for j in range(3):
            active.normal[j, i] = rows.normal[row, j]
        if other == ACTIVE_CAPACITY:
            continue
        active.key[other], active.body[other] = active.key[i], own.second[pair]
        active.multiplier[other] = active.multiplier[i]
        for j in range(3):
            active.normal[j, other] = -rows.normal[row, j]
            active.point[j, other] = 0.0
        active.count += 1


store_meeting.of(NoPairs)(nothing)
keep_apart.of(NoPairs)(as_it_is)
