"""Tracks of a hand that follows recorded frames without entering the object, from a start of its own each.

The solver's ticks never penetrate, so a track stays on the side of a thin part on which it began. Other starts give
other tracks; which one a frame takes is chosen later. The clearance of hands is measured apart from the solver.
"""

from contextlib import suppress
from copy import copy
from itertools import product
from typing import NamedTuple, TypeAlias

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.mesh_distance import balls_are_clear
from hhsim.kernels.tick.block import HapticBlock
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.hands import Bodies, object_bvh
from hhsim.metrics.mesh_penetration import RESOLUTION
from hhsim.metrics.moving_parts import MovingParts
from hhsim.motion.resample import interpolate_monotone, interpolate_orientation
from hhsim.repair.written_hand import SHARES
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import UNLIMITED, SolverOptions
from hhsim.system.progress import Progress, silent
from hhsim.trees.contact_surface import ContactSurface, put_parts

CLEAR = 2e-6
"""Clearance that a hand needs which the solver did not make [m]: above the error of the measure."""
SUBSTEP = 2e-3
"""Largest move of a joint of the haptic hand in one tick [m]: twice the solver's margin."""
MOST_SUBSTEPS = 150
"""Ticks between two frames at most: beyond, the recording jumps, and so may the hand."""
LINEARISATIONS = 100
STEP_TOLERANCE = 1e-6
"""Largest move of any point of the hand in the last linearisation of a tick [m]."""
AT_REST = 1e-6
"""A hand whose joints move less in a tick with its target held [m] is at rest."""
MOST_TICKS_AT_REST = 30
"""Ticks at most with a frame held."""
LONGEST_RETREAT = 0.3
"""Farthest shift at which a free start is looked for [m]."""
STANDOFF = 1e-3
"""Clearance of a free start [m]."""
GivenObject: TypeAlias = ContactSurface | MovingParts
"""Object of a recording: the surface of a closed mesh, or parts with their poses in each frame."""


class HandJudge:
    """Clearance of hands from closed meshes by closest points, with nothing of the solver.

    Hands are those of all frames of parts that move, or of the frames that `at` takes.
    """

    def __init__(self, hand: HandModel, given: GivenObject | Mesh) -> None:
        mesh = given.mesh if isinstance(given, ContactSurface) else given
        assert mesh is not None
        self.hand, self.shape, self.bodies = hand, hand_shape(hand), Bodies.of(mesh)

    def at(self, frames: int | slice | IntArray) -> "HandJudge":
        """Return the judge of some frames, or of a single one."""
        judge = copy(self)
        judge.bodies = self.bodies.at(frames)
        return judge

    def clearance(self, frames: HandConfiguration, limit: float = CLEAR) -> FloatArray:
        """Return the least signed distance of each hand [m], shape (T,), at most `limit`; NaN for a hand of NaN."""
        return self.placed_clearance(forward_kinematics(self.hand, *frames), limit)

    def placed_clearance(self, placed: PlacedHand, limit: float = CLEAR) -> FloatArray:
        """Return the same for any joints and palms."""
        return self.bodies.clearance(self.shape, placed, limit)

    def are_clear(self, points: FloatArray, radii: FloatArray, least: FloatArray) -> bool:
        """Return True if a hand of one frame, of balls as of `WrittenHand.samples`, has the clearance that it needs.

        `least` are lower bounds of the balls' signed distances to all bodies [m], shape (n,).
        """
        rest = len(SHARES), CLEAR, RESOLUTION
        return all(
            balls_are_clear(object_bvh(mesh), np.ascontiguousarray(seen[0]), radii, least, *rest)
            for mesh, seen in zip(self.bodies.meshes, self.bodies.seen(points[None]))
        )

    def points(self, frames: HandConfiguration) -> FloatArray:
        """Return joints, tips and palm origin of each hand [m], shape (T, 21, 3)."""
        return forward_kinematics(self.hand, *frames).points


def farthest(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the largest distance between corresponding points [m], shapes (T, P, 3); shape (T,)."""
    return np.asarray(np.linalg.norm(first - second, axis=-1).max(axis=-1))


class Start(NamedTuple):
    """Free hand from which a frame was reached, and where that led."""

    reached: HandConfiguration
    correction: float  # root mean square displacement of the points from the frame's [m]


def solver_beside(given: GivenObject, hand: HandModel, options: SolverOptions, frame: int = 0) -> HandSolver:
    """Return a solver beside an object, whose parts are where they are in a frame."""
    solver = HandSolver(hand, given.surface("mesh") if isinstance(given, MovingParts) else given, options)
    put_at(solver, given, frame)
    return solver


def put_at(solver: HandSolver, given: GivenObject, frame: int) -> None:
    """Put the parts beside which a solver is where they are in a frame; its hand is to be placed then."""
    if isinstance(given, MovingParts):
        put_parts(solver.workspace.surface, given.path[frame])


class FrameFollower:
    """Follows the recorded frames of one hand, finite, on a closed mesh, or on parts that move from frame to frame."""

    def __init__(self, hand: HandModel, given: GivenObject, frames: HandConfiguration, judge: HandJudge) -> None:
        self.hand, self.given, self.frames, self.judge = hand, given, frames, judge
        self.options = SolverOptions(
            surface="mesh", linearisations=LINEARISATIONS, budget=UNLIMITED, step_tolerance=STEP_TOLERANCE
        )
        self.solver = solver_beside(given, hand, self.options)

    def follow(self, order: range, progress: Progress = silent) -> HandConfiguration:
        """Return the track through all frames in an order; NaN where the solver holds too few pairs."""
        track = HandConfiguration(*(np.full(values.shape, np.nan) for values in self.frames))
        begun = False
        for done, (before, frame) in enumerate(zip([order[0], *order], order)):
            progress("frames", done, len(order))
            with suppress(HhsimError):
                if not begun:
                    self.begin(frame)
                begun = False
                put(track, frame, self.arrive(before, frame))
                begun = True
        return track

    def begin(self, frame: int) -> None:
        """Place the graphic hand at a frame, or, where that is inside, as near to it as a free place nearby leads."""
        self.solver = solver_beside(self.given, self.hand, self.options, frame)
        self.solver.begin(HapticBlock(*self.frames.part(frame, frame + 1)))

    def place(self, start: HandConfiguration, frame: int) -> None:
        """Place the graphic hand at a free configuration beside the object of a frame, T = 1."""
        put_at(self.solver, self.given, frame)
        self.solver.place(*start.at(0))

    def arrive(self, before: int, frame: int, start: HandConfiguration | None = None) -> HandConfiguration:
        """Return the graphic hand at rest after a move from frame to frame, T = 1; HhsimError if pairs are too many.

        `start` is a hand in place of that of the frame before.
        """
        goal = self.frames.part(frame, frame + 1)
        origin = self.frames.part(before, before + 1) if start is None else start
        way = (before, origin), (frame, goal)
        seen = zip(*(self.judge.bodies.at(at).seen(self.judge.points(hand)) for at, hand in way))
        moved = max(float(farthest(*points)[0]) for points in seen)
        steps = min(MOST_SUBSTEPS, int(np.ceil(moved / SUBSTEP)))
        if isinstance(self.given, MovingParts):
            workspace, path = self.solver.workspace, parts_between(self.given.path[[before, frame]], max(steps, 1))
            motion = workspace.surface.motion._replace(path=path, tick=np.zeros(1, np.int64))
            workspace.surface = workspace.surface._replace(motion=motion)
        if steps > 1:
            self.solver.run(*origin.line(goal, steps - 1).part(1))
        joints = np.full((5, 4, 3), np.inf)
        for _ in range(MOST_TICKS_AT_REST):
            record = self.solver.run(*goal)
            # A tick that lags or is stuck moves on with the next one, or has nowhere to go.
            if farthest(record.joints[0], joints).max() < AT_REST:
                break
            joints = record.joints[0]
        return HandConfiguration.of(record).copy()

    def starts(self, frame: int, seed: HandConfiguration | None) -> list[Start]:
        """Return where free starts around a frame lead, each from its own side, the nearest to the recorded hand first.

        They are a given seed, and the recorded hand, and the one with stretched fingers, shifted out in 14 directions
        and not at all.
        """
        recorded = self.frames.part(frame, frame + 1)
        straight = np.clip(np.zeros((1, 5, 3)), self.hand.flexion_min, self.hand.flexion_max)
        cube = np.array(list(product((-1.0, 0.0, 1.0), repeat=3)))
        directions = cube[np.isin(np.abs(cube).sum(axis=1), (0.0, 1.0, 3.0))]
        directions /= np.maximum(1.0, np.linalg.norm(directions, axis=1, keepdims=True))
        postures = recorded._replace(flexion=straight), recorded
        judge = self.judge.at(frame)
        free = [seed, *(_moved_out(judge, posture, d) for posture in postures for d in directions)]
        found: list[Start] = []
        for start in free:
            if start is not None:
                with suppress(HhsimError):
                    self.place(start, frame)
                    reached = self.arrive(frame, frame, start)
                    off = judge.points(reached) - judge.points(recorded)
                    found.append(Start(reached, float(np.sqrt((off**2).sum(axis=-1).mean()))))
        return sorted(found, key=lambda start: start.correction)


def parts_between(poses: FloatArray, steps: int) -> FloatArray:
    """Return poses of parts on their way from one frame to another, (2, P, 7), which is the last one, (steps, P, 7)."""
    ends, share, ways = np.array([0.0, 1.0]), np.arange(1, steps + 1) / steps, poses.swapaxes(0, 1)
    places = np.stack([interpolate_monotone(ends, way[:, :3], share) for way in ways], axis=1)
    turns = np.stack([interpolate_orientation(ends, way[:, 3:], share) for way in ways], axis=1)
    return np.concatenate([places, turns], axis=2)


def _moved_out(judge: HandJudge, posture: HandConfiguration, direction: FloatArray) -> HandConfiguration | None:
    """Return a hand shifted along a direction until it is free; None if it is not within `LONGEST_RETREAT`."""
    shift = 0.0
    while shift <= LONGEST_RETREAT:
        moved = posture._replace(position=posture.position + shift * direction)
        clearance = float(judge.clearance(moved, 2.0 * STANDOFF)[0])
        if clearance >= STANDOFF:
            return moved
        if not direction.any():
            return None
        shift += max(STANDOFF, STANDOFF - clearance)
    return None


def put(track: HandConfiguration, frames: int | IntArray, hands: HandConfiguration) -> None:
    """Write hands to frames of a track, or one, T = 1, to a frame."""
    for values, own in zip(track, hands, strict=True):
        values[frames] = own
