"""Claims of a free object: that forces and motion agree, that friction keeps to its law, that nothing is in the table.

All is worked out anew from what the file stores, with scipy's rotations: velocities from poses, forces on the object
from the contacts, the motion from the forces, slip from the poses of both bodies.
"""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.result.reader import Result
from hhsim.system.counted import counted
from hhsim.verify.claim import NOT_JUDGED, Claim, all_true, judged
from hhsim.verify.contacts import PALM
from hhsim.verify.file_checks import follows
from hhsim.verify.force_checks import WHY_SLACK, force_slack
from hhsim.verify.forces import AT_LIMIT
from hhsim.verify.kinematics import Posed, configurations, own_hand, pose, rotations, turn_between
from hhsim.verify.tick_data import CAPACITY_EXCEEDED, LAG, STUCK, JudgedTicks

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


ON_TABLE = -1
UNIT = 1e-9
EARTH = (0.0, 0.0, -9.81)
"""Gravity [m/s²]."""
APART = 1e-6
"""Two contacts of one body that are no farther apart [m] are one."""
FORCE = 1e-6
"""Forces that differ by this share, or by this [N], are the same."""
LENGTH = 1e-9
WHY_FORCE = "a millionth: a ten-thousandth of the least force that has a rate"
WHOSE = ("graphic", "haptic")
ENERGY = 1e-14
"""What rounding of poses adds to an energy, per newton [m]."""
STICKS = 1e-9
"""A contact that slips by no more in a tick [m] sticks, says the file."""
RADIUS = 0.02
"""The shortest phalanx about which a contact turns [m]."""
SQUARE = float(np.sqrt(2.0))
CLEAR = 5e-7
"""By so much of its clearance may a solver take a contact's slip too large [m]."""
AGAINST = np.cos(np.radians(45.0)) - 1e-6
"""Four directions stand for a circle: the friction of a contact that slips is at most 45° off."""


class FreeMotion:
    """A free object's stored motion and forces, world frame, and what follows from the poses alone.

    Args:
        result: As the file has it, with a free object.
    """

    def __init__(self, result: Result) -> None:
        """Read what all claims need."""
        self.result, self.free = result, result.scene["free"]
        self.period = 1.0 / result.rate
        self.mass, self.inertia = float(self.free["mass"]), np.array(self.free["inertia"], np.float64)
        self.gravity, self.damping = np.array(self.free["gravity"]), float(self.free["damping"])
        self.ticks = np.arange(result.ticks)
        # Of the first tick all are; but where a recorder lost others, nobody knows from where the next one went on.
        self.follows = follows(result)
        self.follows[0] = result.live is None or result["live/tick/record"][0] == 0
        # What is none of a tick or of a body is found by `_contacts`.
        self.tick: IntArray = np.clip(result["contact/tick"], 0, result.ticks - 1)
        self.body: IntArray = np.clip(np.asarray(result["contact/body"], np.int64), ON_TABLE, PALM)
        self.point, self.normal = (np.asarray(result[f"contact/{name}"]) for name in ("point", "normal"))
        self.load, self.friction = (
            np.asarray(result[f"contact/{name}"]) for name in ("normal_force", "friction_force")
        )
        self.torsion, self.slip = (np.asarray(result[f"contact/{name}"]) for name in ("torsional_moment", "slip"))
        self.of_table = self.body == ON_TABLE

    @cached_property
    def turned(self) -> "Rotation":
        """Rotations of the object since before the first tick, of that and of every tick, T + 1 of them."""
        first = self.result.static["object/orientation"]
        poses, _ = rotations(np.vstack([first, self.result["object/orientation"]]))
        return poses * poses[0].inv()

    @cached_property
    def center(self) -> FloatArray:
        """Centre of mass before the first tick and at every one [m], shape (T + 1, 3)."""
        first = self.result.static["object/position"]
        origin = np.vstack([first, self.result["object/position"]])
        return np.asarray(origin + self.turned.apply(np.array(self.free["center"]) - first))

    @cached_property
    def whole(self) -> IntArray:
        """Ticks that are neither late nor stuck: in the others the object has made a share of its program's step."""
        behind = (np.asarray(self.result["status"]) & (LAG | STUCK)) != 0
        return np.asarray(np.flatnonzero(~behind))

    @cached_property
    def force(self) -> FloatArray:
        """Of each contact on what it is on [N], shape (C, 3)."""
        return np.asarray(self.load[:, None] * self.normal + self.friction)

    def wrench(self, of_table: bool) -> FloatArray:
        """On the object, about its centre of mass, of its contacts with table or hand, shape (T, 6)."""
        chosen = self.of_table == of_table
        sign = 1.0 if of_table else -1.0
        tick, force = self.tick[chosen], sign * self.force[chosen]
        moment = np.cross(self.point[chosen] - self.center[1:][tick], force)
        moment += sign * self.torsion[chosen, None] * self.normal[chosen]
        found = np.zeros((len(self.ticks), 6))
        np.add.at(found, tick, np.concatenate([force, moment], axis=1))
        return found

    def unbalanced(self, force: FloatArray) -> FloatArray:
        """What Newton's equation leaves over of the contacts' forces [N], both of shape (T, ...)."""
        velocity = np.vstack([self.free["velocity"], self.result["object/velocity"]])
        heavier = 1.0 + self.damping * self.period
        made = heavier * velocity[1:] - velocity[:-1]
        wanted = self.period * (force / self.mass + self.gravity)
        off = np.sqrt(((made - wanted) ** 2).sum(axis=1))
        # A tick that lags is a share of a tick, and its velocity goes a share of its way to what it would have been.
        late = np.ones(len(off), bool)
        late[self.whole] = False
        way = (velocity[:-1] + wanted) / heavier - velocity[:-1]
        change, square = velocity[1:] - velocity[:-1], (way**2).sum(axis=1)
        share = np.clip((change * way).sum(axis=1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
        apart = heavier * np.sqrt(((change - share[:, None] * way) ** 2).sum(axis=1))
        return np.asarray(self.mass / self.period * np.where(late, apart, off))

    @property
    def coefficient(self) -> FloatArray:
        """μ of each contact, shape (C,)."""
        table = self.free["table_friction"]
        of_hand = self.free["friction"]
        return np.asarray(np.where(self.of_table, of_hand if table is None else table, of_hand))


def free_claims(result: Result) -> list[Claim]:
    """What the file claims of a free object; none where it is not free."""
    if not result.free:
        return []
    motion = FreeMotion(result)
    return [
        *_velocities(motion),
        *_balance(motion),
        *_wrenches(motion),
        _equal_and_opposite(motion),
        *_cones(motion),
        *_slips(motion),
        _table(motion),
        *_contacts(motion),
        _solid(motion),
    ]


def _contacts(motion: FreeMotion) -> list[Claim]:
    """The rows of /contact themselves: in the order of the ticks, on the body that they name, each with its own."""
    tick, body, point, normal = motion.tick, motion.body, motion.point, motion.normal
    stored = np.asarray(motion.result["contact/tick"])
    wrong = (np.diff(stored, prepend=0) < 0) | (stored != tick) | (np.asarray(motion.result["contact/body"]) != body)
    wrong |= ~(np.abs(np.linalg.norm(normal, axis=1) - 1.0) <= UNIT)
    wrong |= np.asarray(motion.result["contact/sticks"]) > 1
    wrong |= motion.of_table & (np.abs(normal - [0.0, 0.0, 1.0]).max(axis=1) > UNIT)
    says = "contacts are in the order of the ticks, of known bodies, with unit normals; those of the table look up"
    claims = [all_true("contact rows", says, wrong, ticks=tick)]
    name, says = "single contacts", "no contact is written as two: none is where another one of its body is"
    if motion.result.surface == "mesh":
        note = "two triangles at one edge may each have a row there"
        return [*claims, Claim(name, says, NOT_JUDGED, note=note)]
    # Rows of a tick and body are few: each is held against the next ones of its group.
    order = np.lexsort((body, tick))
    twice = np.zeros(len(tick), bool)
    for step in range(1, int(np.bincount(tick * (PALM + 2) + body + 1).max(initial=1))):
        one, other = order[:-step], order[step:]
        same = (tick[one] == tick[other]) & (body[one] == body[other])
        twice[other] |= same & (np.linalg.norm(point[one] - point[other], axis=1) < APART)
    return [*claims, all_true(name, says, twice, ticks=tick, why="a micrometre; spheres are larger")]


def _solid(motion: FreeMotion) -> Claim:
    """Centre of mass and inertia by trimesh, of the mesh where it was before the first tick."""
    from trimesh.triangles import mass_properties

    name, says = "solid", "centre of mass and inertia are those of the mesh, of one density, in the earth's gravity"
    static = motion.result.static
    try:
        own = mass_properties(np.asarray(static["object/vertices"])[static["object/faces"]])
    except (IndexError, ValueError, ZeroDivisionError) as error:
        return Claim(name, says, NOT_JUDGED, note=f"the mesh has none: {error}")
    inertia = motion.mass / float(own.volume) * np.asarray(own.inertia)
    extent = float(np.ptp(static["object/vertices"], axis=0).max())
    off = [
        float(np.abs(np.asarray(own.center_mass) - motion.free["center"]).max()) / extent,
        float(np.abs(inertia - motion.inertia).max() / np.abs(inertia).max()),
        float(np.abs(motion.gravity - EARTH).max()),
    ]
    claim = judged(name, says, off, FORCE, "1", "a millionth: sums over the triangles in another order")
    if claim.failed:
        note = f"they are off by {max(off):.2g} of it: a program that calls the library may give others"
        return Claim(name, says, NOT_JUDGED, note=note)
    return claim


def _velocities(motion: FreeMotion) -> list[Claim]:
    way = np.diff(motion.center, axis=0) / motion.period
    turn = (motion.turned[1:] * motion.turned[:-1].inv()).as_rotvec() / motion.period
    found = []
    for name, own, unit in (("velocity", way, "m/s"), ("angular_velocity", turn, "rad/s")):
        off = np.linalg.norm(own - motion.result[f"object/{name}"], axis=1)
        # Where exactly the first step began is not in the file.
        off[0] = 0.0
        says = f"the object's {name.replace('_', ' ')} is that of its poses"
        why = "rounding of a pose over a period of the ticks"
        # A position is rounded to 1e-16, a quaternion to a few of them; over 1 ms that is 1e-13 and more.
        kept = motion.whole[motion.follows[motion.whole]]
        found.append(judged(f"object {name.split('_')[0]}", says, off[kept], 1e-9, unit, why, ticks=motion.ticks[kept]))
    return found


def _balance(motion: FreeMotion) -> list[Claim]:
    """Newton's and Euler's equation, as the implicit Euler method has them: with the velocity at the tick's end."""
    rate, heavier = 1.0 / motion.period, 1.0 + motion.damping * motion.period
    result = motion.result
    wrench = np.asarray(result["object/hand_wrench"]) + result["object/table_wrench"]
    size = 1.0 + np.abs(wrench[:, :3]).sum(axis=1)
    off = motion.unbalanced(wrench[:, :3])
    kept = np.flatnonzero(motion.follows)
    says = "m Δv / Δt is the weight and the forces of hand and table; in a tick that lags, a share of them"
    newton = judged("Newton", says, off[kept], (FORCE * size)[kept], "N", WHY_FORCE, ticks=kept)
    # In the body's axes: without moments it would have turned by Δt ω, with I (ω - ω₀) / Δt + ω × I ω = 0.
    omega = np.vstack([motion.free["angular_velocity"], result["object/angular_velocity"]])
    spin = motion.turned[:-1].inv().apply(omega[:-1])
    alone = _gyrated(motion.inertia, spin, motion.period)
    from scipy.spatial.transform import Rotation

    goal = motion.turned[:-1] * Rotation.from_rotvec(motion.period * alone / heavier)
    # A step is a rotation vector of the body as its program finds it, and so are the moments: that is at the tick's
    # start or, of several programs, next to its end.
    apart = np.full((2, len(spin)), np.inf)
    moment = np.linalg.norm(wrench[:, 3:], axis=1)
    # Of several programs in a tick the last began anywhere between: its axes as far off as the object turns.
    turned = np.asarray((motion.turned[:-1].inv() * motion.turned[1:]).magnitude())
    turned[np.asarray(result["work/linearisations"]) <= 1] = 0.0
    for at, frame in enumerate((motion.turned[:-1].inv(), motion.turned[1:].inv())):
        beyond = (frame * motion.turned[1:]).as_rotvec() - (frame * goal).as_rotvec()
        apart[at] = np.linalg.norm(heavier * rate**2 * beyond @ motion.inertia.T - frame.apply(wrench[:, 3:]), axis=1)
    length = float(np.ptp(result.static["object/vertices"], axis=0).max())
    kept = motion.whole[motion.follows[motion.whole]]
    euler = judged(
        "Euler",
        "the change of its turning is the moments of hand and table",
        apart.min(axis=0)[kept],
        (FORCE * length * size + (1e-3 + turned) * moment)[kept],
        "N·m",
        "a millionth of the forces at the object's length, and a thousandth of the moment; of several programs "
        "in a tick the object's turn of it, since nobody knows which of the axes between they had",
        ticks=motion.ticks[kept],
    )
    return [newton, euler]


def _gyrated(inertia: FloatArray, spin: FloatArray, period: float) -> FloatArray:
    """Angular velocities at the end of a tick without moments, body axes, shape (T, 3), by a fixed point."""
    momentum = spin @ inertia.T
    after = spin.copy()
    for _ in range(50):
        after = np.asarray(np.linalg.solve(inertia, (momentum - period * np.cross(after, after @ inertia.T)).T).T)
    return after


def _wrenches(motion: FreeMotion) -> list[Claim]:
    found = []
    for name, of_table in (("hand", False), ("table", True)):
        own, stored = motion.wrench(of_table), np.asarray(motion.result[f"object/{name}_wrench"])
        size = 1.0 + np.abs(stored).sum(axis=1)
        found.append(
            judged(
                f"{name} on object",
                f"the {name}'s force and moment on the object are those of its contacts",
                np.abs(own - stored).max(axis=1),
                FORCE * size,
                "N, N·m",
                WHY_FORCE,
                ticks=motion.ticks,
            )
        )
    return found


def _equal_and_opposite(motion: FreeMotion) -> Claim:
    """Each part of the hand bears what its contacts with the object do."""
    bodies = np.zeros((len(motion.ticks), PALM + 1, 3))
    chosen = ~motion.of_table
    np.add.at(bodies, (motion.tick[chosen], motion.body[chosen]), motion.force[chosen])
    phalanx = np.asarray(motion.result["force/phalanx"]).reshape(-1, PALM, 3)
    palm = np.asarray(motion.result["force/total"]) - phalanx.sum(axis=1)
    off = np.abs(bodies - np.concatenate([phalanx, palm[:, None]], axis=1)).max(axis=(1, 2))
    size = 1.0 + np.abs(bodies).sum(axis=(1, 2))
    says = "the force on each part of the hand is that of its contacts with the object"
    return judged("equal and opposite", says, off, FORCE * size, "N", WHY_FORCE, ticks=motion.ticks)


def _cones(motion: FreeMotion) -> list[Claim]:
    room = FORCE * (1.0 + np.abs(motion.load))
    pushes = np.maximum(0.0, -motion.load)
    along = np.abs((motion.friction * motion.normal).sum(axis=1))
    beyond = np.linalg.norm(motion.friction, axis=1) - motion.coefficient * motion.load
    limit = np.where(motion.of_table, 0.0, float(motion.free["torsion"]))
    twist = np.abs(motion.torsion) - limit * motion.load
    says = "contacts push, and their friction is along the surface and no more than μ times that"
    return [
        judged(
            *("friction cones", says, np.maximum.reduce([pushes, along, beyond, np.zeros_like(along)]), room),
            *("N", WHY_FORCE),
            ticks=motion.tick,
        ),
        judged(
            *("torsion", "the moment about a contact's normal is no more than its limit", np.maximum(twist, 0.0)),
            *(FORCE * room, "N·m", WHY_FORCE),
            ticks=motion.tick,
        ),
    ]


def _slips(motion: FreeMotion) -> list[Claim]:
    """Coulomb: what slips bears all the friction that there is, against its way."""
    way, spin = _ways(motion)
    own = np.linalg.norm(way, axis=1)
    joints = np.asarray(motion.result["graphic/joints"])
    moved = np.linalg.norm(np.diff(joints, axis=0, prepend=joints[:1]), axis=3).max(axis=(1, 2))
    # A step of the solver is straight, and what turns goes round: ½ way² / radius, of the object ½ turn² radius.
    turn = np.asarray((motion.turned[1:] * motion.turned[:-1].inv()).magnitude())[motion.tick]
    arm = np.linalg.norm(motion.point - motion.center[1:][motion.tick], axis=1)
    # Where a tick has several steps they may go beyond where they end: one there and one back bend it twice.
    bends = np.where(np.asarray(motion.result["work/linearisations"]) > 1, 1.0, 0.5)
    room = STICKS + 1e-2 * own + (bends * moved**2)[motion.tick] / RADIUS + 0.5 * turn**2 * arm
    # Its way is that of the hand as the last step found it, which is up to the tolerance of steps from where it ends.
    last = np.where(bends > 0.5, float(motion.result.scene["solver"]["step_tolerance"]), 0.0)
    room += (moved * last)[motion.tick] / RADIUS
    # A tick that lags has gone parts of its steps, and what is left of them is taken off the next ones.
    room += np.where(np.isin(motion.tick, motion.whole), 0.0, 1e-3 * moved[motion.tick])
    wrong = (np.asarray(motion.result["contact/sticks"]) == 1) != (motion.slip <= STICKS)
    known = motion.follows[motion.tick]
    off_by, says = np.abs(own - motion.slip), "the way of a contact along the surface is that of the two bodies"
    apart = judged(
        *("slip", says, off_by[known], room[known], "m"),
        "a hundredth, what turns add to straight steps, and a thousandth of the way in a tick that lags",
        ticks=motion.tick[known],
    )
    # Friction and moment do work on way and turn; in s = (μ way, γ turn) and r = (f / μ, τ / γ) the cone is |r| <= λ.
    reach = np.where(motion.of_table, 0.0, float(motion.free["torsion"]))
    slip = np.hypot(motion.coefficient * own, reach * spin)
    off = np.asarray(motion.result["object/friction_residual"])[motion.tick]
    # Friction is along Γ e, and |s - Γ e| is what is off: with less than |s| / √2 of that, e is at most 45° off s.
    whole = np.isin(motion.tick, motion.whole) & known
    slides = whole & (motion.slip > 1e-7) & (motion.load > 1e-3) & (slip > SQUARE * (off + motion.coefficient * room))
    power = -((motion.friction * way).sum(axis=1) + motion.torsion * spin) / np.where(slip > 0.0, slip, 1.0)
    short = np.maximum(0.0, AGAINST * motion.load - power)[slides]
    return [
        all_true("sticks", "a contact sticks where it slips by no more than a nanometre", wrong, ticks=motion.tick),
        apart,
        judged(
            *("sliding", "a contact that slides bears its friction against its way, to 45 degrees", short),
            *(FORCE * (1.0 + motion.load[slides]), "N", WHY_FORCE),
            ticks=motion.tick[slides],
            note=f"{counted(int(slides.sum()), 'contact')} with a slip of more than the tick's friction is off",
        ),
        _balanced(motion, slip + motion.coefficient * room),
    ]


def _balanced(motion: FreeMotion, slip: FloatArray) -> Claim:
    """What friction is off by is no more than the slips: then it is the convex model's, and no worse."""
    off = np.asarray(motion.result["object/friction_residual"])
    most = np.zeros(len(off))
    np.maximum.at(most, motion.tick, slip)
    # Of a tick that lags it is the slip of a program of whose step the hand has made a part.
    behind = np.setdiff1d(motion.ticks, motion.whole)
    to_go = np.hypot(np.max(motion.coefficient, initial=0.0), float(motion.free["torsion"]) / RADIUS)
    most[behind] += to_go * np.asarray(motion.result["lag"])[behind]
    in_contact = np.unique(motion.tick)
    size = 1e6 * np.percentile(off[in_contact], (50.0, 99.0, 100.0)) if len(in_contact) else np.zeros(3)
    return judged(
        *("balanced", "the slip that friction is balanced against is the slip made, to what the file says", off),
        *(2.0 * most + CLEAR, "m"),
        "twice the slip, which may have turned round, and in a tick that lags what it has to go; the clearance",
        ticks=motion.ticks,
        note=f"µm in contact: {size[0]:.2g} in the median, {size[1]:.2g} at p99, {size[2]:.2g} at most",
    )


def _ways(motion: FreeMotion) -> tuple[FloatArray, FloatArray]:
    """Tangential way of each contact in its tick, of the hand past the object or the object past the table, and turn.

    A place that both bodies have at the end of the tick was at two places at its beginning; shape (C, 3) [m]. The turn
    is that about the normal, shape (C,) [rad].
    """
    tick, point = motion.tick, motion.point
    center, turned = motion.center, motion.turned
    step = turned[:-1] * turned[1:].inv()
    before = center[:-1][tick] + step[tick].apply(point - center[1:][tick])
    of_object = point - before
    way = np.where(motion.of_table[:, None], of_object, -of_object)
    hand = own_hand(motion.result)
    posed = pose(hand, configurations(motion.result, "graphic"))
    frames = _frames(posed, configurations(motion.result, "graphic"))
    chosen = np.flatnonzero(~motion.of_table & (tick > 0))
    origin, axes = frames
    t, b = tick[chosen], motion.body[chosen]
    local = np.einsum("cji,cj->ci", axes[t, b], point[chosen] - origin[t, b])
    was = origin[t - 1, b] + np.einsum("cij,cj->ci", axes[t - 1, b], local)
    way[chosen] += point[chosen] - was
    of_hand = np.einsum("cij,ckj->cik", axes[t, b], axes[t - 1, b])
    turn = np.where(motion.of_table[:, None], 1.0, -1.0) * step.inv().as_rotvec()[tick]
    turn[chosen] += 0.5 * np.stack(
        [of_hand[:, (i + 2) % 3, (i + 1) % 3] - of_hand[:, (i + 1) % 3, (i + 2) % 3] for i in range(3)], axis=1
    )
    first = ~motion.of_table & (tick == 0)
    way[first] = turn[first] = 0.0
    along = (way * motion.normal).sum(axis=1)
    return np.asarray(way - along[:, None] * motion.normal), np.asarray((turn * motion.normal).sum(axis=1))


def _frames(posed: Posed, hands: HandConfiguration) -> tuple[FloatArray, FloatArray]:
    """Origin (T, 16, 3) and axes as columns (T, 16, 3, 3) of every body of the hand."""
    ticks = len(posed.joints)
    origin, axes = np.empty((ticks, PALM + 1, 3)), np.empty((ticks, PALM + 1, 3, 3))
    for body in range(PALM):
        f, k = divmod(body, 3)
        along = posed.joints[:, f, k + 1] - posed.joints[:, f, k]
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
        origin[:, body] = posed.joints[:, f, k]
        axes[:, body] = np.stack([posed.axes[:, f], along, np.cross(posed.axes[:, f], along)], axis=2)
    origin[:, PALM] = posed.position
    axes[:, PALM] = rotations(hands.orientation)[0].as_matrix()
    return origin, axes


def free_hand_claim(judge: JudgedTicks) -> Claim:
    """The coupling of the hand is borne by its contacts with the object, friction and all, and by joints at limits.

    Args:
        judge: Of a result with a free object, in the world.
    """
    from scipy.optimize import nnls

    motion = FreeMotion(judge.result)
    good = judge.status[judge.chosen] & (STUCK | LAG | CAPACITY_EXCEEDED) == 0
    places = np.flatnonzero(good)
    size = np.linalg.norm(judge.pull[judge.chosen] * judge.scale, axis=1)
    off = np.empty(len(places))
    for n, i in enumerate(places):
        tick = int(judge.chosen[i])
        borne = np.zeros(21)
        rows = np.arange(*np.searchsorted(motion.tick, [tick, tick + 1]))
        for row in rows[motion.body[rows] != ON_TABLE]:
            borne += _on_hand(judge.chosen_posed, int(i), motion, int(row))
        flexion = judge.chosen_shown.flexion[i]
        low, high = flexion - judge.hand.flexion_min <= AT_LIMIT, judge.hand.flexion_max - flexion <= AT_LIMIT
        unit = np.eye(21)[6:]
        limits = np.concatenate([unit[low.ravel()], -unit[high.ravel()]]) * judge.scale
        left = (judge.pull[tick] - borne) * judge.scale
        off[n] = nnls(limits.T, left)[1] if len(limits) else np.linalg.norm(left)
    says = "the coupling of a settled tick is borne by its contacts, friction and all, and by joints at their limits"
    room = force_slack(judge, size, judge.chosen)[places]
    return judged("hand's balance", says, off, room, "N", WHY_SLACK, ticks=judge.chosen[places])


def free_complementarity_claim(judge: JudgedTicks) -> Claim:
    """What does not touch bears nothing, but what slides, which floats by no more than the tick's friction is off.

    Args:
        judge: Of a result with a free object, as it sees the hand.
    """
    motion = FreeMotion(judge.result)
    floats = np.repeat(np.asarray(motion.result["object/friction_residual"])[:, None], PALM + 1, axis=1)
    # A tick that lags has not come all of its way, and stands off by as much as it has slipped and still has to go: its
    # forces are those of the program that the object's motion follows from.
    on_the_way = ~motion.of_table & ~np.isin(motion.tick, motion.whole)
    slipped = float(motion.free["friction"]) * motion.slip[on_the_way]
    np.maximum.at(floats, (motion.tick[on_the_way], motion.body[on_the_way]), slipped)
    places = np.flatnonzero(judge.status[judge.chosen] & STUCK == 0)
    ticks = judge.chosen[places]
    late = judge.status[ticks] & LAG > 0
    to_go = np.where(late, np.asarray(motion.result["lag"])[ticks], 0.0)
    # A step of the solver is straight, and what turns goes round; the slip may be too large by its clearance.
    room = CLEAR + judge.moved[ticks].clip(max=float(judge.options["margin"])) ** 2 / RADIUS
    bears = (np.where(late, judge.bearing, judge.touch) + to_go + room)[:, None] + floats[ticks]
    # Of what is beyond the margin the distance is not known.
    nearest = np.minimum(judge.near.nearest[places], float(judge.options["margin"]))
    apart = nearest > bears + LENGTH
    size = np.linalg.norm(judge.stored_forces(ticks), axis=2)
    off = np.where(apart, size, 0.0).max(axis=1)
    says = "what does not touch bears no force, but for what floats by what the tick's friction is off"
    return judged("complementarity", says, off, FORCE, "N", "rounding of a sum", ticks=ticks)


def _on_hand(posed: Posed, i: int, motion: FreeMotion, row: int) -> FloatArray:
    """What a contact does to palm and joints, [N] and [N·m], shape (21,)."""
    force, twist = motion.force[row], motion.torsion[row] * motion.normal[row]
    point, body = motion.point[row], int(motion.body[row])
    found = np.zeros(21)
    found[:3] = force
    found[3:6] = np.cross(point - posed.position[i], force) + twist
    if body != PALM:
        f, last = divmod(body, 3)
        for k in range(last + 1):
            found[6 + 3 * f + k] = posed.axes[i, f] @ (np.cross(point - posed.joints[i, f, k], force) + twist)
    return found


def free_figures(result: Result) -> dict[str, float]:
    """The figures of a free object by the definitions of the documentation; none where it is not free."""
    if not result.free:
        return {}
    motion = FreeMotion(result)
    wrench = np.asarray(result["object/hand_wrench"]) + result["object/table_wrench"]
    size = np.sqrt((motion.friction**2).sum(axis=1))
    outside = (size > motion.coefficient * motion.load * (1.0 + 1e-9)) | (motion.load < 0.0)
    ways = [
        sum(motion.slip[chosen & (motion.tick == tick)].max() for tick in np.unique(motion.tick[chosen]))
        for chosen in (motion.body == body for body in np.unique(motion.body[~motion.of_table]))
    ]
    in_contact = np.unique(motion.tick)
    residual = np.asarray(result["object/friction_residual"])[in_contact] if len(in_contact) else np.zeros(1)
    return {
        **{
            f"friction_residual_{name}": float(np.quantile(residual, share))
            for name, share in (("p50", 0.5), ("p99", 0.99), ("max", 1.0))
        },
        "object_raised": float(motion.center[1:, 2].max() - motion.center[1, 2]),
        "object_slip": float(max(ways, default=0.0)),
        "object_creep": _creep(motion),
        "object_momentum": float(motion.unbalanced(wrench[:, :3]).max()),
        "energy_gained": float(np.fmax.reduce(_energy_gains(motion), initial=0.0)),
        "cone_outside": 100.0 * float(outside.sum()) / len(outside) if len(outside) else 0.0,
        "table_depth_max": max(0.0, -float(np.min(result["object/table_distance"]))),
    }


def _energy_gains(motion: FreeMotion) -> FloatArray:
    """Energy of object and springs gained in each tick beyond what the user, the clearance and rounding give [J].

    NaN where the tick before is not known. See the documentation of `energy_gained` for its terms.
    """
    result, solver = motion.result, motion.result.scene["solver"]
    velocity, shown, user = (np.asarray(result["object/velocity"]), *(configurations(result, name) for name in WHOSE))
    omega = motion.turned[1:].inv().apply(np.array(result["object/angular_velocity"]))
    kinetic = 0.5 * (motion.mass * (velocity * velocity).sum(axis=1) + (omega @ motion.inertia * omega).sum(axis=1))
    springs = np.repeat([solver["stiffness"][name] for name in ("translation", "rotation", "flexion")], (3, 3, 15))
    kept = [_stretch(springs, user.at(slice(1, None)), shown.at(part)) for part in (slice(0, -1), slice(1, None))]
    fall = np.diff(motion.center[1:], axis=0) @ motion.gravity
    gained = np.diff(kinetic) - motion.mass * fall + kept[1] - kept[0]
    clearance = np.zeros(result.ticks)
    np.add.at(clearance, motion.tick, float(solver["offset"]) * motion.load)
    size = np.sqrt(2.0 * motion.mass * np.maximum(kinetic[1:], kinetic[:-1])) / motion.period
    size += motion.mass * np.linalg.norm(motion.gravity) + np.sqrt(2.0 * springs.max() * np.maximum(*kept))
    gained -= clearance[1:] + ENERGY * size
    # The spread of a finger turns it about its first joint.
    hand = own_hand(result)
    posed, palm = pose(hand, shown), rotations(shown.orientation)[0]
    turn = np.diff(shown.abduction, axis=0, prepend=shown.abduction[:1])
    for row in np.flatnonzero(~motion.of_table & (motion.body != PALM)):
        tick, f = int(motion.tick[row]), int(motion.body[row]) // 3
        if tick and turn[tick, f]:
            arm = motion.point[row] - posed.joints[tick, f, 0]
            moment = np.cross(arm, motion.force[row]) + motion.torsion[row] * motion.normal[row]
            gained[tick - 1] += hand.sign * turn[tick, f] * (palm[tick].apply(hand.dorsal[f]) @ moment)
    return np.where(motion.follows, np.concatenate([[np.nan], gained]), np.nan)


def _stretch(springs: FloatArray, user: HandConfiguration, shown: HandConfiguration) -> FloatArray:
    """Energy of the springs between two hands [J], shape (T,)."""
    turn = turn_between(shown.orientation, user.orientation)
    bend = (user.flexion - shown.flexion).reshape(-1, 15)
    return np.asarray(0.5 * np.concatenate([user.position - shown.position, turn, bend], axis=1) ** 2 @ springs)


def _creep(motion: FreeMotion) -> float:
    """The farthest way of a corner of the object's box in the last half of a hold, over its time [m/s]."""
    bounds = motion.result.static["object/vertices"]
    low, high = bounds.min(axis=0), bounds.max(axis=0)
    corners = np.array([np.where([(n >> axis) & 1 for axis in range(3)], high, low) for n in range(8)])
    held = np.abs(np.asarray(motion.result["object/hand_wrench"])[:, :3]).sum(axis=1) > 0.0
    found = float("nan")
    for phase in motion.result.phases:
        if phase.name != "hold":
            continue
        last = min(phase.last_tick, motion.result.ticks - 1)
        first = (phase.first_tick + last + 1) // 2
        if last > first and held[first : last + 1].all():
            arm = corners - np.array(motion.free["center"])
            ends = [motion.center[t + 1] + motion.turned[t + 1].apply(arm) for t in (first, last)]
            way = float(np.linalg.norm(ends[1] - ends[0], axis=1).max())
            found = float(np.fmax(found, way * motion.result.rate / (last - first)))
    return found


def _table(motion: FreeMotion) -> Claim:
    """The lowest corner of the mesh, where the poses put it."""
    says = "the object's lowest point is above the table, as high as the file says"
    height = motion.free["table"]
    stored = np.asarray(motion.result["object/table_distance"])
    if height is None:
        return all_true("table", says, np.isfinite(stored), ticks=motion.ticks, note="there is none")
    corners = motion.result.static["object/vertices"]
    matrix = motion.turned[1:].as_matrix()[:, 2]
    start = np.array(motion.free["center"])
    lowest = motion.center[1:, 2] + ((corners - start) @ matrix.T).min(axis=0) - height
    off = np.maximum(np.abs(lowest - stored), -lowest)
    return judged("table", says, off, LENGTH, "m", "a nanometre", ticks=motion.ticks)
