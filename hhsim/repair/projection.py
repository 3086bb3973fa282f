"""Correction of recorded joints such that the hand that is written does not penetrate.

Each frame whose written hand is inside is solved for the least change of our hand, from its own place and from its
neighbours' corrections. Then all frames are solved at once, tied by the second differences of their change, so that the
correction is steady; Clarabel solves that program.

A frame is solved program by program: each is the least displacement of the joints with the distances of balls along the
bones linearised. A step is shortened where it turns back, since the surface bends more than the rows say.
"""

from collections.abc import Iterator, Sequence
from copy import copy
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.written_hand import balls_are_clear
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.hands import ON_SURFACE, Bodies, object_bvh
from hhsim.metrics.mesh_penetration import RESOLUTION
from hhsim.metrics.moving_parts import MovingParts
from hhsim.motion.trajectory import RigidMotion
from hhsim.repair.written_hand import (
    JOINTS,
    NUMBERS,
    SHARES,
    TIPS,
    WrittenHand,
    change_between,
    changed_hand,
    mean_acceleration,
)
from hhsim.solver.options import Stiffness
from hhsim.solver.qp import QpProblem, QpStatus, solve_active_set
from hhsim.system.progress import Progress, silent
from hhsim.trees.contact_surface import ContactSurface

CLEAR = 2e-6
"""Clearance that a hand needs which the solver did not make [m]: above the error of the measure."""
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

    def points(self, frames: HandConfiguration) -> FloatArray:
        """Return joints, tips and palm origin of each hand [m], shape (T, 21, 3)."""
        return forward_kinematics(self.hand, *frames).points


def farthest(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the largest distance between corresponding points [m], shapes (T, P, 3); shape (T,)."""
    return np.asarray(np.linalg.norm(first - second, axis=-1).max(axis=-1))


def put(track: HandConfiguration, frames: int | IntArray, hands: HandConfiguration) -> None:
    """Write hands to frames of a track, or one, T = 1, to a frame."""
    for values, own in zip(track, hands, strict=True):
        values[frames] = own


SLACK = 1000.0
"""Force [N], above that of any displacement, at which rows that contradict each other give way."""
TOLERANCE = 1e-6
"""Relative gap, and violation of rows, at which Clarabel ends."""


class FrameProgram(NamedTuple):
    """Program of a frame: least x·H·x / 2 − p·x with rows · x ≥ bounds; H is `hessian`, p is `pull`.

    The first 26 of the n variables are the next change of the hand; others are slacks of rows that may give way.
    """

    hessian: FloatArray
    pull: FloatArray
    rows: FloatArray
    bounds: FloatArray


def steady_step(
    programs: Sequence[FrameProgram], change: FloatArray, frames: Sequence[int], steadiness: float
) -> FloatArray | None:
    """Compute the next changes of these frames, shape (n, 26); None if the solver finds none.

    Args:
        programs: Program of each frame that may change.
        change: Change of all T frames so far, shape (T, 26).
        frames: Frames of the programs, ascending.
        steadiness: Weight of a squared second difference of a number of the change, against that of the number in H.
    """
    import clarabel
    import scipy.sparse

    sparse: Any = scipy.sparse

    count, total = len(programs), len(change)
    metric = steadiness * np.mean([np.diag(program.hessian)[:NUMBERS] for program in programs], axis=0)
    one = sparse.eye_array(total).tocsr()
    second = (one[2:] - 2.0 * one[1:-1] + one[:-2]).tocsc()
    own = second[:, frames]
    hessian = sparse.block_diag([program.hessian for program in programs])
    sizes = [len(program.pull) for program in programs]
    first = np.cumsum([0, *sizes[:-1]])[:, None] + np.arange(NUMBERS)
    change_of = sparse.eye_array(sum(sizes)).tocsr()[first.ravel()]
    hessian += change_of.T @ sparse.kron(own.T @ own, sparse.diags_array(metric)) @ change_of
    linear = change_of.T @ ((own.T @ (second @ change)) * metric).ravel()
    linear -= np.concatenate([program.pull for program in programs])
    # One slack for all rows of a frame, so that the program always has a solution.
    rows = sparse.block_diag([-program.rows for program in programs])
    slack = sparse.block_diag([-np.ones((len(program.bounds), 1)) for program in programs])
    matrix = sparse.block_array([[rows, slack], [None, -sparse.eye_array(count)]]).tocsc()
    bounds = np.concatenate([*(-program.bounds for program in programs), np.zeros(count)])
    quadratic = sparse.block_diag([sparse.triu(hessian), sparse.eye_array(count)]).tocsc()
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
    linear = np.concatenate([linear, np.full(count, SLACK)])
    cones = [clarabel.NonnegativeConeT(len(bounds))]
    solution = clarabel.DefaultSolver(quadratic, linear, matrix, bounds, cones, settings).solve()
    if str(solution.status) not in {"Solved", "AlmostSolved"}:
        return None
    return np.asarray(solution.x)[first]


LONGEST_STEP = 5e-3
"""Largest move of a ball in one program [m], and the distance from the surface up to which balls have rows."""
SETTLED = 2e-4
"""Move of all balls in one program [m] below which a hand is the nearest."""
CALM = 1e-3
"""Move [m] from which on the hand between the balls is measured."""
FIRST_GAP, LARGEST_GAP = 2e-5, 1e-3
"""Clearance that a program asks of the balls [m], doubled while the hand between them still penetrates."""
JOINT_STIFFNESS = 50.0
"""Stiffness by which each joint, and the palm's origin, is drawn to its recorded place [N/m]."""
REST = 0.02 * np.concatenate([Stiffness(flexion=0.05).diagonal(), np.full(5, 0.1)])
"""Stiffness of each number of a change beside that of the joints, which tell nothing of a turn about their own line."""
TOUCH_STIFFNESS = 5000.0
"""Stiffness by which a fingertip that touches in the recording is drawn to the object [N/m]."""
TOUCHES, TOUCH, CLOSER = 5e-3, 1.5e-3, 5e-4
"""Distance of a tip that touches in the recording, and up to which it is near enough in any case; by how much it comes
closer than it was recorded, so that it is within the same threshold [m]."""
ORIGIN = np.eye(3, NUMBERS)
PROGRAMS, STEADY_PROGRAMS = 40, 20
"""Programs of one frame, and of all frames at once, at most."""
RELAXATION = 1e-4
"""Distance [√J] by which rows that contradict each other are moved back."""
DEEPEST_START = 1e-3
"""Penetration with which a neighbour's correction is a start [m]."""
STEADINESS = ((0, 3.0), (0, 30.0), (2, 30.0), (6, 30.0))
"""Frames beside those that need a correction that may change too, and the weight of a steady change, see `steady_step`,
in the order in which they are tried."""
STEADY = 1.1
"""Ratio of mean accelerations, written to recorded, up to which no more frames are tried."""
LONGEST_SHIFT = 0.05
"""Farthest shift by which a hand is freed where the programs find no way [m]."""


class FrameHand:
    """Hand of one frame, moved by one program after the other; `judge` measures the object.

    `written` is the recorded hand, `start` one on the side of the object where the nearest one is searched, `goal` the
    wanted one; None: the recorded one, whose touching fingertips are to touch. `posture` is the hand, `found` the last
    measured one that does not penetrate, None without one; all have T = 1. `frame` is its place in the recording.
    """

    def __init__(
        self,
        judge: HandJudge,
        written: WrittenHand,
        start: HandConfiguration,
        goal: HandConfiguration | None = None,
        frame: int = 0,
    ) -> None:
        self.judge, self.written, self.frame = judge, written, frame
        self.goal = goal or written.fitted
        self.posture = start
        self.found: HandConfiguration | None = None
        self.gap, self.reach, self.range = FIRST_GAP, LONGEST_STEP, LONGEST_STEP
        wanted, radii, _ = written.samples(written.posed(self.goal))
        self.wanted = wanted[JOINTS]
        self.touch = np.full(5, np.inf)
        if goal is None:
            tip = (judge.bodies.slopes(wanted[TIPS.ravel()])[0].reshape(TIPS.shape) - radii[TIPS]).min(axis=1)
            self.touch[tip <= TOUCHES] = np.maximum(TOUCH, tip[tip <= TOUCHES]) - CLOSER
        self.posed = written.posed(start)
        self.points, self.radii, self.motion = written.samples(self.posed)
        # No ball is nearer than when it was measured by more than it has moved since.
        self.nearest, self.way = np.full(len(self.points), -np.inf), np.zeros_like(self.points)

    def program(self) -> FrameProgram:
        """Return Gauss and Newton's program of the joints, with the distances of near balls linearised."""
        touching = np.flatnonzero(np.isfinite(self.touch))
        asked = np.zeros(len(self.points), bool)
        asked[self.written.surface] = self.nearest[self.written.surface] < self.range
        asked[TIPS[touching]] = True
        distance, normal = self.judge.bodies.slopes(self.points[asked])
        self.nearest[asked] = value = distance - self.radii[asked]
        slopes = np.einsum("ni,nij->nj", normal, self.motion[asked])
        near = (value < self.range) & (np.abs(distance) > ON_SURFACE)
        tips = TIPS[touching, self.nearest[TIPS[touching]].argmin(axis=1)]
        wishes = slopes[(np.cumsum(asked) - 1)[tips]]
        along = np.concatenate([self.motion[JOINTS].reshape(-1, NUMBERS), ORIGIN])
        off = np.append((self.wanted - self.points[JOINTS]).ravel(), (self.goal.position - self.posture.position)[0])
        count = NUMBERS + len(tips)
        hessian, rows = TOUCH_STIFFNESS * np.eye(count), np.zeros((int(near.sum()) + len(tips), count))
        hessian[:NUMBERS, :NUMBERS] = JOINT_STIFFNESS * along.T @ along + np.diag(REST)
        rows[:, :NUMBERS] = np.concatenate([slopes[near], -wishes])
        rows[len(rows) - len(tips) :, NUMBERS:] = np.eye(len(tips))
        pull = JOINT_STIFFNESS * off @ along + REST * change_between(self.posture, self.goal)[0]
        return FrameProgram(
            hessian,
            np.append(pull, np.zeros(len(tips))),
            rows,
            np.append(self.gap - value[near], self.nearest[tips] - self.touch[touching]),
        )

    def moved(self, change: FloatArray) -> float:
        """Move the hand by a change, shape (26,), or by the share of it that is safe; return the largest move [m]."""
        way = self.motion @ change
        if (way * self.way).sum() < 0.0:
            self.reach *= 0.5
        self.way = way
        whole = float(np.linalg.norm(way, axis=1).max())
        length = min(whole, self.reach, self.range)
        self.posture = changed_hand(self.posture, change[None] * (length / max(whole, 1e-12)))
        self.posed, last = self.written.posed(self.posture), self.points
        self.points, self.radii, self.motion = self.written.samples(self.posed)
        self.nearest -= np.linalg.norm(self.points - last, axis=1)
        self.range = min(LONGEST_STEP, max(CALM, 2.0 * length))
        if length < CALM and not self.is_free() and self.gap < LARGEST_GAP:
            self.gap *= 2.0
        return length

    def is_free(self) -> bool:
        """Return True, and note the hand as found, if it does not penetrate."""
        surface, bodies = self.written.surface, self.judge.bodies
        if surface.start:
            free = bool((bodies.distance(self.points[None, surface]) >= CLEAR).all())
        else:
            rest = self.radii, self.nearest, len(SHARES), CLEAR, RESOLUTION
            free = all(
                balls_are_clear(object_bvh(mesh), np.ascontiguousarray(seen[0]), *rest)
                for mesh, seen in zip(bodies.meshes, bodies.seen(self.points[None]))
            )
        if free:
            self.found = self.posture
        return free


class Projection:
    """Nearest hands whose written joints are outside of one closed object; hands and judge are of the same frames."""

    def __init__(self, written: WrittenHand, judge: HandJudge) -> None:
        self.written, self.judge = written, judge
        self.recorded = written.moved(written.axes, written.fitted)

    def at(self, frames: int | slice) -> "Projection":
        """Return that of some frames, or of a single one."""
        one, part = copy(self), slice(frames, frames + 1) if isinstance(frames, int) else frames
        one.written, one.judge, one.recorded = self.written.at(part), self.judge.at(part), self.recorded[part]
        return one

    def clearance(self, posture: HandConfiguration) -> FloatArray:
        """Return the least signed distance of the written hands [m], at most `CLEAR`, shape (T,)."""
        return self.judge.placed_clearance(self.written.placed(posture))

    def corrected(
        self,
        posture: HandConfiguration,
        needed: BoolArray,
        object_moved: RigidMotion | None = None,
        progress: Progress = silent,
    ) -> HandConfiguration:
        """Return free hands near the recorded ones; as few frames are changed as a steady motion allows.

        `posture` are the repaired hands of T frames, `needed` those whose written hand penetrates, shape (T,),
        `object_moved` the motion of the object's frame in the world; None: it stands still.
        """
        written = self.written
        start = self._near(posture, needed, progress)

        def acceleration(hands: HandConfiguration) -> float:
            """Return the mean acceleration of the joints of hands in the world."""
            joints = written.moved(written.axes, hands)
            return mean_acceleration(joints if object_moved is None else object_moved.points(joints))

        steady, least, best = STEADY * acceleration(written.fitted), np.inf, start
        for reach, steadiness in STEADINESS if needed.any() else ():
            beside = np.convolve(needed, np.ones(2 * reach + 1))[reach : reach + len(needed)] > 0.0
            start = self._steady(start, beside, steadiness, progress)
            now = acceleration(start)
            if now < least:
                least, best = now, start
            if least <= steady:
                break
        return best

    def _near(self, posture: HandConfiguration, needed: BoolArray, progress: Progress) -> HandConfiguration:
        """Return the nearest hand found of each frame in need, from its own and from its neighbours' corrections."""
        near, frames = self.written.fitted.copy(), np.flatnonzero(needed)
        put(near, frames, posture.at(frames))
        off = np.full(len(needed), np.inf)
        for done, (t, before) in enumerate(_forward_and_back(frames.tolist())):
            progress("nearest hands", done, 2 * len(frames))
            one, start = self.at(t), near.part(t, t + 1)
            taken = None if before is None else self._taken(one, near, before)
            if taken is not None and one.off(taken) < one.off(start) - SETTLED:
                start = taken
            elif np.isfinite(off[t]):
                continue
            found = one.nearest(start) or one.free_near(start)
            if found is not None and one.off(found) < off[t]:
                off[t] = one.off(found)
                put(near, t, found)
        return near

    def off(self, hand: HandConfiguration) -> float:
        """Return the root mean square displacement of a single frame's joints from the recorded ones [m]."""
        gone = self.written.moved(self.written.axes, hand)[0] - self.recorded[0]
        return float(np.sqrt((gone**2).sum(axis=1).mean()))

    def _taken(self, one: "Projection", near: HandConfiguration, before: int) -> HandConfiguration | None:
        """Return a frame's hand with the correction of another frame; None if it is deep inside."""
        change = change_between(self.written.fitted.part(before, before + 1), near.part(before, before + 1))
        taken = changed_hand(one.written.fitted, change)
        return taken if one.clearance(taken)[0] > -DEEPEST_START else None

    def _steady(
        self, start: HandConfiguration, may_change: BoolArray, steadiness: float, progress: Progress
    ) -> HandConfiguration:
        """Return free hands near the recorded ones whose correction is steady; `steadiness` as of `steady_step`.

        Each hand of `start` is on the side of the object on which it stays; frames of `may_change` (T,) may change.
        """
        found, frames = start.copy(), np.flatnonzero(may_change).tolist()
        ones = [self.at(t) for t in frames]
        hands = [FrameHand(one.judge, one.written, start.part(t, t + 1), frame=t) for one, t in zip(ones, frames)]
        moving = hands
        for number in range(STEADY_PROGRAMS):
            progress("programs", number, STEADY_PROGRAMS)
            change = change_between(self.written.fitted, found)
            step = steady_step([hand.program() for hand in moving], change, [h.frame for h in moving], steadiness)
            if step is None:
                break
            left = []
            for hand, own in zip(moving, step, strict=True):
                if hand.moved(own) > SETTLED or not hand.is_free():
                    left.append(hand)
                put(found, hand.frame, hand.posture)
            moving = left
            if not moving:
                break
        for hand in moving:
            if not hand.is_free():
                free = hand.found or self.at(hand.frame).free_near(hand.posture)
                put(found, hand.frame, free or start.part(hand.frame, hand.frame + 1))
        return found

    def nearest(self, start: HandConfiguration) -> HandConfiguration | None:
        """Return the free hand nearest to a single recorded one, on the side of a start; None if there is none."""
        hand = FrameHand(self.judge, self.written, start)
        for _ in range(PROGRAMS):
            change = _step(hand)
            if change is None or (hand.moved(change) < SETTLED and hand.is_free()):
                break
        hand.is_free()
        return hand.found

    def free_near(self, goal: HandConfiguration) -> HandConfiguration | None:
        """Return the first free hand that is found near a goal of a single frame; None if there is none.

        The programs lead to it, or the least shift along 26 directions does.
        """
        hand = FrameHand(self.judge, self.written, goal, goal)
        for _ in range(PROGRAMS):
            change = _step(hand)
            if change is None:
                break
            hand.moved(change)
            if hand.is_free():
                return hand.posture
        best, found = LONGEST_SHIFT, None
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
                clearance = float(self.clearance(moved)[0])
                if clearance >= CLEAR:
                    best, found = shift, moved
                    break
                shift += max(1e-4, CLEAR - clearance)
        return found


def _step(hand: FrameHand) -> FloatArray | None:
    """Return the next change of a hand by itself, shape (26,); None if its rows contradict each other."""
    at = hand.program()
    # In these variables the Hessian is the identity.
    root = np.linalg.cholesky(at.hessian)
    rows, target = np.linalg.solve(root, at.rows.T).T, np.linalg.solve(root, at.pull)
    solution = solve_active_set(QpProblem(np.ones(len(root)), rows, at.bounds, target), RELAXATION)
    if solution.status is not QpStatus.OPTIMAL:
        return None
    return np.asarray(np.linalg.solve(root.T, solution.x)[:NUMBERS])


def _forward_and_back(frames: list[int]) -> Iterator[tuple[int, int | None]]:
    """Yield frames forward and backward, each with the one before if that is its neighbour."""
    for order in (frames, frames[::-1]):
        for k, t in enumerate(order):
            yield t, order[k - 1] if k and abs(order[k - 1] - t) == 1 else None
