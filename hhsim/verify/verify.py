"""The referee: every claim of a result file, checked by code that shares no geometry with the solver.

Kinematics are scipy's rotations (`hhsim.verify.kinematics`), distances to spheres a bisection
(`hhsim.verify.contacts`), distances to the true mesh coal's (`hhsim.verify.mesh_distance`), forces least squares and
clarabel (`hhsim.verify.forces`); figures are computed anew (`hhsim.verify.metric_checks`). Nothing is taken from the
solver but what the file holds.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hhsim.arrays import IntArray
from hhsim.errors import InputError, MeshError
from hhsim.mesh.solidify import ASSUMED_SOLID
from hhsim.replay.stored_scene import stored_mesh
from hhsim.result.reader import Result
from hhsim.system.counted import counted
from hhsim.verify.again import again_claims
from hhsim.verify.claim import FAILS, HOLDS, NOT_CLAIMED, NOT_JUDGED, Claim
from hhsim.verify.depth_checks import contact_error_claim, depth_claims
from hhsim.verify.file_checks import file_claims
from hhsim.verify.force_checks import force_claims
from hhsim.verify.free_object_checks import free_claims, free_complementarity_claim, free_hand_claim
from hhsim.verify.input_hand_check import input_hand_claims, motion_claim
from hhsim.verify.metric_checks import metric_claims
from hhsim.verify.object_frame import object_motion_claims, seen_by_referee
from hhsim.verify.origin_checks import origin_claims
from hhsim.verify.posture_checks import posture_claims
from hhsim.verify.session_checks import session_claims
from hhsim.verify.tick_data import JudgedTicks

Progress = Callable[[str, int, int], None]

MESH_LIMIT = 1e-6
"""Distances to the mesh from here on are not looked for [m]."""
MESH_TICKS = 200
"""Ticks between two words of how far the mesh's distances are."""
MESH_EXACT = 1e-8
"""How near the referee's two bounds of a distance to the mesh are to each other [m], see `mesh_distance`."""


LONG, SAMPLED_EVERY = 10_000, 50
"""From so many ticks on, a library is asked at one tick in so many."""
SAMPLED = ("candidates", "distance by coal", "mesh", "contacts off the mesh")
"""Claims that are judged at some ticks of a long run: pairs far from touching are many, and a library is slow."""


@dataclass(frozen=True, repr=False)
class Verification:
    """What the referee found.

    Attributes:
        claims: Every claim with its verdict.
        ticks: Of the file; what is cheap was judged at all of them, depths and forces among it.
        looked_at: Ticks of what is sampled: of the claims `SAMPLED`.
        every: One in so many.
        sphere_penetration: Deepest in the leaf spheres [m]; NaN where it touched the mesh.
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

    def __repr__(self) -> str:
        found = Counter(claim.verdict for claim in self.claims)
        failed = ", ".join(claim.name for claim in self.claims if claim.failed)
        counts = ", ".join(f"{count} {word}" for word, count in found.items())
        return f"Verification({self.ticks:,} ticks; claims: {counts}{f' ({failed})' if failed else ''})"

    @property
    def looked(self) -> str:
        """In words, how many ticks were looked at, and what was sampled."""
        if self.looked_at == self.ticks:
            return f"{counted(self.ticks, 'tick')} looked at"
        names = [claim.name for claim in self.claims if claim.name in SAMPLED]
        return f"{counted(self.ticks, 'tick')} looked at; {', '.join(names)}: 1 in {self.every} ticks"

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


@np.errstate(all="ignore")
def verify(
    result: Result, *, every: int | None = None, again: bool = False, progress: Progress | None = None
) -> Verification:
    """Judge a result; what is not finite is as wrong as can be.

    Args:
        result: Of a replay or a session, complete or not.
        every: A library is asked at one tick in so many, and where the file says that it is worst; None: at every tick
            below `LONG` ticks, else at one in `SAMPLED_EVERY`. All else is judged at every tick.
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
    every = every or (1 if result.ticks < LONG else SAMPLED_EVERY)
    numbers, asked = np.arange(result.ticks), chosen_ticks(result, every)
    # Beside an object that moves, hands and forces are judged as it sees them.
    seen = result.seen_by(seen_by_referee)
    judge = JudgedTicks(seen, numbers, asked)
    claims += posture_claims(judge)
    report("spheres", 2, 4)
    claims += depth_claims(judge)
    report("forces", 3, 4)
    claims += force_claims(judge)
    mesh, depth = _mesh_claim(judge, claims, report)
    claims += [
        mesh,
        contact_error_claim(judge),
        motion_claim(result),
        *input_hand_claims(judge),
        *metric_claims(seen),
        *session_claims(result),
        *origin_claims(result, again),
    ]
    claims += free_claims(result)
    if result.free:
        claims += [free_hand_claim(JudgedTicks(result, numbers)), free_complementarity_claim(judge)]
    if again:
        claims += again_claims(result, report)
    stationarity = next((claim.worst for claim in claims if claim.name == "stationarity"), float("nan"))
    return Verification(tuple(claims), result.ticks, len(asked), every, judge.sphere_penetration, depth, stationarity)


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
    """The ticks to look at: one in `every`, the last, and where the file itself says that something is worst.

    And those in which the hand leaps: what moves by less than it is thick cannot get inside without touching the
    surface in some tick, which is judged at all of them.
    """
    worst = [
        int(np.nan_to_num(np.asarray(result[name], np.float64)).argmax())
        for name in ("penetration_depth", "lag", "force_variation_rate", "contacts/touching")
    ]
    odd = np.flatnonzero(result["status"])
    size = np.linalg.norm(result["force/total"], axis=1)
    regular = np.arange(0, result.ticks, every)
    way = np.linalg.norm(np.diff(result["graphic/joints"], axis=0), axis=3).max(axis=(1, 2), initial=0.0)
    leaps = 1 + np.flatnonzero(way > result.static["hand/phalanx_radius"].min())
    last = [result.ticks - 1, int(np.nan_to_num(size).argmax())]
    return np.unique(np.concatenate([regular, odd[:: max(1, len(odd) // 50)], leaps, worst, last]).astype(np.int64))


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
    hand, posed, at, asked = judge.hand, judge.chosen_posed, judge.chosen_shown, judge.asked
    shape = HandShape(hand.radius, hand.palm_center, hand.palm_radius)
    # A hand at rest is the same hand over and over.
    rounded = np.round(posed.joints[asked].reshape(len(asked), -1), 10)
    different = np.sort(np.unique(rounded, axis=0, return_index=True)[1])
    # A hand that is nowhere has no distance; that it is nowhere is another claim's matter.
    different = asked[different[np.isfinite(rounded[different]).all(axis=1)]]
    least = np.full(len(judge.chosen), np.inf)
    used = np.append(np.repeat(judge.fingers, 3), True)
    for first in range(0, len(different), MESH_TICKS):
        report("mesh", first, len(different))
        part = different[first : first + MESH_TICKS]
        placed = PlacedHand(posed.joints[part], at.position[part], at.orientation[part])
        least[part] = referee.clearances(shape, placed, MESH_LIMIT)[:, used].min(axis=1)
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
