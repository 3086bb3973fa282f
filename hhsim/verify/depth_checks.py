"""Claims of depths: in the bodies at the chosen ticks, of the hand's own parts and of another hand at all."""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.system.counted import counted
from hhsim.verify.claim import NOT_CLAIMED, NOT_JUDGED, Claim, difference, judged
from hhsim.verify.coal_distance import EXACT, coal_distance, has_coal, sphere_shapes, triangle_shapes
from hhsim.verify.contacts import PALM, meetings, parts_that_may_meet, round_cones
from hhsim.verify.tick_data import LENGTH, NO_PLACE, WHY_LENGTH, JudgedTicks

NEVER_IN = 1e-12
"""Rounding of a distance [m]: the depth allowed to a method that never penetrates."""


def depth_claims(judge: JudgedTicks) -> list[Claim]:
    """Judge depths in bodies, in the hand itself and in another hand, and the nearest pair by a library."""
    depth = np.maximum(0.0, -judge.near.nearest)
    finger = depth[:, :PALM].reshape(-1, 5, 3).max(axis=2)
    finger[:, ~judge.fingers] = np.nan
    most = np.fmax(depth[:, PALM], np.nanmax(finger, axis=1, initial=0.0))
    own = np.concatenate([most[:, None], depth[:, PALM:], finger], axis=1)
    claims = [_depth(judge, own), _inside(judge, most), _by_library(judge)]
    return [*claims, *_self_contact(judge), *_hands_apart(judge)]


def _depth(judge: JudgedTicks, own: FloatArray) -> Claim:
    result, chosen = judge.result, judge.chosen
    depths = [np.asarray(result[f"penetration_{name}"])[chosen] for name in ("depth", "palm", "finger")]
    off = difference(np.column_stack(depths), own).max(axis=1)
    says = f"the depth in the {judge.result.surface} is as stored"
    return judged("depth", says, off, LENGTH, "m", WHY_LENGTH, ticks=chosen)


def _inside(judge: JudgedTicks, most: FloatArray) -> Claim:
    chosen, method = judge.chosen, judge.options["method"]
    what = "a triangle is inside of the hand" if judge.on_mesh else "the hand is inside of a sphere"
    says, why = f"nothing of {what}", "rounding of a distance"
    if judge.safe:
        out, squeezed = np.where(judge.squeezed, 0.0, most), most[judge.squeezed]
        deepest = f"{1e6 * squeezed.max(initial=0.0):.3g} µm inside"
        note = f"{counted(len(squeezed), 'tick')} had no place, the deepest {deepest}" if len(squeezed) else ""
        return judged("non-penetration", says, out, NEVER_IN, "m", why, ticks=chosen, note=note)
    note = f"method {method} does not promise it; its deepest is {1e6 * most.max():.3g} µm"
    tick = int(chosen[most.argmax()]) if most.any() else None
    return Claim("non-penetration", says, NOT_CLAIMED, float(most.max()), NEVER_IN, "m", tick, len(chosen), why, note)


def _by_library(judge: JudgedTicks) -> Claim:
    name, says = "distance by coal", "the nearest pair is as far apart as the collision library has it"
    if not has_coal():
        return Claim(name, says, NOT_JUDGED, note="a second opinion by coal: pip install 'hhsim[verify]'")
    shapes = [triangle_shapes(of.mesh) if judge.on_mesh else sphere_shapes(of.center, of.radius) for of in judge.bodies]
    starts, cones = [of.first for of in judge.bodies], round_cones(judge.hand, judge.chosen_posed)
    hand, pairs, posed, off, ticks = judge.hand, judge.pairs, judge.chosen_posed, [], []
    # Sorted by tick, then distance: the first of each tick is its nearest pair.
    pairs = pairs.at(np.flatnonzero(np.isin(pairs.tick, judge.asked)))
    order = np.lexsort((pairs.distance, pairs.tick))
    for n in order[np.unique(pairs.tick[order], return_index=True)[1]]:
        i, body, leaf = int(pairs.tick[n]), int(pairs.body[n]), int(pairs.leaf[n])
        if body == PALM:
            body += int(np.abs(np.linalg.norm(posed.palm[i] - pairs.point[n], axis=1) - hand.palm_radius).argmin())
        a, b, first, last = cones.a[i, body], cones.b[i, body], float(cones.radius_a[body]), float(cones.radius_b[body])
        which = int(np.searchsorted(starts, leaf, side="right")) - 1
        a, b = judge.bodies[which].seen_points(np.stack([a, b])[None], np.array([i]))[0]
        found = coal_distance(a, b, first, last, *shapes[which](leaf - starts[which]))
        off.append(abs(found - float(pairs.distance[n])))
        ticks.append(int(judge.chosen[i]))
    note = "" if off else "nothing is near"
    why = "a nanometre, and the library's bounds"
    return judged(name, says, off, LENGTH + EXACT, "m", why, ticks=ticks, note=note)


def _self_contact(judge: JudgedTicks) -> list[Claim]:
    """Judge the shown hand of a run with self-contact, at every tick."""
    if not judge.self_contact:
        return []
    may = parts_that_may_meet(judge.hand, judge.fingers)
    nearest = meetings(judge.hand, judge.shown_posed, may, 0.0).nearest(len(judge.numbers)).min(axis=1)
    says = "no part of the shown hand is in another part of it"
    return [judged("own parts", says, _depths(judge, nearest), LENGTH, "m", WHY_LENGTH, ticks=judge.numbers)]


def _hands_apart(judge: JudgedTicks) -> list[Claim]:
    """Judge the shown hand of a run of two that keep out of each other, at every tick."""
    if judge.other is None:
        return []
    depth = _depths(judge, judge.of_other_hand(judge.numbers, 0.0).nearest(len(judge.numbers)).min(axis=1))
    # Moving parts that leave a hand no place may push it into the other one.
    depth[(judge.status | np.asarray(judge.other["status"])) & NO_PLACE != 0] = 0.0
    says = "no part of the shown hand is in the other hand"
    return [judged("hands apart", says, depth, LENGTH, "m", WHY_LENGTH, ticks=judge.numbers)]


def _depths(judge: JudgedTicks, nearest: FloatArray) -> FloatArray:
    """Depths [m] by least distances (T,); infinite for a hand that is no number."""
    known = np.isfinite(judge.shown_posed.joints).all(axis=(1, 2, 3))
    return np.where(known, np.maximum(0.0, -nearest), np.inf)
