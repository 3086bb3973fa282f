"""Closing a hand on an object: where the palm goes and how far the fingers flex, from distances alone.

For each of a fixed set of palm directions around the object, the open hand comes near until the palm is as close as
wanted, and the named fingers close until they touch. The best of these grasps is kept: all named fingers reach the
object and press into it, everything else keeps its distance, the palm is where it should be, the fingers oppose each
other and keep hold in a slide, and the hand comes from above or the side. Nothing is random and no solver takes part.
"""

import copy
import hashlib
import math
from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import DEFAULT_HAND_LENGTH, HandModel
from hhsim.kernels.hand import finger_closure as kernel
from hhsim.kernels.hand.kinematics import BODY_COUNT, PALM_BODY
from hhsim.scene.finger_closure import Closer, FingerClosure, body_distances
from hhsim.scene.hand_moves import level
from hhsim.scene.script import Script, ScriptPhase
from hhsim.scene.slide import best_slide
from hhsim.trees.sphere_tree import SphereTree

OPEN_SHARE = 0.6
"""The open hand is extended to this share of the joints' range beyond straight."""
FIST_SHARE = 0.6
"""A hand that closes in the air flexes to this share of the joints' range."""

NEAR_PALM = 0.02
"""Up to this gap [m] the palm is aimed at the object's middle; beyond it the fingertips are."""
PALM_AIMS = ((0.0, 0.02), (0.0, 0.0), (0.0, 0.04), (0.012, 0.02), (0.012, 0.0), (-0.012, 0.02))
FINGERTIP_AIMS = ((0.0, 0.0), (0.0, -0.015), (0.0, 0.015), (0.015, 0.0), (-0.015, 0.0))
"""Where the object's middle may lie under the palm or the fingertips: x and y in the palm frame [m]."""
ROLLS = 8
"""Directions of the fingers tried for each palm direction."""
LEADERS = 8
"""Candidates that the next round starts from."""
TILT = math.radians(15.0)
"""Turn of the last round about each palm axis: a third of the first round's steps."""

TABLE_WEIGHT = 40.0
"""A hand that goes down to the table as far as `UNDER` is as bad as one that reaches with no finger."""
LEVEL_WEIGHT = 20.0
"""So bad is a push straight down on what is to be moved."""
OPPOSE_WEIGHT = 20.0
"""So good is a grasp of it whose thumb pushes against the fingers."""
SLIDE_WEIGHT = 40.0
"""A slide that loses all fingers is as bad as a grasp that reaches with none."""

MARGIN = 0.002
"""Fingers that will touch keep this distance [m] while the open hand comes near."""
UNDER = 0.02
"""A joint this far [m] below the object's lowest point is as bad as any lower one."""
IDLE_DISTANCE = 0.04
"""Fingers that do not take part are out of the way at this distance [m]."""
BEARING = 0.005
"""The palm rests on the object with the spheres that are this near [m] when the first one touches."""

KEPT = 64
"""Closures that a process remembers."""

_found: dict[tuple[Script, bytes], tuple[FingerClosure, float]] = {}


@dataclass(frozen=True, eq=False)
class _Candidate:
    """What was tried: a palm orientation and the point of the palm frame that is brought over the object's middle."""

    rotation: FloatArray
    aim: FloatArray
    score: float
    closure: FingerClosure


def plan_finger_closure(script: Script, hand: HandModel, tree: SphereTree) -> FingerClosure:
    """Find how the hand of a script closes on an object.

    Args:
        script: Which fingers close, how deep, and where the palm is.
        hand: The hand.
        tree: The object at rest, world frame; its leaves are what is touched.

    Raises:
        TrajectoryError: No named finger reaches the object from any side, or the palm cannot touch it.
    """
    closure, bound = _searched(_closing(script), hand, tree)
    across = f"the object, {2.0 * bound:.3g} m across"
    if script.contact and not closure.reached:
        raise TrajectoryError(f"script {script.name}: {', '.join(script.fingers)} cannot reach {across}, from any side")
    if script.palm_depth > 0.0 and closure.distance[PALM_BODY] >= 0.0:
        raise TrajectoryError(f"script {script.name}: the palm cannot touch {across}, from any side")
    return closure


def _closing(script: Script) -> Script:
    """Of a script, what the search may depend on: not its name, its times, its noise or its places."""
    slides = ScriptPhase("slide", 1.0, distance=script.slide_distance)
    pushes = (ScriptPhase("push", 1.0, distance=script.push_distance),) if script.push_distance > 0.0 else ()
    moves = (ScriptPhase("lift", 1.0),) if script.moves_object else ()
    return Script(
        name="",
        phases=(ScriptPhase("grasp", 1.0, fingers=script.fingers), slides, *pushes, *moves),
        contact=script.contact,
        depth=script.depth,
        clearance=script.clearance,
        palm_gap=script.palm_gap,
        palm_depth=script.palm_depth,
        curl=script.curl,
    )


def _searched(script: Script, hand: HandModel, tree: SphereTree) -> tuple[FingerClosure, float]:
    """What the search finds, and the object's radius [m]; searched once in a process, for however many replays."""
    arrays = hashlib.blake2b()
    for values in (*hand.arrays(), *tree.arrays()):
        arrays.update(np.asarray(values).tobytes())
    question = script, arrays.digest()
    if question not in _found:
        search = _Search(script, hand, tree)
        if len(_found) == KEPT:
            del _found[next(iter(_found))]
        _found[question] = search.best(), search.bound
    closure, bound = _found[question]
    return copy.deepcopy(closure), bound


@cache
def _orientations() -> tuple[FloatArray, ...]:
    """Palm to world: its back in each of the 26 directions to a cube's neighbours, the fingers all round."""
    found: list[FloatArray] = []
    for triple in product((1.0, 0.0, -1.0), repeat=3):
        if triple == (0.0, 0.0, 0.0):
            continue
        z = np.array(triple) / np.linalg.norm(triple)
        across = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        across /= np.linalg.norm(across)
        for roll in range(ROLLS):
            angle = 2.0 * math.pi * roll / ROLLS
            y = math.cos(angle) * across + math.sin(angle) * np.cross(z, across)
            found.append(np.column_stack([np.cross(y, z), y, z]))
    return tuple(found)


def _tilts() -> list[FloatArray]:
    """Turns about each palm axis, both ways, shape (3, 3) each."""
    turns = []
    for axis, sign in product(range(3), (1.0, -1.0)):
        turn = np.eye(3)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn[i, i] = turn[j, j] = math.cos(TILT)
        turn[j, i], turn[i, j] = sign * math.sin(TILT), -sign * math.sin(TILT)
        turns.append(turn)
    return turns


def _leading(candidates: list[_Candidate]) -> list[_Candidate]:
    """The best ones, best first; the earlier one of equals, where rounding does not tell symmetric grasps apart."""
    return sorted(candidates, key=lambda candidate: -round(candidate.score, 6))[:LEADERS]


class _Search(Closer):
    """The candidates and their evaluation for one script, hand and object."""

    def __init__(self, script: Script, hand: HandModel, tree: SphereTree) -> None:
        super().__init__(script, hand, tree)
        low, high = tree.bounds
        self.middle = 0.5 * (low + high)
        self.floor = float(low[2])
        self.half_height = 0.5 * float(high[2] - low[2])
        self.bound = float((np.linalg.norm(tree.leaf_center - self.middle, axis=1) + tree.leaf_radius).max())
        finger_reach = float((self.hand.reach + self.hand.radius[:, :3]).max())
        self.reach = max(finger_reach, float(self.hand.palm_reach[0] + self.hand.palm_radius.max()))
        self.abduction = np.zeros(len(FINGERS))
        self.open = np.ascontiguousarray(OPEN_SHARE * np.minimum(hand.flexion_min, 0.0))
        self.fist = self.open + FIST_SHARE * (hand.flexion_max - self.open)
        self.gap = self._gaps()
        self.aims = self._aims(hand.hand_length / DEFAULT_HAND_LENGTH)

    def best(self) -> FingerClosure:
        """Every direction at the first aim, then the best directions at every aim, then the best of those tilted."""
        found = [self._evaluate(rotation.copy(), self.aims[0]) for rotation in _orientations()]
        found += [self._evaluate(leader.rotation, aim) for leader in _leading(found) for aim in self.aims[1:]]
        found += [self._evaluate(leader.rotation @ tilt, leader.aim) for leader in _leading(found) for tilt in _tilts()]
        leaders = _leading(found)
        if self.script.push_distance > 0.0:
            return replace(leaders[0].closure, slide=self._pressing(leaders[0].closure))
        return self._with_slide(leaders) if self.script.slide_distance > 0.0 else leaders[0].closure

    def _pressing(self, closure: FingerClosure) -> FloatArray:
        """Where the closing fingers press, level: the unit direction in which they push, shape (3,)."""
        tips = []
        for flexion in (closure.contact, closure.command):
            self._distances(closure.position, closure.rotation, flexion)
            tips.append(self.work.joints[self.fingers, 3].mean(axis=0))
        return level(tips[1] - tips[0], -closure.back)

    def _with_slide(self, leaders: list[_Candidate]) -> FingerClosure:
        """The leader that slides best, with the direction in which it does."""
        script = self.script
        best, best_score = leaders[0].closure, -math.inf
        for leader in leaders:
            direction, share = best_slide(script, leader.closure, self.hand, self.tree)
            if leader.score + SLIDE_WEIGHT * share > best_score + 1e-6:
                best_score = leader.score + SLIDE_WEIGHT * share
                best = replace(leader.closure, slide=direction)
        return best

    def _gaps(self) -> FloatArray:
        """Distance that each body keeps [m] while the open hand comes near, shape (16,)."""
        script = self.script
        gap = np.full(BODY_COUNT, script.clearance + MARGIN)
        touches = script.palm_depth > 0.0
        for finger in self.fingers:
            gap[3 * finger : 3 * finger + 3] = 0.0 if touches else MARGIN
        if script.contact:
            gap[PALM_BODY] = 0.0 if touches else max(script.palm_gap, script.clearance)
        return gap

    def _aims(self, scale: float) -> list[FloatArray]:
        """Points of the palm plane that may come over the object's middle [m], palm frame, shape (3,) each."""
        middle = np.zeros(3)
        offsets: tuple[tuple[float, float], ...] = PALM_AIMS
        if self.fingers and self.script.palm_gap > NEAR_PALM and self.script.palm_depth == 0.0:
            half_closed = self.open + 0.7 * self.rates
            self._distances(np.zeros(3), np.eye(3), half_closed)
            middle, offsets = self.work.joints[self.fingers, 3].mean(axis=0) * [1.0, 1.0, 0.0], FINGERTIP_AIMS
        side = self.hand.abduction_sign[0]
        return [middle + scale * np.array([side * x, y, 0.0]) for x, y in offsets]

    def _distances(self, position: FloatArray, rotation: FloatArray, flexion: FloatArray) -> FloatArray:
        return body_distances(self.hand, self.tree, position, rotation, flexion, self.abduction, self.work)

    def _evaluate(self, rotation: FloatArray, aim: FloatArray) -> _Candidate:
        """Bring the open hand near along the palm's normal, close the fingers, command them deeper."""
        rotation = np.ascontiguousarray(rotation)
        back = np.ascontiguousarray(rotation[:, 2])
        # From here no body can reach the object, whatever the posture.
        far = self.bound + self.reach + float(np.linalg.norm(aim)) + float(self.gap.max())
        start = self.middle - rotation @ aim + far * back
        # A hand that must not touch keeps clear in every stage of closing in the air.
        stages = [0.0] if self.script.contact else np.linspace(0.0, 1.0, 9)
        travel, blocking = 2.0 * far, -1
        for stage in stages:
            posture = self.open + stage * (self.fist - self.open)
            distance, body = kernel.advance_hand(
                self.hand, self.tree, start, rotation, posture, self.abduction, -back, self.gap, travel, self.work
            )
            if body >= 0:
                travel, blocking = distance, body
        position = start - travel * back
        unclosed = None if self.script.contact else self.fist
        place = position, rotation, back
        closure = self.closed(place, self.open, self.abduction, np.zeros(3), self.fingers, unclosed)
        score = self._score(closure) if blocking >= 0 else -math.inf
        return _Candidate(rotation, aim, score, closure)

    def _score(self, closure: FingerClosure) -> float:
        """How good a grasp is; the weights order the wishes, from reaching at all down to looks."""
        upward = float(closure.rotation[2, 2])
        # From above or the side rather than from below, where a table would be.
        score = 0.5 * upward - 3.0 * max(0.0, -upward)
        if not self.fingers:
            return score
        score += 40.0 * len(closure.reached) / len(self.fingers)
        at_contact = self._distances(closure.position, closure.rotation, closure.contact)
        palm_excess = float(at_contact[PALM_BODY] - self.gap[PALM_BODY])
        if self.script.palm_depth > 0.0:
            score -= min(40.0, palm_excess / 2e-4)
            score += 6.0 * self._bearing(closure)
        else:
            score -= min(10.0, palm_excess / 0.005)
        before = self.work.joints.copy()
        # No finger goes under the object, through what it stands on.
        score -= 4.0 * min(1.0, max(0.0, self.floor - float(before[..., 2].min())) / UNDER)
        if self.script.moves_object:
            # Nor through the table on which a free object stands.
            lowest = float((before[..., 2] - self.hand.radius).min())
            score -= TABLE_WEIGHT * min(1.0, max(0.0, self.floor - lowest) / UNDER)
        normals: list[tuple[int, int, FloatArray]] = []
        for f in self.fingers:
            for k in np.flatnonzero(closure.touching[f]).tolist():
                normal = np.empty(3)
                kernel.contact_normal(self.hand, self.tree, f, k, self.work, normal)
                normals.append((f, k, normal))
        if not normals:
            return score
        self._distances(closure.position, closure.rotation, closure.command)
        moved = self.work.joints - before
        # The command goes straight into the surface instead of grazing it.
        push = np.zeros(len(FINGERS))
        for f, phalanx, normal in normals:
            push[f] = max(push[f], -float(moved[f, phalanx + 1] @ normal))
        score += 8.0 * float(np.clip(push[self.fingers] / max(self.script.depth, 1e-6), 0.0, 1.0).mean())
        if self.script.moves_object:
            # What is moved is held level and about its middle; what is pushed need not be held from two sides.
            steep = float(np.mean([abs(normal[2]) for _, _, normal in normals]))
            high = float(np.mean([abs(before[f, k + 1, 2] - self.middle[2]) for f, k, _ in normals])) / self.half_height
            score -= LEVEL_WEIGHT * (steep + 0.5 * min(1.0, high))
        if self.script.push_distance > 0.0:
            return score
        # The fingers oppose each other instead of pushing the object away.
        oppose = OPPOSE_WEIGHT if self.script.moves_object else 4.0
        score += oppose * (1.0 - self._one_sided(normals))
        # Fingers that do not take part are well out of the way.
        idle = [f for f in range(len(FINGERS)) if f not in self.fingers]
        if idle:
            away = float(closure.distance[:PALM_BODY].reshape(len(FINGERS), 3)[idle].min())
            score += 4.0 * min(1.0, away / IDLE_DISTANCE)
        # The pads touch, and more phalanges hold better than fewer.
        touching = closure.touching[self.fingers]
        return score + 3.0 * float(touching[:, 2].mean()) + 6.0 * float(touching.mean())

    def _one_sided(self, normals: list[tuple[int, int, FloatArray]]) -> float:
        """How far the fingers push to one side: 0 where the thumb holds against all others, 1 where all push alike.

        For what is to be moved, the thumb's side counts as much as that of all fingers together.
        """
        if not self.script.moves_object:
            return float(np.linalg.norm(np.mean([normal for _, _, normal in normals], axis=0)))
        sides = [[normal for f, _, normal in normals if (f == 0) == thumb] for thumb in (True, False)]
        if not all(sides):
            return 1.0
        mean = [np.mean(side, axis=0) for side in sides]
        return float(np.linalg.norm(0.5 * (mean[0] + mean[1])))

    def _bearing(self, closure: FingerClosure) -> float:
        """Share of the palm's spheres that lie within `BEARING` of the object where the palm touches it."""
        centers = np.column_stack([self.hand.palm_x, self.hand.palm_y, self.hand.palm_z])
        near = [
            kernel.sphere_distance(self.tree, closure.position + closure.rotation @ center, radius, BEARING, self.work)
            < BEARING
            for center, radius in zip(centers, self.hand.palm_radius)
        ]
        return float(np.mean(near))
