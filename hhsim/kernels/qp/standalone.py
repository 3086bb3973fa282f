"""Program apart from the tick that built it, to solve again and time."""

import numpy as np

from hhsim.kernels.clock import monotonic_ns
from hhsim.kernels.jit import Indices, Record, jit
from hhsim.kernels.qp.active_set import CAPACITY, N_MAX, solve
from hhsim.kernels.qp.row_scan import ProgramRows

PROGRAM_GROUPS = 11
PROGRAM_GUESSES = 64

PROGRAM = np.dtype(
    [
        ("common", np.float64, (6, CAPACITY)),
        ("block", np.float64, (3, CAPACITY)),
        ("rhs", np.float64, (CAPACITY,)),
        ("target", np.float64, (N_MAX,)),
        ("group_start", np.int64, (PROGRAM_GROUPS,)),
        ("group_stop", np.int64, (PROGRAM_GROUPS,)),
        ("group_block", np.int64, (PROGRAM_GROUPS,)),
        ("guess", np.int64, (PROGRAM_GUESSES,)),
        ("guess_count", np.int64),
        ("variables", np.int64),
        ("common_columns", np.int64),
        ("groups", np.int64),
        ("tolerance", np.float64),
        ("relaxation", np.float64),
    ],
    align=True,
)
"""Arguments of `active_set.solve` in the layout of a tick."""


@jit
def solve_repeatedly(program: Record, duration_out: Indices, work: Record) -> int:
    """Solve a program once for each entry of `duration_out`, the wall time [ns] with two readings of the clock.

    Returns the status of `active_set.solve`; the result is in `work`.
    """
    groups, target = program.groups, program.target[: program.variables]
    rows = ProgramRows(
        program.common_columns,
        program.common[:],
        program.block[:],
        program.rhs[:],
        program.group_start[:groups],
        program.group_stop[:groups],
        program.group_block[:groups],
    )
    guess, guessed, tolerance = program.guess[:], program.guess_count, program.tolerance
    status = 0
    for i in range(duration_out.shape[0]):
        began = monotonic_ns()
        status = solve(program.variables, rows, target, tolerance, program.relaxation, guess, guessed, work)
        duration_out[i] = monotonic_ns() - began
    return status
