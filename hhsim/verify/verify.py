"""Referee of result files: judges every claim by code that shares no geometry with the solver.

Kinematics use scipy's rotations, distances closed forms and bisection, forces least squares and clarabel.
"""

from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hhsim.arrays import IntArray
from hhsim.errors import InputError, MeshError
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.mesh.solidify import ASSUMED_SOLID
from hhsim.result.reader import Result
from hhsim.system.counted import counted
from hhsim.system.progress import Progress
from hhsim.verify.again import again_claims
from hhsim.verify.body_checks import body_claims
from hhsim.verify.claim import FAILS, HOLDS, NOT_CLAIMED, NOT_JUDGED, Claim
from hhsim.verify.coverage import unjudged_claim
from hhsim.verify.depth_checks import contact_error_claim, depth_claims, hands_apart_claims, self_contact_claims
from hhsim.verify.file_checks import file_claims
from hhsim.verify.force_checks import force_claims
from hhsim.verify.free_object_checks import free_claims, free_complementarity_claim, free_hand_claim
from hhsim.verify.judged_body import seen_by_referee
from hhsim.verify.mesh_distance import CLOSE, HandReferee
from hhsim.verify.metric_checks import input_hand_claims, metric_claims, motion_claim
from hhsim.verify.origin_checks import origin_claims
from hhsim.verify.posture_checks import posture_claims
from hhsim.verify.session_checks import session_claims
from hhsim.verify.tick_data import NO_PLACE, JudgedTicks, left_out

MESH_LIMIT = 1e-6
"""Distances to the mesh are computed up to this value [m]."""
MESH_TICKS = 200
"""Ticks between two progress reports of the distances to the mesh."""
LONG, SAMPLED_EVERY = 10_000, 50
"""Ticks from which on a run is sampled by the claims in `SAMPLED`, and the sampling interval."""
SAMPLED = ("candidates", "distance by coal", "mesh", "contacts off the mesh")
"""Claims judged at sampled ticks of a long run, because they are slow."""


@dataclass(frozen=True, repr=False)
class Verification:
    """Verdicts of the referee."""

    claims: tuple[Claim, ...]  # every claim with its verdict
    ticks: int  # number of ticks in the file
    looked_at: int  # number of ticks at which the claims of `SAMPLED` were judged; all others are judged at every tick
    every: int  # sampling interval of those [ticks]
    sphere_penetration: float  # maximum depth in the leaf spheres [m]; NaN for a hand that touched the mesh
    mesh_penetration: float  # maximum depth in the true mesh [m]; NaN where it could not be judged
    stationarity: float  # worst imbalance of coupling and contacts [N]; NaN where no optimum is claimed

    def __repr__(self) -> str:
        found = Counter(claim.verdict for claim in self.claims)
        failed = ", ".join(claim.name for claim in self.claims if claim.failed)
        counts = ", ".join(f"{count} {word}" for word, count in found.items())
        return f"Verification({self.ticks:,} ticks; claims: {counts}{f' ({failed})' if failed else ''})"

    @property
    def looked(self) -> str:
        """Number of judged ticks and the sampled claims, in words."""
        if self.looked_at == self.ticks:
            return f"{counted(self.ticks, 'tick')} looked at"
        names = [claim.name for claim in self.claims if claim.name in SAMPLED]
        return f"{counted(self.ticks, 'tick')} looked at; {', '.join(names)}: 1 in {self.every} ticks"

    @property
    def passed(self) -> bool:
        """True if no claim failed."""
        return not any(claim.failed for claim in self.claims)

    def to_json(self) -> dict[str, Any]:
        """Return the verdicts as plain values, SI."""
        return {
            "passed": self.passed,
            "ticks": self.ticks,
            "ticks_looked_at": self.looked_at,
            "every": self.every,
            **{name: getattr(self, name) for name in ("sphere_penetration", "mesh_penetration", "stationarity")},
            "claims": [asdict(claim) for claim in self.claims],
        }


@np.errstate(all="ignore")
def verify(
    result: Result,
    *,
    every: int | None = None,
    again: bool = False,
    trust: bool = False,
    progress: Progress | None = None,
) -> Verification:
    """Judge a result of a replay or a session; values that are not finite fail.

    Args:
        result: Complete or not.
        every: Sampling interval of the claims in `SAMPLED` [ticks]; None: 1 below `LONG` ticks, else `SAMPLED_EVERY`.
            The ticks that the file itself names as worst are judged besides.
        again: Make the motion and run the ticks once more, too.
        trust: Import and run the code of a method that the file names for that, `package.module:Class`.
        progress: Called with a label, the work done and the total work.

    Raises:
        InputError: No ticks.
    """
    if result.ticks == 0:
        raise InputError(f"{result.path} has no ticks: there is nothing to verify")
    report = progress or (lambda what, done, total: None)
    report("file", 0, 4)
    claims = [*file_claims(result), *body_claims(result, again)]
    report("kinematics", 1, 4)
    every = every or (1 if result.ticks < LONG else SAMPLED_EVERY)
    numbers, sampled = np.arange(result.ticks), chosen_ticks(result, every)
    # Beside an object that moves, hands and forces are judged as it sees them.
    seen = result.seen_by(seen_by_referee)
    judge = JudgedTicks(seen, numbers, sampled)
    claims += posture_claims(judge)
    report("spheres", 2, 4)
    claims += [*depth_claims(judge), *self_contact_claims(judge), *hands_apart_claims(judge)]
    report("forces", 3, 4)
    claims += force_claims(judge)
    mesh, depth = _mesh_claim(judge, claims, report)
    claims += [mesh, contact_error_claim(judge), motion_claim(result), *input_hand_claims(judge)]
    claims += [*metric_claims(result), *session_claims(result), *origin_claims(result, again), *free_claims(result)]
    if result.body.is_free:
        claims += [free_hand_claim(JudgedTicks(result, numbers)), free_complementarity_claim(judge)]
    if again:
        claims += again_claims(result, report, trust)
    claims.append(unjudged_claim(result, claims))
    stationarity = next((claim.worst for claim in claims if claim.name == "stationarity"), float("nan"))
    return Verification(tuple(claims), result.ticks, len(sampled), every, judge.sphere_penetration, depth, stationarity)


def chosen_ticks(result: Result, every: int) -> IntArray:
    """Ticks judged by the sampled claims: one in `every`, the last, those that the file names as worst, and leaps.

    A leap moves a joint by more than the thinnest phalanx's radius, so it could pass a surface between two ticks.
    """
    worst = [
        int(np.nan_to_num(np.asarray(result[name], np.float64)).argmax())
        for name in ("penetration_depth", "lag", "force_variation_rate", "contacts/touching")
    ]
    odd = np.flatnonzero(result["status"])
    size = np.linalg.norm(result["force/total"], axis=1)
    regular = np.arange(0, result.ticks, every)
    travel = np.linalg.norm(np.diff(result["graphic/joints"], axis=0), axis=3).max(axis=(1, 2), initial=0.0)
    leaps = 1 + np.flatnonzero(travel > result.static["hand/phalanx_radius"].min())
    last = [result.ticks - 1, int(np.nan_to_num(size).argmax())]
    return np.unique(np.concatenate([regular, odd[:: max(1, len(odd) // 50)], leaps, worst, last]).astype(np.int64))


def _mesh_claim(judge: JudgedTicks, claims: list[Claim], report: Progress) -> tuple[Claim, float]:
    """Judge the graphic hand against the true mesh; return the claim and the maximum depth [m]."""
    name, says = "mesh", "the graphic hand stays out of the true mesh"
    why = "rounding, and the nanometre that the cover lets pass"
    try:
        referees = [HandReferee(body.mesh, open_too=judge.on_mesh) for body in judge.bodies]
    except MeshError as error:
        return Claim(name, says, NOT_JUDGED, unit="m", why=why, note=str(error)), float("nan")
    hand, posed, at, sampled = judge.hand, judge.chosen_posed, judge.chosen_shown, judge.asked
    shape = HandShape(hand.radius, hand.palm_center, hand.palm_radius)
    least, checked = np.full(len(judge.chosen), np.inf), 0
    used = np.append(np.repeat(judge.fingers, 3), True)
    for body, referee in zip(judge.bodies, referees):
        # Equal postures are measured once; a posture that is not finite fails other claims.
        rounded = np.round(body.seen_points(posed.joints[sampled], sampled).reshape(len(sampled), -1), 10)
        different = np.sort(np.unique(rounded, axis=0, return_index=True)[1])
        different = sampled[different[np.isfinite(rounded[different]).all(axis=1)]]
        for first in range(0, len(different), MESH_TICKS):
            report("mesh", first, len(different))
            rows = different[first : first + MESH_TICKS]
            away = referee.clearances(shape, body.seen_hand(posed, at.orientation, rows), MESH_LIMIT)
            least[rows] = np.minimum(least[rows], away[:, used].min(axis=1))
        checked = max(checked, len(different))
    least[judge.squeezed] = np.inf
    worst = int(least.argmin())
    depth = max(0.0, -float(least[worst]))
    covers = judge.on_mesh or any(claim.name == "cover" and claim.verdict in (HOLDS, FAILS) for claim in claims)
    promised = judge.safe and covers
    verdict = NOT_CLAIMED if not promised else FAILS if depth > CLOSE else HOLDS
    note = "" if promised else "neither the method nor the tree promises it"
    assumed = [text for text in judge.result.scene.get("object_repairs") or [] if text.startswith(ASSUMED_SOLID)]
    note = "; ".join(filter(None, (note, left_out(judge.status[judge.chosen], NO_PLACE), *assumed)))
    tick = int(judge.chosen[worst]) if depth > 0.0 else None
    return Claim(name, says, verdict, depth, CLOSE, "m", tick, checked, why, note), depth
