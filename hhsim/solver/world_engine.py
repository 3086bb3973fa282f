"""Engine of `coupled` and `progressive`: hands and bodies in one program, with friction and a table."""

from collections.abc import Sequence
from contextlib import ExitStack
from functools import cached_property
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.self_pairs import cross_pairs, self_pairs
from hhsim.kernels.by_reference import write_rows
from hhsim.kernels.contact.hand_pairs import NO_PAIRS, HandPairs, PairsCode, add_bends, do_pairs
from hhsim.kernels.hand.kinematics import DOF, PALM_BODY
from hhsim.kernels.hand.pose import copy_configuration
from hhsim.kernels.machine_code import code_of
from hhsim.kernels.memory import copy_values
from hhsim.kernels.qp.active_set import new_work
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED
from hhsim.kernels.tick.step import ACTIVE_CAPACITY
from hhsim.kernels.world.body import OBJECT_DOF
from hhsim.kernels.world.edges import EDGE_PAIRS
from hhsim.kernels.world.linearisation import write_other_pairs
from hhsim.kernels.world.pairs import World
from hhsim.kernels.world.record import WorldRecord
from hhsim.kernels.world.rows import SLACKS, friction_count
from hhsim.kernels.world.second_order import correct
from hhsim.kernels.world.state import MOST_BODIES, MOST_HANDS, world_dtype
from hhsim.kernels.world.tick import REBUILD, run_many, tick_world
from hhsim.result.schema import body_fields
from hhsim.scene.body import Body, Driven, Fixed, HalfSpace
from hhsim.scene.kernel_bodies import bearer_of, body_shapes, may_meet, write_body, write_joint
from hhsim.solver.options import FREE, UNLIMITED, require_options
from hhsim.solver.workspace import (
    ThreadTeam,
    TickWorkspace,
    any_states,
    fresh_state,
    of_hands,
    surface_code,
    tick_record,
    zeroed,
)
from hhsim.trees.contact_surface import contact_surface

START_LINEARISATIONS = 4000
"""Most linearisations of the approach from a free place to the object, where the haptic hand starts inside it."""


class WorldEngine:
    """Runs the ticks of one or two hands and of bodies, all in one program.

    The surface of the hands is that of the first body, which is free; further ones are beside it, and the plane.
    Without bodies none moves: the states of the pairs are then those of the hands' workspaces.
    """

    alone: "tuple[WorldEngine, ...]" = ()
    """Engine of each hand by itself, where it has one."""

    def __init__(self, *hands: TickWorkspace, bodies: Sequence[Body | HalfSpace] = ()) -> None:
        self.hands, self.workspace = hands, hands[0]
        workspace, options = self.workspace, self.workspace.options
        if bodies:
            require_options(options, FREE)
        self.bodies = tuple(body for body in bodies if isinstance(body, Body))
        # Of the body that bears a body's joint, and the point about which that turns [m], world at the start.
        self._bearers = [bearer_of(body, self.bodies) for body in self.bodies]
        borne_by = zip(self.bodies, self._bearers)
        self._centers = [body.pivot if on is None else np.array(body.solid.center) for body, on in borne_by]
        made = [contact_surface(options.surface, body.placed_mesh, body.placed_tree) for body in self.bodies[1:]]
        surfaces = [workspace.touched, *made]
        count = len(surfaces)
        if count > MOST_BODIES:
            raise InputError(f"{count} bodies; expected up to {MOST_BODIES}")
        pairs, self._world = self._find_pairs(), zeroed(world_dtype())
        self.world = world = self._world[0]
        problem, rows = world.problem, world.hand_pairs
        self.qp = new_work(len(problem.delta), len(problem.rhs))
        springs, modelled = options.stiffness.diagonal(), options.modelled()
        # Of the pairs, as `any_states`.
        self.states = workspace.states
        if bodies or len(hands) > 1:
            self.states = any_states(fresh_state(workspace.state_dtype, springs, modelled, pairs + 1))
        for h, hand in enumerate(hands):
            hand.beside = tuple(surface.arrays for surface in made)
            if not bodies:
                hand.states = self.states[h : h + 2]
        coded = [surface_code(of.arrays, workspace.hand, workspace.state_dtype) for of in made]
        codes = [*(hand.code for hand in (hands[:1] if bodies else hands)), *(code for _, code in coded)]
        self._written = [written for written, _ in coded]
        supports, palms, edges = body_shapes(workspace.hand, self.bodies, surfaces, self._centers)
        self._still = World(
            workspace.tick_options,
            filled(supports, MOST_BODIES),
            self.states,
            self._world,
            zeroed(EDGE_PAIRS, pairs),
            filled([hand.hand for hand in hands] + palms, MOST_HANDS + MOST_BODIES),
            filled(codes, MOST_BODIES),
            filled(edges, MOST_BODIES),
        )
        self.thread_team = ThreadTeam(options.threads if len(hands) == 1 else 1, self.qp)
        self._called: Any = None
        self._entry: Any = None
        self._ticks = 0
        problem.hands, problem.bodies, world.friction.room = len(hands), count, friction_count(count)
        problem.slacks = 0
        self._name_pairs()
        self._name_columns()
        rows.bound[:] = rows.floor[:] = -np.inf
        rows.within[:] = np.inf, options.margin
        problem.inverse_root[:] = self.states[0].problem.inverse_root
        for record in world.bodies[:count]:
            record.period, record.orientation[0], record.moment[:] = options.period, 1.0, 1.0
            record.axes[:] = record.rotation[:] = np.eye(3)
        plane = next((body for body in bodies if isinstance(body, HalfSpace)), None)
        for k, (body, support, record) in enumerate(zip(self.bodies, supports, world.bodies)):
            write_body(record, body, self._centers[k], support, plane, options.offset)
            if (joint := body.free_joint) is not None:
                on = self._bearers[k]
                write_joint(record, body, joint, None if on is None else self._pairs.index((0, k, on)))
                if on is not None and joint.friction > 0.0:
                    problem.slacks = SLACKS
            # As if the tick before had ended with these velocities: by them it is foreseen what slips.
            column = problem.column[k]
            step = record.period * np.concatenate([record.velocity, record.spin])
            world.safe_total[column : column + 6] = step

    @cached_property
    def method(self) -> World:
        """Arguments of the ticks, with the machine code of what the scene has: it is compiled or loaded if need be."""
        workspace, world, states, options = self.workspace, self.world, self.states, self.workspace.tick_options
        pairs, pairs_code, bending, vector = self.hand_pairs, NO_PAIRS, 0, np.zeros(DOF)
        if len(pairs.part):
            self._pairs_row = write_rows([pairs])
            if workspace.options.self_contact:
                bending = code_of(add_bends, pairs, 0, 0, states[0].step.row, *[vector] * 4)
            pairs_code = PairsCode(self._pairs_row.ctypes.data, code_of(do_pairs, pairs, 0, 0.0, 0.0), bending)
        options = options._replace(pairs=pairs_code)
        if workspace.options.self_contact or not self.bodies:
            options = options._replace(correcting=code_of(correct, options, states, world, self.qp))
        method = self._still._replace(options=options)
        code: dict[str, Any] = {}
        if self.bodies:
            from hhsim.kernels.world.bodies import do_bodies
            from hhsim.kernels.world.program import solve_free
            from hhsim.kernels.world.record import record_bodies

            code["bodies"] = code_of(do_bodies, method, 0, 0.0)
            code["solver"] = code_of(solve_free, method, states[0], False, self.qp)
            code["recorder"] = code_of(record_bodies, whole_record(1, 0), world, 0)
        if len(self._pairs) > 1:
            code["pairs"] = code_of(write_other_pairs, method, states[0])
        if len(self.hands) == 1 and not self.bodies and workspace.options.method == "progressive":
            from hhsim.kernels.world.progressive import solve_progressive

            code["solver"] = code_of(solve_progressive, method, states[0], False, self.qp)
        elif workspace.options.qp != "active-set":
            from hhsim.solver.qp import backend_code

            code["solver"], self._called = backend_code(method, workspace.options.qp)
        if workspace.parts_move and len(self.hands) == 1:
            from hhsim.kernels.parts.tick import give_way

            parts = workspace.surface.motion
            self._parts = write_rows([parts])
            code["parts_tick"] = code_of(give_way, parts, method, self.qp)
            code["parts"] = self._parts.ctypes.data
        return method._replace(**code)

    @cached_property
    def hand_pairs(self) -> HandPairs:
        """Pairs of the hands' parts that may meet."""
        options, several = self.workspace.options, [cross_pairs()] if len(self.hands) > 1 else []
        for h, space in enumerate(self.hands if options.self_contact else ()):
            own = self_pairs(space.model, options.fingers)
            several.append(own._replace(hand=own.hand + h))
        none = np.zeros((0, 2), np.int64)
        hand, part = (np.concatenate([none, *(pairs[k] for pairs in several)]) for k in range(2))
        first, second = self.hands[0].hand, self.hands[-1].hand
        return HandPairs(hand, part, len(self.hands), first, second, self.states, self._world["hand_pairs"])

    def _name_columns(self) -> None:
        """Give each palm and each body that moves its columns; a fixed body has those behind all others."""
        problem = self.world.problem
        palms = [problem.palm[h : h + 1] for h in range(len(self.hands))]
        moving = [problem.column[k : k + 1] for k, body in enumerate(self.bodies) if body.motion != Fixed()]
        problem.column[:] = len(problem.delta) - OBJECT_DOF
        order = [palms[0], *moving[:1], *palms[1:], *moving[1:]]
        for number, column in enumerate(order):
            column[0] = 6 * number
        problem.width = 6 * len(order)

    def _find_pairs(self) -> int:
        """Find the pairs, the hands and the first body first; return how many."""
        hands, bodies = range(len(self.hands)), range(len(self.bodies))
        self._pairs = [(h, -1, 0) for h in hands] + [(h, -1, k) for h in hands for k in bodies[1:]]
        for other, one in enumerate(self.bodies):
            on = self._bearers[other]
            self._pairs += [(0, other, k) for k in bodies if k == on or may_meet(one, self.bodies[k])]
        return len(self._pairs)

    def _name_pairs(self) -> None:
        """Write to the program which hand, bodies and surface each pair has."""
        problem, count = self.world.problem, len(self._pairs)
        problem.hand[:count], problem.other[:count], problem.body[:count] = np.array(self._pairs).T
        problem.surface[:count], problem.pairs = problem.body[:count] if self.bodies else problem.hand[:count], count
        for state, (_, other, body) in zip(self.states, self._pairs):
            if other >= 0:
                state.modelled[:] = False
                state.modelled[PALM_BODY] = may_meet(self.bodies[other], self.bodies[body])

    def _driven(self, ticks: int) -> FloatArray:
        """Return position [m] and orientation of each body's centre in the next ticks, (K, B, 7), 0 unless driven."""
        poses = np.zeros((max(1, len(self.bodies)), ticks, 7))
        for pose, body, center in zip(poses, self.bodies, self._centers):
            if isinstance(body.motion, Driven):
                rows = np.minimum(self._ticks + np.arange(ticks), len(body.motion.poses.position) - 1)
                motion = body.motion.poses.since(body.position, body.orientation).at(rows)
                pose[:, :3], pose[:, 3:] = motion.points(np.tile(center, (ticks, 1))), motion.turn
        return poses

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
        for body in world.bodies:
            quaternion_to_matrix(np.array(body.orientation), body.rotation)
        if tick_world(self.method, self.qp, REBUILD) != 0:
            raise self.workspace.full()
        problem = world.problem
        for state, body, other in zip(self.states, problem.body, problem.other):
            depth = -float(state.candidates.nearest[PALM_BODY])
            if other >= 0 and depth > 0.0:
                inner, outer = (self.bodies[k].name for k in (other, body))
                where = f"{1e3 * depth:.3g} mm inside {outer}"
                raise InputError(f"{inner} begins {where}; expected bodies beside each other")

    @cached_property
    def code(self) -> Any:
        """Machine code of a tick of all, see `kernels.machine_code`."""
        return code_of(tick_world, self.method, self.qp, 0)

    def approach(self) -> None:
        """Bring the hands from free places as near to the user's as many linearisations of one tick can.

        It is beside bodies that stand still and do not rub. Raises HhsimError where more pairs were near than fit.
        """
        world = self.world
        bodies, problem, total = world.bodies, world.problem, world.safe_total.copy()
        kept, slacks = bodies.copy(), int(problem.slacks)
        for name in ("is_free", "is_driven", "inverse_root", "joint", "pair_joint", "has_table", "friction", "torsion"):
            bodies[name] = 0
        problem.slacks = 0
        self.begin()
        goals, record = [hand.states[0].haptic for hand in self.hands], tick_record(len(self.hands), 1)
        haptic = HapticBlock(*(np.stack([goal[name] for goal in goals])[:, None] for name in HapticBlock._fields))
        options = self.method.options._replace(linearisations=START_LINEARISATIONS, budget=UNLIMITED, snap_step=np.inf)
        method = self.method._replace(options=options, parts_tick=0)
        own = whole_record(len(self.bodies), 1)
        run_many(method, self.qp, haptic, record, own, self._driven(1), self.code)
        if record.status[0, 0] & STATUS_CAPACITY_EXCEEDED:
            raise self.workspace.full()
        for state, hand in zip(self.states, self.hands):
            copy_configuration(state.pose, hand.states[0].pose)
        bodies[:], problem.slacks, world.safe_total[:] = kept, slacks, total
        self.begin()

    def call(self, haptic: HapticBlock, record: TickRecord, bodies: WorldRecord) -> tuple[Any, tuple[Any, ...]]:
        """Return the kernel of the next ticks, and its arguments, which have these arrays."""
        driven = self._driven(haptic.position.shape[1])
        return run_many, (self.method, self.qp, haptic, record, bodies, driven, self.code)

    def run(self, haptic: HapticBlock, record: TickRecord, bodies: WorldRecord) -> int:
        """See `Engine.run`."""
        kernel, arguments = self.call(haptic, record, bodies)
        # Compiled before there are helpers, which would look on, each on a processor of its own; looked at once, since
        # the types of the arguments do not change.
        self._entry = self._entry or kernel.entry(*arguments)
        with ExitStack() as helped:
            for engine in (self, *self.alone):
                helped.enter_context(engine.thread_team.at_work(engine.method))
            done = int(self._entry(*arguments))
        self._ticks += haptic.position.shape[1]
        if self._called is not None and self._called[1]:
            raise self._called[1].pop()
        return done


class HandsApart(WorldEngine):
    """Runs the ticks of two hands by themselves, and again together where they might have met."""

    def __init__(self, *hands: TickWorkspace) -> None:
        super().__init__(*hands)
        self.alone = tuple(WorldEngine(hand) for hand in hands)

    def begin(self) -> None:
        """See `Engine.begin`."""
        for engine in self.alone:
            engine.begin()
        if self.world.is_near:
            super().begin()

    def call(self, haptic: HapticBlock, record: TickRecord, bodies: WorldRecord) -> tuple[Any, tuple[Any, ...]]:
        """See `WorldEngine.call`."""
        from hhsim.kernels.world.side_by_side import run_hands_apart

        alone = tuple(engine.method for engine in self.alone)
        given, written = (of_hands(haptic, 0), of_hands(haptic, 1)), (of_hands(record, 0), of_hands(record, 1))
        return run_hands_apart, (alone, self.method, given, written, self.workspace.parts_move, self.qp, self.code)


def filled(values: Sequence[Any], count: int) -> tuple[Any, ...]:
    """Pad values to a length with the last one: a tuple's length is part of the type that is compiled for."""
    return (*values, *(values[-1] for _ in range(len(values), count)))


def whole_record(bodies: int, ticks: int) -> WorldRecord:
    """Allocate the record of all bodies in a block of ticks; without bodies it has no ticks."""
    # As many rows as there are in all: those of a tick may follow on those of the ticks before it.
    ticks = ticks if bodies else 0
    fields = body_fields(max(1, bodies), ticks, ticks * ACTIVE_CAPACITY)
    return WorldRecord(**{name: np.zeros(shape, kind) for name, kind, shape in fields})
