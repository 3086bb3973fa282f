"""Search for a grasp: palm pose and finger flexion at which a hand closes on an object, from distances alone.

For each of a fixed set of palm directions the open hand advances until the palm is as near as wanted, and the named
fingers close until they touch. The best grasp is kept: all named fingers press into the object, everything else keeps
its distance, the fingers oppose each other and keep hold in a slide, and the hand comes from above or the side.

A search takes about a second and finds the same for the same script, hand and object: closures that were found ship for
the catalogue's objects and scripts.
"""

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import fields, replace
from functools import cache
from importlib.resources import files
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics
from hhsim.hand.model import DEFAULT_HAND_LENGTH, HandModel
from hhsim.hand.quaternion import quaternion_from_matrix
from hhsim.kernels.hand import finger_closure as kernel
from hhsim.kernels.hand.kinematics import BODY_COUNT, PALM_BODY
from hhsim.metrics.metrics import distance_of_hands
from hhsim.reproducible import across, dot, matmul, norm, sine_and_cosine
from hhsim.scene.finger_closure import OPEN_SHARE, Closer, FingerClosure, body_distances
from hhsim.scene.script import Script
from hhsim.trees.sphere_tree import SphereTree

SEARCH_VERSION = 1
"""Raised when the search finds other closures: `python -m tools.build_closures` then makes anew those that ship."""
SHIPPED = "closures.json"

Fields = dict[str, Any]
"""A closure as JSON has it: lists of numbers and names by field."""

_found: dict[str, Fields] = {}
"""Closures that this process has searched for, by their key."""

FIST_SHARE = 0.6
"""Share of the joints' range to which a hand flexes that closes in the air."""

NEAR_PALM = 0.02
"""Up to this gap [m] the palm is aimed at the object's middle; beyond it the fingertips are."""
PALM_AIMS = ((0.0, 0.02), (0.0, 0.0), (0.0, 0.04), (0.012, 0.02), (0.012, 0.0), (-0.012, 0.02))
FINGERTIP_AIMS = ((0.0, 0.0), (0.0, -0.015), (0.0, 0.015), (0.015, 0.0), (-0.015, 0.0))
"""Places of the object's middle under the palm or the fingertips: x and y in the palm frame [m]."""
ROLLS = 8
"""Number of finger directions for each palm direction."""
LEADERS = 8
"""Number of candidates that the next round starts from."""
TILT = math.radians(15.0)
"""Rotation of the last round about each palm axis: a third of the first round's steps."""

TABLE_WEIGHT = 40.0
"""Penalty of a hand that goes below the table by `UNDER`: that of a grasp that reaches with no finger."""
LEVEL_WEIGHT = 20.0
"""Penalty of a push straight down on an object that is to be moved."""
OPPOSE_WEIGHT = 20.0
"""Reward of a grasp of it whose thumb pushes against the fingers."""
SLIDE_WEIGHT = 40.0
"""Penalty of a slide that loses all fingers."""

BESIDE = 0.02
"""Distance [m] from which another hand counts as clear."""
BESIDE_WEIGHT = 60.0
"""Penalty of a grasp that touches the other hand: more than that of one that reaches with no finger."""
WAY_BACK = (1.0, 0.5, 0.25, 0.0)
"""Shares of the way back at which two hands are kept clear of each other."""

MARGIN = 0.002
"""Distance [m] that fingers which will touch keep while the open hand advances."""
UNDER = 0.02
"""Depth [m] of a joint below the object's lowest point from which the penalty is full."""
UNUSED_DISTANCE = 0.04
"""Distance [m] from which uninvolved fingers count as clear."""
BEARING = 0.005
"""The palm rests on the object with the spheres that are this near [m] when the first one touches."""

HOLDING_DEPTH = 0.002
"""A finger commanded this deep [m] surely keeps hold."""
DIRECTIONS = 16
"""Number of slide directions along the palm; the first is its own x axis."""
STATIONS = (0.25, 0.5, 0.75, 1.0)
"""Shares of the slide at which the hand is evaluated."""
UPRIGHT = 0.5
"""An axis whose level part is shorter than this share of it gives no direction on a table."""


class _Candidate(NamedTuple):
    """A palm orientation, the point of the palm frame that comes over the object's middle, and the grasp it gives."""

    rotation: FloatArray
    aim: FloatArray
    score: float
    closure: FingerClosure


class OtherHand(NamedTuple):
    """Hand that closes on the object too, and where."""

    hand: HandModel
    closure: FingerClosure


def plan_finger_closure(
    script: Script, hand: HandModel, tree: SphereTree, other: OtherHand | None = None
) -> FingerClosure:
    """Find how the hand of a script closes on an object at rest (`tree`, world frame), whose leaves are touched.

    Beside another hand, which comes and goes at the same time, it keeps clear of that. Raises TrajectoryError where no
    named finger reaches the object from any side, the palm cannot touch it, or no place is free beside the other hand.
    """
    if other is None:
        closure = kept_closure(script, hand, tree, lambda: _Search(script, hand, tree).best())
    else:
        search = _Search(script, hand, tree, other)
        closure = search.best()
        if search.gap_to_other(closure) < 0.0:
            raise TrajectoryError(f"script {script.name}: the object has no room for both hands")
    closure.require_touch(script, f"the object, {2.0 * bounding_radius(tree):.3g} m across, from any side")
    return closure


def bounding_radius(tree: SphereTree) -> float:
    """Return the radius [m] of the sphere about the middle of a tree's bounds that holds it."""
    middle = 0.5 * (tree.bounds[0] + tree.bounds[1])
    return float((np.linalg.norm(tree.leaf_center - middle, axis=1) + tree.leaf_radius).max())


@cache
def _orientations() -> tuple[FloatArray, ...]:
    """Palm to world: its back in each of the 26 directions to a cube's neighbours, the fingers all round."""
    found: list[FloatArray] = []
    for triple in product((1.0, 0.0, -1.0), repeat=3):
        if triple == (0.0, 0.0, 0.0):
            continue
        z = np.array(triple) / norm(triple)
        first, second = across(z)
        for roll in range(ROLLS):
            sine, cosine = sine_and_cosine(2.0 * math.pi * roll / ROLLS)
            y = cosine * first + sine * second
            found.append(np.column_stack([np.cross(y, z), y, z]))
    return tuple(found)


def _tilts() -> list[FloatArray]:
    turns = []
    sine, cosine = sine_and_cosine(TILT)
    for axis, sign in product(range(3), (1.0, -1.0)):
        turn = np.eye(3)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn[i, i] = turn[j, j] = cosine
        turn[j, i], turn[i, j] = sign * sine, -sign * sine
        turns.append(turn)
    return turns


def _leading(candidates: list[_Candidate]) -> list[_Candidate]:
    """Best candidates, best first; of equals the earlier one, since rounding must not decide between symmetric ones."""
    return sorted(candidates, key=lambda candidate: -round(candidate.score, 6))[:LEADERS]


class _Search(Closer):
    def __init__(self, script: Script, hand: HandModel, tree: SphereTree, other: OtherHand | None = None) -> None:
        super().__init__(script, hand, tree)
        self.model, self.other = hand, other
        low, high = tree.bounds
        self.middle = 0.5 * (low + high)
        self.floor = float(low[2])
        self.half_height = 0.5 * float(high[2] - low[2])
        self.bound = bounding_radius(tree)
        finger_reach = float((self.hand.reach + self.hand.radius[:, :3]).max())
        self.reach = max(finger_reach, float(self.hand.palm_reach[0] + self.hand.palm_radius.max()))
        self.abduction = np.zeros(len(FINGERS))
        self.open = np.ascontiguousarray(OPEN_SHARE * np.minimum(hand.flexion_min, 0.0))
        self.fist = self.open + FIST_SHARE * (hand.flexion_max - self.open)
        # What each body keeps while the open hand advances [m].
        touches = script.palm_depth > 0.0
        self.gap = np.full(BODY_COUNT, script.clearance + MARGIN)
        for finger in self.fingers:
            self.gap[3 * finger : 3 * finger + 3] = 0.0 if touches else MARGIN
        if script.contact:
            self.gap[PALM_BODY] = 0.0 if touches else max(script.palm_gap, script.clearance)
        self.aims = self._aims(hand.hand_length / DEFAULT_HAND_LENGTH)

    def best(self) -> FingerClosure:
        """Evaluate every direction at the first aim, the best directions at every aim, and the best of those tilted."""
        found = [self._evaluate(rotation.copy(), self.aims[0]) for rotation in _orientations()]
        found += [self._evaluate(leader.rotation, aim) for leader in _leading(found) for aim in self.aims[1:]]
        found += [
            self._evaluate(matmul(leader.rotation, tilt), leader.aim) for leader in _leading(found) for tilt in _tilts()
        ]
        leaders = _leading(found)
        best = leaders[0].closure
        if self.script.way("push") > 0.0:
            tips = []
            for flexion in (best.contact, best.command):
                self._distances(best.position, best.rotation, flexion)
                tips.append(self.work.joints[self.fingers, 3].mean(axis=0))
            # The way in which the closing fingers push.
            return replace(best, slide=level(tips[1] - tips[0], -best.back))
        if self.script.way("slide") == 0.0:
            return best
        slides = [self._best_slide(leader.closure) for leader in leaders]
        best_score = -math.inf
        for leader, (direction, share) in zip(leaders, slides):
            if leader.score + SLIDE_WEIGHT * share > best_score + 1e-6:
                best_score = leader.score + SLIDE_WEIGHT * share
                best = replace(leader.closure, slide=direction)
        return best

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
        return body_distances(position, rotation, flexion, self.abduction, self.work)

    def _evaluate(self, rotation: FloatArray, aim: FloatArray) -> _Candidate:
        """Advance the open hand along the palm's normal, close the fingers, command them deeper."""
        rotation = np.ascontiguousarray(rotation)
        back = np.ascontiguousarray(rotation[:, 2])
        # From here no body can reach the object, whatever the posture.
        far = self.bound + self.reach + float(norm(aim)) + float(self.gap.max())
        start = self.middle - matmul(rotation, aim) + far * back
        # A hand that must not touch keeps clear in every stage of closing in the air.
        stages = [0.0] if self.script.contact else np.linspace(0.0, 1.0, 9)
        travel, blocking = 2.0 * far, -1
        for stage in stages:
            posture = self.open + stage * (self.fist - self.open)
            distance, body = kernel.advance_hand(
                start, rotation, posture, self.abduction, -back, self.gap, travel, self.work
            )
            if body >= 0:
                travel, blocking = distance, body
        position = start - travel * back
        unclosed = None if self.script.contact else self.fist
        closure = self.closed((position, rotation, back), self.open, self.abduction, np.zeros(3), unclosed)
        if blocking < 0:
            return _Candidate(rotation, aim, -math.inf, closure)
        near = max(0.0, 1.0 - self.gap_to_other(closure) / BESIDE)
        return _Candidate(rotation, aim, self._score(closure) - BESIDE_WEIGHT * near, closure)

    def gap_to_other(self, closure: FingerClosure) -> float:
        """Least distance to the other hand [m] as both come near, open, and close; infinite without another."""
        if self.other is None:
            return math.inf
        coming = [self._coming(self.model, closure), self._coming(*self.other)]
        if any(phase.hand for phase in self.script.phases):
            # A phase is of one of the hands: each comes and goes beside the other one, which is closed.
            mine, other = coming
            shut, other_shut = (
                PlacedHand(*(np.repeat(part[-1:], len(part), axis=0) for part in hand)) for hand in coming
            )
            coming = [PlacedHand(*map(np.concatenate, zip(*pair))) for pair in ((mine, shut), (other_shut, other))]
        return float(distance_of_hands((self.model, self.other.hand), coming).min())

    def _coming(self, model: HandModel, closure: FingerClosure) -> PlacedHand:
        """Hand at the shares of its way back in `WAY_BACK`, open, and closed at last."""
        back = self.script.start_distance * np.array([*WAY_BACK, 0.0])
        flexion = np.stack([*[closure.open] * len(WAY_BACK), closure.command])
        turn = np.tile(quaternion_from_matrix(closure.rotation), (len(back), 1))
        position = closure.position + back[:, None] * closure.back
        return forward_kinematics(model, position, turn, flexion, np.tile(closure.abduction, (len(back), 1)))

    def _score(self, closure: FingerClosure) -> float:
        """Quality of a grasp by one hand; the weights order the demands, from reaching at all down to appearance."""
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
            centers = np.column_stack([self.hand.palm_x, self.hand.palm_y, self.hand.palm_z])
            places = [closure.position + matmul(closure.rotation, center) for center in centers]
            near = [
                kernel.sphere_distance(place, radius, BEARING, self.work) < BEARING
                for place, radius in zip(places, self.hand.palm_radius)
            ]
            score += 6.0 * float(np.mean(near))
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
                kernel.contact_normal(f, k, self.work, normal)
                normals.append((f, k, normal))
        if not normals:
            return score
        self._distances(closure.position, closure.rotation, closure.command)
        moved = self.work.joints - before
        # The command goes straight into the surface instead of grazing it.
        push = np.zeros(len(FINGERS))
        for f, phalanx, normal in normals:
            push[f] = max(push[f], -float(dot(moved[f, phalanx + 1], normal)))
        score += 8.0 * float(np.clip(push[self.fingers] / max(self.script.depth, 1e-6), 0.0, 1.0).mean())
        if self.script.moves_object:
            # What is moved is held level and about its middle; what is pushed need not be held from two sides.
            steep = float(np.mean([abs(normal[2]) for _, _, normal in normals]))
            high = float(np.mean([abs(before[f, k + 1, 2] - self.middle[2]) for f, k, _ in normals])) / self.half_height
            score -= LEVEL_WEIGHT * (steep + 0.5 * min(1.0, high))
        if self.script.way("push") > 0.0:
            return score
        # The fingers oppose each other instead of pushing the object away.
        oppose = OPPOSE_WEIGHT if self.script.moves_object else 4.0
        score += oppose * (1.0 - self._one_sided(normals))
        # Fingers that do not take part are well out of the way.
        unused = [f for f in range(len(FINGERS)) if f not in self.fingers]
        if unused:
            away = float(closure.distance[:PALM_BODY].reshape(len(FINGERS), 3)[unused].min())
            score += 4.0 * min(1.0, away / UNUSED_DISTANCE)
        # The pads touch, and more phalanges hold better than fewer.
        touching = closure.touching[self.fingers]
        return score + 3.0 * float(touching[:, 2].mean()) + 6.0 * float(touching.mean())

    def _one_sided(self, normals: list[tuple[int, int, FloatArray]]) -> float:
        """Share of the push to one side: 0 where the thumb balances all others, 1 where all push alike.

        For an object that is to be moved, the thumb counts as much as all fingers together.
        """
        if not self.script.moves_object:
            return float(norm(np.mean([normal for _, _, normal in normals], axis=0)))
        sides = [[normal for f, _, normal in normals if (f == 0) == thumb] for thumb in (True, False)]
        if not all(sides):
            return 1.0
        mean = [np.mean(side, axis=0) for side in sides]
        return float(norm(0.5 * (mean[0] + mean[1])))

    def _best_slide(self, closure: FingerClosure) -> tuple[FloatArray, float]:
        """Find the unit direction along the palm (3,), world, in which the fingers keep hold best, and its score.

        The score is 1 where nothing changes on the way, lower the more it does; `closure` is the hand before the slide.
        """
        script, rotation = self.script, closure.rotation
        reached = [FINGERS.index(name) for name in closure.reached]
        best, best_score = rotation[:, 0], -math.inf if reached else 0.0
        before = _finger_depth(closure.distance)[reached]
        start = closure.position - script.palm_depth * closure.back
        for k in range(DIRECTIONS) if reached else ():
            sine, cosine = sine_and_cosine(2.0 * math.pi * k / DIRECTIONS)
            direction = cosine * rotation[:, 0] + sine * rotation[:, 1]
            score = 0.0
            for station in STATIONS:
                place = start + station * script.way("slide") * direction
                near = body_distances(place, rotation, closure.command, closure.abduction, self.work)
                depth = _finger_depth(near)[reached]
                change = np.abs(depth - before) / max(script.depth, HOLDING_DEPTH)
                score += float(np.mean(np.clip(depth / HOLDING_DEPTH, -1.0, 1.0) - 0.5 * np.minimum(change, 2.0)))
                if (near[PALM_BODY] < 0.0) != (script.palm_depth > 0.0):
                    score -= 1.0
            # Only a real difference turns the slide away from the palm's own axes.
            if score / len(STATIONS) > best_score + 1e-6:
                best, best_score = direction, score / len(STATIONS)
        return best.copy(), best_score


def _finger_depth(distance: FloatArray) -> FloatArray:
    """Depth [m] of each finger in the object, negative outside, from body distances (16,); shape (5,)."""
    return np.asarray(-distance[:PALM_BODY].reshape(len(FINGERS), 3).min(axis=1))


def level(direction: FloatArray, otherwise: FloatArray) -> FloatArray:
    """Return the unit vector along the level part of a direction, or of another one if it is upright; shape (3,)."""
    for axis in (direction, otherwise):
        flat = np.array([axis[0], axis[1], 0.0])
        length = float(norm(flat))
        if length >= UPRIGHT * float(norm(axis)) and length > 0.0:
            return flat / length
    return np.array([1.0, 0.0, 0.0])


def kept_closure(
    script: Script, hand: HandModel, tree: SphereTree, search: Callable[[], FingerClosure]
) -> FingerClosure:
    """Return the closure of a script's hand on an object (`tree`, world frame): shipped, or searched for once."""
    key = closure_key(script, hand, tree)
    kept = shipped_closures().get(key) or _found.get(key)
    if kept is None:
        kept = _found[key] = encoded(search())
    return decoded(kept)


def closure_key(script: Script, hand: HandModel, tree: SphereTree) -> str:
    """Return a digest of what a search depends on: every array of hand and tree, and the script without its rest."""
    names = ("contact", "depth", "clearance", "palm_gap", "palm_depth", "curl", "fingers", "moves_object")
    searched = [script.way("slide"), script.way("push"), *(getattr(script, name) for name in names)]
    digest = hashlib.blake2b(f"{SEARCH_VERSION} {searched!r}".encode(), digest_size=16)
    for values in (*hand.arrays(), *tree.arrays()):
        digest.update(np.asarray(values).tobytes())
    return digest.hexdigest()


@cache
def shipped_closures() -> dict[str, Fields]:
    """Return the closures that ship by their key."""
    file = files("hhsim.objects") / SHIPPED
    kept: dict[str, Fields] = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    return kept


def encoded(closure: FingerClosure) -> Fields:
    """Return a closure's fields, with every digit of its numbers."""
    return {each.name: np.array(getattr(closure, each.name)).tolist() for each in fields(FingerClosure)}


def decoded(kept: Fields) -> FingerClosure:
    """Return the closure of such fields."""
    names = ("reached", "missed")
    parts: dict[str, Any] = {name: np.array(values, np.float64) for name, values in kept.items() if name not in names}
    return FingerClosure(**parts | {name: tuple(kept[name]) for name in names})
