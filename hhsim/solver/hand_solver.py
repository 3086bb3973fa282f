"""Solver of the graphic hand, one tick after another from a free place on, and the reference optimum of its tracking.

The reference of a method is `coupled`, converged.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import HhsimError, InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.hand.self_pairs import self_clearance, self_pairs
from hhsim.kernels.callee import collector_at_rest
from hhsim.kernels.contact.contact_points import clearances
from hhsim.kernels.hand.hand_shape import StoredHands
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.kernels.hand.pose import is_finite_configuration
from hhsim.kernels.jit import as_argument
from hhsim.kernels.kernel_cache import compiled_kernels
from hhsim.kernels.parts.surface import JointedSurface
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.kernels.tick.evaluation import look_at
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, STATUS_START_INSIDE, STATUS_STUCK
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import penetration, tracking_energy, tracking_excess
from hhsim.reproducible import norm
from hhsim.scene.body import Body, HalfSpace
from hhsim.solver.method import Engine, find_method
from hhsim.solver.options import PARTS, UNBOUNDED, UNLIMITED, USUAL, SolverOptions, require_options
from hhsim.solver.workspace import TickWorkspace, tick_record
from hhsim.solver.world_engine import WorldEngine
from hhsim.trees.contact_surface import contact_surface, jointed_surface
from hhsim.trees.sphere_tree import SphereTree

if TYPE_CHECKING:
    from hhsim.kernels.world.record import WorldRecord

START_LINEARISATIONS = 4000
"""Most linearisations of the approach from a free place to the object, where the haptic hand starts inside it."""
SHARES = 64
"""Number of postures that are tried between a hand that is in itself and the straight one."""
REFERENCE_LINEARISATIONS = 400
REFERENCE_STEP_TOLERANCE = 1e-8
"""Largest move of any point of the hand [m] in the last linearisation of a converged reference."""


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
    def object_ticks(self) -> "WorldRecord":
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
    start = time.perf_counter()
    before = compiled_kernels()
    mesh = Mesh(np.full((3, 3), 100.0) + 0.01 * np.eye(3), np.array([[0, 1, 2]]))
    ball = SphereTree(mesh.vertices[:1], np.array([0.01]), np.zeros(1, np.int64), np.full(1, -1))
    ball_surface = contact_surface(options.surface, mesh, ball)
    surface: Any = ball_surface.arrays
    if jointed:
        surface = jointed_surface([ball_surface], np.array([[[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]]))
    # A method from outside is not for a scene like this; what is compiled for it is what its hands are measured with.
    method = find_method(options.method)
    solver = HandSolver(
        hand, surface, options if method.compiled or free is not None else replace(options, method="coupled"), free
    )
    orientation = np.array([[1.0, 0.0, 0.0, 0.0]])
    block = solver.run(np.zeros((1, 3)), orientation, np.zeros((1, 5, 3)), np.zeros((1, 5)))
    penetration(ball_surface.arrays, hand_shape(hand), PlacedHand(block.joints, block.position, block.orientation))
    if not method.compiled:
        look_at(solver.workspace.hand, solver.workspace.code, solver.workspace.tick_options, solver.workspace.states)
    return WarmUp(time.perf_counter() - start, compiled_kernels() > before)


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


def best_hands(hand: HandModel, mesh_surface: Any, options: SolverOptions, haptic: HandConfiguration) -> TickRecord:
    """Return the least-energy pose of every tick: `coupled` on the triangles, converged, from the haptic hand on.

    `mesh_surface` is the object's surface `mesh`, world; the options give stiffness and lengths. Raises HhsimError
    where the optimum has more pairs than the solver holds.
    """
    on_mesh = _converged(options, surface="mesh", skin=USUAL, touch=USUAL)
    return HandSolver(hand, mesh_surface, on_mesh).run(*haptic)


def _converged(options: SolverOptions, **changed: Any) -> SolverOptions:
    return replace(
        options,
        method="coupled",
        threads=1,
        qp="active-set",
        linearisations=REFERENCE_LINEARISATIONS,
        budget=UNLIMITED,
        step_tolerance=REFERENCE_STEP_TOLERANCE,
        snap_speed=UNBOUNDED,
        **changed,
    )


def reference_excess(
    hand: HandModel,
    surface: Any,
    options: SolverOptions,
    haptic: HandConfiguration,
    graphic: HandConfiguration,
    ticks: IntArray,
) -> FloatArray:
    """Compute the coupling energy above the reference optimum, (E - E*) / E*, at some ticks, shape (len(ticks),).

    The optimum is the local one that `coupled` converges to from the method's own graphic hand with the input held,
    with the stiffness and lengths of the options. NaN in free space, and where the graphic hand is too deep inside for
    the reference. The surface is in the world, as `HandSolver` takes it; the hands are those of every tick.
    """
    solver = HandSolver(hand, surface, _converged(options))
    diagonal = options.stiffness.diagonal()
    found, wanted = graphic.at(ticks), haptic.at(ticks)
    best = found.copy()
    for i in range(len(ticks)):
        block = None
        # So deep inside that there are more pairs than the solver holds.
        with suppress(HhsimError):
            solver.place(*found.at(i))
            block = solver.run(*wanted.part(i, i + 1)._replace(abduction=found.abduction[i : i + 1]))
        if block is None or block.status[0] & STATUS_STUCK:
            best.position[i] = np.nan
            continue
        for name in ("position", "orientation", "flexion"):
            getattr(best, name)[i] = getattr(block, name)[0]
    return tracking_excess(tracking_energy(wanted, found, diagonal), tracking_energy(wanted, best, diagonal))
