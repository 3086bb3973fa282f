"""Where an object has to stand so that a recorded grasp closes on it, whichever fingers take part.

A recording of a bare hand tells where its fingers close, and not on what. The moment of the grasp is where the fingers
have closed furthest while the palm is slow. Some way before it, with the fingertips still open by a lead, the object is
brought against the hand from outside: along the palm's normal, the fingers' stroke or the palm's way, upright in some
turn about the vertical. From there the recorded fingers close on into it. Of all candidates the best is the one that
most of the closing fingers sink into, a little and from two sides, and that neither the start of the recording nor the
palm is in. A recording whose fingers never close is placed at the fingertips of its deepest flexion. Nothing is random.
"""

from collections.abc import Iterator
from dataclasses import dataclass
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
from hhsim.scene.finger_closure import body_distances, make_work
from hhsim.scene.object_pose import START_GAP, across
from hhsim.trees.sphere_tree import SphereTree

WINDOW = 1.5
"""A closing that takes longer than this [s] is two motions."""
SLOW = 0.3
"""A palm of this speed [m/s] halves what a closing counts."""
CLOSED = 0.5
"""A finger closes whose three joints together bend by this [rad]; the thumb alone grasps nothing."""
SHARE = 0.3
"""A finger takes part that bends by this share of what the one does that bends most."""
LEADS = (0.006, 0.015, 0.04, 0.1)
"""How far the fingertips still have to go [m] when the object meets the hand."""
LEAST_WAY = 0.003
"""A shorter way [m] has no direction."""
PUSH = 0.006
"""Where the fingers do not close, the hand is commanded this deep [m]."""
TURNS = 12
"""Turns about the vertical that are tried."""
OFFSETS = ((0.0, 0.0), (0.25, 0.0), (-0.25, 0.0), (0.0, 0.25), (0.0, -0.25))
"""Places of the hand across the object, as shares of its width."""
LOOKS = 32
"""Samples of the recording at which a candidate is looked at."""
FINALISTS = 60
"""Candidates that are looked at over the whole recording; the others only at its start and at the grasp."""
WANTED_DEPTH = 0.004
"""A finger that sinks in this deep [m] at the grasp is in."""
MOST_DEPTH = 0.012
"""Deeper than this [m] is no longer a bit."""
IN = 0.0005
"""A finger this deep [m] in the object at the grasp is named."""


class Grasp(NamedTuple):
    """The closest grasp of a recording.

    Attributes:
        sample: Where the fingers have closed furthest.
        fingers: Those that take part, by number.
        closes: Whether any finger closes.
    """

    sample: int
    fingers: tuple[int, ...]
    closes: bool


@dataclass(frozen=True)
class GraspPlacement:
    """An object placed at a recorded grasp.

    Attributes:
        motion: The recording, with the object's pose.
        grasp: Where the object was put.
        time: Of the grasp, from the first sample on [s].
        fingers: Those that are in the object then.
        depth: How deep the deepest of them is [m].
        start_gap: Distance of the hand to the object at the first sample [m]; negative where it begins inside.
    """

    motion: Trajectory
    grasp: Grasp
    time: float
    fingers: tuple[str, ...]
    depth: float
    start_gap: float

    @property
    def text(self) -> str:
        """The placement in one line."""
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
        """For machines: SI units."""
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
    """The moment at which a recorded hand has closed furthest while its palm is slow."""
    stamps = motion.time - motion.time[0]
    bend = motion.flexion.sum(axis=2)
    rise = bend - _least_before(bend, stamps)
    slowness = 1.0 / (1.0 + _palm_speed(motion.position, stamps) / SLOW)
    sample = int(np.argmax(rise.sum(axis=1) * slowness))
    most = float(rise[sample].max())
    if rise[sample, 1:].max() < CLOSED:
        return Grasp(int(np.argmax(bend.sum(axis=1))), tuple(range(len(FINGERS))), False)
    return Grasp(sample, tuple(np.flatnonzero(rise[sample] >= SHARE * most).tolist()), True)


def place_at_grasp(motion: Trajectory, hand: HandModel, tree: SphereTree) -> GraspPlacement:
    """Put an object where the fingers of a recording close.

    Args:
        motion: Of a hand, without regard for its object pose.
        tree: The object at rest in its own frame, z up.

    Raises:
        TrajectoryError: No finger meets the object from any side.
    """
    grasp = find_grasp(motion)
    search = _Search(motion, hand, tree, grasp)
    best = search.best()
    if best is None:
        raise TrajectoryError(
            f"{motion.name or 'the motion'} cannot be placed at this object: at the grasp, at "
            f"{motion.time[grasp.sample] - motion.time[0]:.2f} s, no finger meets it"
        )
    turn = quaternion(np.array([0.0, 0.0, best.turn]))
    distance = search.distances(best, np.array([0, grasp.sample]))
    depth = -distance[1, :PALM_BODY].reshape(len(FINGERS), PHALANX_COUNT).min(axis=1)
    # In the object's frame a point is Rᵀ p + shift, so the object's own origin is at -R shift.
    return GraspPlacement(
        motion=motion.placed(-(rotation_matrix(turn) @ best.shift), turn),
        grasp=grasp,
        time=float(motion.time[grasp.sample] - motion.time[0]),
        fingers=tuple(finger for finger, deep in zip(FINGERS, depth) if deep > IN),
        depth=float(max(0.0, depth.max())),
        start_gap=float(distance[0].min()),
    )


def _least_before(bend: FloatArray, stamps: FloatArray) -> FloatArray:
    """The least of each column over the `WINDOW` up to each sample."""
    first = np.searchsorted(stamps, stamps - WINDOW)
    return np.stack([bend[a : t + 1].min(axis=0) for t, a in enumerate(first.tolist())])


def _palm_speed(position: FloatArray, stamps: FloatArray) -> FloatArray:
    """Speed of the palm over a tenth of a second around each sample [m/s]."""
    first = np.searchsorted(stamps, stamps - 0.05)
    last = np.minimum(np.searchsorted(stamps, stamps + 0.05), len(stamps) - 1)
    span = np.maximum(stamps[last] - stamps[first], 1e-3)
    speed: FloatArray = np.linalg.norm(position[last] - position[first], axis=1) / span
    return speed


class _Candidate(NamedTuple):
    """A placement in the object's frame: the turn of the object, the hand's shift, and how good it is."""

    turn: float
    shift: FloatArray
    score: float


class _Approach(NamedTuple):
    """How the object is brought against the hand of the grasp.

    Attributes:
        sample: That the fingers are as open as.
        direction: That the hand comes in, unit, world.
        aim: Point of the hand that comes over the object's middle [m], world.
        push: How much farther than first contact [m].
    """

    sample: int
    direction: FloatArray
    aim: FloatArray
    push: float


class _Search:
    """The candidates and their evaluation for one recording, hand and object."""

    def __init__(self, motion: Trajectory, hand: HandModel, tree: SphereTree, grasp: Grasp) -> None:
        self.motion, self.grasp = motion, grasp
        self.hand, self.nodes, self.work = hand.arrays(), tree.arrays(), make_work()
        radius = tree.leaf_radius[:, None]
        self.low, self.high = (tree.leaf_center - radius).min(axis=0), (tree.leaf_center + radius).max(axis=0)
        self.rotation = rotation_matrix(motion.orientation)
        still = (np.zeros_like(motion.position), np.tile([1.0, 0.0, 0.0, 0.0], (motion.sample_count, 1)))
        self.tips = forward_kinematics(hand, *still, motion.flexion, motion.abduction).joints[:, :, 3]
        last = motion.sample_count - 1
        self.looks = np.unique(np.append(np.linspace(0, last, LOOKS).round().astype(np.int64), grasp.sample))

    def best(self) -> _Candidate | None:
        """The best of the candidates; one whose hand begins in the object only where there is no other."""
        ends = np.array([0, self.grasp.sample])
        found = [self._scored(candidate, ends) for candidate in self._candidates()]
        met = [candidate for candidate in found if np.isfinite(candidate.score)]
        leading = sorted(met, key=lambda candidate: -candidate.score)[:FINALISTS]
        return max((self._scored(c, self.looks) for c in leading), key=lambda c: c.score, default=None)

    def distances(self, candidate: _Candidate, samples: IntArray) -> FloatArray:
        """Signed distance of every body at some samples [m], shape (N, 16)."""
        back = rotation_matrix(quaternion(np.array([0.0, 0.0, candidate.turn]))).T
        return np.stack([self._pose_distances(back, candidate.shift, int(sample)) for sample in samples])

    def _pose_distances(self, back: FloatArray, shift: FloatArray, sample: int) -> FloatArray:
        position = back @ self.motion.position[sample] + shift
        rotation = np.ascontiguousarray(back @ self.rotation[sample])
        flexion, abduction = self.motion.flexion[sample].copy(), self.motion.abduction[sample].copy()
        return body_distances(self.hand, self.nodes, position, rotation, flexion, abduction, self.work)

    def _candidates(self) -> Iterator[_Candidate]:
        middle, size = 0.5 * (self.low + self.high), float(np.linalg.norm(self.high - self.low))
        # No body of a hand reaches farther than its length from its own tips.
        far = size + 0.3
        gap = np.zeros(BODY_COUNT)
        approaches = list(self._approaches())
        for step in range(TURNS):
            turn = 2.0 * np.pi * step / TURNS
            back = rotation_matrix(quaternion(np.array([0.0, 0.0, turn]))).T
            palm = back @ self.motion.position[self.grasp.sample]
            rotation = np.ascontiguousarray(back @ self.rotation[self.grasp.sample])
            for approach in approaches:
                flexion, abduction = (
                    values[approach.sample].copy() for values in (self.motion.flexion, self.motion.abduction)
                )
                direction = np.ascontiguousarray(back @ approach.direction)
                side = across(direction)
                width = np.abs(side) @ (self.high - self.low)
                aim = back @ approach.aim
                for offset in OFFSETS:
                    goal = middle + (np.array(offset) * width) @ side
                    here = goal - aim - far * direction
                    start = palm + here
                    travel, body = kernel.advance_hand(
                        self.hand, self.nodes, start, rotation, flexion, abduction, direction, gap, 2.0 * far, self.work
                    )
                    if body >= 0:
                        yield _Candidate(turn, here + (travel + approach.push) * direction, 0.0)

    def _approaches(self) -> Iterator[_Approach]:
        g, closure = self.grasp.sample, list(self.grasp.fingers)
        palm, rotation = self.motion.position[g], self.rotation[g]
        # The palm of the grasp, with fingers as open as they were: so the palm's own way does not count as closing.
        tips = palm + np.einsum("tfj,ij->tfi", self.tips, rotation)
        earlier = int(np.searchsorted(self.motion.time, self.motion.time[g] - 0.2))
        for k in sorted({self._before(lead) for lead in LEADS}) if self.grasp.closes else [g]:
            stroke = (tips[g] - tips[k])[closure].mean(axis=0)
            ways = [-rotation[:, 2], rotation[:, 1], stroke, palm - self.motion.position[earlier]]
            middle = tips[k, closure].mean(axis=0)
            aims = [middle, 0.5 * (middle + tips[k, 0]), 0.5 * (middle + palm)]
            for way, aim in product(ways, aims):
                length = float(np.linalg.norm(way))
                if length > LEAST_WAY:
                    yield _Approach(k, way / length, aim, 0.0 if self.grasp.closes else PUSH)

    def _before(self, lead: float) -> int:
        """The last sample before the grasp at which the closing tips are still `lead` from where they close."""
        g, closure = self.grasp.sample, list(self.grasp.fingers)
        off = np.linalg.norm(self.tips[: g + 1, closure] - self.tips[g, closure], axis=2).mean(axis=1)
        return int(np.flatnonzero(off >= lead).max(initial=0))

    def _scored(self, candidate: _Candidate, samples: IntArray) -> _Candidate:
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
