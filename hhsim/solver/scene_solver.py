"""Solver of a scene: the seam between its bodies in the world, and the engines, each of which has its own frame.

With nothing free the frame of a hand's ticks goes along with the object of the motion; beside free bodies hands are
given in the world, and returned as the first free body sees them. `OneTick` is for loops that run ticks one by one.
"""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from hhsim.arrays import Records
from hhsim.hand.configuration import SHAPES, HandConfiguration
from hhsim.hand.self_pairs import cross_pairs
from hhsim.kernels.contact.hand_pairs import hands_distance
from hhsim.kernels.hand.pose import update_kinematics
from hhsim.kernels.jit import as_argument
from hhsim.kernels.tick.block import HapticBlock, TickRecord, run_block
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, STATUS_START_INSIDE
from hhsim.kernels.world.record import WorldRecord
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.moving_parts import MovingParts, placed_mesh
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.result.schema import bodies_row
from hhsim.scene.body import Body, Driven, HalfSpace
from hhsim.scene.declared_bodies import joined_tree
from hhsim.scene.overlap import raised
from hhsim.scene.scene import Scene
from hhsim.solver.hand_solver import START_LINEARISATIONS, HandSolver, WarmUp, distances_of, shift_until, warm_up
from hhsim.solver.method import find_method
from hhsim.solver.options import PARTS, SolverOptions, require_options
from hhsim.solver.workspace import TickWorkspace, tick_record, zeroed
from hhsim.solver.world_engine import WorldEngine, seen_ticks
from hhsim.trees.contact_surface import ContactSurface, contact_surface
from hhsim.trees.sphere_tree import SphereTree

STRAY = 1e-9
"""Distance [m], or change of a quaternion, by which a body that goes along with a frame strays from it by rounding."""


@dataclass(frozen=True, eq=False)
class EngineScene:
    """A scene in the frame of its engine, which is the world's at the first tick.

    Attributes:
        mesh: What a hand closes on at the first tick [m]: the first free body, or all where none is free.
        tree: Its sphere tree.
        place: Pose of the object's frame, or of that of the bodies' file, at the first tick, (3,) and (4,), world.
        carrier: That pose at each tick, which the engine's frame goes along with; None if the frame is the world's.
        haptic: Hands at the ticks, in the frame.
        free: The first free body.
        parts: Several bodies with their poses, which those of free ones become when ticks have run.
        others: Bodies beside a free one, and the plane.
    """

    mesh: Mesh
    tree: SphereTree
    place: ObjectMotion
    carrier: ObjectMotion | None
    haptic: tuple[HandConfiguration, ...]
    free: Body | None
    parts: MovingParts | None
    others: tuple[Body | HalfSpace, ...] = ()

    @property
    def beside(self) -> tuple[Body, ...]:
        """Bodies beside a free one."""
        return tuple(body for body in self.others if isinstance(body, Body))

    def surface(self, kind: str) -> ContactSurface:
        """Return what hands touch, but bodies beside a free one, as `spheres` or `mesh`."""
        if self.parts is not None and self.free is None:
            return self.parts.surface(kind)
        return contact_surface(kind, self.mesh, self.tree)


def engine_scene(scene: Scene) -> EngineScene:
    """Return a scene in its engine's frame: that of an object that moves as recorded, else the world's."""
    solids, first = list(scene.solids), scene.hands[0]
    hands = tuple(HandConfiguration.of(hand.ticks) for hand in scene.hands)
    moves = [body for body in solids if body.is_free]
    if moves:
        solids.sort(key=lambda body: body is not moves[0])
    body = solids[0]
    place = ObjectMotion(body.position, body.orientation)
    if len(solids) > 1:
        place = ObjectMotion(first.trajectory.object_position, first.trajectory.object_orientation)
    if moves:
        planes = [body for body in scene.bodies if isinstance(body, HalfSpace)]
        mesh, tree = replace(body.placed_mesh, name=scene.name), body.placed_tree
        parts = _free_parts(scene, solids) if len(solids) > 1 else None
        return EngineScene(mesh, tree, place, None, hands, body, parts, (*solids[1:], *planes))
    carrier = first.ticks.object_motion
    if len(solids) == 1:
        carrier = body.motion.poses if isinstance(body.motion, Driven) else None
    moved = None if carrier is None else carrier.since(*carrier.at(0))
    if len(solids) == 1:
        haptic = tuple(seen_hand(hand, moved) for hand in hands)
        mesh = replace(body.placed_mesh, name=scene.name)
        return EngineScene(mesh, body.placed_tree, place, carrier, haptic, None, None)
    motions = [_poses(solid, scene.ticks.tick_count) for solid in solids]
    driven = {solid.name: solid.motion.values for solid in solids if isinstance(solid.motion, Driven)}
    joints = {name: values for name, values in driven.items() if values is not None}
    carried = [motion for solid, motion in zip(solids, motions) if solid.name not in joints]
    if moved is not None and not all(_goes_along(motion, moved) for motion in carried):
        carrier = moved = None
    begin = [RigidMotion(solid.orientation[None], solid.position[None]) for solid in solids]
    names, meshes, trees = zip(*((solid.name, solid.mesh, solid.tree) for solid in solids))
    mesh = placed_mesh(meshes, begin, scene.name)
    tree = joined_tree(trees, begin, scene.name, mesh)
    poses = np.stack([np.concatenate(motion, axis=1) for motion in motions], axis=1)
    parts = MovingParts(scene.name, names, meshes, trees, poses, joints, moved)
    haptic = tuple(seen_hand(hand, moved) for hand in hands)
    return EngineScene(mesh, tree, place, carrier, haptic, None, parts)


def seen_hand(hand: HandConfiguration, moved: RigidMotion | None) -> HandConfiguration:
    """Return a hand, given in the world, as a frame that has moved sees it; None is the world's frame."""
    if moved is None:
        return hand
    places, turns = moved.seen_points(hand.position), moved.seen_orientations(hand.orientation)
    return hand._replace(position=places, orientation=turns)


def _poses(body: Body, count: int) -> ObjectMotion:
    if isinstance(body.motion, Driven):
        return body.motion.poses
    return ObjectMotion(np.tile(body.position, (count, 1)), np.tile(body.orientation, (count, 1)))


def _goes_along(poses: ObjectMotion, along: RigidMotion) -> bool:
    """Return True if a body stands still in a moving frame."""
    seen = along.seen_points(poses.position), along.seen_orientations(poses.orientation)
    return all(bool((np.abs(values - values[0]) < STRAY).all()) for values in seen)


def _free_parts(scene: Scene, solids: Sequence[Body]) -> MovingParts:
    """Return room for the poses of all bodies at the ticks, and the motion of the driven ones."""
    moved = ((solid, solid.motion.poses) for solid in solids if isinstance(solid.motion, Driven))
    driven = {solid.name: poses.since(solid.position, solid.orientation) for solid, poses in moved}
    meshes, trees = tuple(solid.placed_mesh for solid in solids), tuple(solid.placed_tree for solid in solids)
    names, room = tuple(solid.name for solid in solids), np.zeros((scene.ticks.tick_count, len(solids), 7))
    return MovingParts(scene.name, names, meshes, trees, room, {}, free=True, driven=driven)


def standing_apart(scene: Scene, surface: str) -> Scene:
    """Return a scene in which no free body begins in the spheres of another one, if these are the surface."""
    if surface != "spheres" or len(scene.solids) < 2:
        return scene
    solids = {body.name: body for body in raised(scene.solids)}
    return replace(scene, bodies=tuple(solids.get(body.name, body) for body in scene.bodies))


def keeps_hands_apart(options: SolverOptions) -> bool:
    """Return whether two hands of these options, on an object that is not free, keep out of each other."""
    return options.method in ("coupled", "progressive") and options.qp == "active-set"


class WorldSolver:
    """Keeps hands between ticks, and what moves freely with them.

    If a body is free, all hands and bodies share one program. Otherwise each hand is solved alone, and ticks in which
    two hands might have met are solved again together. Methods that promise no distance to the object,
    and other QP solvers, keep no two hands apart.

    Args:
        hands: Solver of one hand, which has all that is free; or of the right and the left one, at one surface where it
            is at first and with the same options: each places its hand at the start.
        free: A free body beside two hands, whose surface is that of the hands.
        others: Further bodies beside it, and the plane.

    Raises:
        InputError: Options that a free object does not go with.
    """

    def __init__(
        self, hands: Sequence[HandSolver], free: Body | None = None, others: Sequence[Body | HalfSpace] = ()
    ) -> None:
        self.hands = tuple(hands)
        self._spaces = tuple(hand.workspace for hand in hands)
        self._has_free = free is not None
        self.engine = hands[0].free
        self._pair: WorldEngine | None = None
        if len(self.hands) > 1 and (free is not None or keeps_hands_apart(hands[0].options)):
            self._pair = self.engine = WorldEngine(self._spaces[0], free, self._spaces[1], others)
        self._started = self._pair is None

    def run(self, *haptic: HandConfiguration) -> tuple[TickRecord, ...]:
        """Run one tick for each haptic configuration of the hands; arguments and errors as of `HandSolver.run`.

        With a free object they are in the world, and the ticks are returned as seen from it: its own motion is in
        `object_ticks`.
        """
        inputs = HapticBlock(*(as_argument(np.stack(values)) for values in zip(*haptic)))
        record = tick_record(*inputs.position.shape[:2])
        blocks, records = views_of_hands(inputs, record)
        if not inputs.position.shape[1]:
            return tuple(records)
        start_status = [0] * len(blocks) if self._started else self.begin(blocks)
        if (pair := self._pair) is None:
            status = self.tick(inputs, record)
        else:
            if self._has_free:
                done = pair.run_many(inputs, record)
            else:
                kernel, arguments = self._call_apart(pair, blocks, records)
                with ExitStack() as stack:
                    for alone in self._alone:
                        stack.enter_context(alone.thread_team.at_work(alone.method))
                    done = int(kernel(*arguments))
            status = int(np.bitwise_or.reduce(record.status[:, done - 1])) if done else 0
        if status & STATUS_CAPACITY_EXCEEDED:
            raise self._spaces[0].full()
        for written, start in zip(records, start_status):
            written.status[:1] |= start
        return tuple(records)

    def _call_apart(
        self, pair: WorldEngine, haptic: Sequence[HapticBlock], record: Sequence[TickRecord]
    ) -> tuple[Any, tuple[Any, ...]]:
        """Return the kernel of two hands beside each other, and its arguments."""
        from hhsim.kernels.world.side_by_side import run_hands_apart

        alone = tuple(engine.method for engine in self._alone)
        return run_hands_apart, (alone, pair.method, tuple(haptic), tuple(record), pair.parts_move, pair.qp, pair.code)

    @property
    def object_ticks(self) -> WorldRecord:
        """Record of the free object in the last ticks."""
        assert self.engine is not None
        return self.engine.ticks

    @property
    def _alone(self) -> list[WorldEngine]:
        """Engine of each hand alone."""
        return [hand.world for hand in self.hands if hand.world is not None]

    def tick_call(self, haptic: HapticBlock, record: TickRecord, bodies: WorldRecord) -> tuple[Any, tuple[Any, ...]]:
        """Return the kernel of begun ticks, None where Python takes part, and its arguments, which have these arrays.

        Those of hands have the hand as the first axis; `bodies` is written where one is free.
        """
        inputs, written = views_of_hands(haptic, record)
        if self._pair is not None and not self._has_free:
            return self._call_apart(self._pair, inputs, written)
        first, engine = self.hands[0], self.engine or self.hands[0].world
        if first.method.compiled and engine is None and len(self.hands) == 1:
            return run_block, first.workspace.block(getattr(first.engine, "method", None), inputs[0], written[0])
        engine = engine or WorldEngine(first.workspace)
        compiled = first.is_compiled and (len(self.hands) == 1 or self._pair is not None)
        return engine.call(haptic, record, bodies, compiled)

    def tick(self, haptic: HapticBlock, record: TickRecord) -> int:
        """Run ticks of each hand alone, and return their last status bits; arrays as for `tick_call`."""
        status = 0
        for hand, sample, written in zip(self.hands, *views_of_hands(haptic, record), strict=True):
            status |= hand.tick(sample, written)
        return status

    def begin(self, haptic: Sequence[HapticBlock]) -> list[int]:
        """Place both hands, apart where they begin in each other; return the status bits of each first tick.

        The first tick does it if nobody has, and must be given the same input.
        """
        self._started, pair = True, self._pair
        start_status = [hand.begin(sample) for hand, sample in zip(self.hands, haptic)]
        if pair is None:
            return start_status
        parted = _part(self._spaces)
        if parted:
            start_status = [start | STATUS_START_INSIDE for start in start_status]
        # Beside one body alone each hand has come as near as it can.
        if parted or (any(start_status) and self._spaces[0].beside):
            pair.approach(START_LINEARISATIONS)
        elif self._has_free:
            pair.begin()
        pair.world.is_near = parted
        return start_status


def views_of_hands(haptic: HapticBlock, record: TickRecord) -> tuple[list[HapticBlock], list[TickRecord]]:
    """Return views for each hand of arrays that have the hand as the first axis."""
    hands = range(len(haptic.position))
    inputs = [HapticBlock(*(values[h] for values in haptic)) for h in hands]
    return inputs, [TickRecord(*(values[h] for values in record)) for h in hands]


def _part(spaces: Sequence[TickWorkspace]) -> bool:
    """Shift two graphic hands apart, free of the object, where they begin in each other; return whether they did."""
    pairs, hands = cross_pairs(), [space.hand for space in spaces]
    first, second = (space.states[0].pose for space in spaces)

    def distance() -> float:
        update_kinematics(hands[0], first)
        update_kinematics(hands[1], second)
        apart = hands_distance(pairs, hands[0], first, hands[1], second)
        return min(apart, *(min(distances_of(space)) for space in spaces))

    if distance() >= 0.0:
        return False
    away, clear = first.position - second.position, spaces[0].options.margin
    shift_until([first.position, second.position], away, distance, clear)
    return True


class SceneSolver(WorldSolver):
    """Runs the ticks of a scene, whose hands and their records are as the engine's frame sees them.

    InputError for options that the scene does not go with.
    """

    def __init__(self, scene: Scene, options: SolverOptions) -> None:
        self.scene = standing_apart(scene, options.surface)
        self.seen = engine_scene(self.scene)
        self.options = options.at_rate(scene.ticks.rate)
        kind, free = self.options.surface, self.seen.free
        jointed = self.seen.parts is not None and free is None
        if jointed and not find_method(self.options.method).beside_parts:
            require_options(self.options, PARTS)
        alone = free if len(scene.hands) == 1 else None
        self.prepared: tuple[WarmUp, ...] = tuple(
            warm_up(hand.model, self.options, alone, jointed=jointed) for hand in scene.hands
        )
        # Each hand has the surface for itself: what is near it is kept with moving parts.
        self.surfaces = tuple(self.seen.surface(kind) for _ in scene.hands)
        hands = [
            HandSolver(hand.model, surface, self.options, alone, self.seen.others)
            for hand, surface in zip(scene.hands, self.surfaces)
        ]
        super().__init__(hands, free, self.seen.others)

    @property
    def free_ticks(self) -> tuple[WorldRecord, WorldRecord | None] | None:
        """Ticks of the first free body that were run last, and of all if there are several; None without one."""
        engine = self.engine
        return None if engine is None or self.seen.free is None else (engine.ticks, engine.all_ticks)


class OneTick:
    """Tick of a scene that is solved again and again, by its machine code, or from Python.

    Attributes:
        haptic: Input as of `HapticBlock` [m, rad], with the hand as the first axis and one tick as the second; write it
            before a tick.
        record: Outcome, likewise; a tick whose pairs did not fit says so in its status.
        row: Outcome of the bodies if one is free, of `bodies_row`, shape (1,).
        kernel: Kernel that solves a begun tick, None where Python takes part.
        arguments: Its arguments, which have the arrays above.
    """

    def __init__(self, solver: SceneSolver) -> None:
        self._solver, self._begun = solver, False
        hands, bodies = len(solver.hands), 0 if solver.seen.free is None else len(solver.scene.solids)
        self.haptic = HapticBlock(*(np.zeros((hands, 1, *shape)) for shape in SHAPES.values()))
        self.haptic.orientation[..., 0] = 1.0
        self.record = tick_record(hands, 1)
        self.row = zeroed(bodies_row(bodies))
        arrays = {name: self.row[name].view(np.ndarray)[0] for name in self.row.dtype.names}
        self.kernel, self.arguments = solver.tick_call(self.haptic, self.record, WorldRecord(**arrays))

    @property
    def address(self) -> int:
        """Address of the machine code, 0 if there is none."""
        return 0 if self.kernel is None else int(self.kernel.address(*self.arguments))

    @cached_property
    def _entry(self) -> Callable[..., Any]:
        found: Callable[..., Any] = self.kernel.entry(*self.arguments)
        return found

    def begin(self, haptic: Sequence[HapticBlock]) -> list[int]:
        """Place the hands for their first tick, see `WorldSolver.begin`; without it `solve` does."""
        self._begun = True
        return self._solver.begin(haptic)

    def solve(self) -> None:
        """Solve a tick from Python; raises what the solver does."""
        if self.kernel is None:
            self._solver.tick(self.haptic, self.record)
            return
        start_status = []
        if not self._begun:
            start_status = self.begin(views_of_hands(self.haptic, self.record)[0])
        self._entry(*self.arguments)
        for h, start in enumerate(start_status):
            self.record.status[h, 0] |= start

    def run(self, haptic: Sequence[HandConfiguration]) -> tuple[TickRecord, ...]:
        """Solve a tick for each configuration of the hands, and keep the bodies' as the solver's last ticks."""
        inputs = HapticBlock(*(np.stack(values) for values in zip(*haptic)))
        count = inputs.position.shape[1]
        record, rows = tick_record(len(haptic), count), zeroed(self.row.dtype, count)
        for i in range(count):
            for values, samples in zip(self.haptic, inputs):
                values[:, 0] = samples[:, i]
            self.solve()
            for written, found in zip(record, self.record):
                written[:, i] = found[:, 0]
            rows[i] = self.row[0]
        if (engine := self._solver.engine) is not None and len(self.row["turn"][0]):
            engine.ticks, engine.all_ticks = bodies_ticks(rows)
        return tuple(views_of_hands(inputs, record)[1])


def bodies_ticks(rows: Records) -> tuple[WorldRecord, WorldRecord | None]:
    """Return the ticks of the first free body, and of all if there are several, from records of `bodies_row`."""
    count = rows["contact"][:, 1]
    kept = np.arange(rows["body"].shape[1]) < count[:, None]
    names, contact = WorldRecord._fields, WorldRecord._fields.index("contact")
    moving = {name: rows[name][:, :, 0].swapaxes(0, 1) for name in names[:contact]}
    contacts = {name: rows[name][kept] for name in names[contact + 1 :]}
    return seen_ticks(WorldRecord(**moving, contact=np.concatenate([[0], np.cumsum(count)]), **contacts))
