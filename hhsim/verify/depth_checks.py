"""Claims of depths: touching pairs and contacts off the mesh at the chosen ticks, and at all the hand's own parts."""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.metrics.mesh_penetration import ticks_looked_at
from hhsim.result.schema import BETWEEN_COLUMNS
from hhsim.system.counted import counted
from hhsim.verify.claim import NOT_CLAIMED, NOT_JUDGED, Claim, all_true, as_number, difference, judged
from hhsim.verify.coal_distance import EXACT, coal_distance, has_coal, sphere_shapes, triangle_shapes
from hhsim.verify.contacts import PALM, meetings, meetings_of_two, parts_that_may_meet, round_cones
from hhsim.verify.file_checks import follows
from hhsim.verify.kinematics import configurations, own_hand, pose
from hhsim.verify.mesh_distance import TrueSurface
from hhsim.verify.tick_data import CAPACITY_EXCEEDED, LENGTH, NO_PLACE, WHY_LENGTH, JudgedTicks

RESTS = 0.25
"""Largest motion of a tick whose successor predicts no hand, as a ratio of `step_tolerance`."""
NEVER_IN = 1e-12
"""Rounding of a distance [m]: the depth allowed to a method that never penetrates."""
CONTACT_ERROR = "contact_error_max"
"""Figure of the summary on contacts off the mesh."""
_OFF_MESH = (
    "contacts off the mesh",
    "the contacts of the ticks that the summary is of are as far from the true mesh as it says",
)


def depth_claims(judge: JudgedTicks) -> list[Claim]:
    """Judge depths, touching pairs, candidates, and the nearest pair by a library."""
    depth = np.maximum(0.0, -judge.near.nearest)
    finger = depth[:, :PALM].reshape(-1, 5, 3).max(axis=2)
    finger[:, ~judge.fingers] = np.nan
    most = np.fmax(depth[:, PALM], np.nanmax(finger, axis=1, initial=0.0))
    own = np.concatenate([most[:, None], depth[:, PALM:], finger], axis=1)
    return [_depth(judge, own), _inside(judge, most), _touching(judge), *_candidates(judge), _by_library(judge)]


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


def _touching(judge: JudgedTicks) -> Claim:
    says, wrong = "as many pairs touch as stored", judge.miscounted
    if judge.options["method"] == "paper":
        note = f"method paper counts what its own detection finds; it differs in {counted(int(wrong.sum()), 'tick')}"
        return Claim("touching pairs", says, NOT_CLAIMED, checked=len(judge.chosen), note=note)
    why = "exact, but for pairs within 1 nm of the limit"
    return all_true("touching pairs", says, wrong, ticks=judge.chosen, why=why)


def _candidates(judge: JudgedTicks) -> list[Claim]:
    """A tick begins at the hand of the tick before; what is within the margin there enters its first program.

    Skipped after a tick that moved, since a prediction may begin elsewhere. On a mesh only triangles within a step's
    reach (twice the final step) are listed.
    """
    if not judge.safe or (judge.result.body.is_free and len(judge.result.bodies) > 1):
        # Pairs with other bodies count, too, and are not in the file.
        return []
    result, near, chosen = judge.result, judge.listed, judge.chosen[judge.asked]
    after = np.minimum(chosen + 1, result.ticks - 1)
    steps = np.asarray(result["work/linearisations"])[after]
    full = judge.status & CAPACITY_EXCEEDED > 0
    rests = result.body.is_free | (judge.last_step[chosen] <= RESTS * float(judge.options["step_tolerance"]))
    rests &= ~judge.carried[after]
    looked = rests & (after > chosen) & follows(result)[after] & ~full[after] & ~full[chosen] & (steps > 0)
    wrong = np.zeros(len(after), bool)
    counts, bodies = (near.fewest, near.most), (near.fewest_bodies, near.most_bodies)
    for name, (least, most) in (("contacts/candidates", counts), ("work/bodies", bodies)):
        stored = np.asarray(result[name])[after]
        wrong |= (stored < least) | ((steps == 1) & (stored > most))
    within = "a step's reach" if judge.on_mesh else "the margin"
    says = f"as many pairs and bodies are within {within} as stored; no fewer where a tick went on from there"
    why = "exact, but for pairs within 1 nm of the margin"
    return [all_true("candidates", says, wrong[looked], ticks=after[looked], why=why)]


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


def contact_error_claim(judge: JudgedTicks) -> Claim:
    """Judge the summary's distance of contacts to the true mesh by the contacts of the chosen ticks."""
    result = judge.result
    if CONTACT_ERROR not in result.summary:
        return Claim(*_OFF_MESH, NOT_JUDGED, checked=0, note="the file does not state it")
    # The figure of a long run covers some ticks only.
    stated_of = np.isin(judge.chosen, ticks_looked_at(np.asarray(result["contacts/candidates"]) > 0))
    stated_of &= np.isin(np.arange(len(judge.chosen)), judge.asked)
    touching = judge.touching.at(np.flatnonzero(stated_of[judge.touching.tick]))
    away = np.empty(len(touching.tick))
    for body in judge.bodies:
        of = body.of(touching)
        # Equal contact points of a hand at rest are measured once.
        seen = np.round(body.seen_points(touching.point[of], touching.tick[of]), 12)
        points, place = np.unique(seen, axis=0, return_inverse=True)
        away[of] = TrueSurface(body.mesh, open_too=True).nearest(points)[0][place.ravel()]
    stated = as_number(result.summary[CONTACT_ERROR])
    over = np.maximum(0.0, away - stated) if np.isfinite(stated) else away
    if len(judge.asked) == len(judge.chosen) == result.ticks and np.isfinite(stated):
        # With every tick judged, the farthest contact equals the figure.
        over = np.where(away == away.max(initial=-np.inf), np.abs(away - stated), over)
    return judged(*_OFF_MESH, over, LENGTH, "m", WHY_LENGTH, ticks=judge.chosen[touching.tick])


def self_contact_claims(judge: JudgedTicks) -> list[Claim]:
    """Judge the shown hand of a run with self-contact, at every tick, and the depths that its summary states."""
    if not judge.self_contact:
        return []
    may = parts_that_may_meet(judge.hand, judge.fingers)
    depth = {}
    for name, posed in (("self_depth_haptic", judge.wanted_posed), ("self_depth_graphic", judge.shown_posed)):
        nearest = meetings(judge.hand, posed, may, 0.0).nearest(len(judge.numbers)).min(axis=1)
        depth[name] = np.where(np.isfinite(posed.joints).all(axis=(1, 2, 3)), np.maximum(0.0, -nearest), np.inf)
    shown = depth["self_depth_graphic"]
    says = "no part of the shown hand is in another part of it"
    claims = [judged("own parts", says, shown, LENGTH, "m", WHY_LENGTH, ticks=judge.numbers)]
    stated = [(name, as_number(judge.result.summary[name])) for name in depth if name in judge.result.summary]
    if stated:
        off = [abs(value - depth[name].max()) for name, value in stated]
        says = "user's and shown hand are as deep in themselves as the summary says"
        claims.append(judged("depth in itself", says, off, LENGTH, "m", WHY_LENGTH))
    return claims


def hands_apart_claims(judge: JudgedTicks) -> list[Claim]:
    """Judge the shown hand of a run of two that keep out of each other, at every tick."""
    claims = _between(judge)
    if judge.other is None:
        return claims
    name, says = "hands apart", "no part of the shown hand is in the other hand"
    nearest = judge.of_other_hand(judge.numbers, 0.0).nearest(len(judge.numbers)).min(axis=1)
    known = np.isfinite(judge.shown_posed.joints).all(axis=(1, 2, 3))
    depth = np.where(known, np.maximum(0.0, -nearest), np.inf)
    # Moving parts that leave a hand no place may push it into the other one.
    depth[(judge.status | np.asarray(judge.other["status"])) & NO_PLACE != 0] = 0.0
    return [*claims, judged(name, says, depth, LENGTH, "m", WHY_LENGTH, ticks=judge.numbers)]


def _between(judge: JudgedTicks) -> list[Claim]:
    """Judge how far two hands are from each other at every tick."""
    result = judge.result.hands[judge.result.name]
    ticks = judge.numbers
    if result.other is None:
        return []
    hands = result, result.other
    off = np.zeros(len(ticks))
    for column in BETWEEN_COLUMNS:
        stored = np.asarray(result[column.name])[ticks]
        posed = [pose(own_hand(one), configurations(one, column.name.partition("/")[2]).at(ticks)) for one in hands]
        # A hand that is no number has no distance.
        known = np.flatnonzero(np.logical_and.reduce([np.isfinite(of.joints).all(axis=(1, 2, 3)) for of in posed]))
        near = np.nan_to_num(stored[known]) + LENGTH
        found = meetings_of_two([own_hand(one) for one in hands], [of.at(known) for of in posed], near)
        apart = np.abs(found.nearest(len(known)).min(axis=1) - stored[known])
        off[known] = np.maximum(off[known], np.nan_to_num(apart, nan=np.inf))
    says = "the two hands, the users' and the shown ones, are as far from each other as the file says"
    return [judged("between hands", says, off, LENGTH, "m", WHY_LENGTH, ticks=ticks)]
