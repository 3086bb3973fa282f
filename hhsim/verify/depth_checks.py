"""Claims of depths: in spheres or triangles, in the true mesh, of the hand's own parts and of another hand."""

from importlib.util import find_spec
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import MeshError
from hhsim.mesh.solidify import ASSUMED_SOLID
from hhsim.system.counted import counted
from hhsim.system.progress import Progress
from hhsim.verify.claim import FAILS, HOLDS, NOT_CLAIMED, NOT_JUDGED, Claim, difference, judged
from hhsim.verify.contacts import PALM, meetings, own_cones, parts_that_may_meet
from hhsim.verify.mesh_distance import CLOSE, TrueSurface
from hhsim.verify.tick_data import LENGTH, NO_PLACE, WHY_LENGTH, JudgedTicks, left_out

NEVER_IN = 1e-12
"""Rounding of a distance [m]: the depth allowed to a method that never penetrates."""
MESH_LIMIT = 1e-6
"""Distances to the mesh are computed up to this value [m]."""
EXACT = 1e-9
"""Accuracy of coal's distances [m]."""
MESH_TICKS = 64
"""Ticks between two progress reports of the distances to the mesh."""


def depth_claims(judge: JudgedTicks) -> list[Claim]:
    """Judge depths in bodies, in the hand itself and in another hand, and the nearest pair by a library."""
    depth = np.maximum(0.0, -judge.nearest)
    finger = depth[:, :PALM].reshape(-1, 5, 3).max(axis=2)
    finger[:, ~judge.fingers] = np.nan
    most = np.fmax(depth[:, PALM], np.nanmax(finger, axis=1, initial=0.0))
    own = np.concatenate([most[:, None], depth[:, PALM:], finger], axis=1)
    depths = [np.asarray(judge.result[f"penetration_{name}"]) for name in ("depth", "palm", "finger")]
    off, says = difference(np.column_stack(depths), own).max(axis=1), f"the depth in the {judge.result.surface} is as "
    claims = [judged("depth", f"{says}stored", off, LENGTH, "m", WHY_LENGTH, ticks=judge.numbers)]
    claims += [_inside(judge, most), _by_library(judge)]
    if judge.self_contact:
        may = parts_that_may_meet(judge.hand, judge.fingers)
        nearest = meetings(judge.hand, judge.posed, may, 0.0).nearest(len(judge.numbers)).min(axis=1)
        claims.append(_out_of(judge, "own parts", "another part of it", nearest))
    if judge.other is not None:
        nearest = judge.of_other_hand(0.0).nearest(len(judge.numbers)).min(axis=1)
        # Moving parts that leave a hand no place may push it into the other one.
        nearest[(judge.status | np.asarray(judge.other["status"])) & NO_PLACE != 0] = 0.0
        claims.append(_out_of(judge, "hands apart", "the other hand", nearest))
    return claims


def _inside(judge: JudgedTicks, most: FloatArray) -> Claim:
    method = judge.options["method"]
    what = "a triangle is inside of the hand" if judge.on_mesh else "the hand is inside of a sphere"
    says, why = f"nothing of {what}", "rounding of a distance"
    if judge.safe:
        out, squeezed = np.where(judge.squeezed, 0.0, most), most[judge.squeezed]
        deepest = f"{1e6 * squeezed.max(initial=0.0):.3g} µm inside"
        note = f"{counted(len(squeezed), 'tick')} had no place, the deepest {deepest}" if len(squeezed) else ""
        return judged("non-penetration", says, out, NEVER_IN, "m", why, ticks=judge.numbers, note=note)
    note = f"method {method} does not promise it; its deepest is {1e6 * most.max():.3g} µm"
    tick = int(most.argmax()) if most.any() else None
    return Claim("non-penetration", says, NOT_CLAIMED, float(most.max()), NEVER_IN, "m", tick, len(most), why, note)


def _out_of(judge: JudgedTicks, name: str, what: str, nearest: FloatArray) -> Claim:
    """Judge least distances (T,) [m]; those of a hand that is no number are infinitely deep."""
    known = np.isfinite(judge.posed.joints).all(axis=(1, 2, 3))
    depth = np.where(known, np.maximum(0.0, -nearest), np.inf)
    says = f"no part of the shown hand is in {what}"
    return judged(name, says, depth, LENGTH, "m", WHY_LENGTH, ticks=judge.numbers)


def _by_library(judge: JudgedTicks) -> Claim:
    name, says = "distance by coal", "the nearest pair is as far apart as the collision library has it"
    if not has_coal():
        return Claim(name, says, NOT_JUDGED, note="a second opinion by coal: pip install 'hhsim[verify]'")
    cones, pairs, off, ticks = own_cones(judge.hand, judge.posed), judge.pairs, [], []
    starts = [body.first for body in judge.bodies]
    # Sorted by tick, then distance: the first of each tick is its nearest pair.
    pairs = pairs.at(np.flatnonzero(np.isin(pairs.tick, judge.asked)))
    order = np.lexsort((pairs.distance, pairs.tick))
    for n in order[np.unique(pairs.tick[order], return_index=True)[1]]:
        i, part, leaf = int(pairs.tick[n]), int(pairs.body[n]), int(pairs.leaf[n])
        if part == PALM:
            away = np.linalg.norm(judge.posed.palm[i] - pairs.point[n], axis=1)
            part += int(np.abs(away - judge.hand.palm_radius).argmin())
        body = judge.bodies[int(np.searchsorted(starts, leaf, side="right")) - 1]
        leaf -= body.first
        pieces = body.pieces
        if pieces.triangles is not None and not pieces.triangles.solid[leaf]:
            # Coal has no triangle without area.
            continue
        piece = (body.mesh.triangles[leaf],) if judge.on_mesh else (pieces.center[leaf], float(pieces.radius[leaf]))
        row = i * (PALM + len(judge.hand.palm_radius)) + part
        a, b = body.seen_points(np.stack([cones.a[row], cones.b[row]])[None], np.array([i]))[0]
        found = coal_distance(a, b, float(cones.radius_a[row]), float(cones.radius_b[row]), *piece)
        off.append(abs(found - float(pairs.distance[n])))
        ticks.append(i)
    note, why = "" if off else "nothing is near", "a nanometre, and the library's bounds"
    return judged(name, says, off, LENGTH + EXACT, "m", why, ticks=ticks, note=note)


def mesh_claim(judge: JudgedTicks, report: Progress, *, covers: bool) -> tuple[Claim, float]:
    """Judge the graphic hand against the true mesh; return the claim and the maximum depth [m]."""
    name, says = "mesh", "the graphic hand stays out of the true mesh"
    why = "rounding, and the nanometre that the cover lets pass"
    try:
        surfaces = [TrueSurface(body.mesh, open_too=judge.on_mesh) for body in judge.bodies]
    except MeshError as error:
        return Claim(name, says, NOT_JUDGED, unit="m", why=why, note=str(error)), float("nan")
    least, checked, asked = np.full(len(judge.numbers), np.inf), 0, judge.asked
    used = np.append(np.repeat(judge.fingers, 3), np.ones(len(judge.hand.palm_radius), bool))
    for body, surface in zip(judge.bodies, surfaces):
        # Equal postures are measured once; a posture that is not finite fails other claims.
        rounded = np.round(body.seen_points(judge.posed.joints[asked], asked).reshape(len(asked), -1), 10)
        different = np.sort(np.unique(rounded, axis=0, return_index=True)[1])
        different = asked[different[np.isfinite(rounded[different]).all(axis=1)]]
        for begin in range(0, len(different), MESH_TICKS):
            report("mesh", begin, len(different))
            rows = different[begin : begin + MESH_TICKS]
            away = surface.round_cones(own_cones(judge.hand, body.seen(judge.posed, rows)), MESH_LIMIT)
            least[rows] = np.minimum(least[rows], away.reshape(len(rows), -1)[:, used].min(axis=1))
        checked = max(checked, len(different))
    least[judge.squeezed] = np.inf
    worst = int(least.argmin())
    depth = max(0.0, -float(least[worst]))
    promised = judge.safe and (judge.on_mesh or covers)
    verdict = NOT_CLAIMED if not promised else FAILS if depth > CLOSE else HOLDS
    note = "" if promised else "neither the method nor the tree promises it"
    assumed = [text for text in judge.result.scene.get("object_repairs") or [] if text.startswith(ASSUMED_SOLID)]
    note = "; ".join(filter(None, (note, left_out(judge.status, NO_PLACE), *assumed)))
    return Claim(name, says, verdict, depth, CLOSE, "m", worst if depth > 0.0 else None, checked, why, note), depth


# A second opinion by the collision library coal, where it is installed. It has no round cones but balls: the cone's
# distance is the minimum of d(x(s)) - r(s) along its axis, and d is convex for a sphere or a triangle.


def has_coal() -> bool:
    """Return True if coal is installed."""
    return find_spec("coal") is not None


def coal_distance(
    a: FloatArray, b: FloatArray, radius_a: float, radius_b: float, piece: FloatArray, size: float = 0.0
) -> float:
    """Compute the signed distance [m] of the hull of two balls to a triangle or a sphere, at most `EXACT` too large.

    `a`, `b` are the centres of the balls [m], shape (3,), with their radii [m]; `piece` is a triangle's corners [m],
    shape (3, 3), or a sphere's centre, shape (3,), of radius `size` [m].
    """
    import coal
    from scipy.optimize import minimize_scalar

    shape: Any = coal.Sphere(float(size))
    place = coal.Transform3s()
    if piece.ndim == 2:
        # Coal has no distance of a lone triangle, but that of a hierarchy of one.
        shape = coal.BVHModelOBBRSS()
        shape.beginModel(1, 3)
        shape.addVertices(np.array(piece))
        shape.addTriangles(np.array([[0, 1, 2]]))
        shape.endModel()
    else:
        place.setTranslation(np.array(piece))
    request, answer, ball, there = coal.DistanceRequest(), coal.DistanceResult(), coal.Sphere(0.0), coal.Transform3s()
    request.gjk_tolerance = 1e-12

    def distance(share: float) -> float:
        there.setTranslation(a + share * (b - a))
        answer.clear()
        radius = (1.0 - share) * radius_a + share * radius_b
        return float(coal.distance(shape, place, ball, there, request, answer)) - radius

    ends = min(distance(0.0), distance(1.0))
    if np.array_equal(a, b):
        return ends
    # The search looks between the ends, and does not reach them.
    return min(ends, float(minimize_scalar(distance, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-9}).fun))
