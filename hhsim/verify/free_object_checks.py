"""Claims of a free object: motion follows from forces, friction keeps Coulomb's law, nothing is in the table.

Velocities are derived from poses, forces on the object from contacts, slip from the poses of both bodies.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.result.contacts import ON_TABLE
from hhsim.result.reader import Result
from hhsim.system.counted import counted
from hhsim.verify.bodies_apart import CLEAR, bodies_apart_claim
from hhsim.verify.claim import NOT_JUDGED, Claim, all_true, judged
from hhsim.verify.contacts import PALM, Pairs, joined
from hhsim.verify.force_checks import FORCE, TURN, WHY_FORCE, WHY_SLACK, bears_where_near
from hhsim.verify.forces import limit_rows, pushes, residual
from hhsim.verify.free_motion import FreeBody, FreeMotion
from hhsim.verify.joint_checks import driven_claim, held_claim, pair_claim
from hhsim.verify.judged_body import JudgedBody
from hhsim.verify.kinematics import Posed, configurations, own_hand, phalanx_axes, pose, rotations, turn_between
from hhsim.verify.tick_data import CAPACITY_EXCEEDED, LAG, LENGTH, START_INSIDE, STUCK, JudgedTicks, left_out

if TYPE_CHECKING:
    pass


UNIT = 1e-9
EARTH = (0.0, 0.0, -9.81)
"""Gravity [m/s²]."""
APART = 1e-6
"""Distance below which two contacts of one body are the same [m]."""
STICKS = 1e-9
"""Largest slip of a contact that sticks, in one tick [m]."""
RADIUS = 0.02
"""Shortest radius at which a contact turns [m]: that of a phalanx."""
AGAINST = np.cos(np.radians(45.0)) - 1e-6
"""Cosine of the friction's error: four directions approximate the circle, to 45°."""

SIDES_OF_CONE = 8
"""Sides of the pyramid around the cone of a contact that is not in the file."""


def free_claims(result: Result) -> list[Claim]:
    """Judge what the file claims of a free object, or of several bodies; none where none is free."""
    if not result.body.is_free:
        return []
    motion = FreeMotion(result)
    bodies = [motion, *(FreeBody(result, body) for body in list(result.bodies.values())[1:])]
    joints = [(body, joint["on"]) for body in bodies if (joint := body.joint)]
    pairs = [(body, one) for body, on in joints for one in bodies if one.name == on and not one.fixed]
    held = [body for body, _ in joints if body not in [one for one, _ in pairs]]
    claims = [
        *_velocities(bodies),
        *_balance([body for body in bodies if not (body in held or body.driven)]),
        *(driven_claim(body) for body in bodies if body.driven),
        *_wrenches(motion, any(bodies[0] in pair for pair in pairs)),
        _equal_and_opposite(motion),
        *_cones(motion),
        *_slips(motion),
        _table(motion, bodies),
        *_contacts(motion),
        _solid(bodies),
        *map(held_claim, held),
        *(pair_claim(body, bearer) for body, bearer in pairs),
    ]
    if len(bodies) > 1:
        claims += [_between_bodies(bodies), _hands_on_bodies(bodies)]
        joined, still = [{body.name, on} for body, on in joints], [body.fixed or body.driven for body in bodies]
        ways = itertools.permutations(range(len(bodies)), 2)
        apart = [(i, j) for i, j in ways if {bodies[i].name, bodies[j].name} not in joined]
        claims.append(bodies_apart_claim(result, [(i, j) for i, j in apart if not (still[i] and still[j])]))
    return claims


def _of_each(
    name: str, says: str, unit: str, why: str, bodies: Sequence[FreeBody], figures: Any, whole: bool = False
) -> list[Claim]:
    """Judge deviations, tolerances and ticks of each body: the claim is that of the worst one; none for no body.

    `whole` says that they are of the ticks alone in which the bodies make all of their programs' step.
    """
    note = bodies[0].left_out if whole and bodies else ""
    found = [judged(name, says, off, limit, unit, why, ticks=ticks, note=note) for off, limit, ticks in figures]
    if len(found) < 2:
        return found
    worst = max(range(len(found)), key=lambda i: (found[i].failed, found[i].worst / found[i].tolerance))
    note = f"the worst is that of {bodies[worst].name}" + (note and f"; {note}")
    return [replace(found[worst], checked=sum(claim.checked for claim in found), note=note)]


def _contacts(motion: FreeMotion) -> list[Claim]:
    tick, body, point, normal = motion.tick, motion.touching, motion.point, motion.normal
    stored = np.asarray(motion.result["contact/tick"])
    wrong = (np.diff(stored, prepend=0) < 0) | (stored != tick)
    wrong |= ~(np.abs(np.linalg.norm(normal, axis=1) - 1.0) <= UNIT)
    wrong |= np.asarray(motion.result["contact/sticks"]) > 1
    wrong |= (body == ON_TABLE) & (np.abs(normal - [0.0, 0.0, 1.0]).max(axis=1) > UNIT)
    says = "contacts are in the order of the ticks, of known bodies, with unit normals; those of the table look up"
    claims = [all_true("contact rows", says, wrong, ticks=tick)]
    name, says = "single contacts", "no contact is written as two: none is where another one of its body is"
    if motion.result.surface == "mesh":
        note = "two triangles at one edge may each have a row there"
        return [*claims, Claim(name, says, NOT_JUDGED, note=note)]
    # Of two bodies each meets the other one: what they bear at a place may be two rows.
    hand_or_table = np.flatnonzero(body >= ON_TABLE)
    # Rows of one tick and body are few: each is compared with the next ones of its group.
    order = hand_or_table[np.lexsort((body[hand_or_table], tick[hand_or_table]))]
    twice = np.zeros(len(tick), bool)
    groups = 2 * tick[order] * (PALM + 2) + body[order] - ON_TABLE
    for step in range(1, int(np.bincount(groups).max(initial=1))):
        one, other = order[:-step], order[step:]
        same = (tick[one] == tick[other]) & (body[one] == body[other])
        twice[other] |= same & (np.linalg.norm(point[one] - point[other], axis=1) < APART)
    return [*claims, all_true(name, says, twice, ticks=tick, why="a micrometre; spheres are larger")]


def _solid(bodies: Sequence[FreeBody]) -> Claim:
    from trimesh.triangles import mass_properties

    name, says = "solid", "centres of mass and inertias are those of the meshes, of one density, in the earth's gravity"
    off = []
    for body in bodies:
        try:
            own = mass_properties(body.vertices[body.stored.faces])
        except (IndexError, ValueError, ZeroDivisionError) as error:
            return Claim(name, says, NOT_JUDGED, note=f"the mesh of {body.name} has none: {error}")
        inertia = body.mass / float(own.volume) * np.asarray(own.inertia)
        extent = float(np.ptp(body.vertices, axis=0).max())
        off += [
            float(np.abs(np.asarray(own.center_mass) - body.free["center"]).max()) / extent,
            float(np.abs(inertia - body.inertia).max() / np.abs(inertia).max()),
            float(np.abs(body.gravity - EARTH).max()),
        ]
    claim = judged(name, says, off, FORCE, "1", "a millionth: sums over the triangles in another order")
    if claim.failed:
        note = f"they are off by {max(off):.2g} of it: a program that calls the library may give others"
        return Claim(name, says, NOT_JUDGED, note=note)
    return claim


def _velocities(bodies: Sequence[FreeBody]) -> list[Claim]:
    # A position is rounded to 1e-16, a quaternion to a few of them; over 1 ms that is 1e-13 and more.
    why, travel, turn = "rounding of a pose over a period of the ticks", [], []
    for body in bodies:
        kept = body.whole[body.follows[body.whole]]
        # The start of the first step is not in the file.
        kept = kept[kept > 0]
        made = np.diff(body.center, axis=0) / body.period - body.velocity[1:]
        travel.append((np.linalg.norm(made, axis=1)[kept], 1e-9, kept))
        turn.append((np.linalg.norm(body.turn / body.period - body.spin[1:], axis=1)[kept], 1e-9, kept))
    says = "the object's {} is that of its poses"
    return [
        *_of_each("object velocity", says.format("velocity"), "m/s", why, bodies, travel, whole=True),
        *_of_each("object angular", says.format("angular velocity"), "rad/s", why, bodies, turn, whole=True),
    ]


def _balance(bodies: Sequence[FreeBody]) -> list[Claim]:
    says = "m Δv / Δt is the weight and the forces of hand and table; in a tick that lags, a share of them"
    newton = []
    for body in bodies:
        kept = np.flatnonzero(body.follows)
        limit = FORCE * body.size
        newton.append((body.unbalanced(body.borne[:, :3])[kept], limit[kept], kept))
    claims = _of_each("Newton", says, "N", WHY_FORCE, bodies, newton)
    says = "the change of its turning is the moments of hand and table"
    why = "a millionth of the forces at the object's length; of several programs in a tick the object's turn of the "
    why += "moment, since nobody knows which of the axes between they had"
    free = [body for body in bodies if not body.fixed]
    return [*claims, *_of_each("Euler", says, "N·m", why, free, map(_euler, free), whole=True)]


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
    limit = FORCE * motion.extent * motion.size + motion.turned_in_programs * np.linalg.norm(wrench[:, 3:], axis=1)
    return apart.min(axis=0)[kept], limit[kept], kept


def gyrated(inertia: FloatArray, spin: FloatArray, period: float) -> FloatArray:
    """Return angular velocities at the end of ticks without moments, body axes, shape (T, 3), by Newton's method."""
    found = spin
    for _ in range(20):
        turning = found @ inertia.T
        off = (found - spin) @ inertia.T / period + np.cross(found, turning)
        slope = inertia / period + _crossing(found) @ inertia - _crossing(turning)
        found = found - np.linalg.solve(slope, off[:, :, None])[:, :, 0]
    return found


def _crossing(vector: FloatArray) -> FloatArray:
    """Matrices [v]× of vectors (T, 3)."""
    x, y, z = vector.T
    none = np.zeros_like(x)
    return np.stack([none, -z, y, z, none, -x, -y, x, none], axis=1).reshape(-1, 3, 3)


def _wrenches(motion: FreeMotion, jointed: bool) -> list[Claim]:
    found = []
    for name, of_table in (("hand", False), ("table", True)):
        own, stored = motion.of_contacts(of_table), motion.of_others if of_table else motion.of("hand_wrench")
        size = 1.0 + np.abs(stored).sum(axis=1)
        says, off = f"the {name}'s force and moment on the object are those of its contacts", np.abs(own - stored)
        claim = f"{name} on object", says, off.max(axis=1), FORCE * size, "N, N·m", WHY_FORCE
        if jointed and of_table:
            note = "what its joint bears counts as the table's, and is not in the file"
            found.append(Claim(claim[0], says, NOT_JUDGED, note=note))
        else:
            found.append(judged(*claim, ticks=motion.ticks))
    return found


def _equal_and_opposite(motion: FreeMotion) -> Claim:
    bodies = np.zeros((len(motion.ticks), PALM + 1, 3))
    chosen = motion.own
    np.add.at(bodies, (motion.tick[chosen], motion.touching[chosen]), motion.force[chosen])
    phalanx = np.asarray(motion.result["force/phalanx"]).reshape(-1, PALM, 3)
    palm = np.asarray(motion.result["force/total"]) - phalanx.sum(axis=1)
    off = np.abs(bodies - np.concatenate([phalanx, palm[:, None]], axis=1)).max(axis=(1, 2))
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


def _slips(motion: FreeMotion) -> list[Claim]:
    """Coulomb: a contact that slips bears all its friction, against its slip."""
    travel, spin = _travel_and_spin(motion)
    slid = travel - (travel * motion.normal).sum(axis=1, keepdims=True) * motion.normal
    own = np.where(motion.of_other, motion.slip, np.linalg.norm(slid, axis=1))
    tolerance = STICKS + _beyond_straight(motion, np.maximum(own, np.linalg.norm(travel, axis=1)))
    wrong = (np.asarray(motion.result["contact/sticks"]) == 1) != (motion.slip <= STICKS)
    # An object that tilts off the table and back in a tick's programs has turned otherwise than their turns add up to,
    # and how far it was off is not in the file: the step tolerance is of the hand beside it.
    untold = motion.of_table & ~motion.of_other & (motion.of_hands("work/linearisations")[motion.tick] > 2)
    untold &= np.isfinite(motion.slip)
    # Where a hand was put that began inside is not in the file, so that its slip is what the file says.
    put = (np.asarray(motion.result["status"])[motion.tick] & START_INSIDE != 0) & ~motion.of_table
    known = motion.follows[motion.tick] & ~untold & ~put
    own = np.where(put, np.maximum(own, motion.slip), own)
    off_by, says = np.abs(own - motion.slip), "the slip of a contact along the surface is that of the two bodies"
    why = "a nanometre, and what the turns of the tick add to the solver's straight steps, to second order"
    note = f"not of {counted(int(untold.sum()), 'contact')} with the table in ticks of three programs or more"
    note = note if untold.any() else ""
    slips = judged("slip", says, off_by[known], tolerance[known], "m", why, ticks=motion.tick[known], note=note)
    # Friction and moment work on slip and spin; in s = (μ slip, γ spin) and r = (f / μ, τ / γ) the cone is |r| <= λ.
    reach = np.where(motion.of_table, 0.0, float(motion.free["torsion"]))
    slip = np.hypot(motion.coefficient * own, reach * spin)
    off = motion.of("friction_residual")[motion.tick]
    # Friction is along Γ e with residual |s - Γ e|: while that is below |s| / √2, e is at most 45° off s.
    whole = np.isin(motion.tick, motion.whole) & known
    slides = whole & ~motion.of_other & (motion.slip > 1e-7) & (motion.load > 1e-3)
    slides &= slip > np.sqrt(2.0) * (off + motion.coefficient * tolerance)
    power = -((motion.friction * slid).sum(axis=1) + motion.torsion * spin) / np.where(slip > 0.0, slip, 1.0)
    short = np.maximum(0.0, AGAINST * motion.load - power)[slides]
    says, limit = "a contact that slides bears its friction against its slip, to 45 degrees", 1.0 + motion.load[slides]
    note = f"{counted(int(slides.sum()), 'contact')} with a slip of more than the tick's friction is off"
    tick = motion.tick[slides]
    return [
        all_true("sticks", "a contact sticks where it slips by no more than a nanometre", wrong, ticks=motion.tick),
        slips,
        judged("sliding", says, short, FORCE * limit, "N", WHY_FORCE, ticks=tick, note=note),
        _balanced(motion, slip + motion.coefficient * tolerance),
    ]


def _balanced(motion: FreeMotion, slip: FloatArray) -> Claim:
    """Judge that the friction residual is no more than the slips: the convex model's friction, or better."""
    off = motion.of("friction_residual")
    most = np.zeros(len(off))
    np.maximum.at(most, motion.tick, slip)
    # Each program begins with the slips of the one before it, and is off by what these were off: a tick has two or
    # three, so that what a contact slipped in the last two ticks is still in it.
    most = np.lib.stride_tricks.sliding_window_view(np.concatenate([np.zeros(2), most]), 3).max(axis=1)
    # In a tick that lags it is the slip of a program of whose step the hand has made a fraction.
    behind = np.setdiff1d(motion.ticks, motion.whole)
    to_go = np.hypot(np.max(motion.coefficient, initial=0.0), float(motion.free["torsion"]) / RADIUS)
    most[behind] += to_go * motion.of_hands("lag")[behind]
    in_contact = np.unique(motion.tick)
    size = 1e6 * np.percentile(off[in_contact], (50.0, 99.0, 100.0)) if len(in_contact) else np.zeros(3)
    says = "the slip that friction is balanced against is the slip made, to what the file says"
    why = "twice the slip of three ticks, which may have turned round; where a tick lags, its way to go; the clearance"
    note = f"µm in contact: {size[0]:.2g} in the median, {size[1]:.2g} at p99, {size[2]:.2g} at most"
    if len(motion.result.bodies) > 1:
        # The residual is of all bodies, the contacts in the file are the first one's.
        return Claim("balanced", says, NOT_JUDGED, note="contacts of the other bodies alone are not in the file")
    return judged("balanced", says, off, 2.0 * most + CLEAR, "m", why, ticks=motion.ticks, note=note)


def _beyond_straight(motion: FreeMotion, travel: FloatArray) -> FloatArray:
    """Bound what the turns of a tick may add to the slips (C,) of a solver whose steps are straight [m], shape (C,).

    A point that is turned by α about axes within R goes ½ α² R beside its tangent. The file has a contact's point and
    normal as they were before the last step: what is at the point after it was off by the `travel` (C,) [m] of the two
    bodies there, along the surface and towards it, so that both travel and arm turn. Of several steps the tangents
    are those where the last one begins: within the step tolerance of the end or, in a tick that lags, within its way.
    """
    result, tick, center = motion.result, motion.tick, motion.center[1:]
    shown, hand = configurations(result, "graphic"), own_hand(result)
    posed = pose(hand, shown)
    palm = np.zeros(result.ticks)
    palm[1:] = np.linalg.norm(turn_between(shown.orientation[:-1], shown.orientation[1:]), axis=1)
    bends = [np.abs(np.diff(of, axis=0, prepend=of[:1])) for of in (shown.flexion, shown.abduction)]
    of_bodies = (np.cumsum(bends[0], axis=2) + bends[1][:, :, None]).reshape(-1, PALM)
    angle = np.column_stack([of_bodies, np.zeros(len(palm))]) + palm[:, None]
    body = np.clip(motion.touching, 0, PALM)
    finger = np.minimum(body // 3, 4)
    joints = np.concatenate([posed.joints[tick, finger, :3], posed.position[tick, None]], axis=1)
    reach = np.linalg.norm(joints - motion.point[:, None], axis=2).max(axis=1)
    angle, reach = (np.where(motion.of_table, 0.0, of) for of in (angle[tick, body], reach))
    turn = np.linalg.norm(motion.turn, axis=1)[tick]
    arm = np.linalg.norm(motion.point - center[tick], axis=1)
    hinge = motion.free.get("hinge")
    arm += np.linalg.norm(np.array(hinge["origin"]) - motion.free["center"]) if hinge else 0.0
    several, step = np.asarray(result["work/linearisations"])[tick] > 1, np.zeros(len(tick))
    step[several] = float(result.scene["solver"]["step_tolerance"])
    late = several & ~np.isin(tick, motion.whole)
    way = np.linalg.norm(np.diff(posed.joints, axis=0, prepend=posed.joints[:1]), axis=3).max(axis=(1, 2))
    step[late] = np.maximum(step, way[tick])[late]
    # In it a phalanx turns by no more than both its ends go.
    last = 2.0 * step / hand.length.min()
    tangents = (
        0.5 * (angle**2 * reach + turn**2 * arm) + (angle + turn + last) * step + last * (angle * reach + turn * arm)
    )
    return np.asarray(tangents + (angle + turn) * (travel + turn * arm))


def _travel_and_spin(motion: FreeMotion) -> tuple[FloatArray, FloatArray]:
    """Travel of each contact in its tick (C, 3) [m], tangential it is the slip, and turn about the normal (C,) [rad].

    Hand relative to object, or object relative to table: a point that both share at the end of the tick was at two
    places at its start.
    """
    tick, point = motion.tick, motion.point
    center, turned = motion.center, motion.turned
    step = turned[:-1] * turned[1:].inv()
    before = center[:-1][tick] + step[tick].apply(point - center[1:][tick])
    of_object = point - before
    travel = np.where(motion.of_table[:, None], of_object, -of_object)
    shown = configurations(motion.result, "graphic")
    origin, axes = hand_frames(pose(own_hand(motion.result), shown), rotations(shown.orientation)[0].as_matrix())
    chosen = np.flatnonzero(motion.own & (tick > 0))
    t, b = tick[chosen], motion.touching[chosen]
    local = np.einsum("cji,cj->ci", axes[t, b], point[chosen] - origin[t, b])
    was = origin[t - 1, b] + np.einsum("cij,cj->ci", axes[t - 1, b], local)
    travel[chosen] += point[chosen] - was
    of_hand = np.einsum("cij,ckj->cik", axes[t, b], axes[t - 1, b])
    turn = np.where(motion.of_table[:, None], 1.0, -1.0) * motion.turn[tick]
    turn[chosen] += 0.5 * np.stack(
        [of_hand[:, (i + 2) % 3, (i + 1) % 3] - of_hand[:, (i + 1) % 3, (i + 2) % 3] for i in range(3)], axis=1
    )
    first = motion.of_other | (motion.own & (tick == 0))
    travel[first] = turn[first] = 0.0
    return np.asarray(travel), np.asarray((turn * motion.normal).sum(axis=1))


def hand_frames(posed: Posed, palm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return origins (T, 16, 3) and axes as columns (T, 16, 3, 3) of the hand's bodies; palm axes (T, 3, 3)."""
    axes = np.stack([*(phalanx_axes(posed, *divmod(body, 3)) for body in range(PALM)), palm], axis=1)
    phalanges = posed.joints[:, :, :3].reshape(-1, PALM, 3)
    return np.concatenate([phalanges, posed.position[:, None]], axis=1), axes


def free_hand_claim(judge: JudgedTicks) -> Claim:
    """Judge a free object's hand, world: contacts, friction and joint limits balance the coupling.

    Contacts with other bodies are not in the file: any that push within their cones, where the hand is near enough,
    may bear what is left, as long as they give the forces on the hand's bodies and on these bodies.
    """
    name, says = "hand's balance", "the coupling of a settled tick is borne by its contacts, friction and all, "
    says += "and by joints at their limits"
    result, motion = judge.result, FreeMotion(judge.result)
    others = [FreeBody(result, body) for body in list(result.bodies.values())[1:]]
    status, flags = judge.status[judge.chosen], STUCK | LAG | CAPACITY_EXCEEDED
    settled = status & flags == 0
    places, ticks = np.flatnonzero(settled), judge.chosen[settled]
    size = np.linalg.norm(judge.pull[judge.chosen] * judge.scale, axis=1)
    stored = judge.stored_forces(ticks).reshape(len(ticks), 3 * (PALM + 1))
    near = _near_others(judge, motion, places[~motion.alone[ticks]])
    # A wrench on a body is that of both hands.
    known = others if result.other is None else []
    wrench = np.concatenate([stored[:, :0], *(body.of("hand_wrench")[ticks] for body in known)], axis=1)
    scale = np.concatenate([judge.scale, np.ones(stored.shape[1]), np.tile(judge.scale[:6], len(known))])
    off = np.empty(len(places))
    for n, (i, tick) in enumerate(zip(places.tolist(), ticks.tolist())):
        rows = np.arange(*np.searchsorted(motion.tick, [tick, tick + 1]))
        rows = rows[motion.own[rows]]
        twist = motion.torsion[rows, None] * motion.normal[rows]
        pushed = pushes(judge.chosen_posed, i, motion.touching[rows], motion.point[rows], motion.force[rows], twist)
        borne, on_bodies = (values.sum(axis=0) for values in pushed)
        limits, _ = limit_rows(judge.hand, judge.chosen_shown.flexion[i])
        may = [np.pad(limits, ((0, 0), (0, len(scale) - 21)))]
        met = judge.against_other_hand.of(i)
        by_hand = pushes(judge.chosen_posed, i, met.body, met.point, met.normal)
        may.append(np.concatenate([*by_hand, np.zeros((len(met.body), len(wrench[n])))], axis=1)[:, : len(scale)])
        for k, body in enumerate(others):
            parts, point, force, twist = _cone(near.of(i), judge.bodies[k + 1], body.free)
            on_body = np.zeros((len(parts), len(others), 6))
            on_body[:, k, :3], on_body[:, k, 3:] = -force, -np.cross(point - body.center[tick + 1], force) - twist
            by_body = pushes(judge.chosen_posed, i, parts, point, force, twist)
            columns = np.concatenate([*by_body, on_body.reshape(len(parts), 6 * len(others))], axis=1)
            may.append(columns[:, : len(scale)])
        wanted = np.concatenate([judge.pull[tick] - borne, stored[n] - on_bodies, wrench[n]])
        off[n] = residual((np.concatenate(may) * scale).T, wanted * scale)
    tolerance = _hand_slack(judge, [motion, *others], size, places)
    return judged(name, says, off, tolerance, "N", WHY_SLACK, ticks=ticks, note=left_out(status, flags))


def _hand_slack(judge: JudgedTicks, bodies: Sequence[FreeBody], size: FloatArray, places: IntArray) -> FloatArray:
    """Tolerance [N] of the hand's balance at some chosen ticks, by the last steps of both bodies of a contact."""
    ticks, longest = judge.chosen[places], float(judge.options["step_tolerance"])
    # The last of several programs may take back what those before it made: the tick's travel does not bound its step.
    several = np.asarray(judge.result["work/linearisations"])[ticks] > 1
    past = np.max([np.where(body.of("hand_wrench").any(axis=1), body.travel, 0.0) for body in bodies], axis=0)[ticks]
    step = np.where(several, longest, np.minimum(judge.moved[ticks] + past, longest))
    slack = FORCE * (1.0 + size[places]) + TURN * size[places] * step / judge.rolling
    if judge.other is not None:
        # Two hands roll on each other by the steps of both, with what the bodies that meet bear.
        other, met = JudgedTicks(judge.other, judge.chosen), judge.against_other_hand
        meets = np.zeros((len(judge.chosen), PALM + 1, 1), bool)
        meets[met.tick, met.body] = True
        borne = np.linalg.norm(judge.stored_forces(ticks) * meets[places], axis=(1, 2))
        radii = sum(float(min(of.hand.radius.min(), of.hand.palm_radius.min())) for of in (judge, other))
        slack += TURN * borne * np.where(several, longest, other.last_step[ticks]) / radii
    return np.asarray(slack)


def _near_others(judge: JudgedTicks, motion: FreeMotion, places: IntArray) -> Pairs:
    """Pairs of the hand and the other bodies that may bear a force at some chosen ticks, world."""
    within = judge.touch + _stands_off(judge, motion.ticks) + motion.of("friction_residual")
    reach = float(within[judge.chosen[places]].max(initial=0.0)) + LENGTH
    near = joined([judge.near_body(body, places, reach) for body in judge.bodies[1:] or judge.bodies])
    near = near._replace(tick=places[near.tick])
    return near.at(np.flatnonzero(near.distance <= within[judge.chosen[near.tick]] + LENGTH))


def _cone(pairs: Pairs, of: JudgedBody, free: Mapping[str, Any]) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Bodies, points [m], forces [N] and moments [N·m] that span what contacts with a body may do to the hand.

    A pyramid around the circular cone holds it, and a pair at an edge of several triangles counts once.
    """
    pairs = pairs.at(of.of(pairs))
    rows = np.round(np.column_stack([pairs.body, pairs.point, pairs.normal]), 9)
    pairs = pairs.at(np.sort(np.unique(rows, axis=0, return_index=True)[1]))
    first = np.cross(pairs.normal, np.eye(3)[np.abs(pairs.normal).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    around, normal = np.linspace(0.0, 2.0 * np.pi, SIDES_OF_CONE, endpoint=False)[:, None, None], pairs.normal
    across = np.cos(around) * first + np.sin(around) * np.cross(normal, first)
    force = normal + float(free["friction"]) / np.cos(np.pi / SIDES_OF_CONE) * across
    twist = np.concatenate([np.broadcast_to(sign * float(free["torsion"]) * normal, force.shape) for sign in (1, -1)])
    body, point = np.tile(pairs.body, 2 * SIDES_OF_CONE), np.tile(pairs.point, (2 * SIDES_OF_CONE, 1))
    return body, point, np.tile(force.reshape(-1, 3), (2, 1)), twist.reshape(-1, 3)


def _stands_off(judge: JudgedTicks, ticks: IntArray) -> FloatArray:
    """Distance [m] of what bears a force: steps are straight and rotations are not; the slip has a clearance.

    Hand and body go straight and turn about points of their own. Turned together by φ they come apart by ½ φ² times
    the distance of these points, and by φ times what the hand goes beside the body.
    """
    motion, posed = FreeMotion(judge.result), judge.shown_posed
    points = np.concatenate([posed.joints.reshape(len(judge.numbers), -1, 3), posed.position[:, None]], axis=1)
    if judge.result.view is not None:
        now = motion.turned[1:].as_matrix()
        points = np.einsum("tij,tnj->tni", now, points - motion.place) + motion.of("position")[:, None]
    bends, bodies = np.zeros(len(points)), [FreeBody(judge.result, body) for body in judge.result.bodies.values()]
    movable = [body.name for body in bodies if not body.fixed]
    for body in bodies:
        # A body that another one bears goes on its own, and their joint draws it back.
        hinge = body.free.get("hinge")
        pivot = hinge["origin"] if hinge and hinge["on"] not in movable else body.free["center"]
        there = points - body.moved(np.array(pivot))[1:, None]
        beside = np.einsum("tji,tnj->tni", body.turned[1:].as_matrix(), there)
        way = np.linalg.norm(np.diff(beside, axis=0, prepend=np.inf), axis=2).max(axis=1).clip(max=judge.margin)
        turn = np.linalg.norm(body.turn, axis=1)
        bends = np.maximum(bends, turn * (0.5 * turn * np.linalg.norm(there[:, -1], axis=1) + way))
    return np.asarray(CLEAR + judge.moved[ticks].clip(max=judge.margin) ** 2 / RADIUS + bends[ticks])


def free_complementarity_claim(judge: JudgedTicks) -> Claim:
    """Judge, in the object's frame, that only touching bodies bear forces, but for the friction's residual slip."""
    motion = FreeMotion(judge.result)
    says = "what does not touch bears no force, but for what floats by what the tick's friction is off"
    floats = np.repeat(motion.of("friction_residual")[:, None], PALM + 1, axis=1)
    # A tick that lags stands off by its slip and by the travel left; its forces are those of the unfinished program.
    on_the_way = motion.own & ~np.isin(motion.tick, motion.whole)
    slipped = float(motion.free["friction"]) * motion.slip[on_the_way]
    np.maximum.at(floats, (motion.tick[on_the_way], motion.touching[on_the_way]), slipped)
    # How a contact with another body slips in a tick that lags is not in the file.
    known = motion.alone | (judge.status & LAG == 0)
    places = np.flatnonzero((judge.status[judge.chosen] & STUCK == 0) & known[judge.chosen])
    ticks = judge.chosen[places]
    late = judge.status[ticks] & LAG > 0
    to_go = np.where(late, np.asarray(motion.result["lag"])[ticks], 0.0)
    within = (np.where(late, judge.bearing, judge.touch) + to_go + _stands_off(judge, ticks))[:, None]
    # Distances beyond the margin are unknown.
    nearest, met = np.minimum(judge.near.nearest, judge.margin), judge.against_other_hand
    np.minimum.at(nearest, (met.tick, met.body), met.distance)
    note = left_out(judge.status[judge.chosen], STUCK)
    return bears_where_near(judge, places, nearest[places] - floats[ticks], within, says, note)


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
