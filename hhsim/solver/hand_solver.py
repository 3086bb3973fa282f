"""Solver of the graphic hand, one tick after another from a free place on, and of hands that keep out of each other.

With what moves freely hands move by one program.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.hand.self_pairs import self_clearance
from hhsim.kernels.callee import collector_at_rest
from hhsim.kernels.contact.contact_points import clearances
from hhsim.kernels.contact.hand_pairs import hands_nearest
from hhsim.kernels.hand.hand_shape import StoredHands
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.kernels.hand.pose import is_finite_configuration, update_kinematics
from hhsim.kernels.jit import as_argument
from hhsim.kernels.kernel_cache import compiled_kernels
from hhsim.kernels.parts.surface import JointedSurface
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.kernels.tick.block import HapticBlock, TickRecord, run_block
from hhsim.kernels.tick.evaluation import look_at
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, STATUS_START_INSIDE
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import penetration
from hhsim.reproducible import norm
from hhsim.scene.body import Body, HalfSpace
from hhsim.solver.method import Engine, find_method
from hhsim.solver.options import PARTS, SolverOptions, require_options
from hhsim.solver.workspace import TickWorkspace, tick_record
from hhsim.solver.world_engine import WorldEngine
from hhsim.trees.contact_surface import contact_surface, jointed_surface
from hhsim.trees.sphere_tree import SphereTree

if TYPE_CHECKING:
    from hhsim.kernels.world.record import BodiesRecord, ObjectRecord, WorldRecord

START_LINEARISATIONS = 4000
"""Most linearisations of the approach from a free place to the object, where the haptic hand starts inside it."""
SHARES = 64
"""Number of postures that are tried between a hand that is in itself and the straight one."""


class HandSolver:
    """Keeps the graphic hand between ticks.

    Args:
        surface: Object's surface, world frame, of the kind that the options name: a
            `hhsim.trees.contact_surface.ContactSurface`, or its arrays alone. A method from outside may need the mesh.
        options: Method, stiffness and lengths.
        free: A free body, whose surface at the start `surface` is. Ticks are given in the world and returned as seen
            from it; its own motion is in `object_ticks`.
        others: Further bodies beside it, and the plane. A hand that begins in one of them is freed of it, too.

    Raises:
        InputError: A method that lacks what it needs, arrays of another surface than the options name, or options that
            a free object does not go with.
    """

    def __init__(
        self,
        hand: HandModel,
        surface: Any,
        options: SolverOptions,
        free: Body | None = None,
        others: Sequence[Body | HalfSpace] = (),
    ) -> None:
        self.options = options
        self.workspace = TickWorkspace(hand, surface, options)
        self.method = find_method(options.method)
        if free is None and self.method.missing:
            raise InputError(f"method {options.method} {self.method.missing}")
        if isinstance(self.workspace.surface, JointedSurface) and not self.method.beside_parts:
            require_options(options, PARTS)
        self.free = None if free is None else WorldEngine(self.workspace, free, others=others)
        self.engine: Engine = self.free or self.method.engine(self.workspace)
        self._started = False

    def __repr__(self) -> str:
        return f"HandSolver({self.options!r})"

    @property
    def object_ticks(self) -> "ObjectRecord":
        """Record of the free object in the last ticks."""
        assert self.free is not None
        return self.free.ticks

    def run(
        self, position: FloatArray, orientation: FloatArray, flexion: FloatArray, abduction: FloatArray
    ) -> TickRecord:
        """Run one tick for each haptic configuration; raise HhsimError where more pairs were near than the arrays hold.

        Palm origin [m], (B, 3), and quaternion (w, x, y, z), (B, 4), world; flexion (B, 5, 3), abduction (B, 5) [rad].
        """
        haptic = HapticBlock(*(as_argument(values) for values in (position, orientation, flexion, abduction)))
        record = tick_record(len(haptic.position))
        if len(haptic.position) and self.tick(haptic, record) & STATUS_CAPACITY_EXCEEDED:
            raise self.workspace.full()
        return record

    def tick(self, haptic: HapticBlock, record: TickRecord) -> int:
        """Run one tick for each haptic configuration with a record that the caller allocated.

        It gives the same bytes as `run`, but returns the status bits of the last tick (`hhsim.kernels.tick.state`)
        instead of raising that more pairs were near than the arrays hold. The input, at least one, is float64 and
        C-contiguous; `record` has as many ticks and is overwritten.
        """
        start = 0 if self._started else self.begin(haptic)
        done = self.engine.run(haptic, record)
        record.status[0] |= start
        return int(record.status[done - 1])

    def begin(self, haptic: HapticBlock) -> int:
        """Place the graphic hand at the first finite haptic configuration; the first tick does it if nobody has.

        Where that is inside the object or a body beside it, or its own parts are in each other, start at a free place
        nearby and come as near as possible; a hand whose program is that of others, too, waits there for them. The
        first tick must be given the same input. Returns STATUS_START_INSIDE or 0; raises HhsimError where more pairs
        were near than the arrays hold.
        """
        self._started = True
        workspace = self.workspace
        first = next((sample for sample in zip(*haptic) if is_finite_configuration(*sample)), None)
        pose, haptic_pose, limits = workspace.states[0].pose, workspace.states[0].haptic, workspace.hand
        if first is not None:
            pose.position[:] = first[0]
            pose.orientation[:] = first[1] / norm(first[1])
            pose.flexion[:] = np.clip(first[2], limits.flexion_min, limits.flexion_max)
            pose.abduction[:] = first[3]
        for name in HapticBlock._fields:
            haptic_pose[name][:] = pose[name]
        in_itself = part_fingers(workspace)
        inside = min(distances_of(workspace)) < 0.0
        if inside:
            retreat(workspace)
        inside |= in_itself
        self.engine.begin()
        if not inside:
            return 0
        if workspace.beside and self.free is None:
            return STATUS_START_INSIDE
        # The start is no part of the method: every method begins from the same place.
        engine = self.world or WorldEngine(workspace)
        engine.approach(START_LINEARISATIONS)
        if engine is not self.engine:
            self.engine.begin()
        return STATUS_START_INSIDE

    @property
    def world(self) -> WorldEngine | None:
        """Engine of hands and bodies, None of a method with another one."""
        return self.engine if isinstance(self.engine, WorldEngine) else None

    @property
    def is_compiled(self) -> bool:
        """True if no part of a tick is Python's."""
        return self.options.qp == "active-set" and self.method.compiled

    def place(self, position: FloatArray, orientation: FloatArray, flexion: FloatArray, abduction: FloatArray) -> None:
        """Place the graphic hand, shapes (3,), (4,), (5, 3), (5,), where it is free; method `paper` takes any pose."""
        state = self.workspace.states[0]
        for name, values in zip(HapticBlock._fields, (position, orientation, flexion, abduction)):
            state.pose[name][:] = values
        state.warm.count = 0
        state.decoupling.is_suspended = False
        self.engine.begin()
        self._started = True


class WarmUp(NamedTuple):
    """Wall time of the warm-up [s], and True if anything was compiled instead of loaded."""

    seconds: float
    compiled: bool


@collector_at_rest()
def warm_up(hand: HandModel, options: SolverOptions, free: Body | None = None, *, jointed: bool = False) -> WarmUp:
    """Run one tick of a hand far from a small body, fixed, free or driven, with every kernel."""
    began = time.perf_counter()
    before = compiled_kernels()
    mesh = Mesh(np.full((3, 3), 100.0) + 0.01 * np.eye(3), np.array([[0, 1, 2]]))
    ball = SphereTree(mesh.vertices[:1], np.array([0.01]), np.zeros(1, np.int64), np.full(1, -1))
    surface: Any = contact_surface(options.surface, mesh, ball).arrays
    one = surface
    if jointed:
        surface = jointed_surface([one], np.array([[[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]]))
    # A method from outside is not for a scene like this; what is compiled for it is what its hands are measured with.
    method = find_method(options.method)
    solver = HandSolver(
        hand, surface, options if method.compiled or free is not None else replace(options, method="coupled"), free
    )
    orientation = np.array([[1.0, 0.0, 0.0, 0.0]])
    block = solver.run(np.zeros((1, 3)), orientation, np.zeros((1, 5, 3)), np.zeros((1, 5)))
    penetration(one, hand_shape(hand), PlacedHand(block.joints, block.position, block.orientation))
    if not method.compiled:
        look_at(solver.workspace.hand, solver.workspace.code, solver.workspace.tick_options, solver.workspace.states)
    return WarmUp(time.perf_counter() - began, compiled_kernels() > before)


def distances_of(workspace: TickWorkspace) -> list[float]:
    """Signed distances [m] of the graphic hand to each surface, also deep inside, up to ten times the margin."""
    pose, options = workspace.states[0].pose, workspace.options
    joints = workspace.model.joints(pose.position, pose.orientation, pose.flexion, pose.abduction)
    rotation = np.empty((3, 3))
    quaternion_to_matrix(np.array(pose.orientation), rotation)
    palm, finger, shape = np.empty(1), np.empty((1, FINGER_COUNT)), hand_shape(workspace.model)
    placed = StoredHands(shape, np.ascontiguousarray(joints)[None], np.array(pose.position)[None], rotation[None])
    used, found = options.modelled()[:PALM_BODY:PHALANX_COUNT], []
    for surface in (workspace.surface, *workspace.beside):
        clearances(surface, placed, 10.0 * options.margin, palm, finger)
        found.append(float(min(palm[0], finger[0, used].min(initial=np.inf))))
    return found


def part_fingers(workspace: TickWorkspace) -> bool:
    """Straighten the fingers of a hand that is in itself until it is not; return whether it was."""
    own = workspace.tick_options.own.pairs
    if not len(own.first):
        return False
    pose, share = workspace.states[0].pose, np.linspace(1.0, 0.0, SHARES + 1)
    flexion, abduction = (share.reshape(-1, *[1] * values.ndim) * values for values in (pose.flexion, pose.abduction))
    flexion = np.clip(flexion, workspace.hand.flexion_min, workspace.hand.flexion_max)
    # The straight hand is the last one: its parts that may meet are apart.
    first = int(np.argmax(self_clearance(workspace.model, own, flexion, abduction) >= workspace.options.offset))
    pose.flexion[:], pose.abduction[:] = flexion[first], abduction[first]
    return first > 0


def retreat(workspace: TickWorkspace) -> None:
    """Shift the hand by the least distance that frees it, over 26 directions and away from what it is deepest in."""
    pose, deepest = workspace.states[0].pose, int(np.argmin(distances_of(workspace)))
    joints = workspace.model.joints(pose.position, pose.orientation, pose.flexion, pose.abduction)
    away = joints.reshape(-1, 3).mean(axis=0) - workspace.center(deepest)
    shift_until([pose.position], away, lambda: min(distances_of(workspace)), workspace.options.margin)


def shift_until(positions: Sequence[FloatArray], away: FloatArray, distance: Callable[[], float], clear: float) -> None:
    """Shift palms least, in 26 directions and `away`, to a signed distance `clear` [m]; a second one opposite."""
    origins = [position.copy() for position in positions]
    directions = [np.array(d) - 1.0 for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)]
    if norm(away) > 0.0:
        directions.insert(0, away)
    best, nearest = np.inf, np.zeros(3)

    def place(shift: FloatArray) -> None:
        for position, origin, sign in zip(positions, origins, (1.0, -1.0)):
            position[:] = origin + sign * shift

    for direction in directions:
        unit = direction / norm(direction)
        shift = 0.0
        while shift < best:
            place(shift * unit)
            found = distance()
            if found >= clear:
                best, nearest = shift, shift * unit
                break
            shift += max(clear, -found / len(positions))
    place(nearest)


FAR = 10.0
"""Distance [m] up to which hands that begin in each other, or may, are measured."""


def keeps_hands_apart(options: SolverOptions) -> bool:
    """Return whether two hands of these options, on an object that is not free, keep out of each other."""
    return options.method in ("coupled", "progressive") and options.qp == "active-set"


class WorldSolver:
    """Keeps hands between ticks, and what moves freely with them.

    Where something is free all move by one program. Else each hand's ticks are those that it has alone, but for those
    in which two might have met: these are made by one program of both. Methods that promise no distance to the object,
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
        self._two: WorldEngine | None = None
        if len(self.hands) > 1 and (free is not None or keeps_hands_apart(hands[0].options)):
            self._two = self.engine = WorldEngine(self._spaces[0], free, self._spaces[1], others)
        self._started = self._two is None

    def run(self, *haptic: HandConfiguration) -> tuple[TickRecord, ...]:
        """Run one tick for each haptic configuration of the hands; arguments and errors as of `HandSolver.run`.

        With a free object they are in the world, and the ticks are returned as seen from it: its own motion is in
        `object_ticks`.
        """
        given = HapticBlock(*(as_argument(np.stack(values)) for values in zip(*haptic)))
        record = tick_record(*given.position.shape[:2])
        blocks, records = views_of_hands(given, record)
        if not given.position.shape[1]:
            return tuple(records)
        begun = [0] * len(blocks) if self._started else self.begin(blocks)
        if self._two is None:
            status = self.tick(given, record)
        else:
            done = self._run_two(self._two, given, record)
            status = int(np.bitwise_or.reduce(record.status[:, done - 1])) if done else 0
        if status & STATUS_CAPACITY_EXCEEDED:
            raise self._spaces[0].full()
        for written, start in zip(records, begun):
            written.status[:1] |= start
        return tuple(records)

    def _run_two(self, two: WorldEngine, haptic: HapticBlock, record: TickRecord) -> int:
        if self._has_free:
            return two.run_many(haptic, record)
        kernel, arguments = self._call_apart(two, *views_of_hands(haptic, record))
        with ExitStack() as stack:
            for alone in self._alone:
                stack.enter_context(alone.thread_team.at_work(alone.method))
            return int(kernel(*arguments))

    def _call_apart(
        self, two: WorldEngine, haptic: Sequence[HapticBlock], record: Sequence[TickRecord]
    ) -> tuple[Any, tuple[Any, ...]]:
        """Return the kernel of two hands beside each other, and its arguments."""
        from hhsim.kernels.world.side_by_side import run_hands_apart

        alone = tuple(engine.method for engine in self._alone)
        return run_hands_apart, (alone, two.method, tuple(haptic), tuple(record), two.parts_move, two.qp, two.code)

    @property
    def object_ticks(self) -> "ObjectRecord":
        """Record of the free object in the last ticks."""
        assert self.engine is not None
        return self.engine.ticks

    @property
    def all_ticks(self) -> "BodiesRecord | None":
        """Record of all bodies beside a free one in the last ticks; None where there are none."""
        return None if self.engine is None else self.engine.all_ticks

    @property
    def _alone(self) -> list[WorldEngine]:
        """Engine of each hand alone."""
        return [hand.world for hand in self.hands if hand.world is not None]

    def tick_call(self, haptic: HapticBlock, record: TickRecord, bodies: "WorldRecord") -> tuple[Any, tuple[Any, ...]]:
        """Return the kernel of begun ticks, None where Python takes part, and its arguments, which have these arrays.

        Those of hands have the hand as the first axis; `bodies` is written where one is free.
        """
        given, written = views_of_hands(haptic, record)
        if self._two is not None and not self._has_free:
            return self._call_apart(self._two, given, written)
        first, engine = self.hands[0], self.engine or self.hands[0].world
        if first.method.compiled and engine is None and len(self.hands) == 1:
            return run_block, first.workspace.block(getattr(first.engine, "method", None), given[0], written[0])
        engine = engine or WorldEngine(first.workspace)
        compiled = first.is_compiled and (len(self.hands) == 1 or self._two is not None)
        return engine.call(haptic, record, bodies, compiled)

    def tick(self, haptic: HapticBlock, record: TickRecord) -> int:
        """Run ticks of each hand alone, and return their last status bits; arrays as for `tick_call`."""
        status = 0
        for hand, given, written in zip(self.hands, *views_of_hands(haptic, record), strict=True):
            status |= hand.tick(given, written)
        return status

    def begin(self, haptic: Sequence[HapticBlock]) -> list[int]:
        """Place both hands, apart where they begin in each other; return the status bits of each first tick.

        The first tick does it if nobody has, and must be given the same input.
        """
        self._started, two = True, self._two
        begun = [hand.begin(given) for hand, given in zip(self.hands, haptic)]
        if two is None:
            return begun
        parted = _part(self._spaces, two.world.meeting)
        if parted:
            begun = [start | STATUS_START_INSIDE for start in begun]
        # Beside one body alone each hand has come as near as it can.
        if parted or (any(begun) and self._spaces[0].beside):
            two.approach(START_LINEARISATIONS)
        elif self._has_free:
            two.begin()
        two.world.is_near, two.world.apart = parted, 0.0
        return begun


def views_of_hands(haptic: HapticBlock, record: TickRecord) -> tuple[list[HapticBlock], list[TickRecord]]:
    """Return views for each hand of arrays that have the hand as the first axis."""
    hands = range(len(haptic.position))
    given = [HapticBlock(*(values[h] for values in haptic)) for h in hands]
    return given, [TickRecord(*(values[h] for values in record)) for h in hands]


def _part(spaces: Sequence[TickWorkspace], pairs: Any) -> bool:
    """Shift two graphic hands apart, free of the object, where they begin in each other; return whether they did."""
    arrays, states = tuple(space.hand for space in spaces), tuple(space.states[0] for space in spaces)
    first, second = (state.pose for state in states)

    def distance() -> float:
        for hand, state in zip(arrays, states):
            update_kinematics(hand, state.pose)
        return min(hands_nearest(arrays, states, FAR, pairs), *(min(distances_of(space)) for space in spaces))

    if distance() >= 0.0:
        return False
    away, clear = first.position - second.position, spaces[0].options.margin
    shift_until([first.position, second.position], away, distance, clear)
    return True
