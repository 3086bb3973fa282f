"""Written hand of one frame on its way to the nearest one outside the object, program by program.

A program is the least displacement of the joints with the distances of balls along the bones linearised. A step is
shortened where it turns back, since the surface bends more than the rows say.
"""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.repair.hand_change import NUMBERS, change_between, changed_hand
from hhsim.repair.steady_program import FrameProgram
from hhsim.repair.tracks import CLEAR, HandJudge
from hhsim.repair.written_hand import JOINTS, TIPS, WrittenHand
from hhsim.solver.options import Stiffness

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
            tip = (judge.distances(wanted[TIPS.ravel()])[0].reshape(TIPS.shape) - radii[TIPS]).min(axis=1)
            self.touch[tip <= TOUCHES] = np.maximum(TOUCH, tip[tip <= TOUCHES]) - CLOSER
        self.posed = written.posed(start)
        self.points, self.radii, self.motion = written.samples(self.posed)
        # No ball is nearer than when it was measured by more than it has moved since.
        self.nearest, self.way = np.full(len(self.points), -np.inf), np.zeros_like(self.points)

    def program(self) -> FrameProgram:
        """Return Gauss and Newton's program of the joints, with the distances of near balls linearised."""
        from scipy.linalg import block_diag

        touching = np.flatnonzero(np.isfinite(self.touch))
        asked = self.nearest < self.range
        asked[TIPS[touching]] = True
        distance, normal = self.judge.distances(self.points[asked])
        self.nearest[asked] = value = distance - self.radii[asked]
        slopes = np.einsum("ni,nij->nj", normal, self.motion[asked])
        near = (value < self.range) & (np.abs(distance) > 1e-9)
        tips = TIPS[touching, self.nearest[TIPS[touching]].argmin(axis=1)]
        wishes, slack = slopes[(np.cumsum(asked) - 1)[tips]], np.eye(len(tips))
        along = np.concatenate([self.motion[JOINTS].reshape(-1, NUMBERS), ORIGIN])
        off = np.append((self.wanted - self.points[JOINTS]).ravel(), (self.goal.position - self.posture.position)[0])
        hessian = JOINT_STIFFNESS * along.T @ along + np.diag(REST)
        pull = JOINT_STIFFNESS * off @ along + REST * change_between(self.posture, self.goal)[0]
        return FrameProgram(
            block_diag(hessian, TOUCH_STIFFNESS * slack),
            np.append(pull, np.zeros(len(tips))),
            np.block([[slopes[near], np.zeros((near.sum(), len(tips)))], [-wishes, slack]]),
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
        free = bool(self.judge.placed_clearance(self.posed.placed)[0] >= CLEAR)
        if free:
            self.found = self.posture
        return free
