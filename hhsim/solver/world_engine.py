"""Engine of `coupled` and `progressive`: hands and bodies in one program, with friction and a table."""

from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from itertools import count
from typing import Any

import numpy as np

from hhsim.arrays import AnyArray, FloatArray
from hhsim.errors import InputError
from hhsim.hand.model import palm_arrays
from hhsim.kernels.by_reference import write_rows
from hhsim.kernels.contact.hand_pairs import hand_reach
from hhsim.kernels.hand.kinematics import BODY_COUNT, PALM_BODY, HandArrays
from hhsim.kernels.hand.pose import copy_configuration
from hhsim.kernels.machine_code import code_of
from hhsim.kernels.memory import copy_values
from hhsim.kernels.parts.surface import JointedSurface
from hhsim.kernels.qp.active_set import new_work
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED
from hhsim.kernels.tick.step import ACTIVE_CAPACITY
from hhsim.kernels.world.body import HINGE, OBJECT_DOF, SLIDER, Support
from hhsim.kernels.world.edges import EDGE_PAIRS, Edges
from hhsim.kernels.world.linearisation import write_other_pairs
from hhsim.kernels.world.meeting import SEEN, do_hands
from hhsim.kernels.world.pairs import World
from hhsim.kernels.world.record import BodiesRecord, ObjectRecord, WorldRecord
from hhsim.kernels.world.rows import SLACKS, friction_count
from hhsim.kernels.world.second_order import correct
from hhsim.kernels.world.state import MOST_BODIES, MOST_HANDS, world_dtype
from hhsim.kernels.world.tick import REBUILD, run_many, tick_world
from hhsim.reproducible import across, matmul, principal_axes
from hhsim.scene.body import Joint
from hhsim.solver.free_object import EngineBody, FreeObject, require_free
from hhsim.solver.options import UNLIMITED
from hhsim.solver.workspace import ThreadTeam, TickWorkspace, any_states, fresh_state, surface_code, tick_record, zeroed
from hhsim.trees.contact_surface import ContactSurface
from hhsim.trees.hierarchy import build_hierarchy

MOST_POINTS = 1024
"""Most corners or spheres by which a body meets another one: as many as a palm may have."""
FLAT = 1e-9
"""Faces that turn by less than this at an edge go on in one plane, or are a groove."""
BRANCHING = 8
NO_SUPPORT = Support(np.zeros((0, 3)), np.zeros(0))
NO_EDGES = Edges(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 2, 3)))
BELOW = 1e-6
"""Largest depth [m] of an object in the table at the start: rounding."""
STILL = 1.0, (0.0, 0.0, 0.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Stand-in mass [kg], centre [m] and inertia [kg·m²] of the first body where no body is free; it stays fixed."""
HEAVY = 1e6
"""Mass [kg] and moment of inertia [kg·m²] of a driven body: 100 N move it by 0.1 nm in a tick of 1 ms."""


def support_of(surface: ContactSurface) -> Support:
    """Return the points that can stand on a plane: the corners of the mesh's convex hull; spheres without a mesh."""
    arrays, mesh = surface.arrays, surface.mesh
    if mesh is not None:
        from scipy.spatial import ConvexHull, QhullError

        points = mesh.vertices[np.unique(mesh.faces)]
        # All of its vertices where it is flat.
        with suppress(QhullError):
            points = points[np.sort(ConvexHull(points).vertices)]
    elif isinstance(arrays, TreeArrays):
        leaves = arrays.child_count == 0
        points = np.stack([arrays.x[leaves], arrays.y[leaves], arrays.z[leaves]], axis=1)
        return Support(points, np.array(arrays.radius[leaves]))
    else:
        points = arrays.vertex
    return Support(np.ascontiguousarray(points), np.zeros(len(points)))


def _as_palm(hand: HandArrays, surface: Any, center: FloatArray) -> HandArrays:
    """Return a body as a palm about its centre: its leaf spheres, or the corners of its mesh."""
    points, radius = support_of(ContactSurface(surface))
    if len(points) > MOST_POINTS:
        expected = f"expected up to {MOST_POINTS:,}, of a tree of a lower level, or the surface mesh"
        raise InputError(f"a body beside others has {len(points):,} corners or spheres; {expected}")
    level = next(level for level in count(1) if BRANCHING**level >= len(points))
    return hand._replace(**palm_arrays(build_hierarchy(points - center, radius, level, BRANCHING), hand.length))


def _edges_of(surface: Any, center: FloatArray) -> Edges:
    """Return the convex edges of a mesh between two faces; none of spheres."""
    if isinstance(surface, TreeArrays):
        return NO_EDGES
    first = surface.wing_start[:-1]
    whole = np.flatnonzero(np.diff(surface.wing_start) == 2)
    one, two = first[whole], first[whole] + 1
    normal = np.stack([surface.face[surface.wing_face[which], :3] for which in (one, two)], axis=1)
    convex = (surface.wing[one] * normal[:, 1]).sum(axis=1) < -FLAT
    edge = surface.edge[whole[convex]]
    parts = edge[:, :3] - center, edge[:, 3:6], edge[:, 6], normal[convex]
    return Edges(*(np.ascontiguousarray(part) for part in parts))


def _about(axis: FloatArray) -> FloatArray:
    """Return two directions across a unit axis and the axis, as right-handed rows (3, 3)."""
    return np.vstack([across(axis), axis])


class WorldEngine:
    """Runs the ticks of one or two hands and of bodies, all in one program.

    `ticks` is the record of the first body in the last ticks; `all_ticks` that of all bodies, None if there is but one.
    With None for `free` no body moves: the states of the pairs are then those of the hands' workspaces.
    """

    def __init__(
        self,
        workspace: TickWorkspace,
        free: FreeObject | None,
        second: TickWorkspace | None = None,
        others: Sequence[EngineBody] = (),
    ) -> None:
        if free is not None:
            require_free(workspace.options)
        self.workspace = workspace
        first = ContactSurface(workspace.surface, (), workspace.mesh, workspace.tree)
        still = EngineBody(first, FreeObject(*STILL, friction=0.0), fixed=True)
        self.bodies = (still if free is None else EngineBody(first, free, name=free.name), *others)
        self.hands = (workspace,) if second is None else (workspace, second)
        surfaces = [body.surface.arrays for body in self.bodies]
        for hand in self.hands:
            hand.beside = tuple(surfaces[1:])
        hands, bodies = len(self.hands), len(self.bodies)
        if bodies > MOST_BODIES:
            raise InputError(f"{bodies} bodies; expected up to {MOST_BODIES}")
        pairs, self._world = self._find_pairs(), zeroed(world_dtype())
        self.world = world = self._world[0]
        problem, friction = world.problem, world.friction
        self.qp = new_work(len(problem.delta), len(problem.rhs))
        springs, modelled = workspace.options.stiffness.diagonal(), workspace.options.modelled()
        self._own: Any = None
        if free is not None or second is not None:
            self._own = any_states(fresh_state(workspace.state_dtype, springs, modelled, pairs + 1))
        supports = [support_of(body.surface) if body.moves_freely else NO_SUPPORT for body in self.bodies]
        movers, edges = [hand.hand for hand in self.hands], [NO_EDGES]
        if others:
            placed = list(zip(surfaces, map(self._center, self.bodies)))
            movers += [_as_palm(workspace.hand, *given) for given in placed]
            edges = [_edges_of(*given) for given in placed]
        codes = [hand.code for hand in self.hands]
        if free is None:
            for h, hand in enumerate(self.hands):
                hand.states = self.states[h : h + 2]
        else:
            made = [surface_code(arrays, workspace.hand, workspace.state_dtype) for arrays in surfaces[1:]]
            codes, self._written = [codes[0], *(code for _, code in made)], [written for written, _ in made]
        self._made_of = (
            filled(supports, MOST_BODIES),
            zeroed(EDGE_PAIRS, pairs),
            filled(movers, MOST_HANDS + MOST_BODIES),
            filled(codes, MOST_BODIES),
            filled(edges, MOST_BODIES),
        )
        self.thread_team = ThreadTeam(workspace.options.threads if second is None else 1, self.qp)
        self.ticks = object_record(0)
        self.all_ticks: BodiesRecord | None = None
        self._called: Any = None
        self._ticks = 0
        self._name_pairs()
        if free is None:
            problem.surface[:hands] = range(hands)
        problem.hands, problem.bodies, friction.room = hands, bodies, friction_count(bodies)
        problem.slacks = 0
        self._name_columns()
        self.world.seen, self.world.within = SEEN, workspace.options.margin
        if free is None:
            self.world.seen = workspace.options.margin
        self.world.meeting.reach[:hands] = [hand_reach(hand.hand) for hand in self.hands]
        problem.inverse_root[:] = self.states[0].problem.inverse_root
        for k, (body, support, record) in enumerate(zip(self.bodies, supports, self.world.bodies)):
            self._place(body, support, record)
            bearer = self._bearer(body)
            if bearer is not None:
                record.pair = self._pairs.index((0, k, bearer))
                self._join_pair(body.free.joint, body.free, record)
                problem.slacks = SLACKS if record.joint_friction > 0.0 else problem.slacks
            elif body.free.joint is not None and not body.fixed:
                self._join(body.free, body.free.joint, record)
            # As if the tick before had ended with these velocities: by them it is foreseen what slips.
            column = problem.column[k]
            step = record.period * np.concatenate([record.velocity, record.spin])
            self.world.safe_total[column : column + 6] = step

    @cached_property
    def method(self) -> World:
        """Arguments of the ticks, with the machine code of what the scene has: it is compiled or loaded if need be."""
        workspace, world, states, options = self.workspace, self.world, self.states, self.workspace.tick_options
        if workspace.options.self_contact or self.bodies[0].fixed:
            correcting = code_of(correct, options, states, world, self.qp)
            options = options._replace(own=options.own._replace(correcting=correcting))
        supports, edge_pairs, movers, codes, edges = self._made_of
        method = World(options, supports, states, self._world, edge_pairs, movers, codes, edges)
        code: dict[str, Any] = {}
        if not self.bodies[0].fixed:
            from hhsim.kernels.world.bodies import do_bodies, solve_with_bodies
            from hhsim.kernels.world.record import record_bodies

            code["bodies"] = code_of(do_bodies, method, 0, 0.0)
            code["solving"] = code_of(solve_with_bodies, method, states[0], False, self.qp)
            code["recording"] = code_of(record_bodies, whole_record(1, 0), world, 0)
        if len(self._pairs) > 1:
            code["pairs"] = code_of(write_other_pairs, method, states[0])
        if len(self.hands) > 1:
            code["hands"] = code_of(do_hands, method, 0, 0.0)
        elif self.bodies[0].fixed and workspace.options.method == "progressive":
            from hhsim.kernels.world.progressive import solve_progressive

            code["solving"] = code_of(solve_progressive, method, states[0], False, self.qp)
        elif workspace.options.qp != "active-set":
            from hhsim.solver.qp import backend_code

            code["solving"], self._called = backend_code(method, workspace.options.qp)
        if self.parts_move and len(self.hands) == 1:
            from hhsim.kernels.parts.tick import give_way

            parts = workspace.surface.motion
            self._parts = write_rows([parts])
            code["giving"] = code_of(give_way, parts, method, self.qp)
            code["given"] = self._parts.ctypes.data
        return method._replace(**code)

    @property
    def states(self) -> Any:
        """States of the pairs, of `any_states`; of a hand beside what stands still those of its workspace."""
        return self.workspace.states if self._own is None else self._own

    @property
    def parts_move(self) -> bool:
        """True for a surface of parts that move as they were recorded."""
        return isinstance(self.workspace.surface, JointedSurface)

    def _name_columns(self) -> None:
        """Give each palm and each body that moves its columns; a fixed body has those behind all others."""
        problem = self.world.problem
        palms = [problem.palm[h : h + 1] for h in range(len(self.hands))]
        moving = [problem.column[k : k + 1] for k, body in enumerate(self.bodies) if not body.fixed]
        problem.column[:] = len(problem.delta) - OBJECT_DOF
        begins_moving = not self.bodies[0].fixed
        order = [palms[0], *moving[:begins_moving], *palms[1:], *moving[begins_moving:]]
        for number, column in enumerate(order):
            column[0] = 6 * number
        problem.width = 6 * len(order)

    def _find_pairs(self) -> int:
        """Find the pairs, the hands and the first body first; return how many."""
        hands, bodies = range(len(self.hands)), range(len(self.bodies))
        self._pairs = [(h, -1, 0) for h in hands] + [(h, -1, k) for h in hands for k in bodies[1:]]
        for other, one in enumerate(self.bodies):
            bearer = self._bearer(one)
            self._pairs += [(0, other, k) for k in bodies if k == bearer or self._may_meet(one, self.bodies[k])]
        return len(self._pairs)

    def _name_pairs(self) -> None:
        """Write to the program which hand, bodies and surface each pair has."""
        problem, count = self.world.problem, len(self._pairs)
        problem.hand[:count], problem.other[:count], problem.body[:count] = np.array(self._pairs).T
        problem.surface[:count], problem.pairs = problem.body[:count], count
        for state, (_, other, body) in zip(self.states, self._pairs):
            if other >= 0:
                state.modelled[:] = False
                state.modelled[PALM_BODY] = self._may_meet(self.bodies[other], self.bodies[body])

    @staticmethod
    def _may_meet(one: EngineBody, two: EngineBody) -> bool:
        """Return True if one of two bodies moves freely, and no joint bears one on the other, through which it goes."""
        if one is two:
            return False
        bears = ((a.free.joint.on if a.free.joint else "", b.name) for a, b in ((one, two), (two, one)))
        joined = any(on != "" and on == name for on, name in bears)
        return not joined and (one.moves_freely or two.moves_freely)

    def _bearer(self, body: EngineBody) -> int | None:
        """Return the number of the free body that bears a body's joint; None for a fixed one, or the world."""
        on = body.free.joint.on if body.free.joint and not body.fixed else ""
        return next((k for k, one in enumerate(self.bodies) if on and one.name == on and not one.fixed), None)

    def _driven(self, ticks: int) -> FloatArray:
        """Return position [m] and orientation of each body's centre in the next ticks, (K, B, 7), 0 unless driven."""
        poses = np.zeros((len(self.bodies), ticks, 7))
        for pose, body in zip(poses, self.bodies):
            if body.motion is not None:
                motion = body.motion.at(np.minimum(self._ticks + np.arange(ticks), len(body.motion.turn) - 1))
                pose[:, :3], pose[:, 3:] = motion.points(np.tile(self._center(body), (ticks, 1))), motion.turn
        self._ticks += ticks
        return poses

    def _center(self, body: EngineBody) -> FloatArray:
        """Return the point about which a body turns [m], world at the start, shape (3,)."""
        return body.free.pivot if self._bearer(body) is None else np.array(body.free.center)

    def _place(self, body: EngineBody, support: Support, record: Any) -> None:
        free, period, offset = body.free, self.workspace.options.period, self.workspace.options.offset
        # Right-handed, or the gyroscopic term would have the other sign.
        moment, axes = principal_axes(free.inertia)
        record.is_free, record.is_driven = not body.fixed, body.motion is not None
        record.period = period
        record.center[:] = record.position[:] = self._center(body)
        record.axes[:] = axes.T
        record.moment[:] = moment
        # Damping at the end of the step weighs as mass: forces balance as they would without it.
        damped = 0.0 if body.fixed else period / np.sqrt(1.0 + free.damping * period)
        record.inverse_root[:3] = damped / np.sqrt(free.mass)
        record.inverse_root[3:] = damped / np.sqrt(moment)
        record.gravity[:] = free.gravity
        record.damping = free.damping
        record.friction, record.torsion = free.friction, free.torsion
        if body.motion is not None:
            record.inverse_root[:] = period / np.sqrt(HEAVY)
        record.has_table = free.table is not None and body.moves_freely
        record.table = 0.0 if free.table is None else free.table
        record.table_friction = free.of_table
        record.orientation[0] = 1.0
        record.rotation[:] = np.eye(3)
        record.velocity[:] = free.velocity
        record.spin[:] = matmul(axes.T, free.angular_velocity)
        if not record.has_table:
            return
        lowest = float((support.point[:, 2] - support.radius).min()) - record.table
        if lowest < -BELOW:
            depth, height = f"{-1e3 * lowest:.3g} mm below", f"z = {1e3 * (lowest + record.table):.6g} mm or lower"
            raise InputError(f"the object begins {depth} the table: put the table at {height}")
        record.position[2] += max(0.0, offset - lowest)

    @staticmethod
    def _join(free: FreeObject, joint: Joint, body: Any) -> None:
        """Restrict a body to the motion about or along the axis of its joint."""
        axis = joint.direction
        body.axes[:] = _about(axis)
        body.limits[:] = joint.limits or (-np.inf, np.inf)
        body.joint_friction = joint.friction
        if joint.type == "slider":
            body.joint = SLIDER
            body.inverse_root[3:] = body.spin[:] = 0.0
            for vector in (body.gravity, body.velocity):
                vector[:] = (axis * vector).sum() * axis
            return
        body.joint = HINGE
        body.lever[:] = free.center - free.pivot
        moment = (axis * matmul(np.array(free.inertia), axis)).sum() + free.mass * (body.lever**2).sum()
        body.moment[:] = moment
        body.inverse_root[:] = 0.0
        body.inverse_root[5] = body.period / np.sqrt((1.0 + free.damping * body.period) * moment)
        body.pull[:] = free.mass / moment * np.cross(free.gravity, axis)
        body.gravity[:] = body.velocity[:] = 0.0
        body.spin[:] = matmul(body.axes, free.angular_velocity) * (0.0, 0.0, 1.0)

    @staticmethod
    def _join_pair(joint: Any, free: FreeObject, body: Any) -> None:
        """Let a body and the free one that bears it move against each other about or along the axis alone."""
        body.pair_joint = HINGE if joint.type == "hinge" else SLIDER
        body.joint_origin[:] = joint.origin if joint.type == "hinge" else free.center
        body.joint_axes[:] = _about(joint.direction)
        body.limits[:] = joint.limits or (-np.inf, np.inf)
        body.joint_friction = joint.friction

    def begin(self) -> None:
        """See `Engine.begin`; the graphic hand stands in the workspace as the object sees it."""
        world = self.world
        places = zip(self.states, self.hands, world.palm_position, world.palm_orientation)
        for state, hand, position, orientation in places:
            plain = hand.states[0]
            for name in HapticBlock._fields:
                state.pose[name][:] = plain.pose[name]
                state.haptic[name][:] = plain.haptic[name]
            copy_values(np.array(plain.haptic.position), position)
            copy_values(np.array(plain.haptic.orientation), orientation)
        workspace = self.workspace
        for body in world.bodies:
            quaternion_to_matrix(np.array(body.orientation), body.rotation)
        if not self._fits():
            raise workspace.full()
        problem = world.problem
        for state, body, other in zip(self.states, problem.body, problem.other):
            depth = -float(state.candidates.nearest[PALM_BODY])
            if other >= 0 and depth > 0.0:
                one, two = (self.bodies[k].name or "the first body" for k in (other, body))
                raise InputError(f"{one} begins {1e3 * depth:.3g} mm inside {two}; expected bodies beside each other")

    @cached_property
    def code(self) -> Any:
        """Machine code of a tick of all, see `kernels.machine_code`."""
        return code_of(tick_world, self.method, self.states, self.qp, 0)

    def _fits(self) -> bool:
        """Take all as it stands; return whether what is near fits into the arrays."""
        return bool(tick_world(self.method, self.states, self.qp, REBUILD) == 0)

    def approach(self, linearisations: int) -> None:
        """Bring the hands from free places as near to the user's as so many linearisations of one tick can.

        It is beside bodies that stand still and do not rub. Raises HhsimError where more pairs were near than fit.
        """
        world = self.world
        bodies, problem, total = world.bodies, world.problem, world.safe_total.copy()
        kept, slacks = bodies.copy(), int(problem.slacks)
        for name in ("is_free", "is_driven", "inverse_root", "joint", "pair_joint", "has_table", "friction", "torsion"):
            bodies[name] = 0
        problem.slacks = 0
        self.begin()
        goals = [hand.states[0].haptic for hand in self.hands]
        haptic = [HapticBlock(*(np.array(goal[name])[None] for name in HapticBlock._fields)) for goal in goals]
        records = [tick_record(1) for _ in self.hands]
        options = self.method.options._replace(linearisations=linearisations, budget=UNLIMITED, snap_step=np.inf)
        method = self.method._replace(options=options, giving=0)
        self._run(method, haptic, records, np.zeros((len(self.bodies), 1, 7)))
        if records[0].status[0] & STATUS_CAPACITY_EXCEEDED:
            raise self.workspace.full()
        for state, hand in zip(self.states, self.hands):
            copy_configuration(state.pose, hand.states[0].pose)
        bodies[:], problem.slacks, world.safe_total[:] = kept, slacks, total
        self.begin()

    def run(self, haptic: HapticBlock, record: TickRecord) -> int:
        """See `Engine.run`."""
        return self.run_many((haptic,), (record,))

    def run_many(self, haptic: tuple[HapticBlock, ...], record: tuple[TickRecord, ...]) -> int:
        """Run the ticks of all hands and bodies, whose program is one; return those done."""
        done, own = self._run(self.method, haptic, record, self._driven(len(haptic[0].position)))
        if not self.bodies[0].fixed:
            self.ticks, self.all_ticks = seen_ticks(own)
        return done

    def _run(
        self, method: World, haptic: Sequence[HapticBlock], record: Sequence[TickRecord], driven: FloatArray
    ) -> tuple[int, WorldRecord]:
        """Run ticks by a method; return those done, and the record of the bodies."""
        count = len(haptic[0].position)
        moves = not self.bodies[0].fixed
        own = whole_record(len(self.bodies), count if moves else 0)
        given, written = HapticBlock(*map(_of_all, zip(*haptic))), TickRecord(*map(_of_all, zip(*record)))
        if self.thread_team.works:
            # Compiled before there are helpers, which would look on, each on a processor of its own.
            none = HapticBlock(*(values[:, :0] for values in given))
            run_many(method, self.states, self.qp, none, written, own, driven, self.code)
        with self.thread_team.at_work(method):
            done = int(run_many(method, self.states, self.qp, given, written, own, driven, self.code))
        if self._called is not None and self._called[1]:
            raise self._called[1].pop()
        if len(record) > 1:
            for h, of_hand in enumerate(record):
                for values, found in zip(of_hand, written):
                    values[...] = found[h]
        return done, own

    def seen_by(self, hand: int) -> ObjectRecord:
        """Return the record of the object as that of the first or the second hand: its own bodies come first."""
        body = self.ticks.body
        return self.ticks if hand == 0 else self.ticks._replace(body=np.where(body < 0, body, body ^ BODY_COUNT))

    def call(
        self, haptic: HapticBlock, record: TickRecord, bodies: WorldRecord, compiled: bool = True
    ) -> tuple[Any, tuple[Any, ...]]:
        """Return the kernel of ticks beside which nothing is driven, None where Python solves, and its arguments."""
        still, code = np.zeros((len(self.bodies), len(haptic.position[0]), 7)), self.code if compiled else 0
        arguments = self.method, self.states, self.qp, haptic, record, bodies, still, code
        return run_many if compiled else None, arguments


def filled(values: Sequence[Any], count: int) -> tuple[Any, ...]:
    """Pad values to a length with the last one: a tuple's length is part of the type that is compiled for."""
    return (*values, *(values[-1] for _ in range(len(values), count)))


def _of_all(values: Sequence[AnyArray]) -> AnyArray:
    """Return arrays of hands in one with the hand first; that of one hand shares its memory."""
    return values[0][None] if len(values) == 1 else np.stack(values)


def whole_record(bodies: int, ticks: int) -> WorldRecord:
    """Allocate the record of all bodies in a block of ticks."""
    record = world_record(bodies, ticks)
    # As many rows as there are in all: those of a tick may follow on those of the ticks before it.
    rows = len(record.body)
    return WorldRecord(record, np.zeros(rows, np.int64), np.zeros((rows, 3)), np.zeros((bodies, ticks, 6)))


def world_record(bodies: int, ticks: int) -> ObjectRecord:
    """Return the record of bodies in a block of ticks, with the body first where it is of motion or wrenches."""
    first, moved = object_record(ticks), ObjectRecord._fields.index("contact")
    moving = (np.zeros((bodies, *values.shape)) for values in first[:moved])
    return ObjectRecord._make([*moving, *first[moved:]])


def object_record(ticks: int) -> ObjectRecord:
    """Allocate the record of the object in a block of ticks."""
    zeros, rows = np.zeros, ticks * ACTIVE_CAPACITY
    return ObjectRecord(
        turn=zeros((ticks, 4)),
        shift=zeros((ticks, 3)),
        velocity=zeros((ticks, 3)),
        angular_velocity=zeros((ticks, 3)),
        hand_wrench=zeros((ticks, 6)),
        table_wrench=zeros((ticks, 6)),
        table_distance=zeros(ticks),
        friction_residual=zeros(ticks),
        contact=zeros(ticks + 1, np.int64),
        body=zeros(rows, np.int64),
        point=zeros((rows, 3)),
        normal=zeros((rows, 3)),
        normal_force=zeros(rows),
        friction_force=zeros((rows, 3)),
        torsional_moment=zeros(rows),
        slip=zeros(rows),
    )


def seen_ticks(record: WorldRecord) -> tuple[ObjectRecord, BodiesRecord | None]:
    """Return the record of the first body, and of all if there are several."""
    every = of_each(record)
    return (of_first(every), every) if len(every.bodies) > 1 else (every.bodies[0], None)


def of_each(record: WorldRecord) -> BodiesRecord:
    """Return the record of each body, as views."""
    moved = ObjectRecord._fields.index("contact")
    own, shared = record.bodies[:moved], record.bodies[moved:]
    return BodiesRecord(tuple(ObjectRecord(*rows, *shared) for rows in zip(*own)), *record[1:])


def of_first(record: BodiesRecord) -> ObjectRecord:
    """Return the record of the first body with its own contacts; other bodies count as the table does.

    Where it meets another body `body` is -2 less that one's number, and normal and forces are on the first body.
    """
    first = record.bodies[0]
    count = int(first.contact[-1])
    other = -2 - first.body[:count]
    on_first, by_first = record.contact_body[:count] == 0, other == 0
    chosen = np.flatnonzero(on_first | by_first)
    # Where another body touches the first one, what is stated is on the other.
    sign = np.where(on_first & (other >= 0), -1.0, 1.0)[chosen, None]
    tick = np.repeat(np.arange(len(first.turn)), np.diff(first.contact))[chosen]
    body = np.where(by_first, -2 - record.contact_body[:count], first.body[:count])[chosen]
    rows = {name: getattr(first, name)[chosen] for name in ("normal_force", "torsional_moment", "slip")}
    point = np.where(by_first[:, None], record.other_point[:count], first.point[:count])[chosen]
    return first._replace(
        **rows,
        point=point,
        body=body,
        normal=sign * first.normal[chosen],
        friction_force=sign * first.friction_force[chosen],
        contact=np.searchsorted(tick, np.arange(len(first.turn) + 1)),
        table_wrench=first.table_wrench + record.body_wrench[0],
    )
