"""Claims of a hand whose own parts, or that and the other hand, keep out of each other, and of depths in itself."""

import numpy as np

from hhsim.result.schema import HANDS_APART
from hhsim.verify.claim import NOT_JUDGED, Claim, as_number, judged
from hhsim.verify.own_parts import meetings, parts_that_may_meet
from hhsim.verify.tick_data import LENGTH, NO_OTHER, NO_PLACE, WHY_LENGTH, JudgedTicks


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
    if not judge.result.scene.get(HANDS_APART):
        return []
    name, says = "hands apart", "no part of the shown hand is in the other hand"
    if judge.other is None:
        return [Claim(name, says, NOT_JUDGED, note=NO_OTHER)]
    nearest = judge.of_other_hand(judge.numbers, 0.0).nearest(len(judge.numbers)).min(axis=1)
    known = np.isfinite(judge.shown_posed.joints).all(axis=(1, 2, 3))
    depth = np.where(known, np.maximum(0.0, -nearest), np.inf)
    # Moving parts that leave a hand no place may push it into the other one.
    depth[(judge.status | np.asarray(judge.other["status"])) & NO_PLACE != 0] = 0.0
    return [judged(name, says, depth, LENGTH, "m", WHY_LENGTH, ticks=judge.numbers)]
