"""Claims of a thing of several parts: their poses, and the shown hand beside each of them, in the part's frame."""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import MeshError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.mesh.mesh import Mesh
from hhsim.verify.claim import HOLDS, NOT_CLAIMED, NOT_JUDGED, Claim, difference, judged
from hhsim.verify.contacts import PALM, ball_places, near_pairs, near_triangle_pairs, ready_triangles, triangle_places
from hhsim.verify.kinematics import Posed, pose, rotations
from hhsim.verify.mesh_distance import EXACT, HandReferee
from hhsim.verify.tick_data import LENGTH, NO_PLACE, WHY_LENGTH, JudgedTicks

NEVER_IN = 1e-12
"""Rounding of a distance [m], as of one object."""


def part_claims(judge: JudgedTicks) -> list[Claim]:
    """Judge poses, depths in the parts' surfaces, and what is inside their true meshes, at the chosen ticks.

    Ticks that say that the parts left the hand no place are inside; all others are outside.
    """
    result, chosen = judge.result, judge.chosen
    depth = np.zeros((len(chosen), PALM + 1))
    inside: list[FloatArray] = []
    notes = []
    for group in result.parts:
        posed, seen = _seen(judge, group)
        depth = np.maximum(depth, -_nearest(judge, group, posed))
        try:
            inside.append(_mesh_depth(judge, group, posed, seen))
        except MeshError as error:
            notes.append(f"{group}: {error}")
    finger = depth[:, :PALM].reshape(-1, 5, 3).max(axis=2)
    finger[:, ~judge.fingers] = np.nan
    most = np.fmax(depth[:, PALM], np.nanmax(finger, axis=1, initial=0.0))
    own = np.concatenate([most[:, None], depth[:, PALM:], finger], axis=1)
    stored = [np.asarray(result[f"penetration_{name}"])[chosen] for name in ("depth", "palm", "finger")]
    off = difference(np.column_stack(stored), own).max(axis=1)
    squeezed = judge.status[chosen] & NO_PLACE > 0
    says = f"the depth in the {result.surface} of all parts is as stored"
    free = "nothing of the hand is inside of a part in a tick that does not say that there was no place"
    tick = int(chosen[most.argmax()]) if most.any() else None
    note = f"{int(squeezed.sum()):,} of the ticks looked at say that there was no place" if squeezed.any() else ""
    deep = Claim("deepest", "where the hand is deepest", NOT_CLAIMED, float(most.max()), unit="m", tick=tick, note=note)
    return [
        _poses(judge),
        judged("depth", says, off, LENGTH, "m", WHY_LENGTH, ticks=chosen),
        judged("non-penetration", free, np.where(squeezed, 0.0, most), NEVER_IN, "m", "rounding", ticks=chosen),
        deep,
        _mesh_claim(judge, inside, squeezed, notes),
    ]


def _poses(judge: JudgedTicks) -> Claim:
    off = []
    for group in judge.result.parts:
        position, turn = judge.result[f"{group}/position"], np.asarray(judge.result[f"{group}/orientation"])
        unit = np.abs(np.linalg.norm(turn, axis=1) - 1.0)
        off.append(np.where(np.isfinite(position).all(axis=1) & np.isfinite(unit), unit, np.inf))
    says = "every part has a pose at every tick, with a unit quaternion"
    return judged("poses of parts", says, np.max(off, axis=0), 1e-9, "1", "rounding", ticks=judge.numbers)


def _seen(judge: JudgedTicks, group: str) -> tuple[Posed, HandConfiguration]:
    """Return the shown hand of the chosen ticks as a part sees it."""
    at = judge.chosen_shown
    back = rotations(np.asarray(judge.result[f"{group}/orientation"])[judge.chosen])[0].inv()
    position = back.apply(at.position - np.asarray(judge.result[f"{group}/position"])[judge.chosen])
    turned = (back * rotations(at.orientation)[0]).as_quat()[:, [3, 0, 1, 2]]
    seen = at._replace(position=position, orientation=turned)
    return pose(judge.hand, seen), seen


def _mesh(judge: JudgedTicks, group: str) -> Mesh:
    return Mesh(np.array(judge.result[f"{group}/vertices"]), np.array(judge.result[f"{group}/faces"]), name=group)


def _nearest(judge: JudgedTicks, group: str, posed: Posed) -> FloatArray:
    """Return the least distance [m] of each body to the touched surface of a part where they meet, else infinity."""
    result, count = judge.result, len(judge.chosen)
    if judge.on_mesh:
        triangles = _mesh(judge, group).triangles
        ready, places = ready_triangles(triangles), triangle_places(triangles)
        return near_triangle_pairs(judge.hand, posed, ready, places, judge.fingers, LENGTH).nearest(count)
    level = np.asarray(result[f"{group}/tree/level"])
    leaves = level == level.max()
    center, radius = np.asarray(result[f"{group}/tree/center"])[leaves], np.asarray(result[f"{group}/tree/radius"])
    return near_pairs(judge.hand, posed, ball_places(center, radius[leaves]), judge.fingers, LENGTH).nearest(count)


def _mesh_depth(judge: JudgedTicks, group: str, posed: Posed, seen: HandConfiguration) -> FloatArray:
    """Return the depth [m] of the hand in the true mesh of a part by coal, (n,)."""
    shape = HandShape(judge.hand.radius, judge.hand.palm_center, judge.hand.palm_radius)
    referee = HandReferee(_mesh(judge, group), open_too=judge.on_mesh)
    used = np.append(np.repeat(judge.fingers, 3), True)
    least = referee.clearances(shape, PlacedHand(posed.joints, seen.position, seen.orientation), LENGTH)
    return np.asarray(np.maximum(0.0, -least[:, used].min(axis=1)))


def _mesh_claim(judge: JudgedTicks, inside: list[FloatArray], squeezed: BoolArray, notes: list[str]) -> Claim:
    name, says = "mesh", "the graphic hand stays out of the true meshes of all parts where it has a place"
    why = "the bounds of the referee's own distance"
    if notes:
        return Claim(name, says, NOT_JUDGED, unit="m", why=why, note="; ".join(notes))
    depth = np.where(squeezed, 0.0, np.max(inside, axis=0))
    found = judged(name, says, depth, EXACT, "m", why, ticks=judge.chosen)
    if judge.on_mesh or found.verdict == HOLDS:
        return found
    note = "trees need not cover the mesh"
    return Claim(name, says, NOT_CLAIMED, found.worst, EXACT, "m", found.tick, found.checked, why, note)
