"""Claims of free bodies: motion follows from forces, friction stays in its cones, nothing is in the table.

Velocities are derived from poses, forces on the object from contacts.
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.mesh.mesh import Mesh
from hhsim.result.reader import Result
from hhsim.verify.claim import NOT_JUDGED, Claim, all_true, judged
from hhsim.verify.force_checks import FORCE, TURN, WHY_FORCE, WHY_SLACK, bears_where_near, limit_rows, pushes, residual
from hhsim.verify.free_motion import FreeBody, FreeMotion
from hhsim.verify.joint_checks import held_claim, pair_claim
from hhsim.verify.kinematics import rotations
from hhsim.verify.mesh_distance import TrueSurface
from hhsim.verify.tick_data import CAPACITY_EXCEEDED, LAG, LENGTH, SNAP, STUCK, JudgedTicks, left_out

RADIUS = 0.02
"""Shortest radius at which a contact turns [m]: that of a phalanx."""
LOOKED_AT = 1000
"""Ticks in which the bodies are looked for in each other."""
CLEAR = 5e-7
"""Clearance of contacts [m]."""
BEHIND, MOST_FACES = 0.5 ** np.arange(1, 13)[:, None, None], 100
"""Points inside are so far behind a face, in lengths of the body, and about so many faces have some."""


def free_claims(result: Result) -> list[Claim]:
    """Judge what the file claims of a free object, or of several bodies, with their groups; none where none is free."""
    if not result.body.is_free:
        return []
    motion = FreeMotion(result)
    bodies = [motion, *(FreeBody(result, body) for body in list(result.bodies.values())[1:])]
    joints = [(body, joint["on"]) for body in bodies if (joint := body.joint)]
    pairs = [(body, one) for body, on in joints for one in bodies if one.name == on and not one.fixed]
    held = [body for body, _ in joints if body not in [one for one, _ in pairs]]
    claims = {
        "forces": [*_wrenches(motion, any(bodies[0] in pair for pair in pairs))],
        "friction": _cones(motion),
        "motion": [
            *_velocities(bodies),
            *_balance([body for body in bodies if not (body in held or body.driven)]),
            _table(motion, bodies),
        ],
        "joints": [*map(held_claim, held), *(pair_claim(body, bearer) for body, bearer in pairs)],
    }
    if len(bodies) > 1:
        claims["forces"] += [_between_bodies(bodies), _hands_on_bodies(bodies)]
        joined, still = [{body.name, on} for body, on in joints], [body.fixed or body.driven for body in bodies]
        ways = itertools.permutations(range(len(bodies)), 2)
        apart = [(i, j) for i, j in ways if {bodies[i].name, bodies[j].name} not in joined]
        claims["motion"].append(bodies_apart_claim(result, [(i, j) for i, j in apart if not (still[i] and still[j])]))
    return [replace(claim, group=group) for group, of in claims.items() for claim in of]


def _of_all(
    name: str, says: str, unit: str, why: str, bodies: Sequence[FreeBody], figures: Iterable[Any]
) -> list[Claim]:
    """Judge deviations, tolerances and ticks of each body in the ticks in which bodies make all of a program's step."""
    if not bodies:
        return []
    off, limit, ticks = (np.concatenate(values) for values in zip(*figures))
    return [judged(name, says, off, limit, unit, why, ticks=ticks, note=bodies[0].left_out)]


def _velocities(bodies: Sequence[FreeBody]) -> list[Claim]:
    # A position is rounded to 1e-16, a quaternion to a few of them; over 1 ms that is 1e-13 and more.
    travel, turn = list[Any](), list[Any]()
    why = "rounding of a pose over a period of the ticks"
    for body in bodies:
        kept = body.whole[body.follows[body.whole]]
        # The start of the first step is not in the file.
        kept = kept[kept > 0]
        made = np.diff(body.center, axis=0) / body.period - body.velocity[1:]
        turned = body.turn / body.period - body.spin[1:]
        for found, off in ((travel, made), (turn, turned)):
            found.append((np.linalg.norm(off, axis=1)[kept], np.full(len(kept), 1e-9), kept))
    says = "the object's {} is that of its poses"
    return [
        *_of_all("object velocity", says.format("velocity"), "m/s", why, bodies, travel),
        *_of_all("object angular", says.format("angular velocity"), "rad/s", why, bodies, turn),
    ]


def _balance(bodies: Sequence[FreeBody]) -> list[Claim]:
    newton = []
    for body in bodies:
        kept = body.whole[body.follows[body.whole]]
        limit = FORCE * body.size + body.left_at_rest
        newton.append((body.unbalanced(body.borne[:, :3])[kept], limit[kept], kept))
    says = "m Δv / Δt is the weight and the forces of hand and table"
    claims = _of_all("Newton", says, "N", WHY_FORCE, bodies, newton)
    says = "the change of its turning is the moments of hand and table"
    why = "a millionth of the forces at the object's length; of several programs in a tick the object's turn of the "
    why += "moment, since nobody knows which of the axes between they had"
    free = [body for body in bodies if not body.fixed]
    return [*claims, *_of_all("Euler", says, "N·m", why, free, map(_euler, free))]


def _euler(motion: FreeBody) -> tuple[FloatArray, FloatArray, IntArray]:
    """Residual of Euler's equation [N·m], its tolerance and the ticks."""
    from scipy.spatial.transform import Rotation

    rate, heavier, wrench = 1.0 / motion.period, 1.0 + motion.damping * motion.period, motion.borne
    # Body axes: without moments the object turns by Δt ω, with I (ω - ω₀) / Δt + ω × I ω = 0.
    spin = motion.turned[:-1].inv().apply(motion.spin[:-1])
    alone = gyrated(motion.inertia, spin, motion.period)
    goal = motion.turned[:-1] * Rotation.from_rotvec(motion.period * alone / heavier)
    # Step and moments are rotation vectors in the body's axes where its program begins: at the tick's start or, of
    # several programs, next to its end.
    apart = np.full((2, len(spin)), np.inf)
    for at, frame in enumerate((motion.turned[:-1].inv(), motion.turned[1:].inv())):
        beyond = (frame * motion.turned[1:]).as_rotvec() - (frame * goal).as_rotvec()
        apart[at] = np.linalg.norm(heavier * rate**2 * beyond @ motion.inertia.T - frame.apply(wrench[:, 3:]), axis=1)
    kept = motion.whole[motion.follows[motion.whole]]
    limit = motion.extent * (FORCE * motion.size + motion.left_at_rest)
    limit += motion.turned_in_programs * np.linalg.norm(wrench[:, 3:], axis=1)
    return apart.min(axis=0)[kept], limit[kept], kept


def gyrated(inertia: FloatArray, spin: FloatArray, period: float) -> FloatArray:
    """Return angular velocities at the end of ticks without moments, body axes, shape (T, 3), by Newton's method."""

    def crossing(vector: FloatArray) -> FloatArray:
        return np.cross(vector[:, None], np.eye(3)).swapaxes(1, 2)

    found = spin
    for _ in range(20):
        turning = found @ inertia.T
        off = (found - spin) @ inertia.T / period + np.cross(found, turning)
        slope = inertia / period + crossing(found) @ inertia - crossing(turning)
        found = found - np.linalg.solve(slope, off[:, :, None])[:, :, 0]
    return found


def _wrenches(motion: FreeMotion, jointed: bool) -> list[Claim]:
    found = []
    for name, of_table, sign in (("hand", False, -1.0), ("table", True, 1.0)):
        # The wrench of the contacts on the object, about its centre of mass.
        chosen, own = motion.of_table == of_table, np.zeros((len(motion.ticks), 6))
        tick, force = motion.tick[chosen], sign * motion.force[chosen]
        moment = np.cross(motion.point[chosen] - motion.center[1:][tick], force)
        moment += sign * motion.torsion[chosen, None] * motion.normal[chosen]
        np.add.at(own, tick, np.concatenate([force, moment], axis=1))
        stored = motion.of_others if of_table else motion.of("hand_wrench")
        size = 1.0 + np.abs(stored).sum(axis=1)
        says, off = f"the {name}'s force and moment on the object are those of its contacts", np.abs(own - stored)
        claim = f"{name} on object", says, off.max(axis=1), FORCE * size, "N, N·m", WHY_FORCE
        if jointed and of_table:
            note = "what its joint bears counts as the table's, and is not in the file"
            found.append(Claim(claim[0], says, NOT_JUDGED, note=note))
        else:
            found.append(judged(*claim, ticks=motion.ticks))
    return found


def free_hand_claims(judge: JudgedTicks) -> list[Claim]:
    """Judge the forces of a hand beside a free body; none without one."""
    if not judge.result.body.is_free:
        return []
    motion, bodies = FreeMotion(judge.result), [FreeBody(judge.result, of) for of in judge.result.bodies.values()]
    claims = [_equal_and_opposite(judge, motion), _hand_balance(judge, motion, bodies)]
    return [*claims, _complementarity(judge, motion, bodies)]


def _equal_and_opposite(judge: JudgedTicks, motion: FreeMotion) -> Claim:
    bodies, chosen = np.zeros_like(judge.forces), motion.own
    np.add.at(bodies, (motion.tick[chosen], motion.touching[chosen]), motion.force[chosen])
    off = np.abs(bodies - judge.forces).max(axis=(1, 2))
    limit, kept = FORCE * (1.0 + np.abs(bodies).sum(axis=(1, 2))), np.flatnonzero(motion.alone)
    says = "the force on each part of the hand is that of its contacts with the object"
    return judged("equal and opposite", says, off[kept], limit[kept], "N", WHY_FORCE, ticks=kept)


def _cones(motion: FreeMotion) -> list[Claim]:
    tolerance = FORCE * (1.0 + np.abs(motion.load))
    pushes = np.maximum(0.0, -motion.load)
    along = np.abs((motion.friction * motion.normal).sum(axis=1))
    beyond = np.linalg.norm(motion.friction, axis=1) - motion.coefficient * motion.load
    limit = np.where(motion.of_table, 0.0, float(motion.free["torsion"]))
    twist = np.abs(motion.torsion) - limit * motion.load
    off = np.maximum.reduce([pushes, along, beyond, np.zeros_like(along)])
    says = "contacts push, and their friction is along the surface and no more than μ times that"
    cones = judged("friction cones", says, off, tolerance, "N", WHY_FORCE, ticks=motion.tick)
    says = "the moment about a contact's normal is no more than its limit"
    off, tolerance = np.maximum(twist, 0.0), FORCE * tolerance
    return [cones, judged("torsion", says, off, tolerance, "N·m", WHY_FORCE, ticks=motion.tick)]


def _hand_balance(judge: JudgedTicks, motion: FreeMotion, bodies: Sequence[FreeBody]) -> Claim:
    """Judge a free object's hand: contacts, friction and joint limits balance the coupling.

    Where it bears on other bodies, whose contacts are not in the file, its forces as a whole balance the palm's pull;
    ticks in which it meets another hand, or snaps, are left out.
    """
    flags = STUCK | LAG | CAPACITY_EXCEEDED | SNAP
    ticks = np.flatnonzero((judge.status & flags == 0) & ~motion.meets_hand)
    off = np.linalg.norm(judge.pull[ticks, :3] - np.asarray(judge.result["force/total"])[ticks], axis=1)
    for n, i in enumerate(ticks.tolist()):
        if not motion.alone[i]:
            continue
        rows = np.arange(*np.searchsorted(motion.tick, [i, i + 1]))
        rows = rows[motion.own[rows]]
        twist = motion.torsion[rows, None] * motion.normal[rows]
        pushed, _ = pushes(judge.posed, i, motion.touching[rows], motion.point[rows], motion.force[rows], twist)
        rests = limit_rows(judge.hand, judge.shown.flexion[i]) * judge.scale
        off[n] = residual(rests.T, (judge.pull[i] - pushed.sum(axis=0)) * judge.scale)
    # Normals turn by the last steps of both bodies of a contact. The last of several programs may take back what those
    # before it made: the tick's travel does not bound its step.
    longest = float(judge.options["step_tolerance"])
    several = np.asarray(judge.result["work/linearisations"])[ticks] > 1
    past = np.max([np.where(body.of("hand_wrench").any(axis=1), body.travel, 0.0) for body in bodies], axis=0)[ticks]
    world = np.linalg.norm(np.diff(judge.posed.joints, axis=0, prepend=np.inf), axis=3).max(axis=(1, 2))[ticks]
    step = np.where(several, longest, np.minimum(world + past, longest))
    size = np.linalg.norm(judge.pull * judge.scale, axis=1)[ticks]
    says = "the coupling of a settled tick is borne by its contacts, friction and all, and by joints at their limits"
    # The ways of several steps, each from where the one before ended, add up to first order.
    limit = FORCE * (1.0 + size) + TURN * size * step / judge.rolling
    note = left_out(judge.status, flags)
    return judged("hand's balance", says, off, limit, "N", WHY_SLACK, ticks=ticks, note=note)


def _complementarity(judge: JudgedTicks, motion: FreeMotion, bodies: Sequence[FreeBody]) -> Claim:
    """Judge that only touching bodies bear forces, but for the friction's residual slip."""
    ticks = np.flatnonzero(judge.status & (STUCK | LAG) == 0)
    within = (judge.touch + _stands_off(judge, bodies)[ticks])[:, None]
    # Distances beyond the margin are unknown.
    nearest = np.minimum(judge.nearest, judge.margin)
    nearest = np.minimum(nearest, judge.against_other_hand.nearest(len(nearest)))
    nearest -= motion.of("friction_residual")[:, None]
    says = "what does not touch bears no force, but for what floats by what the tick's friction is off"
    return bears_where_near(judge, ticks, nearest[ticks], within, says, left_out(judge.status, STUCK | LAG))


def _stands_off(judge: JudgedTicks, bodies: Sequence[FreeBody]) -> FloatArray:
    """Distance [m] of what bears a force: steps are straight and rotations are not; the slip has a clearance.

    Hand and body go straight and turn about points of their own. Turned together by φ they come apart by ½ φ² times
    the distance of these points, and by φ times what the hand goes beside the body.
    """
    points = np.concatenate([judge.posed.joints.reshape(len(judge.numbers), -1, 3), judge.posed.position[:, None]], 1)
    bends, movable = np.zeros(len(points)), [body.name for body in bodies if not body.fixed]
    for body in bodies:
        # A body that another one bears goes on its own, and their joint draws it back.
        hinge = body.free.get("hinge")
        pivot = hinge["origin"] if hinge and hinge["on"] not in movable else body.free["center"]
        there = points - body.moved(np.array(pivot))[1:, None]
        beside = np.einsum("tji,tnj->tni", body.turned[1:].as_matrix(), there)
        way = np.linalg.norm(np.diff(beside, axis=0, prepend=np.inf), axis=2).max(axis=1).clip(max=judge.margin)
        turn = np.linalg.norm(body.turn, axis=1)
        bends = np.maximum(bends, turn * (0.5 * turn * np.linalg.norm(there[:, -1], axis=1) + way))
    return np.asarray(CLEAR + judge.moved.clip(max=judge.margin) ** 2 / RADIUS + bends)


def _table(motion: FreeMotion, bodies: Sequence[FreeBody]) -> Claim:
    says, height = "the object's lowest point is above the table, as high as the file says", motion.free["table"]
    stored = motion.of("table_distance")
    if height is None:
        return all_true("table", says, np.isfinite(stored), ticks=motion.ticks, note="there is none")
    lowest = [body.lowest - height for body in bodies if not (body.fixed or body.driven)]
    off = np.maximum(np.abs(lowest[0] - stored), -np.min(lowest, axis=0))
    return judged("table", says, off, LENGTH, "m", "a nanometre", ticks=motion.ticks)


def _between_bodies(bodies: Sequence[FreeBody]) -> Claim:
    """Judge forces, and moments about the origin; a moment is about what a contact was at in the tick."""
    force, moment = np.zeros((2, len(bodies[0].ticks), 3))
    size, travel = np.ones(len(force)), np.zeros(len(force))
    for body in bodies:
        wrench = body.of("body_wrench")
        force += wrench[:, :3]
        moment += wrench[:, 3:] + np.cross(body.center[1:], wrench[:, :3])
        size += np.abs(wrench).sum(axis=1)
        travel += body.travel
    # Of several programs the last one may take back what those before it made.
    result = bodies[0].result
    several = np.asarray(result["work/linearisations"]) > 1
    travel = np.where(several, np.maximum(travel, float(result.scene["solver"]["step_tolerance"])), travel)
    off = np.maximum(np.abs(force).max(axis=1), np.maximum(0.0, np.abs(moment).max(axis=1) - size * travel))
    says = "the forces of the bodies on each other are equal and opposite, and their moments but for the tick's travel"
    return judged("between bodies", says, off, FORCE * size, "N, N·m", WHY_FORCE, ticks=bodies[0].ticks)


def _hands_on_bodies(bodies: Sequence[FreeBody]) -> Claim:
    result, name = bodies[0].result, "hands on bodies"
    says, hands = "the forces of the hands on the bodies are opposite to those on the hands", [result]
    if result.other is not None:
        hands = [result, result.other]
    ticks = np.arange(min(hand.ticks for hand in hands))
    forces = [body.of("hand_wrench")[ticks, :3] for body in bodies]
    forces += [np.asarray(hand["force/total"])[ticks] for hand in hands]
    off, size = np.abs(np.sum(forces, axis=0)).max(axis=1), 1.0 + np.abs(forces).sum(axis=(0, 2))
    return judged(name, says, off, FORCE * size, "N", WHY_FORCE, ticks=ticks)


# No body is in another one: an edge that pierces a triangle is out of it after the least shift to a face of the prism
# that both span, and a point inside of one body is out of another one after its depths in both, also where their
# surfaces coincide, or do not meet.


class _Solid:
    """Mesh of a body, its surface, and points on it and in it with their depths [m], in its frame at the start."""

    def __init__(self, mesh: Mesh) -> None:
        self.bounds, self.shell = mesh.bounds, TrueSurface(mesh, open_too=True)
        corners = self.shell.corners
        middle, step, self.boxes = corners.mean(axis=1), max(1, len(corners) // MOST_FACES), _boxes(corners)
        inner = middle[::step] - float(mesh.extent.max()) * BEHIND * self.shell.normal[::step]
        on, inner = np.concatenate([mesh.vertices[np.unique(mesh.faces)], middle]), inner.reshape(-1, 3)
        depth = -self.shell.signed_distance(inner)
        self.points, self.depth = np.vstack([on, inner[depth > 0.0]]), np.append(np.zeros(len(on)), depth[depth > 0.0])

    def depths_of(self, other: "_Solid", turn: FloatArray, shift: FloatArray) -> FloatArray:
        """Depth of another body [m], by its points and edges, at poses in this one's frame, (T, 3, 3) and (T, 3)."""
        depth, last, room = np.zeros(len(turn)), np.zeros_like(other.points), np.zeros(len(other.points))
        # What is deeper than the clearance is as far within the bounds.
        low, high = self.bounds + [[CLEAR], [-CLEAR]]
        for t, (rotation, place) in enumerate(zip(turn, shift)):
            if t and np.array_equal(place, shift[t - 1]) and np.array_equal(rotation, turn[t - 1]):
                depth[t] = depth[t - 1]
                continue
            seen = other.points @ rotation.T + place
            near = np.flatnonzero(((seen > low) & (seen < high)).all(axis=1))
            # A point that has moved by less than it was away from the surface is still outside.
            near = near[np.linalg.norm(seen[near] - last[near], axis=1) >= room[near]]
            last[near], room[near] = seen[near], self.shell.signed_distance(seen[near])
            near = near[room[near] < 0.0]
            pierced = _pierced(*self._overlapping(other, rotation, place)).max(initial=0.0)
            depth[t] = max((other.depth[near] - room[near]).max(initial=0.0), pierced)
        return depth

    def _overlapping(self, other: "_Solid", turn: FloatArray, shift: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pairs of a triangle and one of another body at a pose in this frame whose boxes overlap, (K, 3, 3) each."""
        (low, high), balls = self.bounds, other.shell.pieces
        middle, radius = balls.center @ turn.T + shift, balls.radius[:, None]
        near = np.flatnonzero(((middle + radius >= low) & (middle - radius <= high)).all(axis=1))
        row, piece = self.shell.pieces.within(middle[near], balls.radius[near])
        theirs = other.shell.corners[near] @ turn.T + shift
        (low, high), (own_low, own_high) = _boxes(theirs), self.boxes
        kept = ((own_low[piece] <= high[row]) & (low[row] <= own_high[piece])).all(axis=1)
        return self.shell.corners[piece[kept]], theirs[row[kept]]


def _boxes(triangles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least and largest coordinates of triangles (N, 3, 3), each (N, 3)."""
    a, b, c = triangles.transpose(1, 0, 2)
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def _pierced(corners: FloatArray, other: FloatArray) -> FloatArray:
    """Compute the least shift that takes each edge of other triangles out of a triangle [m], (K, 3, 3) each, (K, 3)."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, None]
    ends = [_height(across, place - corners[:, :1]) for place in (other, np.roll(other, -1, axis=1))]
    # Of each edge and each side of the triangle.
    a, b, c = (np.roll(corners, -i, axis=1)[:, None] for i in range(3))
    beside = np.cross(b - a, (np.roll(other, -1, axis=1) - other)[:, :, None])
    sides = np.sign((beside * (c - a)).sum(axis=-1)) * _height(beside, other[:, :, None] - a)
    return np.asarray(np.minimum(sides.min(axis=2), np.minimum(np.maximum(*ends), -np.minimum(*ends))))


def _height(normal: FloatArray, vector: FloatArray) -> FloatArray:
    size = np.linalg.norm(normal, axis=-1)
    return np.asarray((normal * vector).sum(axis=-1) / np.where(size > 0.0, size, np.inf))


def bodies_apart_claim(result: Result, pairs: Sequence[tuple[int, int]]) -> Claim:
    """Judge that one body is not in another one, by pairs of their numbers in both orders."""
    ticks = np.unique(np.linspace(0, result.ticks - 1, LOOKED_AT).astype(int))
    bodies = [_Solid(Mesh(body.vertices, body.faces)) for body in result.bodies.values()]
    moved = [(rotations(of.turn[ticks])[0].as_matrix(), of.shift[ticks]) for of in result.meshes_moved()]
    depth = np.zeros(len(ticks))
    for one, other in pairs:
        back, ((_, at), (turn, place)) = moved[one][0].swapaxes(1, 2), (moved[one], moved[other])
        shift = (back @ (place - at)[:, :, None])[:, :, 0]
        depth = np.maximum(depth, bodies[one].depths_of(bodies[other], back @ turn, shift))
    says = f"no body is in another one, by edges and points of both in {len(ticks)} ticks"
    return judged("bodies apart", says, depth, CLEAR, "m", "the clearance", ticks=ticks)
