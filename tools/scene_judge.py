"""Judge of the result of a scene by geometry of its own: depths, equations of motion, joints, and hands that stop.

Distances are those of `hhsim.verify`, in double precision by numpy and scipy; no compiled kernel takes part. Two bodies
are convex pieces, which separating axes judge. Newton's and Euler's equations are looked at in every tick, depths in
some of them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import conjugate, quaternion_product, rotation_matrix
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_NO_PLACE, STATUS_STUCK
from hhsim.motion.trajectory import RigidMotion
from hhsim.result.reader import Result
from hhsim.scene.body import Body, Driven, Free
from hhsim.scene.scene import Scene
from hhsim.solver.options import Stiffness
from hhsim.verify.contacts import (
    PALM,
    Pairs,
    Pieces,
    joined,
    meetings,
    meetings_of_two,
    near_pairs,
    parts_that_may_meet,
)
from hhsim.verify.force_checks import limit_rows, residual, unit_pushes
from hhsim.verify.free_object_checks import gyrated
from hhsim.verify.kinematics import OwnHand, Posed, configurations, pose, rotations, turn_between
from tools.convex_solids import Solid, separation

PERIOD = 1e-3
"""Of a tick [s]."""
EVERY = 100
"""Ticks from one whose depths are judged to the next."""
DEEP = 1e-9
"""Depth [m] that counts: a nanometre is rounding."""
JOINED = 2e-6
"""How far a body may come off its joint [m, rad], unless the tick lags."""
TOUCH = 5e-6
"""Largest distance [m] of what may bear a force."""
EQUATION = 1e-6
"""Largest residual of an equation of motion as a share of the forces at hand."""
CRUSH = 1e6
"""Force [N] from which on a driven body crushes a free one: its size is that of the mass that a driven one is given."""
ROUNDED = 1e-15
"""Of the largest force at any body of a tick: what one program leaves of it in the sums of all of its bodies [N/N]."""
AXES = 1e-3
"""Residual of Euler's equation as a share of the moment, of ticks of several programs."""
SPEED = 1e-9
"""Largest difference of a velocity from that of the poses [m/s, rad/s]: rounding of a pose over a tick."""
WINDOW, STOPPED = 100, 1e-5
"""A hand that has not converged in so many ticks one after another, and moved less than this [m], has stopped."""
BORNE = 0.05
"""Contacts explain a hand that has stopped if they bear all of its pull but this share."""
NO_PULL = 1e-9
"""Up to here a pull, over the root of its stiffness [√J], is rounding: of a hand whose abduction alone is held back."""
SIDES = 16
"""Of the pyramid in a cone of friction: it has 98 % of it."""
ARRIVED, ON_ITS_WAY = 1e-5, 1e-3
"""Distance [m] from the user's hand at which a hand that was let go has followed; one that has not is on its way if it
goes farther than this [m] in its last `WINDOW` ticks."""
GRAVITY = 9.81
OPEN = "a hand has no place between open bodies"


@dataclass(eq=False)
class Moved:
    """Body of a result, T ticks: what is at x at the first tick is at turn · x + shift; forces if it is free."""

    body: Body
    solid: Solid
    turn: FloatArray  # (w, x, y, z), (T, 4)
    shift: FloatArray  # [m], (T, 3)
    spheres: tuple[FloatArray, FloatArray] | None = None  # leaves at the first tick [m], where hands touch them
    velocity: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))  # of the centre of mass [m/s], (T, 3)
    spin: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))  # angular velocity, world [rad/s], (T, 3)
    # On the body by hands, table and other bodies: force [N], moment about the centre of mass [N·m], (3, T, 6).
    wrench: FloatArray = field(default_factory=lambda: np.zeros((3, 0, 6)))

    @property
    def free(self) -> Free | None:
        """How forces move it; None for a body that stands still or moves as given."""
        return self.body.motion if isinstance(self.body.motion, Free) else None

    def at(self, look: IntArray) -> RigidMotion:
        """Motion at some ticks."""
        return RigidMotion(self.turn[look], self.shift[look])


@dataclass(eq=False)
class Recorded:
    """Ticks of a scene, all in the world."""

    hands: tuple[HandModel, ...]
    shown: tuple[HandConfiguration, ...]
    haptic: tuple[HandConfiguration, ...]
    status: IntArray  # of each hand, (H, T)
    programs: IntArray  # linearisations of each tick, (T,)
    bodies: tuple[Moved, ...]
    hand_force: FloatArray | None = None  # of all hands together, as they record it [N], (T, 3)
    table: float | None = None  # height [m]
    self_contact: bool = False  # True if a hand's own parts keep out of each other
    released: bool = False  # True if the user's hands end where nothing is

    @property
    def ticks(self) -> int:
        """Number of ticks."""
        return int(self.status.shape[1])

    @property
    def joints(self) -> Iterator[tuple[Moved, Moved | None]]:
        """Each body on a joint with the body that bears it, None for the world."""
        for one in self.bodies:
            if one.body.joint is not None:
                yield one, next((other for other in self.bodies if other.body.name == one.body.joint.on), None)


def recorded(
    scene: Scene, result: Result, solids: Mapping[str, Solid], *, self_contact: bool, released: bool
) -> Recorded:
    """Return a scene's ticks of its result; solids are where their bodies are at the first tick, by name."""
    hands, bodies = list(result.hands.values()), list[Moved]()
    for body in scene.solids:
        stored = result.bodies.get(body.name, result.body)
        turn, shift = stored.moved()
        if isinstance(body.motion, Driven):
            # A file may have its mesh anywhere; its solid is where it is at the first tick.
            begin = turn[:1], shift[0]
            turn = quaternion_product(turn, conjugate(begin[0]))
            shift = shift - np.einsum("tij,j->ti", rotation_matrix(turn), begin[1])
        found = Moved(body, solids[body.name], turn, shift)
        if result.surface == "spheres":
            leaf = body.tree.level == body.tree.level.max()
            found.spheres = body.placed_tree.center[leaf], body.placed_tree.radius[leaf]
        if "hand_wrench" in stored:
            names = [name for name in ("hand_wrench", "table_wrench", "body_wrench") if name in stored]
            found.wrench = np.zeros((3, len(shift), 6))
            for place, name in enumerate(names):
                found.wrench[place] = stored[name]
            found.velocity, found.spin = (np.array(stored[name]) for name in ("velocity", "angular_velocity"))
        bodies.append(found)
    force = np.sum([hand["force/total"] for hand in hands], axis=0)
    return Recorded(
        tuple(hand.model for hand in scene.hands),
        tuple(configurations(hand, "graphic") for hand in hands),
        tuple(configurations(hand, "haptic") for hand in hands),
        np.stack([hand["status"] for hand in hands]),
        np.asarray(hands[0]["work/linearisations"]),
        tuple(bodies),
        hand_force=force if bodies[0].wrench.shape[1] else None,
        table=None if scene.plane is None else scene.plane.height,
        self_contact=self_contact,
        released=released,
    )


@dataclass(frozen=True)
class Finding:
    """What is wrong, and in which tick of the scene."""

    what: str
    tick: int
    size: float

    def __str__(self) -> str:
        return f"tick {self.tick}: {self.what} {self.size:.3g}"


@dataclass(eq=False)
class Verdict:
    """Worst figures of some scenes: depths [m], residuals as shares, and counts."""

    ticks: int = 0
    judged: int = 0
    touching: int = 0  # judged ticks in which a hand is within `TOUCH` of something
    deepest: dict[str, float] = field(default_factory=dict)  # by the kind of pair [m]
    newton: float = 0.0
    euler: float = 0.0
    equations: int = 0  # ticks of a body in which they were looked at
    late: int = 0  # of these, the ones that lag, whose body makes a share of its step
    crushed: int = 0  # ticks of a body with a force above `CRUSH`
    crushed_newton: float = 0.0  # largest residual of Newton's equation in them
    squeezed: int = 0  # ticks that say that moving parts left no place
    squeezed_deepest: float = 0.0  # of those that were judged [m]
    stops: int = 0
    explained: int = 0
    on_the_way: int = 0  # hands that have not arrived at the end, and are moving
    findings: list[Finding] = field(default_factory=list)

    def add(self, other: "Verdict") -> None:
        """Take in another scene's figures."""
        counts = "ticks judged touching equations late crushed squeezed stops explained on_the_way"
        for name in counts.split():
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for name in ("newton", "euler", "crushed_newton", "squeezed_deepest"):
            setattr(self, name, max(getattr(self, name), getattr(other, name)))
        for kind, depth in other.deepest.items():
            self.deepest[kind] = max(self.deepest.get(kind, 0.0), depth)
        self.findings += other.findings

    def note(self, what: str, size: FloatArray, limit: FloatArray | float, ticks: IntArray) -> None:
        """Keep the largest excess of a size over a limit as a finding."""
        over = np.where(np.isfinite(size), size - limit, np.inf)
        if len(over) and (worst := int(over.argmax())) >= 0 and over[worst] > 0.0:
            self.findings.append(Finding(what, int(ticks[worst]), float(size[worst])))

    def depth(self, kind: str, depth: FloatArray, ticks: IntArray) -> None:
        """Keep the deepest of a kind of pair, and what is too deep as a finding."""
        self.deepest[kind] = max(self.deepest.get(kind, 0.0), float(depth.max(initial=0.0)))
        self.note(f"{kind}, depth [m]", depth, DEEP, ticks)


def judge(scene: Recorded, every: int = EVERY) -> Verdict:
    """Judge recorded ticks: depths in one of `every`, equations in all, and hands that stop."""
    found = Verdict(ticks=scene.ticks)
    owns = [own_hand_of(hand) for hand in scene.hands]
    look = ticks_to_judge(scene, every)
    found.judged = len(look)
    posed = [pose(own, at.at(look)) for own, at in zip(owns, scene.shown)]
    touching = np.zeros(len(look), bool)
    squeezed = (scene.status[:, look] & STATUS_NO_PLACE) > 0
    for h, (own, hand) in enumerate(zip(owns, posed)):
        for body in scene.bodies:
            nearest = hand_distance(own, hand, body, look)
            depth = np.maximum(0.0, -nearest)
            touching |= nearest < TOUCH
            found.squeezed_deepest = max(found.squeezed_deepest, float(depth[squeezed[h]].max(initial=0.0)))
            found.depth("hand in body", np.where(squeezed[h], 0.0, depth), look)
        if scene.self_contact:
            nearest = meetings(own, hand, parts_that_may_meet(own, np.ones(5, bool)), TOUCH).nearest(len(look))
            touching |= nearest.min(axis=1) < TOUCH
            found.depth("hand in itself", np.where(squeezed[h], 0.0, np.maximum(0.0, -nearest.min(axis=1))), look)
    found.squeezed = int(((scene.status & STATUS_NO_PLACE) > 0).any(axis=0).sum())
    if len(owns) == 2:
        nearest = meetings_of_two(owns, posed, TOUCH).nearest(len(look)).min(axis=1)
        touching |= nearest < TOUCH
        # What leaves a hand no place may push it into the other one, or into itself.
        found.depth("hand in hand", np.where(squeezed.any(axis=0), 0.0, np.maximum(0.0, -nearest)), look)
    found.touching = int(touching.sum())
    together = list(scene.joints)
    for one, bearer in together:
        off = off_joint(one, bearer)
        found.deepest["off a joint"] = max(found.deepest.get("off a joint", 0.0), float(off.max()))
        whole = np.flatnonzero(((scene.status & (STATUS_LAG | STATUS_STUCK)) == 0).all(axis=0))
        found.note("off a joint [m, rad]", off[whole], JOINED, whole)
    for i, body in enumerate(scene.bodies):
        for other in scene.bodies[:i]:
            if (body, other) in together or (other, body) in together or (body.free is None and other.free is None):
                continue
            apart = separation(body.solid, other.solid, body.at(look), other.at(look))
            found.depth("body in body", np.maximum(0.0, -apart), look)
        if body.free is not None and scene.table is not None:
            found.depth("body in table", np.maximum(0.0, scene.table - lowest(body, look)), look)
        # What a joint on the world or on a fixed body bears is in no column; `hhsim verify` judges along such a joint.
        hung = any(one is body and (bearer is None or bearer.free is None) for one, bearer in together)
        if body.free is not None and not hung:
            _equations(scene, body, found)
    _forces(scene, found)
    _stops(scene, owns, found)
    return found


def off_joint(one: Moved, bearer: Moved | None) -> FloatArray:
    """Return how far a body is off its joint with the one that bears it, or beyond the limits [m, rad], (T,)."""
    joint = one.body.joint
    assert joint is not None
    still = RigidMotion(np.tile([1.0, 0.0, 0.0, 0.0], (len(one.shift), 1)), np.zeros_like(one.shift))
    on, own = still if bearer is None else RigidMotion(bearer.turn, bearer.shift), RigidMotion(one.turn, one.shift)
    axis, hinge = np.array(joint.axis) / np.linalg.norm(joint.axis), joint.type == "hinge"
    origin = np.tile(joint.origin if hinge else one.solid.mesh.bounds.mean(axis=0), (len(one.shift), 1))
    way = on.seen_points(own.points(origin)) - origin
    relative = (rotations(on.turn)[0].inv() * rotations(own.turn)[0]).as_rotvec()
    turned = on.seen_vectors(own.vectors(np.tile(axis, (len(way), 1)))) - axis
    value = relative @ axis if hinge else way @ axis
    kept = (way, turned) if hinge else (way - np.outer(value, axis), relative)
    least, most = joint.limits or (-np.inf, np.inf)
    value = value + joint.value
    off = np.maximum(*(np.linalg.norm(each, axis=1) for each in kept))
    return np.asarray(np.maximum(off, np.maximum(least - value, value - most)))


def ticks_to_judge(scene: Recorded, every: int) -> IntArray:
    """Return one tick of `every`, and the first two in which a hand is stuck or without a place, or no longer so."""
    wanted = np.zeros(scene.ticks, bool)
    wanted[every - 1 :: every] = True
    for bit in (STATUS_STUCK, STATUS_NO_PLACE):
        turns = 1 + np.flatnonzero(np.diff((scene.status & bit) > 0, axis=1).any(axis=0))
        wanted[turns] = True
        wanted[np.minimum(turns + 1, scene.ticks - 1)] = True
    return np.flatnonzero(wanted)


def own_hand_of(hand: HandModel) -> OwnHand:
    """Return a hand as the referee has it."""
    names = ("base", "distal", "dorsal", "length", "radius", "flexion_min", "flexion_max")
    palm, sign = hand.palm_tree, -1.0 if hand.side == "left" else 1.0
    arrays = [np.array(getattr(hand, name)) for name in names]
    return OwnHand._make([*arrays, palm.leaf_center, palm.leaf_radius, sign])


def seen(posed: Posed, turn: FloatArray, shift: FloatArray) -> Posed:
    """Return hands (T) as bodies see them that are turned by matrices (T, 3, 3) and shifted [m] (T, 3)."""

    def points(values: FloatArray) -> FloatArray:
        flat = values.reshape(len(values), -1, 3) - shift[:, None]
        return np.asarray(np.einsum("tji,tkj->tki", turn, flat).reshape(values.shape))

    axes = np.asarray(np.einsum("tji,tfj->tfi", turn, posed.axes))
    return Posed(points(posed.joints), axes, points(posed.palm), points(posed.position[:, None])[:, 0])


def winding(triangles: FloatArray, points: FloatArray) -> FloatArray:
    """Return the winding numbers of triangles (F, 3, 3) around points (n, 3), by Van Oosterom & Strackee (1983)."""
    a, b, c = (corner[None] - points[:, None] for corner in triangles.transpose(1, 0, 2))
    x, y, z = (np.linalg.norm(side, axis=2) for side in (a, b, c))
    volume = np.einsum("nfi,nfi->nf", a, np.cross(b, c))
    dots = (np.einsum("nfi,nfi->nf", one, two) * size for one, two, size in ((a, b, z), (b, c, x), (c, a, y)))
    return np.asarray(np.arctan2(volume, x * y * z + sum(dots)).sum(axis=1) / (2.0 * np.pi))


def near_body(own: OwnHand, here: Posed, body: Moved) -> Pairs:
    """Return the pairs of a hand, as a body sees it, and the body's triangles or spheres within `TOUCH`."""
    pieces = Pieces.of_triangles(body.solid.mesh.triangles) if body.spheres is None else Pieces.of_balls(*body.spheres)
    return near_pairs(own, here, pieces, np.ones(5, bool), TOUCH)


def hand_distance(own: OwnHand, posed: Posed, body: Moved, look: IntArray) -> FloatArray:
    """Return the distance [m] of hands (n) and a body at the ticks `look` (n), infinite from `TOUCH` on.

    A part whose axis is inside counts as deep as its radius.
    """
    mesh = body.solid.mesh
    here = seen(posed, rotation_matrix(body.turn[look]), body.shift[look])
    nearest = near_body(own, here, body).nearest(len(look)).min(axis=1)
    middles = 0.5 * (here.joints[:, :, :3] + here.joints[:, :, 1:]).reshape(len(look), PALM, 3)
    points = np.concatenate([middles, here.palm], axis=1)
    size = np.concatenate([own.radius[:, :3].ravel(), own.palm_radius])
    low, high = mesh.bounds
    tick, part = np.nonzero(((points > low) & (points < high)).all(axis=2))
    for first in range(0, len(tick), 1000):
        t, p = tick[first : first + 1000], part[first : first + 1000]
        inside = winding(mesh.triangles, points[t, p]) > 0.5
        np.minimum.at(nearest, t[inside], -size[p[inside]])
    return np.asarray(nearest)


def lowest(body: Moved, look: IntArray) -> FloatArray:
    """Return the height [m] of a body's lowest corner at some ticks."""
    up = rotation_matrix(body.turn[look])[:, 2]
    return np.asarray((up @ body.solid.mesh.vertices.T).min(axis=1) + body.shift[look, 2])


def _equations(scene: Recorded, body: Moved, found: Verdict) -> None:
    """Look at velocities, Newton's and Euler's equation of a free body in all ticks but the first."""
    free, ticks = body.free, np.arange(1, scene.ticks)
    assert free is not None
    late = ((scene.status[:, 1:] & (STATUS_LAG | STATUS_STUCK)) > 0).any(axis=0)
    turned, _ = rotations(body.turn)
    center = turned.apply(np.array(free.center)) + body.shift
    before, after = turned[:-1], turned[1:]
    step = (after * before.inv()).as_rotvec() / PERIOD
    off = np.linalg.norm(np.diff(center, axis=0) / PERIOD - body.velocity[1:], axis=1)
    off = np.maximum(off, np.linalg.norm(step - body.spin[1:], axis=1))
    # A position far from the origin is rounded more.
    limit = SPEED * (1.0 + np.abs(center).max())
    found.note("velocity off its poses [m/s, rad/s]", np.where(late, 0.0, off), limit, ticks)
    force, torque = body.wrench[:, 1:, :3].sum(axis=0), body.wrench[:, 1:, 3:].sum(axis=0)
    heavier = 1.0 + free.damping * PERIOD
    weight = free.mass * np.array(free.gravity)
    size = np.linalg.norm(weight) + np.linalg.norm(body.wrench[:, 1:, :3], axis=2).sum(axis=0)
    inertia = np.array(free.inertia)
    # The body's velocities at the end of the tick by its program, world and body axes.
    whole = (body.velocity[:-1] + PERIOD / free.mass * (force + weight)) / heavier
    spin = before.inv().apply(body.spin[:-1])
    alone = gyrated(inertia, spin, PERIOD) / heavier
    frames = before.inv(), after.inv()
    rate = [
        np.asarray(
            before.inv().apply(
                frame.inv().apply(
                    (frame * before).apply(alone) + _solved(inertia, frame.apply(torque) * (PERIOD / heavier))
                )
            )
        )
        for frame in frames
    ]
    # The body's axes go with it: in those of each end of the tick, as Euler's equation has them.
    made = after.inv().apply(body.spin[1:])
    # A tick that lags makes a share of what the program changes, one share of both velocities.
    change = body.velocity[1:] - body.velocity[:-1]
    wanted = whole - body.velocity[:-1]
    off_newton = np.linalg.norm(change - wanted, axis=1)
    shares = []
    for some in rate:
        both = free.mass * (change * wanted).sum(axis=1) + ((made - spin) @ inertia * (some - spin)).sum(axis=1)
        square = free.mass * (wanted**2).sum(axis=1) + ((some - spin) @ inertia * (some - spin)).sum(axis=1)
        shares.append(np.clip(both / np.where(square > 0.0, square, 1.0), 0.0, 1.0))
    own = (change * wanted).sum(axis=1) / np.where((wanted**2).sum(axis=1) > 0.0, (wanted**2).sum(axis=1), 1.0)
    off_late = np.linalg.norm(change - np.clip(own, 0.0, 1.0)[:, None] * wanted, axis=1)
    newton = heavier * free.mass / PERIOD * np.where(late, off_late, off_newton) / size
    length = float(np.ptp(body.solid.mesh.vertices, axis=0).max())
    # As the program has it: rotation vectors in the body's axes where it began, at the tick's start or next to its end.
    from scipy.spatial.transform import Rotation

    goal = before * Rotation.from_rotvec(PERIOD * alone)
    apart = np.full(len(ticks), np.inf)
    for frame, some, share in zip(frames, rate, shares):
        beyond = (frame * after).as_rotvec() - (frame * goal).as_rotvec()
        ended = np.linalg.norm(beyond @ inertia / PERIOD - PERIOD / heavier * frame.apply(torque), axis=1)
        behind = np.linalg.norm((made - spin - share[:, None] * (some - spin)) @ inertia, axis=1)
        apart = np.minimum(apart, np.where(late, behind, ended))
    euler = heavier / PERIOD * apart / (length * size)
    # Of several programs the last one began anywhere between: the axes are as uncertain as the body turned meanwhile,
    # of the moment, of gyration and, in a tick that lags, of the turn that is left.
    angle = PERIOD * np.linalg.norm(step, axis=1)
    swing = angle + PERIOD * np.linalg.norm(np.stack([body.spin[:-1], body.spin[1:]]), axis=2).sum(axis=0)
    unfinished = np.linalg.norm(after.inv().apply(step) - made, axis=1) + np.linalg.norm(made - alone, axis=1)
    left = np.where(late, float(np.linalg.eigvalsh(inertia)[-1]) * unfinished, 0.0)
    left += np.linalg.norm((alone * heavier - spin) @ inertia, axis=1)
    moments = np.linalg.norm(body.wrench[:, 1:, 3:], axis=2).sum(axis=0)
    slack = ((AXES + swing) * moments + swing * left / PERIOD) / (length * size)
    slack[scene.programs[1:] <= 1] = 0.0
    sums = [np.linalg.norm(one.wrench[:, 1:, :3], axis=2).sum(axis=0) for one in scene.bodies if one.wrench.shape[1]]
    rounded = ROUNDED * np.max(sums, axis=0) / size
    found.equations += len(ticks)
    found.late += int(late.sum())
    crushed = size > CRUSH
    found.crushed += int(crushed.sum())
    found.crushed_newton = max(found.crushed_newton, float(newton[crushed].max(initial=0.0)))
    newton, euler = (np.where(crushed, 0.0, np.maximum(0.0, of - rounded)) for of in (newton, euler))
    found.newton = max(found.newton, float(newton.max(initial=0.0)))
    found.euler = max(found.euler, float(np.maximum(0.0, euler - slack).max(initial=0.0)))
    found.note("Newton's equation, share of the forces", newton, EQUATION, ticks)
    found.note("Euler's equation, share of the forces at the body's length", euler, EQUATION + slack, ticks)


def _solved(inertia: FloatArray, torque: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.solve(inertia, torque.T).T)


def _forces(scene: Recorded, found: Verdict) -> None:
    """Look whether bodies push each other, and hands and bodies each other, equally and in opposite directions."""
    pushed = [body for body in scene.bodies if body.wrench.shape[1]]
    if not pushed:
        return
    ticks = np.arange(scene.ticks)
    size = GRAVITY * sum(body.free.mass for body in pushed if body.free) + sum(
        np.linalg.norm(body.wrench[:, :, :3], axis=2).sum(axis=0) for body in pushed
    )
    if all(bearer is not None and bearer.free is not None for _, bearer in scene.joints):
        between = np.linalg.norm(sum(body.wrench[2, :, :3] for body in pushed), axis=1) / size
        found.note("forces of bodies on each other, share that is not opposite", between, EQUATION, ticks)
    if scene.hand_force is not None:
        off = np.linalg.norm(sum(body.wrench[0, :, :3] for body in pushed) + scene.hand_force, axis=1) / size
        found.note("force on the hands, share that the bodies do not bear", off, EQUATION, ticks)


def _stops(scene: Recorded, owns: Sequence[OwnHand], found: Verdict) -> None:
    """Look for hands that have stopped or were left behind, and whether their contacts bear their pull."""
    for h, own in enumerate(owns):
        for tick, what in _stopped(scene, own, h):
            if not what:
                found.on_the_way += 1
                continue
            left = unborne(scene, owns, h, tick)
            found.stops += 1
            if left <= BORNE and what != OPEN:
                found.explained += 1
            else:
                away = float(np.linalg.norm(scene.haptic[h].position[tick] - scene.shown[h].position[tick]))
                unborne_share = Finding(f"{what}, share of the pull that no contact bears", tick, left)
                found.findings.append(
                    Finding(f"{what}, from the user's [m]", tick, away) if what == OPEN else unborne_share
                )


def _stopped(scene: Recorded, own: OwnHand, h: int) -> Iterator[tuple[int, str]]:
    """Yield the ticks in which a hand has stopped, and what that is; no words for one that is on its way."""
    ends = np.arange(WINDOW, scene.ticks, WINDOW)
    late = np.add.accumulate((scene.status[h] & (STATUS_LAG | STATUS_STUCK)) > 0)
    joints = pose(own, scene.shown[h].at(np.concatenate([[0], ends]))).joints
    moved = np.linalg.norm(np.diff(joints, axis=0), axis=3).max(axis=(1, 2))
    before = False
    for end, way in zip(ends.tolist(), moved):
        stopped = late[end] - late[end - WINDOW] == WINDOW and way < STOPPED
        # Beside a thing that flies past, a hand that is where the user's is may be late by a nanometre in each tick.
        stopped = stopped and _off(scene, own, h, end) > ARRIVED
        if stopped and not before:
            yield end, "a hand has stopped"
        before = bool(stopped)
    if scene.released:
        last = scene.ticks - 1
        if _off(scene, own, h, last) > ARRIVED:
            was, here = pose(own, scene.shown[h].at(np.array([last - WINDOW, last]))).joints
            goes = np.linalg.norm(here - was, axis=2).max() > ON_ITS_WAY
            # The parts are open again: there is a place.
            has_none = bool(scene.status[h, -1] & STATUS_NO_PLACE)
            yield scene.ticks - 1, OPEN if has_none else "" if goes else "a hand was left behind"


def _off(scene: Recorded, own: OwnHand, h: int, tick: int) -> float:
    """Return how far a shown hand's farthest joint is from the user's at a tick [m]."""
    there, here = (pose(own, of[h].at(np.array([tick]))).joints for of in (scene.haptic, scene.shown))
    return float(np.linalg.norm(there - here, axis=3).max())


def unborne(scene: Recorded, owns: Sequence[OwnHand], h: int, tick: int) -> float:
    """Return the share of the pull on a hand that contacts and joint limits cannot bear, by least squares; 0 of none.

    Contacts are found anew, within `TOUCH`; with friction their forces are in a pyramid of four sides.
    """
    at = np.array([tick])
    posed, own = [pose(one, of.at(at)) for one, of in zip(owns, scene.shown)], owns[h]
    here, there = scene.shown[h].at(at), scene.haptic[h].at(at)
    stiffness = Stiffness().diagonal()
    # What contacts have to bear: the coupling's pull with its sign changed.
    bent = here.flexion - np.clip(there.flexion, own.flexion_min, own.flexion_max)
    turn = turn_between(there.orientation, here.orientation)[0]
    pull = stiffness * np.concatenate([(here.position - there.position)[0], turn, bent.ravel()])
    pairs = joined([_rubbing(_on_body(own, posed[h], body, tick), body, scene) for body in scene.bodies])
    if len(owns) == 2:
        pairs = joined([pairs, _on_other(meetings_of_two(owns, posed, TOUCH), h)])
    may = parts_that_may_meet(own, np.full(5, scene.self_contact))
    pushed, _ = unit_pushes(posed[h], 0, pairs, meetings(own, posed[h], may, TOUCH))
    rows, scale = np.concatenate([pushed, limit_rows(own, here.flexion[0])]), 1.0 / np.sqrt(stiffness)
    size = float(np.linalg.norm(pull * scale))
    return residual((rows * scale).T, pull * scale) / size if size > NO_PULL else 0.0


def _on_body(own: OwnHand, posed: Posed, body: Moved, tick: int) -> Pairs:
    """Return the pairs of a hand and a body that may bear a force, world."""
    turn, shift = rotation_matrix(body.turn[[tick]]), body.shift[[tick]]
    pairs = near_body(own, seen(posed, turn, shift), body)
    return pairs._replace(point=pairs.point @ turn[0].T + shift, normal=pairs.normal @ turn[0].T)


def _rubbing(pairs: Pairs, body: Moved, scene: Recorded) -> Pairs:
    """Return pairs whose normals are those of a pyramid of friction, which there is where something is free."""
    friction = body.body.friction if scene.hand_force is not None else 0.0
    if not len(pairs.tick) or friction == 0.0:
        return pairs
    least = np.eye(3)[np.abs(pairs.normal).argmin(axis=1)]
    first = np.cross(pairs.normal, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second, turns = np.cross(pairs.normal, first), 2.0 * np.pi * np.arange(SIDES) / SIDES
    along = (np.cos(turn) * first + np.sin(turn) * second for turn in turns)
    return joined([pairs._replace(normal=pairs.normal + friction * one) for one in along])


def _on_other(found: Pairs, h: int) -> Pairs:
    """Return the pairs of two hands as those of one of them."""
    return found if h == 0 else found._replace(body=found.leaf, normal=-found.normal)
