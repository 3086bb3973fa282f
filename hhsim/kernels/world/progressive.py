"""Method `progressive`: the paper's decoupled-and-progressive framework, palm first, then finger by finger.

The paper's palm problem does not see the fingers and can carry one to where its three joint angles cannot free it. Here
the palm yields to that. A finger whose program contradicts itself for the palm step at hand joins the palm's program:
its contacts and limits become rows, its three joints variables with a `YIELD_WEIGHT` share of their stiffness. So small
a share makes the palm's choice come first, as in the paper (lexicographic as the share goes to 0), and lets it change
continuously where a finger begins to bind it. Then the fingers are solved for the new palm step. Each round adds a
finger, so there are at most six; standing still is feasible in all of them, and so is the outcome: the guarantee of
`coupled` with the paper's precedence.

A finger with hardly any lever can have a way out that is too long to be taken in one step. A tick in which that leaves
no acceptable step goes on with the coupled program, see `kernels.world.tick`.
"""

from hhsim.kernels.contact.linearise import limit_start
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.jit import Array, Record, as_int64, jit, jit_inline, jit_noinline
from hhsim.kernels.parallel.thread_team import DISMISSED, await_done, item_done, post, rest, take_item
from hhsim.kernels.qp.active_set import INFEASIBLE, OPTIMAL, QpWork, solve
from hhsim.kernels.qp.row_scan import Rows
from hhsim.kernels.tick.state import PALM_GROUPS
from hhsim.kernels.tick.step import DURATION_FINGERS, DURATION_PALM, guess_rows, lap, take_multipliers
from hhsim.kernels.world.pairs import World
from hhsim.kernels.world.program import solve_plain
from hhsim.kernels.world.second_order import Lagrangian, correct_program

YIELD_WEIGHT = 1e-4
"""Share of its stiffness that a joint keeps in the palm's program."""
YIELD_SCALE = 100.0
"""1 / √YIELD_WEIGHT: what its columns are multiplied by there."""


@jit_inline
def _keeps_unmoved_rows(start: int, stop: int, block: Array, slack: float, rhs: Array) -> bool:
    # A row that no joint of the finger moves is for the palm to keep. The solver judges a zero row by a length in its
    # own units, which grow with the stiffness; here it is a length in metres, whatever the stiffness.
    for i in range(start, stop):
        if rhs[i] > 0.0 and block[0, i] == 0.0 and block[1, i] == 0.0 and block[2, i] == 0.0:
            if rhs[i] > slack:
                return False
            rhs[i] = 0.0
    return True


@jit_inline
def _join(problem: Record, contacts: Record, finger: int, work: Record) -> None:
    # The finger's rows and joints become the palm program's.
    first = work.variables
    work.yields[finger] = first
    work.variables += PHALANX_COUNT
    for k in range(PHALANX_COUNT):
        work.palm_target[first + k] = problem.target[6 + PHALANX_COUNT * finger + k] / YIELD_SCALE
    for part in range(2):
        start = contacts.start[finger + 1] if part == 0 else limit_start(contacts, finger)
        stop = contacts.start[finger + 2] if part == 0 else limit_start(contacts, finger + 1)
        group = 1 + 2 * finger + part
        work.palm_start[group] = start
        work.palm_stop[group] = stop
        work.palm_block[group] = first
        for k in range(PHALANX_COUNT):
            for i in range(start, stop):
                work.block[k, i] = YIELD_SCALE * problem.block[k, i]


@jit_noinline
def _solve_palm(method: World, state: Record, qp: QpWork) -> int:
    options, problem, contacts, active, step = (
        method.options,
        method.world[0].problem,
        state.contacts,
        state.warm,
        state.step,
    )
    work, tolerance = state.progressive, options.tolerance
    step.count = 0
    for j in range(DOF):
        step.delta[j] = 0.0
    if contacts.start[1] == 0 and work.variables == 6:
        for j in range(6):
            work.palm_step[j] = problem.target[j]
            step.delta[j] = problem.target[j] * problem.inverse_root[j]
        return OPTIMAL
    guessed = guess_rows(contacts, active, as_int64(0), work.guess[:], as_int64(0))
    for f in range(FINGER_COUNT):
        if work.yields[f] >= 0:
            guessed = guess_rows(contacts, active, f + 1, work.guess[:], guessed)
    start, stop, block = work.palm_start[:], work.palm_stop[:], work.palm_block[:]
    none = as_int64(0)
    columns = problem.common[:], work.block[:], problem.rhs[:]
    rows = Rows(as_int64(6), *columns, start, stop, block, problem.dense[:], none, none, none)
    # A joint's row is longer here by YIELD_SCALE; to the finger's own program the step must be as exact as its other
    # steps.
    scaled = tolerance / YIELD_SCALE if work.variables > 6 else tolerance
    guess = work.guess[:]
    status = solve(work.variables, rows, work.palm_target[:], scaled, options.relaxation, guess, guessed, qp)
    step.iterations += qp.counts[1]
    if status != OPTIMAL:
        return status
    take_multipliers(qp, step)
    if method.world[0].curved and work.variables == 6:
        for j in range(6):
            step.delta[j] = qp.x[j] * problem.inverse_root[j]
        row, force = step.row[: step.count], step.multiplier[: step.count]
        terms = options.pairs, method.states, method.world[0], row, force, problem.inverse_root[:], none, as_int64(6)
        correct_program(Lagrangian(*terms), qp.counts[0], step.delta[:], rows, options, work.correction, qp)
    for j in range(6):
        work.palm_step[j] = qp.x[j]
        step.delta[j] = qp.x[j] * problem.inverse_root[j]
    return status


@jit_noinline
def solve_finger(method: World, finger: int, qp: QpWork) -> None:
    """Solve one finger's program for the palm step at hand, into the state's progressive.finger[finger].

    Apart from `qp` it writes only there and in the finger's own rows of progressive.rhs.
    """
    state, options, problem = method.states[0], method.options, method.world[0].problem
    contacts, active, work = state.contacts, state.warm, state.progressive
    own = work.finger[finger]
    offset = 6 + PHALANX_COUNT * finger
    start, stop = contacts.start[finger + 1], contacts.start[finger + 2]
    own.start[0] = start
    own.stop[0] = stop
    own.start[1] = limit_start(contacts, finger)
    own.stop[1] = limit_start(contacts, finger + 1)
    for group in range(2):
        for i in range(own.start[group], own.stop[group]):
            total = problem.rhs[i]
            for j in range(6):
                total -= problem.common[j, i] * work.palm_step[j]
            work.rhs[i] = total
    if not _keeps_unmoved_rows(start, stop, problem.block[:], options.relaxation * problem.inverse_root[0], work.rhs):
        own.iterations = 0
        own.status = INFEASIBLE
        return
    for k in range(PHALANX_COUNT):
        own.target[k] = problem.target[offset + k]
    guessed = guess_rows(contacts, active, finger + 1, own.guess[:], as_int64(0))
    none = as_int64(0)
    columns, groups = (problem.common[:], problem.block[:], work.rhs[:]), (own.start[:], own.stop[:], own.block[:])
    rows = Rows(none, *columns, *groups, problem.dense[:], none, none, none)
    guess, tolerance = own.guess[:], options.tolerance
    own.status = solve(as_int64(PHALANX_COUNT), rows, own.target[:], tolerance, options.relaxation, guess, guessed, qp)
    own.iterations = qp.counts[1]
    if own.status != OPTIMAL:
        return
    take_multipliers(qp, own)
    if method.world[0].curved:
        own.step[:] = 0.0
        for j in range(6):
            own.step[j] = work.palm_step[j] * problem.inverse_root[j]
        for k in range(PHALANX_COUNT):
            own.step[offset + k] = qp.x[k] * problem.inverse_root[offset + k]
        row, force, n = own.row[: own.count], own.multiplier[: own.count], as_int64(PHALANX_COUNT)
        terms = options.pairs, method.states, method.world[0], row, force, problem.inverse_root[:], as_int64(offset), n
        correct_program(Lagrangian(*terms), qp.counts[0], own.step[:], rows, options, own.correction, qp)
    for k in range(PHALANX_COUNT):
        own.delta[k] = qp.x[k] * problem.inverse_root[offset + k]


@jit_inline
def _solve_fingers(method: World, state: Record, qp: QpWork) -> None:
    """Solve the program of every finger that has a contact, by whoever of the thread team is free."""
    problem, contacts, step = method.world[0].problem, state.contacts, state.step
    shared, word = state.thread_team.members > 1, state.thread_team.word[:]
    if shared:
        post(word, as_int64(FINGER_COUNT))
        while take_finger(method, qp) >= 0:
            pass
        await_done(word, as_int64(FINGER_COUNT))
    for f in range(FINGER_COUNT):
        if contacts.start[f + 2] > contacts.start[f + 1]:
            if not shared:
                solve_finger(method, as_int64(f), qp)
            continue
        # Nothing but its limits binds it, and to those its target is clamped, see `kernels.tick.tick`.
        offset = 6 + PHALANX_COUNT * f
        for j in range(offset, offset + PHALANX_COUNT):
            step.delta[j] = problem.target[j] * problem.inverse_root[j]


@jit_inline
def take_finger(method: World, qp: QpWork) -> int:
    """Take a finger of the task, and solve its program if it has a contact; returns as `take_item`."""
    contacts, word = method.states[0].contacts, method.states[0].thread_team.word[:]
    finger = take_item(word)
    if finger >= 0:
        if contacts.start[finger + 2] > contacts.start[finger + 1]:
            solve_finger(method, finger, qp)
        item_done(word)
    return finger


@jit
def help_out(method: World, qp: QpWork) -> None:
    """Solve fingers for the thread team's first thread, with the own workspace `qp`, until the team is dismissed."""
    polls, finger = as_int64(0), as_int64(0)
    while finger != DISMISSED:
        finger = take_finger(method, qp)
        if finger >= 0:
            polls = as_int64(0)
        else:
            rest(polls)
            polls += 1


@jit
def solve_progressive(method: World, state: Record, clipped: bool, qp: QpWork) -> int:
    """Solve palm, then fingers, or all at once in a tick without a step apart; `step` is written where OPTIMAL."""
    problem, contacts, work, step = method.world[0].problem, state.contacts, state.progressive, state.step
    loaded = method.world[0].loaded
    if state.fallback.is_coupled:
        return as_int64(solve_plain(method.options, method.states, method.world[0], qp))
    work.variables = 6
    for j in range(6):
        work.palm_target[j] = problem.target[j]
    for group in range(PALM_GROUPS):
        work.palm_start[group] = 0
        work.palm_stop[group] = 0
        work.palm_block[group] = -1
    work.palm_stop[0] = contacts.start[1]
    for f in range(FINGER_COUNT):
        work.yields[f] = -1
    while True:
        status = as_int64(_solve_palm(method, state, qp))
        lap(DURATION_PALM, state)
        if status != OPTIMAL:
            return status
        joined = False
        _solve_fingers(method, state, qp)
        for f in range(FINGER_COUNT):
            if contacts.start[f + 2] == contacts.start[f + 1]:
                continue
            own = work.finger[f]
            step.iterations += own.iterations
            if own.status == INFEASIBLE and work.yields[f] < 0:
                _join(problem, contacts, f, work)
                joined = True
                continue
            if own.status != OPTIMAL:
                lap(DURATION_FINGERS, state)
                return as_int64(own.status)
            for i in range(own.count):
                step.row[step.count + i], step.multiplier[step.count + i] = own.row[i], own.multiplier[i]
            step.count += own.count
            for k in range(PHALANX_COUNT):
                step.delta[6 + PHALANX_COUNT * f + k] = own.delta[k]
        lap(DURATION_FINGERS, state)
        if not joined:
            break
    # What carries the step's multipliers are rows of a program of all variables.
    problem.dense_rows = 0
    problem.gamma_error = 0.0
    loaded.count = step.count
    for i in range(step.count):
        loaded.row[i], loaded.key[i] = step.row[i], problem.key[step.row[i]]
        loaded.multiplier[i] = step.multiplier[i]
    return as_int64(OPTIMAL)
