"""Object pose at which the fingers of a recorded grasp close on the object, whichever fingers take part.

The grasp is the moment when the fingers have closed furthest while the palm is slow. With the fingertips still open by
a lead, the object is brought against the hand from outside: along the palm's normal, the fingers' stroke or the palm's
path, upright at some turn about the vertical; from there the recorded fingers close into it. Best is the candidate that
most of the closing fingers enter, a little and from two sides, with palm and start of the recording outside. If no
finger ever closes, the object goes to the fingertips of the deepest flexion. Nothing is random.
"""

from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.kernels.hand import finger_closure as kernel
from hhsim.kernels.hand.kinematics import BODY_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.motion.trajectory import Trajectory
from hhsim.reproducible import across, matmul, norm
from hhsim.scene.finger_closure import body_distances, make_work
from hhsim.trees.sphere_tree import SphereTree

WINDOW = 1.5
"""A closing that takes longer than this [s] is two motions."""
SLOW = 0.3
"""Palm speed [m/s] that halves the weight of a closing."""
CLOSED = 0.5
"""Sum of the flexions of a finger's joints [rad] from which it closes; the thumb alone grasps nothing."""
SHARE = 0.3
"""A finger takes part if it bends by this share of the one that bends most."""
LEADS = (0.006, 0.015, 0.04, 0.1)
"""Distances of the fingertips from where they close [m] when the object meets the hand."""
LEAST_WAY = 0.003
"""A shorter path [m] has no direction."""
PUSH = 0.006
"""Commanded depth [m] of the hand where no finger closes."""
OFFSETS = ((0.0, 0.0), (0.25, 0.0), (-0.25, 0.0), (0.0, 0.25), (0.0, -0.25))
"""Offsets of the hand across the object, as shares of its width."""
LOOKS = 32
"""Number of samples of the recording at which a candidate is evaluated."""
FINALISTS = 60
"""Number of candidates evaluated over the whole recording; the others only at its start and at the grasp."""
WANTED_DEPTH = 0.004
"""Depth [m] of a finger at the grasp that scores in full."""
MOST_DEPTH = 0.012
"""Depth [m] from which a finger is too deep."""
IN = 0.0005
"""A finger this deep [m] in the object at the grasp is named."""


TURNS = 12
"""Number of turns of the object about the vertical."""
START_GAP = 0.002
"""Least distance [m] of the hand at the start."""


class Candidate(NamedTuple):
    """A placement in the object's frame: turn of the object [rad], shift of the hand [m], shape (3,), and score."""

    turn: float
    shift: FloatArray
    score: float


class Grasp(NamedTuple):
    """Closest grasp of a recording: its sample, the indices of its fingers, and whether any finger closes."""

    sample: int
    fingers: tuple[int, ...]
    closes: bool


class GraspPlacement(NamedTuple):
    """An object placed at a recorded grasp."""

    motion: Trajectory  # recording, with the object's pose
    grasp: Grasp  # grasp at which the object was placed
    time: float  # time of the grasp from the first sample on [s]
    fingers: tuple[str, ...]  # fingers that are in the object then
    depth: float  # depth of the deepest of them [m]
    start_gap: float  # distance of the hand from the object at the first sample [m]; negative where it begins inside

    @property
    def text(self) -> str:
        """Placement in one line."""
        who = " and ".join(filter(None, [", ".join(self.fingers[:-1]), *self.fingers[-1:]])) or "no finger"
        verb = "close on it" if len(self.fingers) > 1 else "closes on it"
        if not self.grasp.closes:
            verb = f"{'are' if len(self.fingers) > 1 else 'is'} in it at the deepest flexion, since no finger closes,"
        begins = (
            f"the hand begins {1e3 * self.start_gap:.0f} mm away"
            if self.start_gap > 0.0
            else "the hand begins in it, nowhere could it begin free"
        )
        return f"object placed where {who} {verb} at {self.time:.2f} s, {1e3 * self.depth:.1f} mm deep; {begins}"

    def to_json(self) -> dict[str, Any]:
        """Return the placement as plain values, SI."""
        return {
            "how": "closing fingers" if self.grasp.closes else "deepest flexion",
            "text": self.text,
            "sample": self.grasp.sample,
            "time": self.time,
            "fingers": list(self.fingers),
            "depth": self.depth,
            "start_gap": self.start_gap,
            "position": self.motion.object_position.tolist(),
            "orientation": self.motion.object_orientation.tolist(),
        }


def find_grasp(motion: Trajectory) -> Grasp:
    """Find the sample at which a recorded hand has closed furthest while its palm is slow."""
    stamps = motion.time - motion.time[0]
    bend = motion.flexion.sum(axis=2)
    first = np.searchsorted(stamps, stamps - WINDOW)
    rise = bend - np.stack([bend[a : t + 1].min(axis=0) for t, a in enumerate(first.tolist())])
    # The palm's speed over a tenth of a second around each sample.
    before = np.searchsorted(stamps, stamps - 0.05)
    after = np.minimum(np.searchsorted(stamps, stamps + 0.05), len(stamps) - 1)
    span = np.maximum(stamps[after] - stamps[before], 1e-3)
    speed = np.linalg.norm(motion.position[after] - motion.position[before], axis=1) / span
    sample = int(np.argmax(rise.sum(axis=1) * (1.0 / (1.0 + speed / SLOW))))
    most = float(rise[sample].max())
    if rise[sample, 1:].max() < CLOSED:
        return Grasp(int(np.argmax(bend.sum(axis=1))), tuple(range(len(FINGERS))), False)
    return Grasp(sample, tuple(np.flatnonzero(rise[sample] >= SHARE * most).tolist()), True)


def place_at_grasp(motion: Trajectory, hand: HandModel, tree: SphereTree) -> GraspPlacement:
    """Place an object (`tree`, own frame, z up) where a recording's fingers close; TrajectoryError if none meets it."""
    grasp = find_grasp(motion)
    search = _Search(motion, hand, tree, grasp)
    best = search.best()
    if best is None:
        when = motion.time[grasp.sample] - motion.time[0]
        raise TrajectoryError(
            f"{motion.name or 'the motion'}: no finger meets this object at the grasp, at {when:.2f} s"
        )
    distance = search.distances(best, np.array([0, grasp.sample]))
    depth = -distance[1, :PALM_BODY].reshape(len(FINGERS), PHALANX_COUNT).min(axis=1)
    return GraspPlacement(
        motion=motion.placed(
            -matmul(_upright_turn(best.turn), best.shift), quaternion(np.array([0.0, 0.0, best.turn]))
        ),
        grasp=grasp,
        time=float(motion.time[grasp.sample] - motion.time[0]),
        fingers=tuple(finger for finger, deep in zip(FINGERS, depth) if deep > IN),
        depth=float(max(0.0, depth.max())),
        start_gap=float(distance[0].min()),
    )


def _upright_turn(angle: float) -> FloatArray:
    """Return the rotation matrix of an angle [rad] about the vertical, shape (3, 3)."""
    return rotation_matrix(quaternion(np.array([0.0, 0.0, angle])))


class _Search:
    def __init__(self, motion: Trajectory, hand: HandModel, tree: SphereTree, grasp: Grasp) -> None:
        self.motion, self.grasp = motion, grasp
        self.work = make_work(hand.arrays(), tree.arrays())
        self.low, self.high = tree.bounds
        self.rotation = rotation_matrix(motion.orientation)
        still = (np.zeros_like(motion.position), np.tile([1.0, 0.0, 0.0, 0.0], (motion.sample_count, 1)))
        self.tips = forward_kinematics(hand, *still, motion.flexion, motion.abduction).joints[:, :, 3]
        last = motion.sample_count - 1
        self.looks = np.unique(np.append(np.linspace(0, last, LOOKS).round().astype(np.int64), grasp.sample))

    def best(self) -> Candidate | None:
        """Return the best candidate; one whose hand begins in the object only where there is no other."""
        ends = np.array([0, self.grasp.sample])
        found = [self._scored(candidate, ends) for candidate in self._candidates()]
        leading = sorted(filter(lambda c: np.isfinite(c.score), found), key=lambda c: -c.score)[:FINALISTS]
        return max((self._scored(c, self.looks) for c in leading), key=lambda c: c.score, default=None)

    def distances(self, candidate: Candidate, samples: IntArray) -> FloatArray:
        """Signed distance of every body at some samples [m], shape (N, 16)."""
        back, motion, found = _upright_turn(candidate.turn).T, self.motion, []
        for sample in samples.tolist():
            position = matmul(back, motion.position[sample]) + candidate.shift
            rotation = matmul(back, self.rotation[sample])
            flexion, abduction = motion.flexion[sample].copy(), motion.abduction[sample].copy()
            found.append(body_distances(position, rotation, flexion, abduction, self.work))
        return np.stack(found)

    def _candidates(self) -> Iterator[Candidate]:
        middle, size = 0.5 * (self.low + self.high), float(norm(self.high - self.low))
        # No body of a hand reaches farther than its length from its own tips.
        far = size + 0.3
        gap = np.zeros(BODY_COUNT)
        approaches, push = list(self._approaches()), 0.0 if self.grasp.closes else PUSH
        for turn in 2.0 * np.pi * np.arange(TURNS) / TURNS:
            back = _upright_turn(turn).T
            palm = matmul(back, self.motion.position[self.grasp.sample])
            rotation = matmul(back, self.rotation[self.grasp.sample])
            for sample, way, over in approaches:
                flexion, abduction = self.motion.flexion[sample].copy(), self.motion.abduction[sample].copy()
                direction = matmul(back, way)
                side = across(direction)
                width = matmul(np.abs(side), self.high - self.low)
                aim = matmul(back, over)
                for offset in OFFSETS:
                    here = middle + matmul(np.array(offset) * width, side) - aim - far * direction
                    posture = palm + here, rotation, flexion, abduction
                    travel, body = kernel.advance_hand(*posture, direction, gap, 2.0 * far, self.work)
                    if body >= 0:
                        yield Candidate(turn, here + (travel + push) * direction, 0.0)

    def _approaches(self) -> Iterator[tuple[int, FloatArray, FloatArray]]:
        """Yield ways of the hand to the object: the sample of its posture, a unit direction, world, and a point [m].

        That point of the hand comes over the object's middle.
        """
        g, closure = self.grasp.sample, list(self.grasp.fingers)
        palm, rotation = self.motion.position[g], self.rotation[g]
        # The palm of the grasp, with fingers as open as they were: so the palm's own way does not count as closing.
        tips = palm + matmul(self.tips, rotation.T)
        earlier = int(np.searchsorted(self.motion.time, self.motion.time[g] - 0.2))
        for k in sorted({self._before(lead) for lead in LEADS}) if self.grasp.closes else [g]:
            stroke = (tips[g] - tips[k])[closure].mean(axis=0)
            ways = [-rotation[:, 2], rotation[:, 1], stroke, palm - self.motion.position[earlier]]
            middle = tips[k, closure].mean(axis=0)
            aims = [middle, 0.5 * (middle + tips[k, 0]), 0.5 * (middle + palm)]
            for way, aim in product(ways, aims):
                length = float(norm(way))
                if length > LEAST_WAY:
                    yield k, way / length, aim

    def _before(self, lead: float) -> int:
        """Last sample before the grasp at which the closing tips are still `lead` from where they close."""
        g, closure = self.grasp.sample, list(self.grasp.fingers)
        off = np.linalg.norm(self.tips[: g + 1, closure] - self.tips[g, closure], axis=2).mean(axis=1)
        return int(np.flatnonzero(off >= lead).max(initial=0))

    def _scored(self, candidate: Candidate, samples: IntArray) -> Candidate:
        distance = self.distances(candidate, samples)
        here = int(np.flatnonzero(samples == self.grasp.sample)[-1])
        depth = np.maximum(0.0, -distance)
        finger = depth[here, :PALM_BODY].reshape(len(FINGERS), PHALANX_COUNT).max(axis=1)
        if finger.max() < IN:
            return candidate._replace(score=-np.inf)
        within = np.minimum(finger / WANTED_DEPTH, 1.0)
        closure = list(self.grasp.fingers)
        score = 10.0 * within[closure].mean()
        # From two sides: a thumb against a finger holds, fingers alone push.
        score += 3.0 * within[0] * within[1:].max()
        score -= 3.0 * float(np.maximum(0.0, depth[here] - MOST_DEPTH).max()) / MOST_DEPTH
        score -= 4.0 * float(depth[here, PALM_BODY]) / MOST_DEPTH
        # Whatever else the hand does, it does beside the object, where that is possible.
        score -= 4.0 * float(np.delete(depth.max(axis=1), here).sum()) / (MOST_DEPTH * len(samples))
        # A hand that begins in the object is a last resort.
        if distance[0].min() < START_GAP:
            score -= 100.0
        return candidate._replace(score=float(score))
