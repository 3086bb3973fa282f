"""Claims of the forces: the wrench at all ticks, balance and complementarity at the chosen ones."""

from collections.abc import Callable
from functools import cache

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.system.counted import counted
from hhsim.verify import forces
from hhsim.verify.claim import NOT_JUDGED, Claim, judged
from hhsim.verify.contacts import PALM
from hhsim.verify.cover_checks import leaves
from hhsim.verify.file_checks import follows
from hhsim.verify.kinematics import euler_change, turn_between
from hhsim.verify.tick_data import CAPACITY_EXCEEDED, LAG, LENGTH, NO_PLACE, SNAP, STUCK, JudgedTicks, left_out

FORCE = 1e-6
"""Relative tolerance of forces, and absolute one [N]: a ten-thousandth of the least force that has a rate."""
WHY_FORCE = "a millionth: a ten-thousandth of the least force that has a rate"
TURN = 4.0
"""Factor of the turn of the normals in a tick's last step, which is the step over the rolling radii; it covers the
levers of moments and both bodies of a contact."""
LEAN = 0.03
"""Sine of the largest angle between a mesh contact's normal and the line to the nearest point (1.7°, docs/methods.md);
the forces of a tick on its way follow such a normal, at rest both agree."""
FALLS = 32.0
"""Ticks in a row after which a hand that snaps may go twice as far in a tick."""
WHY_SLACK = "a millionth, and how far normals turn in the tick's last step, after which the program is not solved again"
NAME, SAYS = "forces", "contact forces follow from the configuration"
SAYS_APART = "what does not touch bears no force"


def force_claims(judge: JudgedTicks) -> list[Claim]:
    """Judge the forces that the method and its force model claim."""
    claims = [_wrench(judge)]
    if not judge.result.gives("work"):
        given = judge.result.gives("forces")
        note = "the method is not hhsim's, " + ("and these are what it said" if given else "and said none")
        return [*claims, Claim(NAME, SAYS, NOT_JUDGED, note=note)]
    if judge.result.body.is_free:
        # Friction has other claims: `hhsim.verify.free_object_checks`.
        return claims
    method, force = judge.options["method"], judge.options["force"]

    # Two claims ask for that of a tick.
    @cache
    def moment_at(i: int) -> forces.Moment:
        flexion, pull = judge.chosen_shown.flexion[i], judge.pull[int(judge.chosen[i])]
        at = forces.moment(judge.hand, judge.chosen_posed, flexion, judge.bearing_at(i), i, pull)
        return forces.with_meetings(at, judge.chosen_posed, judge.meetings_at(i), i) if judge.self_contact else at

    if method == "coupled":
        claims.append(_stationarity(judge, moment_at))
        if force == "kkt":
            claims += [_palm_balance(judge), *_snaps(judge)]
    if force == "paper":
        return [*claims, _eq_14(judge)]
    if judge.safe:
        return [*claims, _complementarity(judge), _balance(judge, moment_at)]
    note = f"of method {method} they do not: its programs are gone"
    return [*claims, Claim(NAME, SAYS, NOT_JUDGED, note=note)]


def _wrench(judge: JudgedTicks) -> Claim:
    pull, stored, says, note = judge.pull[:, :6], np.asarray(judge.result["force/palm_wrench"]), "", ""
    if judge.options["method"] == "paper":
        stiffness, hands = judge.diagonal[3:6], (judge.wanted.orientation, judge.shown.orientation)
        torque = stiffness * euler_change(*hands, stored[:, 3:] / stiffness)
        locked = np.asarray(np.isnan(torque).any(axis=1))
        pull = np.concatenate([pull[:, :3], np.where(locked[:, None], stored[:, 3:], torque)], axis=1)
        says, count = ", rotation in Euler angles", int(locked.sum())
        note = f"torque left out in {counted(count, 'tick')}: Euler angles lock there" if count else ""
    off = np.abs(pull - stored).max(axis=1)
    tolerance, says = FORCE * (1.0 + np.abs(pull).max(axis=1)), f"Eq. 1: G (q_g − q_h){says}"
    return judged("palm wrench", says, off, tolerance, "N", WHY_FORCE, ticks=judge.numbers, note=note)


def force_slack(judge: JudgedTicks, size: FloatArray, ticks: IntArray) -> FloatArray:
    """Tolerance [N] of forces of size (n,) at some ticks: multipliers belong to the program one step earlier."""
    return FORCE * (1.0 + size) + TURN * size * judge.last_step[ticks] / judge.rolling


OTHERWISE = CAPACITY_EXCEEDED | NO_PLACE | SNAP
"""Flags of ticks whose forces are no program's, or of one that was not at an end."""


def _judgeable(judge: JudgedTicks, without: int) -> tuple[IntArray, str]:
    """Return the places in `chosen` of the ticks without some status flags, and in words which are left out."""
    status = judge.status[judge.chosen]
    return np.flatnonzero(status & without == 0), left_out(status, without)


def _stationarity(judge: JudgedTicks, moment_at: Callable[[int], forces.Moment]) -> Claim:
    chosen, note = _judgeable(judge, STUCK | LAG | OTHERWISE)
    off = np.array([forces.balance(moment_at(int(i)), judge.scale) for i in chosen])
    size = np.linalg.norm(judge.pull[judge.chosen] * judge.scale, axis=1)
    tolerance = force_slack(judge, size, judge.chosen)[chosen]
    says = "a settled tick is at the optimum: w = Jᵀλ + μ, λ ≥ 0 at what touches"
    return judged("stationarity", says, off, tolerance, "N", WHY_SLACK, ticks=judge.chosen[chosen], note=note)


def _palm_balance(judge: JudgedTicks) -> Claim:
    flags = STUCK | LAG | CAPACITY_EXCEEDED | NO_PLACE
    settled, note = np.flatnonzero(judge.status & flags == 0), left_out(judge.status, flags)
    total = np.asarray(judge.result["force/total"])[settled]
    size = np.linalg.norm(total, axis=1)
    off = np.linalg.norm(judge.pull[settled, :3] - total, axis=1)
    says = "contact forces add up to the pull on the palm, with what holds back a hand that snaps"
    tolerance = force_slack(judge, np.linalg.norm(judge.pull * judge.scale, axis=1)[settled], settled)
    tolerance = np.maximum(tolerance, FORCE * (1.0 + size))
    return judged("palm balance", says, off, tolerance, "N", WHY_SLACK, ticks=settled, note=note)


def _snaps(judge: JudgedTicks) -> list[Claim]:
    """Judge ticks that snap: a way is left, or a force has yet to follow; no force goes farther than the hand may."""
    snaps = np.flatnonzero((judge.status & SNAP > 0) & follows(judge.result))
    if snaps.size == 0:
        return []
    before, lag = snaps - 1, np.asarray(judge.result["lag"])
    idle = (lag[snaps] <= 0.0) & (judge.status[before] & SNAP == 0)
    step, asked = judge.stored_forces(snaps) - judge.stored_forces(before), judge.wanted_posed.joints
    way = np.linalg.norm(asked[snaps] - asked[before], axis=3).max(axis=(1, 2))
    way += np.where(judge.status[before] & LAG, lag[before], 0.0)
    # What parts that move as recorded push is not known here.
    way += np.inf if len(judge.result.bodies) > 1 else 0.0
    settled = np.maximum.accumulate(np.where(judge.status & SNAP, -1, np.arange(judge.result.ticks)))
    growth = 1.0 + ((before - settled[before]) / FALLS) ** 2
    most = judge.diagonal[0] * (growth * judge.options["snap_speed"] * judge.options["period"] + way)
    # Phalanges of a finger share what touches their joint in any way: their sum is what follows.
    of_finger = step[:, :PALM].reshape(len(step), -1, 3, 3).sum(axis=2)
    off = np.where(idle, np.inf, np.linalg.norm(of_finger, axis=2).max(axis=1) - most)
    says = "a hand that snaps has a way left, or forces that follow as fast as the hand may go"
    return [judged("snaps", says, np.maximum(off, 0.0), FORCE * (1.0 + most), "N", WHY_FORCE, ticks=snaps)]


def _complementarity(judge: JudgedTicks) -> Claim:
    chosen, note = _judgeable(judge, STUCK | OTHERWISE)
    nearest = judge.near.nearest[chosen]
    if judge.self_contact:
        nearest = np.minimum(nearest, judge.meetings.nearest(len(judge.chosen))[chosen])
    nearest = np.minimum(nearest, judge.against_other_hand.nearest(len(judge.chosen))[chosen])
    return bears_where_near(judge, chosen, nearest, judge.bearing_within[chosen], SAYS_APART, note)


def bears_where_near(
    judge: JudgedTicks, places: IntArray, nearest: FloatArray, within: FloatArray, says: str, note: str
) -> Claim:
    """Judge how far from everything (n, 16) [m] bodies are that bear a force, at some chosen ticks."""
    bears = np.linalg.norm(judge.stored_forces(judge.chosen[places]), axis=2) > FORCE
    gap, within = np.where(bears, np.maximum(nearest, 0.0), 0.0), np.broadcast_to(within + LENGTH, bears.shape)
    worst = np.arange(len(places)), (gap / within).argmax(axis=1)
    why = "what the last step of a tick leaves between what bears more than a micronewton"
    return judged("complementarity", says, gap[worst], within[worst], "m", why, ticks=judge.chosen[places], note=note)


def _balance(judge: JudgedTicks, moment_at: Callable[[int], forces.Moment]) -> Claim:
    chosen, note = _judgeable(judge, STUCK | OTHERWISE)
    stored = judge.stored_forces(judge.chosen).reshape(len(judge.chosen), -1)
    size, lags = np.linalg.norm(stored, axis=1), judge.status[judge.chosen] & LAG > 0
    # Normals of all contacts turn, and what they leave adds up.
    every = np.linalg.norm(stored.reshape(len(stored), -1, 3), axis=2).sum(axis=1)
    # On its way, the program is solved once more where the tick stands.
    slack = np.where(lags, FORCE * (1.0 + size), force_slack(judge, every, judge.chosen))
    offset, progressive = float(judge.options["offset"]), judge.options["method"] == "progressive"
    off = np.empty(len(chosen))
    for n, i in enumerate(chosen):
        at, force, late = moment_at(int(i)), stored[i], bool(lags[i])
        explanations = [] if late else [(at.pull, True), (at.pull, False)] if progressive else [(at.pull, False)]
        off[n] = min(
            (forces.explained(at, judge.scale, force, pull, apart) for pull, apart in explanations), default=np.inf
        )
        # On its way, or where the palm of `progressive` yields to a finger, contacts bear what they can.
        yields = late or (progressive and off[n] > slack[i])
        if yields and (judge.on_mesh or judge.against_other_hand.of(int(i)).body.size):
            # Where the other hand goes meanwhile is not known here; the features of a mesh that are rows are the
            # solver's choice. All must be pushes, wherever they act.
            alone = forces.residual(at.bodies.T, force)
            if late and judge.on_mesh and alone < off[n]:
                slack[i] += LEAN * size[i]
            off[n] = min(off[n], alone)
        elif yields:
            pull = forces.on_its_way(at, judge.diagonal, offset)
            off[n] = min(off[n], forces.explained(at, judge.scale, force, pull, False))
    says = "forces push along the normals of what touches, and balance the coupling"
    return judged("force balance", says, off, slack[chosen], "N", WHY_SLACK, ticks=judge.chosen[chosen], note=note)


def _eq_14(judge: JudgedTicks) -> Claim:
    """Eq. 14 over touching pairs; ticks with a pair within 1 nm of the limit, or an ambiguous one, are left out."""
    from scipy.spatial.transform import Rotation

    name, says = "Eq. 14", "each body's force is the sum of k |p_g − p_h| n over what touches"
    if judge.on_mesh:
        return Claim(name, says, NOT_JUDGED, note="which features of a mesh the sum is over is not in the file")
    close = np.abs(judge.pairs.distance - judge.touch) <= LENGTH
    unclear = np.isin(np.arange(len(judge.chosen)), judge.pairs.tick[close])
    if judge.options["method"] == "paper":
        # What the method's own detection finds may be fewer, or more.
        counts = np.bincount(judge.touching.tick, minlength=len(unclear))
        unclear |= counts != np.asarray(judge.result["contacts/touching"])[judge.chosen]
        closed = judge.options["frustum_ends"] == "spheres"
        spheres = leaves(judge.result.body)
        moved = judge.moved[judge.chosen]
        other = forces.on_another_part(judge.hand, judge.chosen_posed, judge.touching, *spheres, closed, moved)
        unclear[judge.touching.tick[other]] = True
    chosen = np.flatnonzero(~unclear & (judge.status[judge.chosen] & CAPACITY_EXCEEDED == 0))
    wanted = judge.wanted_posed.at(judge.chosen)
    there = judge.wanted.at(judge.chosen).orientation
    turn = Rotation.from_rotvec(turn_between(judge.chosen_shown.orientation, there)).as_matrix()
    stiffness = float(judge.options["stiffness"]["contact"])
    own = np.array(
        [
            forces.proxy_forces(judge.touching.of(int(i)), judge.chosen_posed, wanted, turn[i], int(i), stiffness)
            for i in chosen
        ]
    ).reshape(len(chosen), PALM + 1, 3)
    off = np.abs(own - judge.stored_forces(judge.chosen[chosen])).max(axis=(1, 2))
    tolerance = FORCE * (1.0 + np.abs(own).sum(axis=(1, 2)))
    count = int(unclear.sum())
    note = f"{counted(count, 'tick')} left out: what touches, or where, is unclear" if count else ""
    return judged(name, says, off, tolerance, "N", WHY_FORCE, ticks=judge.chosen[chosen], note=note)
