"""Tracks of a hand that follows recorded frames without entering the object, from a start of its own each.

The solver's ticks never penetrate, so a track stays on the side of a thin part on which it began. Other starts give
other tracks; which one a frame takes is chosen later. The clearance of hands is measured apart from the solver.
"""

from contextlib import suppress
from itertools import product
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.mesh.bvh import closest_points
from hhsim.kernels.tick.block import HapticBlock
from hhsim.metrics.field.hands import object_bvh
from hhsim.metrics.mesh_penetration import mesh_clearance
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import UNLIMITED, SolverOptions
from hhsim.system.progress import Progress, silent
from hhsim.trees.contact_surface import ContactSurface

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


class HandJudge:
    """Clearance of hands from a closed mesh by closest points, with nothing of the solver."""

    def __init__(self, hand: HandModel, surface: ContactSurface) -> None:
        assert surface.mesh is not None
        self.hand, self.shape, self.bvh = hand, hand_shape(hand), object_bvh(surface.mesh)

    def clearance(self, frames: HandConfiguration, limit: float = CLEAR) -> FloatArray:
        """Return the least signed distance of each hand [m], shape (T,), at most `limit`; NaN for a hand of NaN."""
        return self.placed_clearance(forward_kinematics(self.hand, *frames), limit)

    def placed_clearance(self, placed: PlacedHand, limit: float = CLEAR) -> FloatArray:
        """Return the same for any joints and palms."""
        return mesh_clearance(self.bvh, self.shape, placed, limit)

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return signed distances of points from the closed mesh [m], shape (n,), and their gradients, (n, 3)."""
        closest, distance = np.empty_like(points), np.empty(len(points))
        closest_points(self.bvh, points, closest, distance)
        # On the surface no direction is known.
        known = (np.abs(distance) > 1e-9)[:, None]
        return distance, np.where(known, points - closest, 0.0) / np.where(known, distance[:, None], 1.0)

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


class FrameFollower:
    """Follows the recorded frames of one hand, finite, on a closed mesh."""

    def __init__(self, hand: HandModel, surface: ContactSurface, frames: HandConfiguration) -> None:
        self.hand, self.surface, self.frames = hand, surface, frames
        self.options = SolverOptions(
            surface="mesh", linearisations=LINEARISATIONS, budget=UNLIMITED, step_tolerance=STEP_TOLERANCE
        )
        self.solver = HandSolver(hand, surface, self.options)

    def follow(self, order: range, progress: Progress = silent) -> HandConfiguration:
        """Return the track through all frames in an order; NaN where the solver holds too few pairs."""
        track = HandConfiguration(*(np.full(values.shape, np.nan) for values in self.frames))
        begun = False
        for done, (before, frame) in enumerate(zip([order[0], *order], order)):
            progress("frames", done, len(order))
            goal = self.frames.part(frame, frame + 1)
            with suppress(HhsimError):
                if not begun:
                    self.begin(goal)
                begun = False
                put(track, frame, self.arrive(self.frames.part(before, before + 1), goal))
                begun = True
        return track

    def begin(self, goal: HandConfiguration) -> None:
        """Place the graphic hand at a frame, or, where that is inside, as near to it as a free place nearby leads."""
        self.solver = HandSolver(self.hand, self.surface, self.options)
        self.solver.begin(HapticBlock(*goal))

    def place(self, start: HandConfiguration) -> None:
        """Place the graphic hand at a free configuration, T = 1."""
        self.solver.place(*start.at(0))

    def arrive(self, origin: HandConfiguration, goal: HandConfiguration) -> HandConfiguration:
        """Return the graphic hand at rest after a move from origin to goal, T = 1; HhsimError if pairs are too many."""
        moved = float(farthest(*(forward_kinematics(self.hand, *frames).points for frames in (origin, goal)))[0])
        steps = min(MOST_SUBSTEPS, int(np.ceil(moved / SUBSTEP)))
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

    def starts(self, judge: HandJudge, frame: int, seed: HandConfiguration | None) -> list[Start]:
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
        free = [seed, *(_moved_out(judge, posture, d) for posture in postures for d in directions)]
        found: list[Start] = []
        for start in free:
            if start is not None:
                with suppress(HhsimError):
                    self.place(start)
                    reached = self.arrive(start, recorded)
                    off = judge.points(reached) - judge.points(recorded)
                    found.append(Start(reached, float(np.sqrt((off**2).sum(axis=-1).mean()))))
        return sorted(found, key=lambda start: start.correction)


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


def put(track: HandConfiguration, frame: int, hand: HandConfiguration) -> None:
    """Write a hand, T = 1, to a frame of a track."""
    for values, own in zip(track, hand, strict=True):
        values[frame] = own[0]
