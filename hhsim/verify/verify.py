"""The referee: every claim of a result file, checked by code that shares no geometry with the solver.

Kinematics are scipy's rotations (`hhsim.verify.kinematics`), distances to spheres a bisection
(`hhsim.verify.contacts`), distances to the true mesh coal's (`hhsim.verify.mesh_distance`), forces least squares and
clarabel (`hhsim.verify.forces`); figures are computed anew (`hhsim.verify.metric_checks`). Nothing is taken from the
solver but what the file holds.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import InputError, MeshError
from hhsim.mesh.solidify import ASSUMED_SOLID
from hhsim.replay.stored_scene import stored_mesh
from hhsim.result.reader import Result
from hhsim.verify.again import again_claims
from hhsim.verify.claim import FAILS, HOLDS, NOT_CLAIMED, NOT_JUDGED, Claim
from hhsim.verify.depth_checks import contact_error_claim, depth_claims
from hhsim.verify.file_checks import file_claims
from hhsim.verify.force_checks import force_claims
from hhsim.verify.free_object_checks import free_claims, free_complementarity_claim, free_hand_claim
from hhsim.verify.input_hand_check import input_hand_claims
from hhsim.verify.metric_checks import metric_claims
from hhsim.verify.object_frame import object_motion_claims, seen_by_referee
from hhsim.verify.origin_checks import origin_claims
from hhsim.verify.posture_checks import posture_claims
from hhsim.verify.session_checks import session_claims
from hhsim.verify.tick_data import JudgedTicks

IntArray = NDArray[np.int64]
Progress = Callable[[str, int, int], None]

MESH_LIMIT = 1e-3
"""Distances to the mesh from here on are not looked for [m]."""
MESH_EXACT = 1e-8
"""How near the referee's two bounds of a distance to the mesh are to each other [m], see `mesh_distance`."""


@dataclass(frozen=True)
class Verification:
    """What the referee found.

    Attributes:
        claims: Every claim with its verdict.
        ticks: Of the file.
        looked_at: Ticks whose geometry and forces were judged; what is cheap was judged at all of them.
        every: One in so many, as asked for.
        sphere_penetration: Deepest in the leaf spheres, of the ticks looked at [m]; NaN where it touched the mesh.
        mesh_penetration: Deepest in the true mesh [m]; NaN where that could not be judged.
        stationarity: Imbalance of the coupling against what touches [N], at the tick nearest to what is let pass there;
            NaN where no optimum is claimed.
    """

    claims: tuple[Claim, ...]
    ticks: int
    looked_at: int
    every: int
    sphere_penetration: float
    mesh_penetration: float
    stationarity: float

    @property
    def passed(self) -> bool:
        """Whether no claim is false."""
        return not any(claim.failed for claim in self.claims)

    def to_json(self) -> dict[str, Any]:
        """For machines, SI units."""
        return {
            "passed": self.passed,
            "ticks": self.ticks,
            "ticks_looked_at": self.looked_at,
            "every": self.every,
            "sphere_penetration": self.sphere_penetration,
            "mesh_penetration": self.mesh_penetration,
            "stationarity": self.stationarity,
            "claims": [claim.to_json() for claim in self.claims],
        }


def verify(result: Result, *, every: int = 10, again: bool = False, progress: Progress | None = None) -> Verification:
    """Judge a result.

    Args:
        result: Of a replay or a session, complete or not.
        every: Geometry and forces are judged at one tick in so many, and where the file says it is worst.
        again: Whether the motion is made and the ticks are run once more, with what the file holds and names.
        progress: Called with what is being done, how much is done and how much there is.

    Raises:
        InputError: No ticks, or coal is not installed.
    """
    require_coal()
    if result.ticks == 0:
        raise InputError(f"{result.path} has no ticks: there is nothing to verify")
    report = progress or (lambda what, done, total: None)
    report("file", 0, 4)
    claims = [*file_claims(result), *object_motion_claims(result)]
    report("kinematics", 1, 4)
    chosen = chosen_ticks(result, every)
    # Beside an object that moves, hands and forces are judged as it sees them.
    seen = result.seen_by(seen_by_referee)
    judge = JudgedTicks(seen, chosen)
    claims += posture_claims(judge)
    report("spheres", 2, 4)
    claims += depth_claims(judge)
    report("forces", 3, 4)
    claims += force_claims(judge)
    mesh, depth = _mesh_claim(judge, claims, report)
    claims += [
        mesh,
        contact_error_claim(judge),
        *input_hand_claims(judge),
        *metric_claims(seen),
        *session_claims(result),
        *origin_claims(result, again),
    ]
    claims += free_claims(result)
    if result.free:
        claims += [free_hand_claim(JudgedTicks(result, chosen)), free_complementarity_claim(judge)]
    if again:
        claims += again_claims(result, report)
    stationarity = next((claim.worst for claim in claims if claim.name == "stationarity"), float("nan"))
    return Verification(tuple(claims), result.ticks, len(chosen), every, judge.sphere_penetration, depth, stationarity)


def require_coal() -> None:
    """Make sure that coal is there.

    Raises:
        InputError: It is not.
    """
    try:
        import coal  # noqa: F401
    except ImportError as error:
        raise InputError(
            "distances to the true mesh are measured with coal, which is not installed: pip install 'hhsim[verify]'"
        ) from error


def chosen_ticks(result: Result, every: int) -> IntArray:
    """The ticks to look at: one in `every`, the last, and where the file itself says that something is worst."""
    worst = [
        int(np.nan_to_num(np.asarray(result[name], np.float64)).argmax())
        for name in ("penetration_depth", "lag", "force_variation_rate", "contacts/touching")
    ]
    odd = np.flatnonzero(result["status"])
    size = np.linalg.norm(result["force/total"], axis=1)
    regular = np.arange(0, result.ticks, every)
    last = [result.ticks - 1, int(np.nan_to_num(size).argmax())]
    return np.unique(np.concatenate([regular, odd[:: max(1, len(odd) // 50)], worst, last]).astype(np.int64))


def _mesh_claim(judge: JudgedTicks, claims: list[Claim], report: Progress) -> tuple[Claim, float]:
    """The graphic hand against the true mesh, by coal: a claim where the spheres cover it and nothing is in them."""
    from hhsim.hand.forward_kinematics import PlacedHand
    from hhsim.kernels.hand.hand_shape import HandShape
    from hhsim.verify.mesh_distance import HandReferee

    name, says = "mesh", "the graphic hand stays out of the true mesh"
    why = "the bounds of the referee's own distance"
    try:
        referee = HandReferee(stored_mesh(judge.result), open_too=judge.on_mesh)
    except MeshError as error:
        return Claim(name, says, NOT_JUDGED, unit="m", why=why, note=str(error)), float("nan")
    hand, posed, at = judge.hand, judge.chosen_posed, judge.chosen_shown
    shape = HandShape(hand.radius, hand.palm_center, hand.palm_radius)
    # A hand at rest is the same hand over and over.
    rounded = np.round(posed.joints.reshape(len(judge.chosen), -1), 10)
    different = np.unique(rounded, axis=0, return_index=True)[1]
    # A hand that is nowhere has no distance; that it is nowhere is another claim's matter.
    different = different[np.isfinite(rounded[different]).all(axis=1)]
    least = np.full(len(judge.chosen), np.inf)
    used = np.append(np.repeat(judge.fingers, 3), True)
    for done, i in enumerate(np.sort(different)):
        report("mesh", done, len(different))
        one = slice(i, i + 1)
        placed = PlacedHand(posed.joints[one], at.position[one], at.orientation[one])
        least[i] = referee.clearances(shape, placed, MESH_LIMIT)[0][used].min()
    worst = int(least.argmin())
    depth = max(0.0, -float(least[worst]))
    covers = judge.on_mesh or any(claim.name == "cover" and claim.verdict in (HOLDS, FAILS) for claim in claims)
    promised = judge.safe and covers
    verdict = NOT_CLAIMED if not promised else FAILS if depth > MESH_EXACT else HOLDS
    note = "" if promised else "neither the method nor the tree promises it"
    assumed = [text for text in judge.result.scene.get("object_repairs") or [] if text.startswith(ASSUMED_SOLID)]
    note = "; ".join([*([note] if note else []), *assumed])
    tick = int(judge.chosen[worst]) if depth > 0.0 else None
    return Claim(name, says, verdict, depth, MESH_EXACT, "m", tick, len(different), why, note), depth
