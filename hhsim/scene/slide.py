"""Sliding a closed hand along an object: the direction in which the fingers keep hold."""

import math

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.kernels.hand.kinematics import PALM_BODY, HandArrays
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.scene.finger_closure import FingerClosure, body_distances, make_work
from hhsim.scene.script import Script

HOLDING_DEPTH = 0.002
"""A finger commanded this deep [m] surely keeps hold."""
DIRECTIONS = 16
"""Directions along the palm that are tried; the first is its own x axis."""
STATIONS = (0.25, 0.5, 0.75, 1.0)
"""Shares of the slide at which the hand is looked at."""


def best_slide(script: Script, closure: FingerClosure, hand: HandArrays, tree: TreeArrays) -> tuple[FloatArray, float]:
    """The direction along the palm in which the fingers keep hold, pressed in neither deeper nor less.

    Args:
        script: How far it slides, and whether the palm touches.
        closure: The hand before the slide.
        hand, tree: The hand and the object, world.

    Returns:
        (unit direction, shape (3,), world; score, 1 where nothing changes on the way, lower the more it does).
    """
    work = make_work()
    reached = [FINGERS.index(name) for name in closure.reached]
    if not reached:
        return closure.rotation[:, 0].copy(), 0.0
    before = _finger_depth(closure.distance)[reached]
    start = closure.position - script.palm_depth * closure.back
    best, best_score = closure.rotation[:, 0], -math.inf
    for k in range(DIRECTIONS):
        angle = 2.0 * math.pi * k / DIRECTIONS
        direction = math.cos(angle) * closure.rotation[:, 0] + math.sin(angle) * closure.rotation[:, 1]
        score = 0.0
        for station in STATIONS:
            place = start + station * script.slide_distance * direction
            near = body_distances(hand, tree, place, closure.rotation, closure.command, closure.abduction, work)
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
    """How deep [m] each finger lies in the object, negative outside, of body distances (16,); shape (5,)."""
    depth: FloatArray = -distance[:PALM_BODY].reshape(len(FINGERS), 3).min(axis=1)
    return depth
