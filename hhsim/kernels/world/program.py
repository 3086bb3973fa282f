"""Program of hands and free objects, solved until friction opposes the resulting slip."""

import math

import numpy as np

from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT
from hhsim.kernels.jit import Record, as_bool, as_int64, jit
from hhsim.kernels.machine_code import ask_code
from hhsim.kernels.qp.active_set import OPTIMAL, RESUMES, QpWork, solve
from hhsim.kernels.qp.row_scan import Rows
from hhsim.kernels.rotation import turned
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.state import WORK_LINEARISATIONS
from hhsim.kernels.tick.step import ACTIVE_CAPACITY
from hhsim.kernels.world.body import OBJECT_DOF, SLIDER, along_axis, as_object_moves, as_other_moves
from hhsim.kernels.world.columns import States, common_count, hand_column, is_still, variable_count, wide_rows
from hhsim.kernels.world.friction import NO_LOAD, end_search, find_directions, lower_slips, next_slips
from hhsim.kernels.world.hand_contact import HAND_CONTACT_KEYS, guess_dense, read_dense
from hhsim.kernels.world.joints import JOINT_KEYS, SLACK_OFFSET, slack_column
from hhsim.kernels.world.pairs import World
from hhsim.kernels.world.rows import (
    STANDS_BACK,
    TABLE_KEYS,
    contact_groups,
    contact_rows,
    end_rows,
    friction_rows,
    measure_slip,
)

SEARCHED = 2
"""Programs of a tick in which Γ and directions are sought; in the later ones they stand."""
SHIFT_ROUNDS = 6
"""Most solutions of each of a tick's first two programs with one Γ after another; then Γ stands: the rest is convex."""
CONVERGES = 0.5
"""A round that leaves more than this share of what Γ was off before is the last one."""
SEARCH = 20
"""A tick looks for no other Γ once its programs have changed so many rows."""
REPAIRS = 8
"""Most solutions more of a program with a Γ that turned out too large made smaller; the last time all are 0."""
PART_REPAIRS = 2
"""Limit for a program with a clipped target, from which the tick goes on."""
LET_FLOAT = 0.5
"""Γ is reduced by this share of the clearance. Otherwise a contact that sticks oscillates, as Γ comes and goes."""
SHIFT_TOLERANCE = 0.2
SHIFT_TOLERANCE_SHARE = 1e-3
"""A Γ that is off by no more than this share of the clearance and this one of it is left: so far a contact floats."""
AT_REST = 1e-11
"""A free body in contact stands still if it would move by no more than this in a tick [m], the tolerance of a program,
and did not in the last one either: the last correction of its pose is still made."""

LOADED = np.dtype(
    [
        ("count", np.int64),
        ("key", np.int64, (ACTIVE_CAPACITY,)),
        ("row", np.int64, (ACTIVE_CAPACITY,)),
        ("multiplier", np.float64, (ACTIVE_CAPACITY,)),
        ("guess", np.int64, (ACTIVE_CAPACITY,)),
    ],
    align=True,
)
"""Rows with a multiplier at the last solution: keys, rows, multipliers; and the guess made of them."""


@jit
def _guess(problem: Record, loaded: Record, pairs: Record) -> int:
    # The rows whose keys carried a multiplier the last time; most lie where they were.
    start, stop = problem.group_start, problem.group_stop
    key, loaded_key = problem.key, loaded.key
    filled = as_int64(0)
    for i in range(loaded.count):
        row = loaded.row[i]
        if JOINT_KEYS < loaded_key[i] <= HAND_CONTACT_KEYS:
            continue
        found = as_bool(row < problem.rows and key[row] == loaded_key[i])
        for g in range(problem.groups):
            if found:
                break
            for row in range(start[g], stop[g]):
                if key[row] == loaded_key[i]:
                    found = as_bool(True)
                    break
        if found:
            loaded.guess[filled] = row
            filled += 1
    return guess_dense(problem, pairs, loaded, filled)


@jit
def scale_target(world: Record) -> None:
    """Write the program's target, scaled and in its order."""
    bodies, problem = world.bodies, world.problem
    hand, target, weight = problem.hand_target, problem.target, problem.inverse_root
    for h in range(problem.hands):
        for j in range(DOF):
            target[hand_column(problem, h, j)] = hand[DOF * h + j] / weight[j]
    for k in range(0 if is_still(problem) else problem.bodies):
        body, column = bodies[k], problem.column[k]
        for j in range(OBJECT_DOF):
            if body.inverse_root[j] > 0.0:
                target[column + j] = problem.body_target[OBJECT_DOF * k + j] / body.inverse_root[j]
            else:
                target[column + j] = 0.0
        if body.joint == SLIDER:
            target[column] = along_axis(body, target[column : column + OBJECT_DOF])
            target[column + 1] = target[column + 2] = 0.0
        if body.joint_friction > 0.0:
            far = math.sqrt(SLACK_OFFSET * body.joint_friction)
            target[slack_column(body, problem, as_int64(k))] = (abs(body.joint_motion) / SLACK_OFFSET - 1.0) * far


@jit
def take_targets(problem: Record) -> None:
    """Write the step to the targets, which is the program's where nothing is near."""
    for h in range(problem.hands):
        for j in range(DOF):
            problem.delta[hand_column(problem, h, j)] = problem.hand_target[DOF * h + j]
    for k in range(0 if is_still(problem) else problem.bodies):
        column = problem.column[k]
        for j in range(OBJECT_DOF):
            problem.delta[column + j] = problem.body_target[OBJECT_DOF * k + j]


@jit
def take_hand_steps(states: States, problem: Record) -> None:
    """Give each hand its step of the program, shape (21,), where nothing else moves."""
    for h in range(problem.hands):
        for j in range(DOF):
            states[h].step.delta[j] = problem.delta[hand_column(problem, h, j)]


@jit
def take_steps(states: States, bodies: Record, fraction: float, problem: Record) -> None:
    """Compute the step past its body of what moves in each pair, shape (21,), from a share of the program's step.

    Relative motion is not proportional to the share. For a share below 1 the step is therefore divided by it, so that
    `fraction` of the step ends where both are after that share of theirs; the fingers' part stays as it was.
    """
    delta, part, palm_step = problem.delta, problem.whole, problem.scratch
    for j in range(common_count(problem)):
        part[j] = delta[j] if fraction == 1.0 else fraction * delta[j]
    for p in range(problem.pairs):
        number, other, step, pose = problem.body[p], problem.other[p], states[p].step, states[p].pose
        column, hand = problem.column[number], problem.hand[p]
        own = part[column : column + OBJECT_DOF]
        if other >= 0:
            first = problem.column[other]
            as_other_moves(bodies[other], pose.rotation[:], part[first : first + OBJECT_DOF], palm_step[:])
        else:
            for j in range(6):
                palm_step[j] = part[problem.palm[hand] + j]
            if number > 0:
                for j in (0, 3):
                    x, y, z = turned(problem.turn[p], palm_step[j], palm_step[j + 1], palm_step[j + 2])
                    palm_step[j], palm_step[j + 1], palm_step[j + 2] = x, y, z
            for j in range(6, DOF if fraction == 1.0 else 6):
                step.delta[j] = delta[hand_column(problem, hand, j)]
        as_object_moves(bodies[number], pose.position[:], palm_step[:], own, step.delta[0:6])
        for j in range(0 if fraction == 1.0 else 6):
            step.delta[j] /= fraction


@jit
def read_step(bodies: Record, problem: Record, qp: QpWork) -> None:
    """Read the step of a solution."""
    delta, weight = problem.delta, problem.inverse_root
    for h in range(problem.hands):
        for j in range(DOF):
            column = hand_column(problem, h, j)
            delta[column] = qp.x[column] * weight[j]
    for k in range(0 if is_still(problem) else problem.bodies):
        body, column = bodies[k], problem.column[k]
        if column >= variable_count(problem):
            continue
        for j in range(OBJECT_DOF):
            delta[column + j] = qp.x[column + j] * body.inverse_root[j]
        if body.joint == SLIDER:
            way, axis = delta[column], body.axes[2]
            delta[column], delta[column + 1], delta[column + 2] = way * axis[0], way * axis[1], way * axis[2]


@jit
def _read(problem: Record, friction: Record, loaded: Record, pairs: Record, qp: QpWork) -> None:
    # The loaded rows of the solution, and what each contact with friction bears and slips.
    for i in range(friction.count):
        friction.plain_load[i] = friction.cone_load[i] = 0.0
    if problem.dense_rows > 0:
        read_dense(problem, pairs, qp)
    loaded.count = qp.counts[0]
    for j in range(loaded.count):
        row = qp.active[j]
        multiplier = qp.multiplier[j]
        loaded.row[j] = row
        loaded.key[j] = problem.key[row]
        loaded.multiplier[j] = multiplier
        owner = problem.owner[row]
        if owner >= 0:
            kind = problem.kind[row]
            if kind == 0:
                friction.plain_load[owner] += multiplier
            else:
                friction.cone_load[owner] += multiplier
    count = as_int64(0)
    for i in range(friction.count):
        if friction.has_friction[i] == 1 and friction.plain_load[i] + friction.cone_load[i] > 0.0:
            friction.loaded_contact[count] = i
            count += 1
    friction.loaded_contacts = count


@jit
def _is_settled(states: States, offset: float, world: Record) -> bool:
    # Whether every contact that bears a force has de Saxcé's Γ and rubs against its slip with all of its load.
    problem, friction, settled = world.problem, world.friction, True
    problem.gamma_error = 0.0
    for j in range(variable_count(problem)):
        problem.whole[j] = problem.total[j] + problem.delta[j]
    for h in range(problem.hands):
        for f in range(FINGER_COUNT):
            i, spread = FINGER_COUNT * h + f, states[h].problem.abduction_step[f]
            problem.whole_abduction[i] = problem.abduction_total[i] + spread
    for i in range(friction.count):
        if friction.has_friction[i] == 0:
            continue
        slip = measure_slip(states, world, problem.whole[:], problem.whole_abduction[:], i)
        friction.length[i] = slip
        load = friction.plain_load[i] + friction.cone_load[i]
        if load == 0.0:
            continue
        # Of a slip that is let float, what Γ is short of it counts as balanced.
        shift = friction.shift[i] + min(slip, LET_FLOAT * offset)
        square = (friction.spin[i] - shift * friction.about[i, 0]) ** 2
        for j in range(3):
            square += (friction.slip[i, j] - shift * friction.along[i, 0, j]) ** 2
        off = math.sqrt(square)
        problem.gamma_error = max(problem.gamma_error, off)
        if off > SHIFT_TOLERANCE * offset + SHIFT_TOLERANCE_SHARE * slip or friction.plain_load[i] > NO_LOAD * load:
            settled = False
    return settled


@jit
def _rest(bodies: Record, problem: Record) -> None:
    delta = problem.delta
    for k in range(problem.bodies):
        body, column = bodies[k], problem.column[k]
        if body.is_free == 0 or body.is_driven == 1 or body.joint > 0:
            continue
        size = 0.0
        before = 0.0
        for j in range(3):
            # The rotation as the way of a point at the radius of gyration.
            radius = body.inverse_root[0] / body.inverse_root[3 + j]
            size += abs(delta[column + j]) + abs(delta[column + 3 + j]) * radius
            before += body.period * (abs(body.velocity[j]) + abs(body.spin[j]) * radius)
        if size <= AT_REST and before <= AT_REST:
            for j in range(OBJECT_DOF):
                delta[column + j] = 0.0


@jit
def _keep_friction(offset: float, world: Record) -> None:
    # Keep what the next program begins from: Γ as it stands, and which way e_1 is to be. A Γ that is found is that of
    # the slip itself, or what is left of one would move what sticks to and fro.
    friction, last, count = world.friction, world.last_friction, as_int64(0)
    for i in range(friction.count):
        if friction.has_friction[i] == 0:
            continue
        load = friction.plain_load[i] + friction.cone_load[i]
        last.key[count] = TABLE_KEYS - friction.key[i] if friction.contact_code[i] < 0 else friction.key[i]
        balanced = max(0.0, friction.length[i] - LET_FLOAT * offset)
        found = load == 0.0 or abs(friction.shift[i] - balanced) <= SHIFT_TOLERANCE * offset
        last.shift[count] = balanced if found else friction.shift[i]
        last.about[count] = friction.about[i, 0]
        for j in range(3):
            last.along[count, j] = friction.along[i, 0, j]
        for j in range(4):
            last.next_direction[count, j] = world.directions.next_direction[i, j]
        count += 1
    last.count = count


@jit
def clip_shifts(fraction: float, friction: Record) -> None:
    """Γ for a step of which the hand goes a fraction of its way past the object."""
    for i in range(friction.count):
        start_slip = friction.start_spin[i] ** 2
        for j in range(3):
            start_slip += friction.start[i, j] ** 2
        start_slip = math.sqrt(start_slip)
        if friction.shift[i] > start_slip:
            friction.shift[i] = start_slip + fraction * (friction.shift[i] - start_slip)


@jit
def _solve_once(options: TickOptions, rows: Rows, guessed: int, world: Record, step: Record, qp: QpWork) -> int:
    """Solve the program for the Γ at hand, and read its solution; returns a status of `kernels.qp.active_set`."""
    problem, loaded, tolerance, relaxation = world.problem, world.loaded, options.tolerance, options.relaxation
    variables, target = variable_count(problem), problem.target[:]
    status = solve(variables, rows, target, tolerance, relaxation, loaded.guess[:], guessed, qp)
    step.iterations += qp.counts[1]
    if status == OPTIMAL:
        read_step(world.bodies, problem, qp)
        _read(problem, world.friction, loaded, world.hand_pairs, qp)
    return status


@jit
def solve_plain(options: TickOptions, states: States, world: Record, qp: QpWork) -> int:
    """Solve for a step of hands beside what stands still, and write it; returns a status of `kernels.qp.active_set`."""
    problem, loaded, pairs, step = world.problem, world.loaded, world.hand_pairs, states[0].step
    end_rows(states, options.offset, contact_groups(states, problem), problem, pairs)
    guessed = _guess(problem, loaded, pairs)
    status = _solve_once(options, wide_rows(problem), guessed, world, step, qp)
    if status == OPTIMAL:
        if options.correcting != 0 and ask_code(options.correcting, (options, states, world, qp)):
            read_step(world.bodies, problem, qp)
        take_hand_steps(states, problem)
    return status


@jit
def solve_free(method: World, state: Record, clipped: bool, qp: QpWork) -> int:
    """Solve for a step of hands and bodies, with one Γ after another until friction is Coulomb's.

    The problem's `delta` and the pairs' steps are written where the status is OPTIMAL. Γ of a step that is clipped is
    for a part of the tick's slip, and is not kept. Returns a status of `kernels.qp.active_set`.
    """
    options, states, world, step = method.options, method.states, method.world[0], state.step
    problem, friction, loaded, coulomb = world.problem, world.friction, world.loaded, world.coulomb
    offset, relaxed, rounds = options.offset, state.fallback.is_relaxed, as_int64(1)
    if state.work[WORK_LINEARISATIONS] - state.progress.restarted <= SEARCHED and not clipped:
        # Where searches came to nothing of late there is none.
        rounds = as_int64(1 if coulomb.wait > 0 else SHIFT_ROUNDS)
        coulomb.wait = max(coulomb.wait - 1, 0)
    friction_rows(states, world, offset, relaxed)
    rows = wide_rows(problem)
    floats, backs = LET_FLOAT * offset, STANDS_BACK * offset
    guessed = _guess(problem, loaded, world.hand_pairs)
    best = np.inf
    seeks = rounds > 1
    repairs = as_int64(0)
    for i in range(rounds + REPAIRS + 2):
        status = _solve_once(options, rows, guessed, world, step, qp)
        if status != OPTIMAL:
            return as_int64(status)
        if _is_settled(states, offset, world):
            if seeks:
                coulomb.failures = 0
            break
        worse = seeks and problem.gamma_error > best
        seeks = seeks and i < rounds - 1 and problem.gamma_error <= CONVERGES * best and step.iterations < SEARCH
        if seeks:
            best = problem.gamma_error
            next_slips(floats, states, world, qp)
        elif worse:
            end_search(friction, loaded, coulomb)
        else:
            repairs += 1
            most = PART_REPAIRS if clipped else REPAIRS
            lowered = lower_slips(floats, backs, problem, friction, qp, coulomb) if repairs <= most else 0
            if lowered == 0:
                break
            if repairs < REPAIRS:
                guessed = RESUMES
                for c in range(lowered):
                    j = coulomb.contact[c]
                    contact_rows(states, world, offset, relaxed, j, friction.row[j])
                continue
            # Once these are lowered others may be too large: none is of which all are 0.
            for j in range(friction.count):
                friction.shift[j] = 0.0
        for j in range(friction.count):
            if friction.has_friction[j] == 1:
                contact_rows(states, world, offset, relaxed, j, friction.row[j])
        guessed = loaded.count
        for j in range(guessed):
            loaded.guess[j] = loaded.row[j]
    if not clipped:
        find_directions(floats, world)
        _keep_friction(offset, world)
    if options.correcting != 0 and ask_code(options.correcting, (options, states, world, qp)):
        read_step(world.bodies, problem, qp)
    if loaded.count > 0:
        _rest(world.bodies, problem)
    take_steps(states, world.bodies, 1.0, problem)
    return as_int64(OPTIMAL)
