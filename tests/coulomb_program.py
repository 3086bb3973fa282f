"""The program of a real tick with friction, and its answer by Gauss-Seidel over the contacts on the Delassus matrix."""

from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.world.rows import DIRECTIONS, STANDS_BACK

PARTS = 1 + DIRECTIONS
"""Of a contact: along its normal, and its s along the three directions (see `kernels.world.rows`)."""


class CoulombProgram(NamedTuple):
    """A tick's last program of C contacts; variables and rows scaled as in the tick."""

    target: FloatArray  # step of hand and object without contacts, (27,)
    rows: FloatArray  # of each contact: n · Δ, then s; zero if it has no friction, (C, 4, 27)
    gap: FloatArray  # n · Δ of the contact less its clearance [m], (C,)
    start: FloatArray  # its s before the program [m], (C, 3)
    found: FloatArray  # the kernel's answer, (27,)
    multiplier: FloatArray  # the kernel's, along the normal and against s [N], (C, 4)
    weight: FloatArray  # factor of the scaled variables [m], [rad], (27,)
    astray: float  # largest difference of a loaded contact's Γ from its slip


def last_program(solver: Any) -> CoulombProgram:
    """The program that the solver's last tick ended with."""
    world = solver.engine.world
    problem, friction, loaded = world.problem, world.friction, world.loaded
    width = 6 * (problem.hands + problem.bodies)
    count = width + 3 * FINGER_COUNT * problem.hands
    dense, owners = {}, {}
    for g in range(problem.groups):
        for row in range(problem.group_start[g], problem.group_stop[g]):
            block = problem.group_block[g]
            dense[row] = np.zeros(count)
            dense[row][:width] = problem.common[:width, row]
            if block >= 0:
                dense[row][block : block + PHALANX_COUNT] = problem.block[:, row]
            owners[row] = (int(problem.owner[row]), int(problem.kind[row]))
    load = dict.fromkeys(dense, 0.0)
    for row, multiplier in zip(loaded.row[: loaded.count], loaded.multiplier[: loaded.count], strict=True):
        load[row] += multiplier
    rows, gap, start, multiplier, astray = [], [], [], [], 0.0
    for row, (owner, kind) in owners.items():
        if kind != 0:
            continue
        whole, begun = np.zeros((PARTS, count)), np.zeros(DIRECTIONS)
        forces = np.array([load[row], *np.zeros(DIRECTIONS)])
        whole[0], needed = dense[row], float(problem.rhs[row])
        if owner >= 0 and friction.has_friction[owner]:
            needed += STANDS_BACK * solver.options.offset
            of = {owners[r][1]: r for r in owners if owners[r][0] == owner and owners[r][1] > 0}
            for e in range(DIRECTIONS):
                if e + 1 in of:
                    ahead, back = of[e + 1], of[e + 1 + DIRECTIONS]
                    whole[1 + e] = 0.5 * (dense[back] - dense[ahead])
                    begun[e] = 0.5 * (problem.rhs[ahead] - problem.rhs[back])
                    forces[0] += load[ahead] + load[back]
                    forces[1 + e] = load[back] - load[ahead]
        rows.append(whole)
        gap.append(needed)
        start.append(begun)
        multiplier.append(forces)
        if owner >= 0 and friction.has_friction[owner] and forces[0] > 0.0:
            slip = begun + whole[1:] @ _scaled(world)
            astray = max(astray, abs(float(np.linalg.norm(slip)) - float(friction.shift[owner])))
    target = np.array(problem.target[:count])
    a, b, c, loads = (np.array(values) for values in (rows, gap, start, multiplier))
    return CoulombProgram(target, a, b, c, _scaled(world), loads, _weights(world), astray)


def _weights(world: Any) -> FloatArray:
    hand = world.problem.inverse_root
    return np.concatenate([hand[:6], *(body.inverse_root for body in world.bodies[: world.problem.bodies]), hand[6:]])


def _scaled(world: Any) -> FloatArray:
    weights = _weights(world)
    scaled: FloatArray = np.array(world.problem.delta[: len(weights)]) / weights
    return scaled


class _Contact:
    """One contact beside all others held: exactly by cases, gone, sticking, or sliding."""

    def __init__(self, delassus: FloatArray) -> None:
        self.w = delassus
        self.normal, self.across = float(delassus[0, 0]), delassus[0, 1:] / delassus[0, 0]
        self.share, self.turn = np.linalg.eigh(delassus[1:, 1:] - np.outer(delassus[1:, 0], self.across))
        self.share = np.maximum(self.share, 0.0)

    def solve(self, b: FloatArray) -> FloatArray:
        """Forces of the contact, shape (4,), where without any its gap and s were b."""
        if b[0] >= 0.0:
            return np.zeros(PARTS)
        c = self.turn.T @ (b[1:] - self.across * b[0])
        low, high = 0.0, float(self.share.max()) + float(np.abs(c).max()) * self.normal / -float(b[0])
        p, excess_low = self._at(b, c, low)
        if excess_low <= 0.0:
            return p
        p, excess_high = self._at(b, c, high)
        while excess_high > 0.0:
            high *= 4.0
            p, excess_high = self._at(b, c, high)
        # s = -λ times the friction, where friction is as large as the normal force: λ by false position (Illinois).
        side = 0
        for _ in range(80):
            middle = (low * excess_high - high * excess_low) / (excess_high - excess_low)
            p, excess = self._at(b, c, middle)
            if abs(excess) <= 1e-15 * p[0] or high - low <= 1e-16 * high:
                break
            if excess > 0.0:
                low, excess_low = middle, excess
                excess_high *= 0.5 if side > 0 else 1.0
                side = 1
            else:
                high, excess_high = middle, excess
                excess_low *= 0.5 if side < 0 else 1.0
                side = -1
        return p

    def _at(self, b: FloatArray, c: FloatArray, damping: float) -> tuple[FloatArray, float]:
        size = self.share + damping
        along = -self.turn @ np.where(size > 0.0, c / np.where(size > 0.0, size, 1.0), 0.0)
        normal = -float(b[0]) / self.normal - float(self.across @ along)
        return np.array([normal, *along]), float(np.linalg.norm(along)) - normal


def solve_coulomb(program: CoulombProgram) -> tuple[FloatArray, FloatArray]:
    """Where the program ends, scaled, shape (27,), and its contacts' forces, shape (C, 4): Gauss-Seidel over contacts.

    It ends where no gap and no s has changed by more than 1e-14 m in a sweep, or after 10,000.
    """
    count = len(program.gap)
    flat = program.rows.reshape(count * PARTS, -1)
    delassus = flat @ flat.T
    v = flat @ program.target
    v[::PARTS] -= program.gap
    v.reshape(count, PARTS)[:, 1:] += program.start
    p = np.zeros((count, PARTS))
    blocks = [slice(PARTS * c, PARTS * (c + 1)) for c in range(count)]
    contacts = [_Contact(delassus[block, block]) for block in blocks]
    columns = [np.ascontiguousarray(delassus[:, block]) for block in blocks]
    for _ in range(10_000):
        before = v.copy()
        for c in range(count):
            if p[c, 0] == 0.0 and v[PARTS * c] >= 0.0:
                continue
            new = contacts[c].solve(v[blocks[c]] - contacts[c].w @ p[c])
            v += columns[c] @ (new - p[c])
            p[c] = new
        if np.abs(v - before).max() <= 1e-14:
            break
    return program.target + flat.T @ p.ravel(), p


def violation(program: CoulombProgram, x: FloatArray, p: FloatArray) -> float:
    """By how much an answer misses Coulomb's law [m], the forces [N] taken as stated.

    The largest of: a gap entered, a gap that bears a force, friction beyond its cone over 1 kN/m, a slip less the part
    of it that friction opposes with all of the load, and the step less what the forces make of it.
    """
    u = np.einsum("cpi,i->cp", program.rows, x)
    gap, s = u[:, 0] - program.gap, u[:, 1:] + program.start
    normal, rub = p[:, 0], np.linalg.norm(p[:, 1:], axis=1)
    borne = normal > 0.0
    rubs = borne & (program.rows[:, 1:] != 0.0).any(axis=(1, 2))
    opposed = -np.einsum("cp,cp->c", s, p[:, 1:])[rubs] / normal[rubs]
    missed = (
        -gap,
        np.abs(gap[borne]),
        1e-3 * (rub - normal),
        1e-3 * -normal,
        np.linalg.norm(s[rubs], axis=1) - opposed,
        np.abs(x - program.target - np.einsum("cpi,cp->i", program.rows, p)),
    )
    return max(float(values.max(initial=0.0)) for values in missed)
