"""Referee of result files: its seal, its scene run again, and its physics by code that shares none with the solver.

Kinematics use scipy's rotations, distances closed forms and bisection, forces least squares and clarabel.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from hhsim.arrays import IntArray
from hhsim.errors import InputError
from hhsim.result.reader import Result
from hhsim.system.counted import counted
from hhsim.system.progress import Progress, silent
from hhsim.verify.claim import FAILS, HOLDS, NOT_CLAIMED, Claim
from hhsim.verify.depth_checks import depth_claims, mesh_claim
from hhsim.verify.file_checks import file_claims
from hhsim.verify.force_checks import force_claims
from hhsim.verify.free_object_checks import free_claims, free_hand_claims
from hhsim.verify.joint_checks import joint_claims, posture_claims
from hhsim.verify.second_run import second_run_claim
from hhsim.verify.tick_data import JudgedTicks
from hhsim.verify.tree_checks import cover, palm_claim, tree_encloses

LONG, SAMPLED_EVERY = 10_000, 50
"""Ticks from which on a run is sampled by the claims in `SAMPLED`, and the sampling interval."""
SAMPLED = ("distance by coal", "mesh")
"""Claims judged at sampled ticks of a long run, because they are slow."""
GROUPS = ("seal", "second run", "depth", "forces", "friction", "motion", "joints", "trees")
"""What claims are of, in the order of the output."""


@dataclass(frozen=True, repr=False)
class Verification:
    """Verdicts of the referee."""

    claims: tuple[Claim, ...]  # every claim with its verdict, by groups
    ticks: int  # number of ticks in the file
    looked_at: int  # number of ticks at which the claims of `SAMPLED` were judged; all others are judged at every tick
    every: int  # sampling interval of those [ticks]
    sphere_penetration: float  # maximum depth in the leaf spheres [m]; NaN for a hand that touched the mesh
    mesh_penetration: float  # maximum depth in the true mesh [m]; NaN where it could not be judged

    def __repr__(self) -> str:
        found = Counter(claim.verdict for claim in self.claims)
        failed = ", ".join(claim.name for claim in self.claims if claim.failed)
        counts = ", ".join(f"{count} {word}" for word, count in found.items())
        return f"Verification({self.ticks:,} ticks; claims: {counts}{f' ({failed})' if failed else ''})"

    @property
    def worst(self) -> tuple[Claim, ...]:
        """Claim of each group that decides: a false one, else that which is nearest to its limit."""
        found = []
        for group in GROUPS:
            mine = [claim for claim in self.claims if claim.group == group]
            judged = [claim for claim in mine if claim.verdict in (HOLDS, FAILS)] or mine
            if judged:
                found.append(max(judged, key=lambda claim: (claim.failed, np.nan_to_num(claim.share, nan=-1.0))))
        return tuple(found)

    @property
    def looked(self) -> str:
        """Number of judged ticks and the sampled claims, in words."""
        if self.looked_at == self.ticks:
            return f"{counted(self.ticks, 'tick')} looked at"
        names = dict.fromkeys(claim.name for claim in self.claims if claim.name in SAMPLED)
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
            **{name: getattr(self, name) for name in ("sphere_penetration", "mesh_penetration")},
            "claims": [asdict(claim) for claim in self.claims],
        }


def verify(
    result: Result, *, every: int | None = None, trust: bool = False, progress: Progress | None = None
) -> Verification:
    """Judge a result of a replay or a session, of two hands both; values that are not finite fail.

    Args:
        result: Complete or not.
        every: Sampling interval of the claims in `SAMPLED` [ticks]; None: 1 below `LONG` ticks, else `SAMPLED_EVERY`.
            The ticks that the file itself names as worst are judged besides.
        trust: Import and run the code of a method that the file names for that, `package.module:Class`.
        progress: Called with a label, the work done and the total work.

    Raises:
        InputError: No ticks.
    """
    if result.ticks == 0:
        raise InputError(f"{result.path} has no ticks: there is nothing to verify")
    report = progress or silent
    again = replace(second_run_claim(result, report, trust), group="second run")
    return physics(result, every=every, progress=report, before=[again])


@np.errstate(all="ignore")
def physics(
    result: Result, *, every: int | None = None, progress: Progress = silent, before: Sequence[Claim] = ()
) -> Verification:
    """Judge all but the second run, whose verdict may come `before`; arguments as of `verify`."""
    hands = [result] if result.name else list(result.hands.values())
    every = every or (1 if result.ticks < LONG else SAMPLED_EVERY)
    claims, deep, judges = list(before), list[float](), list[JudgedTicks]()
    for hand in hands:
        judge = JudgedTicks(hand, chosen_ticks(hand, every))
        progress("file", 0, 3)
        trees = [tree_encloses(hand), cover(hand)]
        mesh, depth = mesh_claim(judge, progress, covers=trees[1].verdict != NOT_CLAIMED)
        groups = {
            "seal": file_claims(hand),
            "depth": [*depth_claims(judge), mesh],
            "forces": [*force_claims(judge), *free_hand_claims(judge)],
            "joints": posture_claims(judge),
            "trees": [palm_claim(hand)],
        }
        own = hand.name if len(hands) > 1 else ""
        claims += [replace(claim, group=group, hand=own) for group, of in groups.items() for claim in of]
        judges.append(judge)
        deep.append(depth)
    of_bodies = {"joints": joint_claims(hands[0]), "trees": trees}
    claims[:0] = [replace(claim, group=group) for group, of in of_bodies.items() for claim in of]
    claims += free_claims(hands[0])
    claims.sort(key=lambda claim: GROUPS.index(claim.group))
    deepest = max(0.0, *(-float(judge.nearest.min(initial=0.0)) for judge in judges))
    spheres = float("nan") if judges[0].on_mesh else deepest
    return Verification(tuple(claims), result.ticks, len(judges[0].asked), every, spheres, max(deep))


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
