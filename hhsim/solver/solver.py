"""Solvers: of hands and what moves freely, tick after tick from free places on; of a hand alone, and of a scene.

Beside free bodies hands are given in the world, and returned as the first free body sees them.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, Records
from hhsim.errors import InputError
from hhsim.hand.configuration import SHAPES, HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.hand.self_pairs import cross_pairs, self_clearance, self_pairs
from hhsim.kernels.callee import collector_at_rest
from hhsim.kernels.contact.hand_pairs import hands_distance
from hhsim.kernels.hand.kinematics import PALM_BODY, PHALANX_COUNT
from hhsim.kernels.hand.pose import is_finite_configuration, update_kinematics
from hhsim.kernels.jit import as_argument
from hhsim.kernels.kernel_cache import compiled_kernels
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.kernels.tick.evaluation import look_at
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, STATUS_START_INSIDE
from hhsim.kernels.world.record import WorldRecord
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import hand_clearance, penetration
from hhsim.reproducible import norm
from hhsim.result.schema import bodies_row
from hhsim.scene.body import Body, HalfSpace
from hhsim.scene.engine_scene import engine_scene, standing_apart
from hhsim.scene.scene import Scene
from hhsim.solver.method import Engine, Method, find_method
from hhsim.solver.options import SolverOptions
from hhsim.solver.workspace import TickWorkspace, of_hands, tick_record, zeroed
from hhsim.solver.world_engine import HandsApart, WorldEngine, whole_record
from hhsim.trees.contact_surface import contact_surface, jointed_surface
from hhsim.trees.sphere_tree import SphereTree

SHARES = 64
"""Number of postures that are tried between a hand that is in itself and the straight one."""


def keeps_hands_apart(options: SolverOptions) -> bool:
    """Return whether two hands of these options, on an object that is not free, keep out of each other."""
    return options.method in ("coupled", "progressive") and options.qp == "active-set"


class Solver:
    """Keeps hands between ticks, and what moves freely with them.

    If a body is free, all hands and bodies share one program. Otherwise each hand is solved alone, and ticks in which
    two hands might have met are solved again together. Methods that promise no distance to the object,
    and other QP solvers, keep no two hands apart.

    Args:
        spaces: Workspace of one hand, or of the right and the left one, with the same options.
        bodies: A free body, whose surface at the start is that of the hands, bodies beside it, and the plane. A hand
            that begins in one of them is freed of it. Nothing where the surface stands still or moves as recorded.
        method: In place of the one that the options name.

    Raises:
        InputError: A method that lacks what it needs, or options that a free object does not go with.
    """

    all_ticks: WorldRecord | None = None
    """Record of all bodies in the last ticks where one is free."""

    def __init__(
        self, spaces: Sequence[TickWorkspace], bodies: Sequence[Body | HalfSpace] = (), method: Method | None = None
    ) -> None:
        self.spaces, self.options = tuple(spaces), spaces[0].options
        self.bodies = tuple(body for body in bodies if isinstance(body, Body))
        self.method = method or find_method(self.options.method)
        if self.method.missing and not bodies:
            raise InputError(f"method {self.options.method} {self.method.missing}")
        self.engines: list[Engine]
        if bodies:
            self.engines = [WorldEngine(*spaces, bodies=bodies)]
        elif len(spaces) > 1 and keeps_hands_apart(self.options):
            self.engines = [HandsApart(*spaces)]
        else:
            self.engines = [self.method.engine(space) for space in spaces]
        self.started = False  # hands have been placed

    @property
    def object_ticks(self) -> WorldRecord:
        """Record of the first free body in the last ticks; its contacts are those of all bodies."""
        assert self.all_ticks is not None
        return self.all_ticks.bodies[0]

    def solve(self, *haptic: HandConfiguration) -> tuple[TickRecord, ...]:
        """Run one tick for each haptic configuration of the hands, and return the record of each hand.

        Palm origin [m], (B, 3), and quaternion (w, x, y, z), (B, 4), world; flexion (B, 5, 3), abduction (B, 5) [rad].
        Raises HhsimError where more pairs were near than the arrays hold.
        """
        given = HapticBlock(*(np.stack(values) for values in zip(*haptic)))
        hands, ticks = given.position.shape[:2]
        record, bodies = tick_record(hands, ticks), whole_record(len(self.bodies), ticks)
        if ticks and self.tick(given, record, bodies) & STATUS_CAPACITY_EXCEEDED:
            raise self.spaces[0].full()
        return tuple(of_hands(record, h) for h in range(hands))

    def tick(self, haptic: HapticBlock, record: TickRecord, bodies: WorldRecord) -> int:
        """Run ticks as `solve` does with records that the caller allocated, and return the last one's status bits.

        The input, at least one row, and `record`, as `tick_record` makes it, have the hand as their first axis and the
        tick as their second. `bodies` is of all bodies, and written where one is free. More pairs than the arrays hold
        raise nothing, but are in the status (`hhsim.kernels.tick.state`).
        """
        haptic, hands = HapticBlock(*(as_argument(values) for values in haptic)), range(len(self.spaces))
        begun = None if self.started else self.begin([of_hands(haptic, h) for h in hands])
        # Hands that have one program have one engine.
        each, status = len(self.spaces) // len(self.engines), 0
        for first, engine in enumerate(self.engines):
            own = slice(first * each, (first + 1) * each)
            done = engine.run(of_hands(haptic, own), of_hands(record, own), bodies)
            status |= int(np.bitwise_or.reduce(record.status[own, done - 1]))
        if begun is not None:
            record.status[:, 0] |= begun
        self.all_ticks = bodies if self.bodies else None
        return status

    def begin(self, haptic: Sequence[HapticBlock]) -> list[int]:
        """Place the graphic hands at their first finite haptic configurations; the first tick does it if nobody has.

        A hand that is inside a body there, or in itself, starts at a free place nearby and comes as near as possible;
        so do two hands that are in each other and keep apart. The first tick must be given the same input. Returns
        STATUS_START_INSIDE or 0 of each hand; raises HhsimError where more pairs were near than the arrays hold.
        """
        self.started = True
        inside = [place_free(space, given) for space, given in zip(self.spaces, haptic)]
        both = self.engines[0] if len(self.spaces) > len(self.engines) else None
        assert both is None or isinstance(both, WorldEngine)
        # Beside one body alone two hands come as near as they can one by one; beside several, both at once.
        at_once = both is not None and len(self.bodies) > 1
        for space, is_inside in zip(self.spaces, inside):
            if is_inside and not at_once:
                self._engine_of(space).approach()
        if both is not None:
            both.world.is_near = parted = part_hands(self.spaces)
            if parted or (any(inside) and at_once):
                both.approach()
            inside = [is_inside or parted for is_inside in inside]
        for engine in self.engines:
            engine.begin()
        return [STATUS_START_INSIDE if is_inside else 0 for is_inside in inside]

    def _engine_of(self, space: TickWorkspace) -> WorldEngine:
        """Return the engine that brings a hand by itself to its start, from which every method begins."""
        known = [*self.engines, *getattr(self.engines[0], "alone", ())]
        own = (engine for engine in known if isinstance(engine, WorldEngine) and engine.hands == (space,))
        return next(own, None) or WorldEngine(space)

    def call(self, haptic: HapticBlock, record: TickRecord, bodies: WorldRecord) -> tuple[Any, tuple[Any, ...]]:
        """Return the kernel of begun ticks, None where Python takes part, and its arguments: arrays as for `tick`."""
        compiled = self.method.compiled and len(self.engines) == 1
        engine: Any = self.engines[0] if compiled else WorldEngine(self.spaces[0])
        kernel, arguments = engine.call(haptic, record, bodies)
        return kernel if compiled and self.options.qp == "active-set" else None, arguments


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
            a free object, or bodies of several parts, do not go with.
    """

    def __init__(
        self,
        hand: HandModel,
        surface: Any,
        options: SolverOptions,
        free: Body | None = None,
        others: Sequence[Body | HalfSpace] = (),
    ) -> None:
        self.options, self.workspace = options, TickWorkspace(hand, surface, options)
        self.solver = Solver([self.workspace], () if free is None else (free, *others))
        self.method, self.engine = self.solver.method, self.solver.engines[0]

    def __repr__(self) -> str:
        return f"HandSolver({self.options!r})"

    @property
    def object_ticks(self) -> WorldRecord:
        """See `Solver.object_ticks`."""
        return self.solver.object_ticks

    def run(
        self, position: FloatArray, orientation: FloatArray, flexion: FloatArray, abduction: FloatArray
    ) -> TickRecord:
        """Run one tick for each haptic configuration; shapes, units and errors as of `Solver.solve`."""
        return self.solver.solve(HandConfiguration(position, orientation, flexion, abduction))[0]

    def tick(self, haptic: HapticBlock, record: TickRecord) -> int:
        """Run ticks with a record that the caller allocated, and return the last one's status: see `Solver.tick`."""
        given = HapticBlock(*(values[None] for values in haptic))
        written: Any = (values[None] for values in record)
        return self.solver.tick(
            given, TickRecord(*written), whole_record(len(self.solver.bodies), len(haptic.position))
        )

    def begin(self, haptic: HapticBlock) -> int:
        """Place the graphic hand, and return STATUS_START_INSIDE or 0: see `Solver.begin`."""
        return self.solver.begin([haptic])[0]

    def place(self, position: FloatArray, orientation: FloatArray, flexion: FloatArray, abduction: FloatArray) -> None:
        """Place the graphic hand, shapes (3,), (4,), (5, 3), (5,), where it is free; method `paper` takes any pose."""
        state = self.workspace.states[0]
        for name, values in zip(HapticBlock._fields, (position, orientation, flexion, abduction)):
            state.pose[name][:] = values
        state.warm.count = 0
        state.decoupling.is_suspended = False
        self.engine.begin()
        self.solver.started = True


class SceneSolver(Solver):
    """Runs the ticks of a scene, whose hands and their records are as the engine's frame sees them.

    `method` is as of `Solver`. InputError for options that the scene does not go with.
    """

    def __init__(self, scene: Scene, options: SolverOptions, method: Method | None = None) -> None:
        self.scene = standing_apart(scene, options.surface)
        self.seen, options = engine_scene(self.scene), options.at_rate(scene.ticks.rate)
        free = self.seen.free
        # Each hand has the surface for itself: what is near it is kept with moving parts.
        spaces = [TickWorkspace(hand.model, self.seen.surface(options.surface), options) for hand in scene.hands]
        alone, jointed = None if len(spaces) > 1 else free, spaces[0].parts_move
        self.prepared = tuple(warm_up(hand.model, options, alone, jointed=jointed) for hand in scene.hands)
        super().__init__(spaces, () if free is None else (free, *self.seen.others), method)


class OneTick:
    """Tick of a scene that is solved again and again, by its machine code, or from Python.

    Attributes:
        haptic: Input as of `HapticBlock` [m, rad], with the hand as the first axis and one tick as the second; write it
            before a tick.
        record: Outcome, likewise; a tick whose pairs did not fit says so in its status.
        row: Outcome of the bodies if one is free, of `bodies_row`, shape (1,).
        begin: `Solver.begin`; without it the first tick that Python solves places the hands.
        arguments: Those of the machine code at `address`, which have the arrays above.
    """

    def __init__(self, solver: Solver) -> None:
        self.solver, self.begin = solver, solver.begin
        hands = len(solver.spaces)
        self.haptic = HapticBlock(*(np.zeros((hands, 1, *shape)) for shape in SHAPES.values()))
        self.haptic.orientation[..., 0] = 1.0
        self.record = tick_record(hands, 1)
        self.row = zeroed(bodies_row(len(solver.bodies)))
        arrays = {name: self.row[name].view(np.ndarray)[0] for name in self.row.dtype.names}
        self._bodies = WorldRecord(**arrays)
        self._kernel, self.arguments = solver.call(self.haptic, self.record, self._bodies)

    @property
    def address(self) -> int:
        """Address of the machine code that solves a begun tick, 0 where Python takes part."""
        return 0 if self._kernel is None else int(self._kernel.address(*self.arguments))

    def solve(self) -> None:
        """Solve a tick from Python; raises what the solver does."""
        self.solver.tick(self.haptic, self.record, self._bodies)


def bodies_ticks(rows: Records) -> WorldRecord:
    """Return the ticks of all bodies from records of `bodies_row`."""
    count = rows["contact"][:, 1]
    kept = np.arange(rows["body"].shape[1]) < count[:, None]
    names, contact = WorldRecord._fields, WorldRecord._fields.index("contact")
    moving = {name: rows[name][:, :, 0].swapaxes(0, 1) for name in names[:contact]}
    contacts = {name: rows[name][kept] for name in names[contact + 1 :]}
    return WorldRecord(**moving, contact=np.concatenate([[0], np.cumsum(count)]), **contacts)


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
    made = contact_surface(options.surface, mesh, ball)
    still = np.array([[[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]])
    surface = jointed_surface([made], still) if jointed else made.arrays
    # A method from outside is not for a scene like this; what is compiled for it is what its hands are measured with.
    method = find_method(options.method)
    solver = HandSolver(
        hand, surface, options if method.compiled or free is not None else replace(options, method="coupled"), free
    )
    orientation = np.array([[1.0, 0.0, 0.0, 0.0]])
    block = solver.run(np.zeros((1, 3)), orientation, np.zeros((1, 5, 3)), np.zeros((1, 5)))
    penetration(made.arrays, hand_shape(hand), PlacedHand(block.joints, block.position, block.orientation))
    if not method.compiled:
        space = solver.workspace
        look_at(space.hand, space.code, space.tick_options, space.states)
    return WarmUp(time.perf_counter() - began, compiled_kernels() > before)


def place_free(workspace: TickWorkspace, haptic: HapticBlock) -> bool:
    """Put a hand to the first finite configuration, or to a free place nearby; return whether that was inside."""
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
    if inside := min(distances_of(workspace)) < 0.0:
        retreat(workspace)
    return inside or in_itself


def distances_of(workspace: TickWorkspace) -> list[float]:
    """Signed distances [m] of the graphic hand to each surface, also deep inside, up to ten times the margin."""
    pose, options, shape = workspace.states[0].pose, workspace.options, hand_shape(workspace.model)
    position, orientation = np.array(pose.position), np.array(pose.orientation)
    joints = workspace.model.joints(position, orientation, pose.flexion, pose.abduction)
    placed, found = PlacedHand(joints[None], position[None], orientation[None]), []
    used = options.modelled()[:PALM_BODY:PHALANX_COUNT]
    for surface in (workspace.surface, *workspace.beside):
        palm, finger = hand_clearance(surface, shape, placed, 10.0 * options.margin)
        found.append(float(min(palm[0], finger[0, used].min(initial=np.inf))))
    return found


def part_fingers(workspace: TickWorkspace) -> bool:
    """Straighten the fingers of a hand that is in itself until it is not; return whether it was."""
    if not workspace.options.self_contact:
        return False
    own = self_pairs(workspace.model, workspace.options.fingers)
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


def part_hands(spaces: Sequence[TickWorkspace]) -> bool:
    """Shift two graphic hands apart, free of the object, where they begin in each other; return whether they did."""
    pairs, (one, other) = cross_pairs(), (space.hand for space in spaces)
    first, second = (space.states[0].pose for space in spaces)

    def distance() -> float:
        update_kinematics(one, first)
        update_kinematics(other, second)
        return min(hands_distance(pairs, one, first, other, second), *(min(distances_of(space)) for space in spaces))

    if distance() >= 0.0:
        return False
    away, clear = first.position - second.position, spaces[0].options.margin
    shift_until([first.position, second.position], away, distance, clear)
    return True
