"""Correction of recorded joints such that the hand that is written does not penetrate.

Each frame whose written hand is inside is solved anew: the least change of our hand, as a sequence of quadratic
programs in which the distances of balls along the written bones are linearised.
"""

from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.mesh.bvh import build_mesh_bvh, closest_points
from hhsim.motion.object_motion import RigidMotion
from hhsim.recordings.correction import BONES, Correction
from hhsim.repair.hand_change import (
    NUMBERS,
    REACH,
    change_between,
    changed_hand,
    finite_frames,
    mean_acceleration,
)
from hhsim.repair.hand_judge import CLEAR, HandJudge, farthest
from hhsim.repair.smoothing import smoothed
from hhsim.repair.tracks import put
from hhsim.repair.written_hand import JOINTS, WrittenHand
from hhsim.solver.options import Stiffness
from hhsim.solver.qp import QpProblem, QpStatus, solve_active_set
from hhsim.system.progress import Progress, silent
from hhsim.trees.contact_surface import ContactSurface

NEAR = 2e-3
"""Balls up to this far from the surface [m] are rows of the program."""
FIRST_GAP, LARGEST_GAP = 2e-5, 1e-3
"""Clearance that a program asks of the balls [m], doubled while the hand between them still penetrates."""
LONGEST_STEP = 4e-3
"""Largest move of a ball in one program [m]."""
PROGRAMS = 40
SETTLED = 5e-5
"""Move of all balls in one program [m] below which a hand is the nearest."""
RELAXATION = 1e-4
"""Distance [√J] by which rows that contradict each other are moved back."""
A_JOINT = 50.0
"""Stiffness by which each joint, and the palm's origin, is drawn to its recorded place [N/m]."""
REST = 0.02 * np.concatenate([Stiffness(flexion=0.05).diagonal(), np.full(5, 0.1)])
"""Stiffness of each number of a change beside that of the joints, which tell nothing of a turn about their own line."""
ORIGIN, UNIT = np.eye(3, NUMBERS), np.ones(NUMBERS)
TAPERS = (0, 2, REACH)
"""Frames beside those that need a correction over which it falls to nothing, in the order in which they are tried."""
STEADY = 1.1
"""Ratio of mean accelerations, written to recorded, up to which no longer taper is tried."""
LONGEST_SHIFT = 0.05
"""Farthest shift by which a hand is freed where the programs find no way [m]."""


class WrittenFrames(NamedTuple):
    """Corrected joints of T frames, and the penetration of the written hands.

    Attributes:
        correction: In the frame of the joints that were given; frames without a need are returned as they were.
        depth_before, depth: Penetration of the recorded and of the written hand [m], 0 outside, NaN without a hand,
            shape (T,).
        moved: Largest move of a recorded joint [m], 0 without one, shape (T,).
        marked: True where the written hand penetrates, or a joint moves by more than the limit, shape (T,).
    """

    correction: Correction
    depth_before: FloatArray
    depth: FloatArray
    moved: FloatArray
    marked: BoolArray


def correct(
    joints: FloatArray,
    hand: HandModel,
    fitted: HandConfiguration,
    posture: HandConfiguration,
    surface: ContactSurface,
    *,
    tip_on_surface: bool,
    object_moved: RigidMotion | None = None,
    max_correction: float = 0.015,
    smooth: bool = True,
    progress: Progress = silent,
) -> WrittenFrames:
    """Move recorded joints with the bones of our hand, and on until the written hand does not penetrate.

    Args:
        joints: Recorded joints in the order of `KEYPOINTS`, in the object's frame [m], shape (T, 21, 3), NaN where
            missing.
        hand: Hand model.
        fitted, posture: Our hand as recorded and as repaired, in the object's frame; NaN in frames without a hand.
        surface: Object's surface.
        tip_on_surface: True if recorded tips are points of the skin; False if they are centres of the fingertips.
        object_moved: Motion of the object's frame in the world, in which accelerations are measured; None: it stands
            still.
        max_correction: Largest move of a joint [m] of a frame that is not marked.
        smooth: True to low-pass the correction again where frames were solved anew.
        progress: Called with the stage, the frames done and their number.
    """
    count = len(joints)
    known = np.flatnonzero(finite_frames(fitted) & finite_frames(posture))
    rotation = np.tile(np.eye(3), (count, BONES, 1, 1))
    moved, corrected = joints.copy(), fitted.copy()
    depth_before, depth = np.full(count, np.nan), np.full(count, np.nan)
    changed = np.zeros(count, bool)
    if known.size:
        written = WrittenHand(joints[known], hand, fitted.at(known), tip_on_surface)
        projection = Projection(written, HandJudge(hand, surface))
        recorded = projection.clearance(written.fitted)
        if object_moved is not None:
            object_moved = RigidMotion(object_moved.turn[known], object_moved.shift[known])
        needed = recorded < 0.0
        found = projection.corrected(posture.at(known), needed, object_moved, max_correction, smooth, progress)
        touched = np.any(change_between(written.fitted, found) != 0.0, axis=1)
        changed[known] = touched
        rotation[known[touched]] = written.rotation(found)[touched]
        moved[known[touched]] = written.moved(joints[known], found)[touched]
        for values, own in zip(corrected, found, strict=True):
            values[known] = own
        depth_before[known] = np.maximum(0.0, 0.0 - recorded)
        depth[known] = np.maximum(0.0, 0.0 - np.where(touched, projection.clearance(found), recorded))
    gone = np.where(np.isfinite(moved - joints), moved - joints, 0.0)
    farthest_move = farthest(gone, np.zeros_like(gone))
    marked = (depth > 0.0) | (farthest_move > max_correction)
    correction = Correction(fitted, corrected, rotation, moved, changed)
    return WrittenFrames(correction, depth_before, depth, farthest_move, marked)


def _taper(needed: BoolArray, reach: int) -> tuple[FloatArray, IntArray]:
    """Return the share of a correction in each frame, and the frame that needs it, shape (T,) each.

    It is 1 where needed, and 0 beyond so many frames beside.
    """
    frames, wanted = np.arange(len(needed)), np.flatnonzero(needed)
    after = np.searchsorted(wanted, frames)
    sides = wanted[np.minimum(after, len(wanted) - 1)], wanted[np.maximum(after - 1, 0)]
    nearest = np.where(np.abs(frames - sides[0]) < np.abs(frames - sides[1]), *sides)
    share = 0.5 + 0.5 * np.cos(np.pi * np.minimum(1.0, np.abs(frames - nearest) / (reach + 1.0)))
    return np.asarray(share), nearest


class Projection:
    """Nearest hands whose written joints are outside of one object."""

    def __init__(self, written: WrittenHand, judge: HandJudge) -> None:
        self.written, self.judge = written, judge
        mesh = judge.surface.mesh
        self.signed = judge.bvh is not None
        self.bvh = judge.bvh
        if mesh is not None and self.bvh is None:
            self.bvh = build_mesh_bvh(mesh.vertices, mesh.faces, signed=False)

    def clearance(self, posture: HandConfiguration) -> FloatArray:
        """Return the least signed distance of the written hands [m], at most `CLEAR`, shape (T,)."""
        return self.judge.placed_clearance(self.written.placed(posture))

    def corrected(
        self,
        posture: HandConfiguration,
        needed: BoolArray,
        object_moved: RigidMotion | None,
        limit: float,
        smooth: bool,
        progress: Progress = silent,
    ) -> HandConfiguration:
        """Return free hands near the recorded ones; as few frames are changed as a steady motion allows.

        Args:
            posture: Repaired hands of T frames.
            needed: True for frames whose written hand penetrates, shape (T,).
            object_moved: Motion of the object's frame in the world; None: it stands still.
            limit: Largest move of a joint [m] that smoothing may lead to.
            smooth: True to low-pass the corrections.
        """
        written, near = self.written, posture.copy()
        for frame in np.flatnonzero(needed).tolist():
            one = written.at(frame)
            found = self.nearest(one, one.fitted, near.part(frame, frame + 1))
            if found is not None:
                put(near, frame, found)
        change = change_between(written.fitted, near)

        def points(hands: HandConfiguration) -> FloatArray:
            """Return the joints of hands in the world [m], shape (T, 21, 3)."""
            joints = written.moved(written.axes, hands)
            return joints if object_moved is None else object_moved.points(joints)

        steady, least, best = STEADY * mean_acceleration(points(written.fitted)), np.inf, written.fitted
        for reach in TAPERS if needed.any() else ():
            share, needing = _taper(needed, reach)
            start = changed_hand(written.fitted, share[:, None] * change[needing])
            found = self.made_free(start, start, progress)
            if smooth:
                parts = points, self.clearance, self.made_free
                found = smoothed(written.fitted, found, limit, *parts, progress, share > 0.0)
            acceleration = mean_acceleration(points(found))
            if acceleration < least:
                least, best = acceleration, found
            if least <= steady:
                break
        return best

    def made_free(
        self, start: HandConfiguration, goals: HandConfiguration, progress: Progress = silent
    ) -> HandConfiguration:
        """Return the goals; a goal whose written hand penetrates is replaced by the nearest free hand found."""
        made = goals.copy()
        changed = change_between(self.written.fitted, goals).any(axis=1)
        inside = np.flatnonzero(self.clearance(goals) < np.where(changed, CLEAR, 0.0)).tolist()
        for done, frame in enumerate(inside):
            progress("written hands", done, len(inside))
            goal = goals.part(frame, frame + 1)
            one = self.written.at(frame)
            free = self.nearest(one, goal)
            put(made, frame, free or self._shifted(one, goal))
        return made

    def nearest(
        self, written: WrittenHand, goal: HandConfiguration, start: HandConfiguration | None = None
    ) -> HandConfiguration | None:
        """Return a free hand near a goal, T = 1; None if the programs do not lead to one.

        Args:
            written: Recorded hand.
            goal: Wanted hand.
            start: Hand on the side of the object where the nearest one is searched; None: the goal, and the first free
                hand is returned.
        """
        if self.bvh is None:
            return None
        posture, gap, free = start or goal, FIRST_GAP, None
        posed = written.posed(posture)
        points, radii, motion = written.samples(posed)
        # No ball is nearer than when it was measured by more than it has moved since.
        nearest, last = np.full(len(points), -np.inf), points
        wanted = written.samples(written.posed(goal))[0][JOINTS]
        for number in range(PROGRAMS):
            if number:
                points, radii, motion = written.samples(posed)
                nearest -= np.linalg.norm(points - last, axis=1)
                last = points
            asked = np.flatnonzero(nearest < NEAR)
            distance, normal = self._distances(points[asked])
            nearest[asked] = value = distance - radii[asked]
            near = (value < NEAR) & (np.abs(distance) > 1e-9)
            rows = np.einsum("ni,nij->nj", normal[near], motion[asked[near]])
            # Gauss and Newton's program of the joints, in the variables in which its Hessian is the identity.
            along = np.concatenate([motion[JOINTS].reshape(-1, NUMBERS), ORIGIN])
            off = np.append((wanted - points[JOINTS]).ravel(), (goal.position - posture.position)[0])
            root = np.linalg.cholesky(A_JOINT * along.T @ along + np.diag(REST))
            pull = A_JOINT * off @ along + REST * change_between(posture, goal)[0]
            program = QpProblem(UNIT, np.linalg.solve(root, rows.T).T, gap - value[near], np.linalg.solve(root, pull))
            solution = solve_active_set(program, RELAXATION)
            if solution.status is not QpStatus.OPTIMAL:
                break
            change = np.asarray(np.linalg.solve(root.T, solution.x), np.float64)
            length = float(np.linalg.norm(motion @ change, axis=1).max())
            posture = changed_hand(posture, change[None] * min(1.0, LONGEST_STEP / max(length, 1e-12)))
            posed = written.posed(posture)
            if self.judge.placed_clearance(posed.placed)[0] >= CLEAR:
                free = posture
                if start is None or length < SETTLED:
                    break
            elif length < LONGEST_STEP and gap < LARGEST_GAP:
                gap *= 2.0
        return free

    def _distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return signed distances [m], shape (n,), and the directions in which they grow, shape (n, 3)."""
        assert self.bvh is not None
        closest, distance = np.empty_like(points), np.empty(len(points))
        closest_points(self.bvh, points, closest, distance)
        if not self.signed:
            distance = np.abs(distance)
        with np.errstate(invalid="ignore", divide="ignore"):
            return distance, (points - closest) / distance[:, None]

    def _shifted(self, written: WrittenHand, goal: HandConfiguration) -> HandConfiguration:
        """Return a goal, T = 1, with the least shift along 26 directions that frees it; the goal if there is none."""
        best, found = LONGEST_SHIFT, goal
        for direction in np.ndindex(3, 3, 3):
            unit = np.array(direction, dtype=np.float64) - 1.0
            if not unit.any():
                continue
            change = np.zeros((1, NUMBERS))
            unit /= np.linalg.norm(unit)
            shift = 0.0
            while shift < best:
                change[0, :3] = shift * unit
                moved = changed_hand(goal, change)
                clearance = float(self.judge.placed_clearance(written.placed(moved))[0])
                if clearance >= CLEAR:
                    best, found = shift, moved
                    break
                shift += max(1e-4, CLEAR - clearance)
        return found
