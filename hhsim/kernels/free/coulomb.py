"""Coulomb's law contact by contact: which way each contact of a program slips, and how far.

With f = (λ, r) a contact's force, r the part against s, u what its displacement w = (n · Δ + d - ε, s) would be without
it, and W what a newton of each part does to it, the law is

    w = u + W f,   λ >= 0,   w_n >= 0,   |r| <= λ,   and where s is not 0:  r = -λ s / |s|.

A contact alone is solved for exactly: it stands off where u_n >= 0, it sticks where f = -W⁻¹ u lies in the cone, and
else it slips: (W + α diag(0, 1, 1, 1)) f = -u with the α at which |r| = λ. Sweep after sweep each contact is solved for
with what the others bear (nonlinear Gauss-Seidel: Jourdan, Alart & Jean 1998). They begin from a solution of the
program of `kernels.free.program`, which knows what contacts do to each other, but not how far they slip; what comes
out, a slip for each contact and the direction of its friction, is what the next program is given.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.free.rows import (
    COMMON,
    DIRECTIONS,
    FREE_DOF,
    FREE_ROWS,
    FRICTIONS,
    TABLE_GROUP,
    coefficient,
    orient,
    torsion_radius,
    write_row,
)
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.kernels.jit import Record, as_int64, jit, jit_once

Array = NDArray[np.float64]

PARTS = 1 + DIRECTIONS
WIDTH = COMMON + PHALANX_COUNT
SWEEPS = 16
"""Most of them at a time."""
STILL = 0.01
"""Sweeps end where none of them moves a contact by more than this share of the clearance."""
MOST_AHEAD = 8.0
"""Rounds of sweeps are foreseen no further than this many of their steps."""
DOUBLINGS = 40
SHARP = 1e-7
"""A slipping contact's α is found until |r| is λ to this share, in at most so many trials."""
SINGULAR = 1e-12
"""Share of the trace that is added to W: a contact may not feel all parts of its force."""

COULOMB = np.dtype(
    [
        ("row", np.float64, (FRICTIONS, PARTS, WIDTH)),
        ("response", np.float64, (FRICTIONS, PARTS, PARTS)),
        ("rhs", np.float64, (FRICTIONS, PARTS)),
        ("force", np.float64, (FRICTIONS, PARTS)),
        ("along", np.float64, (FRICTIONS, DIRECTIONS, 3)),
        ("about", np.float64, (FRICTIONS, DIRECTIONS)),
        ("slips", np.int64, (FRICTIONS,)),
        ("alpha", np.float64, (FRICTIONS,)),
        ("slid", np.int64, (FRICTIONS,)),
        ("given", np.float64, (FRICTIONS, 4)),
        ("found", np.float64, (FRICTIONS, 4)),
        ("found_before", np.float64, (FRICTIONS, 4)),
        ("off_before", np.float64, (FRICTIONS, 4)),
        ("parts", np.int64, (FRICTIONS,)),
        ("block", np.int64, (FRICTIONS,)),
        ("x", np.float64, (FREE_DOF,)),
        ("multiplier", np.float64, (FREE_ROWS,)),
        ("alone", np.float64, (PARTS,)),
        ("next", np.float64, (PARTS,)),
        ("factor", np.float64, (PARTS, PARTS)),
        ("sweeps", np.int64),
    ],
    align=True,
)
"""What the sweeps need; the first axis is that of FRICTION.

| field | meaning |
|---|---|
| row, rhs | w = row · x - rhs, scaled as the program's rows: the normal one, then those of s |
| along, about | the directions of these, as FRICTION has its e_1 to e_3 |
| slips | 1 where the contact slipped when it was last solved for |
| alpha | α of a contact that slipped, 0 where none is known |
| given | s that the last program was given, the part along the surface and that about the normal [m] |
| found, found_before | s that the sweeps have come to, now and in the round before |
| off_before | what they differed by from `given` in the round before |
| slid | 1 where all these are of a contact that slips |
| response | W |
| force | f [N] |
| parts, block | how many parts f has, and where the variables of its finger begin, -1 without |
| x | the program's variables |
| multiplier | of the rows without friction [N] |
| alone, next, factor | scratch: u, f, and a Cholesky factor |
| sweeps | done in this tick |
"""


@jit_once
def begin_sweeps(pose: Record, body: Record, offset: float, problem: Record, friction: Record, work: Record) -> None:
    """Take the contacts that rub, with the slips that the program at hand was given."""
    scratch = as_int64(FREE_ROWS - 1)
    for i in range(friction.count):
        if friction.rubs[i] == 0:
            work.parts[i] = 0
            continue
        of, n = friction.body[i], friction.normal[i]
        mu, radius = coefficient(body, of), torsion_radius(body, of)
        parts = PARTS if radius > 0.0 else PARTS - 1
        work.parts[i] = parts
        work.block[i] = COMMON + PHALANX_COUNT * (of // PHALANX_COUNT) if 0 <= of < PALM_BODY else -1
        work.slips[i] = work.slid[i] = 0
        work.alpha[i] = 0.0
        for j in range(3):
            work.given[i, j] = friction.shift[i] * friction.along[i, 0, j]
        work.given[i, 3] = friction.shift[i] * friction.about[i, 0]
        for e in range(DIRECTIONS):
            work.about[i, e] = friction.about[i, e]
            for j in range(3):
                work.along[i, e, j] = friction.along[i, e, j]
        for part in range(parts):
            if part == 0:
                mx, my, mz, w, rhs = n[0], n[1], n[2], 0.0, offset - friction.distance[i]
            else:
                t = work.along[i, part - 1]
                spin = work.about[i, part - 1]
                mx, my, mz, w = mu * t[0], mu * t[1], mu * t[2], radius * spin
                start = friction.start[i]
                rhs = -(start[0] * t[0] + start[1] * t[1] + start[2] * t[2] + friction.start_spin[i] * spin)
            write_row(
                pose, body, problem, of, scratch, friction.point[i], mx, my, mz, w * n[0], w * n[1], w * n[2], rhs
            )
            work.rhs[i, part] = problem.rhs[scratch]
            for j in range(COMMON):
                work.row[i, part, j] = problem.common[j, scratch]
            for j in range(PHALANX_COUNT):
                work.row[i, part, COMMON + j] = problem.block[j, scratch]
        trace = 0.0
        for a in range(parts):
            for b in range(a + 1):
                total = 0.0
                for j in range(WIDTH):
                    total += work.row[i, a, j] * work.row[i, b, j]
                work.response[i, a, b] = work.response[i, b, a] = total
            trace += work.response[i, a, a]
        for a in range(parts):
            work.response[i, a, a] += SINGULAR * trace


@jit
def _push(i: int, sign: float, work: Record) -> None:
    # Add what the force of a contact does to x.
    block = work.block[i]
    for part in range(work.parts[i]):
        size = sign * work.force[i, part]
        if size == 0.0:
            continue
        for j in range(COMMON):
            work.x[j] += size * work.row[i, part, j]
        if block >= 0:
            for j in range(PHALANX_COUNT):
                work.x[block + j] += size * work.row[i, part, COMMON + j]


@jit
def _moved(i: int, part: int, work: Record) -> float:
    total = -work.rhs[i, part]
    for j in range(COMMON):
        total += work.row[i, part, j] * work.x[j]
    block = work.block[i]
    if block >= 0:
        for j in range(PHALANX_COUNT):
            total += work.row[i, part, COMMON + j] * work.x[block + j]
    return total


@jit
def _bears(i: int, alpha: float, work: Record) -> float:
    # Set the force with (W + α diag(0, 1, …)) f = -u; returns 1 - λ / |r|, positive out of the cone.
    parts, factor, force, response, alone = work.parts[i], work.factor, work.next, work.response, work.alone
    for a in range(parts):
        for b in range(a + 1):
            total = response[i, a, b]
            if a == b and a > 0:
                total += alpha
            for j in range(b):
                total -= factor[a, j] * factor[b, j]
            factor[a, b] = math.sqrt(max(total, 1e-300)) if a == b else total / factor[b, b]
    for a in range(parts):
        total = -alone[a]
        for j in range(a):
            total -= factor[a, j] * force[j]
        force[a] = total / factor[a, a]
    square = 0.0
    for k in range(parts):
        a = parts - 1 - k
        total = force[a]
        for j in range(a + 1, parts):
            total -= factor[j, a] * force[j]
        force[a] = total / factor[a, a]
        if a > 0:
            square += force[a] * force[a]
    # Near 0 only its sign counts.
    return 1.0 - force[0] / math.sqrt(square) if square > 0.0 else -1.0


@jit_once
def _find_slip(i: int, out: float, work: Record) -> None:
    # The α at which |r| = λ, from how far the force is out of the cone without: by regula falsi (Illinois), since
    # λ / |r| is nearly a straight line of α.
    low, out_low = 0.0, out
    high = work.alpha[i]
    if high <= 0.0:
        for a in range(1, work.parts[i]):
            high += work.response[i, a, a]
    out_high = _bears(i, high, work)
    for _ in range(DOUBLINGS):
        if out_high <= 0.0:
            break
        low, out_low = high, out_high
        high *= 4.0
        out_high = _bears(i, high, work)
    alpha, side = high, as_int64(0)
    for _ in range(DOUBLINGS):
        if abs(out) <= SHARP or out_high > 0.0:
            break
        alpha = (low * out_high - high * out_low) / (out_high - out_low)
        out = _bears(i, alpha, work)
        if out > 0.0:
            low, out_low = alpha, out
            if side == 1:
                out_high *= 0.5
            side = as_int64(1)
        else:
            high, out_high = alpha, out
            if side == -1:
                out_low *= 0.5
            side = as_int64(-1)
    work.alpha[i] = alpha


@jit_once
def _visit(i: int, work: Record) -> float:
    # Solve a contact for what the others bear; returns how far that moves it [m].
    parts, alone, force, response = work.parts[i], work.alone, work.next, work.response
    touched = work.force[i, 0] > 0.0
    for a in range(parts):
        alone[a] = _moved(i, a, work)
        if a == 0 and not touched and alone[0] >= 0.0:
            return 0.0
        if touched:
            for b in range(parts):
                alone[a] -= response[i, a, b] * work.force[i, b]
    if alone[0] >= 0.0:
        for a in range(parts):
            force[a] = 0.0
        work.slips[i] = 0
        return _take_force(i, work)
    out = _bears(i, 0.0, work)
    if out <= 0.0:
        work.slips[i] = 0
    else:
        work.slips[i] = 1
        _find_slip(i, out, work)
    return _take_force(i, work)


@jit
def _take_force(i: int, work: Record) -> float:
    # Let a contact bear its new force; returns how far that moves it [m].
    parts, force, response = work.parts[i], work.next, work.response
    far = 0.0
    for a in range(parts):
        total = 0.0
        for b in range(parts):
            total += response[i, a, b] * (force[b] - work.force[i, b])
        far = max(far, abs(total))
    _push(i, -1.0, work)
    for a in range(parts):
        work.force[i, a] = force[a]
    _push(i, 1.0, work)
    return far


@jit
def _visit_row(row: int, block: int, problem: Record, work: Record) -> float:
    common, own = problem.common, problem.block
    total, square = -problem.rhs[row], 0.0
    for j in range(COMMON):
        total += common[j, row] * work.x[j]
    if block >= 0:
        for j in range(PHALANX_COUNT):
            total += own[j, row] * work.x[block + j]
    if total >= 0.0 and work.multiplier[row] == 0.0:
        return 0.0
    for j in range(COMMON):
        square += common[j, row] * common[j, row]
    if block >= 0:
        for j in range(PHALANX_COUNT):
            square += own[j, row] * own[j, row]
    if square == 0.0:
        return 0.0
    change = max(-work.multiplier[row], -total / square)
    work.multiplier[row] += change
    for j in range(COMMON):
        work.x[j] += change * common[j, row]
    if block >= 0:
        for j in range(PHALANX_COUNT):
            work.x[block + j] += change * own[j, row]
    return abs(change) * square


@jit_once
def take_solution(x: Array, problem: Record, friction: Record, loaded: Record, work: Record) -> None:
    """Go on from a solution of the program."""
    for j in range(FREE_DOF):
        work.x[j] = x[j]
    start, stop = problem.group_start, problem.group_stop
    for g in range(2 * FINGER_COUNT + 1):
        for row in range(start[g], stop[g]):
            work.multiplier[row] = 0.0
    for row in range(start[TABLE_GROUP], stop[TABLE_GROUP]):
        work.multiplier[row] = 0.0
    for i in range(friction.count):
        for part in range(PARTS):
            work.force[i, part] = 0.0
    for k in range(loaded.count):
        row, size = loaded.row[k], loaded.multiplier[k]
        i, kind = problem.owner[row], problem.kind[row]
        if i < 0 or friction.rubs[i] == 0:
            work.multiplier[row] += size
            continue
        work.force[i, 0] += size
        if kind == 0:
            continue
        e = (kind - 1) % DIRECTIONS
        against = -size if kind <= DIRECTIONS else size
        for part in range(1, work.parts[i]):
            b = part - 1
            share = friction.about[i, e] * work.about[i, b]
            for j in range(3):
                share += friction.along[i, e, j] * work.along[i, b, j]
            work.force[i, part] += against * share


@jit
def sweep(offset: float, problem: Record, friction: Record, work: Record) -> None:
    """Some sweeps; set Γ and the directions of each contact that rubs by what comes out, and by where that leads to."""
    start, stop, blocks = problem.group_start, problem.group_stop, problem.group_block
    for _ in range(SWEEPS):
        work.sweeps += 1
        far = 0.0
        for i in range(friction.count):
            if friction.rubs[i] == 1:
                far = max(far, _visit(i, work))
        for g in range(2 * FINGER_COUNT + 1):
            for row in range(start[g], stop[g]):
                if problem.owner[row] < 0:
                    far = max(far, _visit_row(row, blocks[g], problem, work))
        for row in range(start[TABLE_GROUP], stop[TABLE_GROUP]):
            owner = problem.owner[row]
            if friction.rubs[owner] == 0:
                far = max(far, _visit_row(row, as_int64(-1), problem, work))
        if far <= STILL * offset:
            break
    for i in range(friction.count):
        if friction.rubs[i] == 0:
            continue
        x = y = z = spin = slip = 0.0
        for part in range(1, work.parts[i]):
            e, size = part - 1, work.force[i, part]
            x -= size * work.along[i, e, 0]
            y -= size * work.along[i, e, 1]
            z -= size * work.along[i, e, 2]
            spin -= size * work.about[i, e]
            slip += _moved(i, part, work) ** 2
        orient(friction, i, x, y, z, spin)
        found = work.found[i]
        slip = math.sqrt(slip) if work.slips[i] == 1 else 0.0
        for j in range(3):
            found[j] = slip * friction.along[i, 0, j]
        found[3] = slip * friction.about[i, 0]
        friction.shift[i] = slip
    _extrapolate(friction, work)


@jit_once
def _extrapolate(friction: Record, work: Record) -> None:
    # Anderson's acceleration of depth one: where the rounds converge slowly they do so along one direction.
    product, square = 0.0, 0.0
    for i in range(friction.count):
        if friction.rubs[i] == 0:
            continue
        slides = work.slips[i] == 1
        both = slides and work.slid[i] == 1
        for j in range(4):
            off = work.found[i, j] - work.given[i, j]
            if both:
                change = off - work.off_before[i, j]
                product += off * change
                square += change * change
            work.off_before[i, j] = off
        work.slid[i] = 2 if both else 1 if slides else 0
    share = product / square if square > 0.0 else 0.0
    share = min(MOST_AHEAD, max(-MOST_AHEAD, share))
    for i in range(friction.count):
        if friction.rubs[i] == 0:
            continue
        given, found, before = work.given[i], work.found[i], work.found_before[i]
        square, product, length = 0.0, 0.0, 0.0
        for j in range(4):
            given[j] = found[j]
            if work.slid[i] == 2:
                given[j] -= share * (found[j] - before[j])
            before[j] = found[j]
            square += given[j] * given[j]
            product += given[j] * found[j]
            length += found[j] * found[j]
        if work.slid[i] == 2:
            work.slid[i] = 1
            if product > 0.5 * math.sqrt(square * length) and square < 4.0 * length:
                friction.shift[i] = math.sqrt(square)
                orient(friction, i, given[0], given[1], given[2], given[3])
            else:
                for j in range(4):
                    given[j] = found[j]
