"""Claims of the ticks: where the hand is, what it touches, and the forces there."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hhsim.result import Result
from hhsim.verify_claim import NOT_CLAIMED, NOT_JUDGED, Claim, all_true, judged
from hhsim.verify_coal import EXACT, coal_distance
from hhsim.verify_contacts import PALM, Pairs, near_pairs
from hhsim.verify_file import leaves
from hhsim.verify_forces import Moment, balance, explained, fingertip_normals, moment, on_its_way, proxy_forces
from hhsim.verify_hand import Configurations, Posed, configurations, own_hand, pose, turn_between

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
FINGERS = ("thumb", "index", "middle", "ring", "little")

STUCK, LAG, HELD, START_INSIDE, FULL, ABDUCTION_HELD = 1, 2, 4, 8, 16, 32
LENGTH = 1e-9
"""Lengths that differ by this [m] are the same: a thousandth of the smallest that any table shows."""
ANGLE = 1e-9
NEVER_IN = 1e-12
"""Rounding of a distance [m]: what promises not to penetrate may be this deep."""
FORCE = 1e-6
"""Forces that differ by this share, or by this [N], are the same: a ten-thousandth of the least that has a rate."""
TURN = 4.0
"""Normals at the end of a tick differ from those of its last program by at most its last step over the radii that
roll on each other; times this for moments, whose levers move as well, and for both hands of a contact."""


class TickReferee:
    """Judges the ticks of a result.

    Args:
        result: Of schema 3.
        chosen: Ticks whose distances and forces are judged, ascending.
    """

    def __init__(self, result: Result, chosen: IntArray) -> None:
        self.result, self.chosen = result, chosen
        self.hand = own_hand(result)
        self.options = result.scene["solver"]
        self.fingers = np.array([name in self.options["fingers"] for name in FINGERS])
        self.status = np.asarray(result["status"])
        self._all = configurations(result, "graphic")
        self._haptic = self._last_good(configurations(result, "haptic"))
        self._posed, self._wanted = pose(self.hand, self._all), pose(self.hand, self._haptic)
        self.configuration = self._all.at(chosen)
        self.graphic = Posed(*(values[chosen] for values in self._posed))
        g = self.options["stiffness"]
        self.diagonal = np.repeat([g["translation"], g["rotation"], g["flexion"]], [3, 3, 15]).astype(np.float64)
        self.scale = np.sqrt(g["translation"] / self.diagonal)

    def _last_good(self, haptic: Configurations) -> Configurations:
        """The input with what is not finite replaced by the last good one, which is what the solver goes on with."""
        good = np.ones(self.result.ticks, bool)
        for values in haptic:
            good &= np.isfinite(values).reshape(len(values), -1).all(axis=1)
        good &= np.linalg.norm(haptic.orientation, axis=1) > 0.0
        last = np.maximum.accumulate(np.where(good, np.arange(len(good)), 0))
        return haptic.at(last)

    @property
    def _ticks(self) -> IntArray:
        return np.arange(self.result.ticks)

    @cached_property
    def _pull(self) -> FloatArray:
        """G (q_g − q_h) of all ticks, shape (T, 21)."""
        here, there = self._all, self._haptic
        turn = turn_between(there.orientation, here.orientation)
        bend = (here.flexion - there.flexion).reshape(-1, 15)
        return np.concatenate([here.position - there.position, turn, bend], axis=1) * self.diagonal

    @cached_property
    def _moved(self) -> FloatArray:
        """How far the farthest joint moved since the tick before [m], shape (T,); the first counts as far."""
        moved = np.linalg.norm(np.diff(self._posed.joints, axis=0), axis=3).max(axis=(1, 2), initial=0.0)
        return np.concatenate([[np.inf], moved])

    @cached_property
    def _pairs(self) -> Pairs:
        center, radius = leaves(self.result)
        return near_pairs(self.hand, self.graphic, center, radius, self.fingers, 2.0 * self.options["touch"])

    @property
    def sphere_penetration(self) -> float:
        """Deepest in the leaf spheres [m]."""
        return max(0.0, -float(self._pairs.distance.min(initial=0.0)))

    def posture_claims(self) -> list[Claim]:
        """Where the hand is, at all ticks."""
        result, hand, at, ticks = self.result, self.hand, self._all, self._ticks
        unit = np.abs(np.linalg.norm(at.orientation, axis=1) - 1.0)
        off = np.linalg.norm(self._posed.joints - result["graphic/joints"], axis=3).max(axis=(1, 2))
        beyond = np.maximum(hand.flexion_min - at.flexion, at.flexion - hand.flexion_max).max(axis=(1, 2))
        settled = self.status & (STUCK | LAG | HELD | START_INSIDE | FULL | ABDUCTION_HELD) == 0
        spread = np.abs(at.abduction - self._haptic.abduction).max(axis=1)
        why = "a thousandth of the smallest length that a table shows"
        return [
            judged("unit quaternions", "orientations are unit", unit, 1e-9, "1", "rounding", ticks=ticks),
            judged(
                "kinematics", "the joints are those of the stored angles and pose", off, LENGTH, "m", why, ticks=ticks
            ),
            judged(
                "joint limits",
                "no joint is beyond its limit",
                np.maximum(0.0, beyond),
                ANGLE,
                "rad",
                "rounding of the solver's steps",
                ticks=ticks,
            ),
            judged(
                "abduction",
                "settled ticks show the user's abduction",
                spread[settled],
                ANGLE,
                "rad",
                "rounding of the solver's steps",
                ticks=ticks[settled],
            ),
            *self._unsettled_claims(),
        ]

    def _unsettled_claims(self) -> list[Claim]:
        result, ticks = self.result, self._ticks
        far = np.linalg.norm(self._posed.joints - self._wanted.joints, axis=3).max(axis=(1, 2))
        lag, late = np.asarray(result["lag"]), self.status & (STUCK | LAG) > 0
        over = np.where(late, np.maximum(0.0, np.maximum(lag - far, -lag)), np.abs(lag))
        why = "a thousandth of the smallest length that a table shows"
        claims = [
            judged(
                "lag", "a settled tick has none, another no more than the way left", over, LENGTH, "m", why, ticks=ticks
            )
        ]
        stuck = np.flatnonzero(self.status & STUCK)
        stuck = stuck[stuck > 0]
        if stuck.size and self.options["method"] in ("coupled", "progressive"):
            apart = np.linalg.norm(self._posed.joints[stuck] - self._posed.joints[stuck - 1], axis=3).max(axis=(1, 2))
            says = "a stuck tick shows the hand of the tick before"
            claims.append(judged("stuck ticks", says, apart, LENGTH, "m", why, ticks=stuck))
        return claims

    def contact_claims(self) -> list[Claim]:
        """Depths and touching pairs, at the chosen ticks."""
        result, chosen, pairs = self.result, self.chosen, self._pairs
        nearest = pairs.nearest(len(chosen))
        depth = np.maximum(0.0, -nearest)
        finger = depth[:, :PALM].reshape(-1, 5, 3).max(axis=2)
        finger[:, ~self.fingers] = np.nan
        most = np.fmax(depth[:, PALM], np.nanmax(finger, axis=1, initial=0.0))
        own = np.concatenate([most[:, None], depth[:, PALM:], finger], axis=1)
        stored = np.concatenate(
            [
                np.asarray(result["penetration_depth"])[chosen, None],
                np.asarray(result["penetration_palm"])[chosen, None],
                np.asarray(result["penetration_finger"])[chosen],
            ],
            axis=1,
        )
        one, other = np.isnan(own), np.isnan(stored)
        off = np.where(one & other, 0.0, np.where(one | other, np.inf, np.abs(own - stored))).max(axis=1)
        why = "a thousandth of the smallest length that a table shows"
        claims = [judged("depth", "the depth in the spheres is as stored", off, LENGTH, "m", why, ticks=chosen)]
        inside = judged(
            "non-penetration",
            "nothing of the hand is inside of a sphere",
            most,
            NEVER_IN,
            "m",
            "rounding of a distance",
            ticks=chosen,
        )
        if self.options["method"] not in ("coupled", "progressive"):
            deep = f"method {self.options['method']} does not promise it; its deepest is {1e6 * most.max():.3g} µm"
            inside = Claim(
                *(inside.name, inside.says, NOT_CLAIMED, float(most.max()), NEVER_IN, "m"),
                *(int(chosen[most.argmax()]) if most.any() else None, len(chosen), inside.why, deep),
            )
        touching = all_true(
            "touching pairs",
            "as many pairs touch as stored",
            self._miscounted,
            ticks=chosen,
            why="exact, but for pairs within 1 nm of the limit",
        )
        if self.options["method"] == "paper":
            note = f"method paper counts what its own detection finds; {int(self._miscounted.sum())} ticks differ"
            touching = Claim(touching.name, touching.says, NOT_CLAIMED, checked=len(chosen), note=note)
        return [*claims, inside, touching, self._library_claim()]

    def _library_claim(self) -> Claim:
        """The nearest pair of each chosen tick by coal."""
        center, radius = leaves(self.result)
        pairs, posed, off, ticks = self._pairs, self.graphic, [], []
        # Sorted by tick, then distance: the first of each tick is its nearest.
        order = np.lexsort((pairs.distance, pairs.tick))
        for n in order[np.unique(pairs.tick[order], return_index=True)[1]]:
            i, body, leaf = int(pairs.tick[n]), int(pairs.body[n]), int(pairs.leaf[n])
            if body == PALM:
                away = np.linalg.norm(posed.palm[i] - center[leaf], axis=1) - self.hand.palm_radius
                nearest = int(away.argmin())
                a = b = posed.palm[i, nearest]
                first = last = float(self.hand.palm_radius[nearest])
            else:
                f, k = divmod(body, 3)
                a, b = posed.joints[i, f, k], posed.joints[i, f, k + 1]
                first, last = (float(size) for size in self.hand.radius[f, k : k + 2])
            found = coal_distance(a, b, first, last, center[leaf], float(radius[leaf]))
            off.append(abs(found - float(pairs.distance[n])))
            ticks.append(int(self.chosen[i]))
        return judged(
            "distance by coal",
            "the nearest pair is as far apart as the collision library has it",
            off,
            LENGTH + EXACT,
            "m",
            "a nanometre, and the bounds of the library's distance",
            ticks=ticks,
            note="" if off else "nothing is near",
        )

    @cached_property
    def _miscounted(self) -> NDArray[np.bool_]:
        """Chosen ticks whose stored number of touching pairs is not the referee's."""
        pairs, touch, size = self._pairs, float(self.options["touch"]), len(self.chosen)
        least, greatest = (
            np.bincount(pairs.tick[pairs.distance <= touch + slack], minlength=size) for slack in (-LENGTH, LENGTH)
        )
        counted = np.asarray(self.result["contacts/touching"])[self.chosen]
        return np.asarray((counted < least) | (counted > greatest))

    def force_claims(self) -> list[Claim]:
        """Wrench and fingertips at all ticks; what balances them at the chosen ones."""
        result, ticks = self.result, self._ticks
        wrench = np.abs(self._pull[:, :6] - result["force/palm_wrench"]).max(axis=1)
        size = 1.0 + np.abs(self._pull[:, :6]).max(axis=1)
        bears = np.abs(np.asarray(result["force/phalanx"])).sum(axis=(2, 3)) > 0.0
        stiffness = float(self.options["stiffness"]["contact"])
        tips = fingertip_normals(self._posed, self._wanted, bears, stiffness)
        tip = np.abs(tips - result["force/fingertip_normal"]).max(axis=(1, 2))
        why = "a millionth: a ten-thousandth of the least force that has a rate"
        claims = [
            judged("palm wrench", "Eq. 1: G (q_g − q_h)", wrench, FORCE * size, "N", why, ticks=ticks),
            judged(
                "fingertips",
                "Fig. 9: k |E E₁| across the distal phalanx",
                tip,
                FORCE * (1.0 + np.abs(tips).max(axis=(1, 2))),
                "N",
                why,
                ticks=ticks,
            ),
        ]
        method, force = self.options["method"], self.options["force"]
        if method == "coupled":
            claims.append(self._stationarity())
        if force == "paper":
            return [*claims, self._eq_14()]
        if method in ("coupled", "progressive"):
            return [*claims, self._complementarity(), self._balance(), *self._stuck_forces()]
        says, note = (
            "contact forces follow from the configuration",
            f"of method {method} they do not: its programs are gone",
        )
        return [*claims, Claim("forces", says, NOT_JUDGED, note=note)]

    def _stored(self, ticks: IntArray) -> FloatArray:
        """Force of each body [N], the palm's last, shape (n, 16, 3)."""
        phalanx = np.asarray(self.result["force/phalanx"])[ticks].reshape(-1, PALM, 3)
        palm = np.asarray(self.result["force/total"])[ticks] - phalanx.sum(axis=1)
        return np.concatenate([phalanx, palm[:, None]], axis=1)

    def _slack(self, size: FloatArray) -> FloatArray:
        """Tolerance [N] at the chosen ticks of forces of a size (n,): multipliers are of the program a step before."""
        step = np.minimum(self._moved[self.chosen], float(self.options["settled"]))
        rolling = float(leaves(self.result)[1].min() + min(self.hand.radius.min(), self.hand.palm_radius.min()))
        return FORCE * (1.0 + size) + TURN * size * step / rolling

    @property
    def _why_slack(self) -> str:
        return (
            "a millionth, and how far normals turn in the tick's last step, after which the program is not solved again"
        )

    def _judgeable(self, without: int) -> IntArray:
        """Of the chosen ticks, those without some status flags; places in `chosen`."""
        return np.flatnonzero(self.status[self.chosen] & (without | FULL) == 0)

    def _moment(self, i: int) -> Moment:
        t = int(self.chosen[i])
        pairs = self._touching.of(i)
        return moment(self.hand, self.graphic, self.configuration.flexion[i], pairs, i, self._pull[t])

    @cached_property
    def _touching(self) -> Pairs:
        return self._pairs.within(float(self.options["touch"]))

    def _stationarity(self) -> Claim:
        """KKT: the coupling of a settled tick is balanced by pushes at what touches and joints at their limits."""
        chosen = self._judgeable(STUCK | LAG)
        off = np.array([balance(self._moment(int(i)), self.scale) for i in chosen])
        size = np.linalg.norm(self._pull[self.chosen] * self.scale, axis=1)
        return judged(
            "stationarity",
            "a settled tick is at the optimum: w = Jᵀλ + μ, λ ≥ 0 at what touches",
            off,
            self._slack(size)[chosen],
            "N",
            self._why_slack,
            ticks=self.chosen[chosen],
        )

    def _complementarity(self) -> Claim:
        """KKT: what does not touch bears nothing."""
        chosen = self._judgeable(STUCK)
        apart = self._pairs.nearest(len(self.chosen))[chosen] > float(self.options["touch"]) + LENGTH
        size = np.linalg.norm(self._stored(self.chosen[chosen]), axis=2)
        return judged(
            "complementarity",
            "what does not touch bears no force",
            np.where(apart, size, 0.0).max(axis=1),
            FORCE,
            "N",
            "rounding of a sum",
            ticks=self.chosen[chosen],
        )

    def _balance(self) -> Claim:
        """The stored forces are pushes along normals at what touches, and balance the coupling."""
        chosen = self._judgeable(STUCK)
        stored = self._stored(self.chosen).reshape(len(self.chosen), -1)
        slack = self._slack(np.linalg.norm(stored, axis=1))
        offset = float(self.options["offset"])
        off = np.empty(len(chosen))
        for n, i in enumerate(chosen):
            at, force = self._moment(int(i)), stored[i]
            late = bool(self.status[self.chosen[i]] & LAG)
            ways = []
            if self.options["method"] == "progressive" and not late:
                ways.append((at.pull, True))
            if not late:
                ways.append((at.pull, False))
            off[n] = min((explained(at, self.scale, force, pull, apart) for pull, apart in ways), default=np.inf)
            # On its way, or where the palm of `progressive` yields to a finger: what touches bears what it can.
            if late or (self.options["method"] == "progressive" and off[n] > slack[i]):
                pull = on_its_way(at, self.diagonal, offset)
                off[n] = min(off[n], explained(at, self.scale, force, pull, False))
        return judged(
            "force balance",
            "forces push along the normals of what touches, and balance the coupling",
            off,
            slack[chosen],
            "N",
            self._why_slack,
            ticks=self.chosen[chosen],
        )

    def _stuck_forces(self) -> list[Claim]:
        stuck = np.flatnonzero(self.status & STUCK)
        stuck = stuck[stuck > 0]
        if stuck.size == 0:
            return []
        now, before = self._stored(stuck), self._stored(stuck - 1)
        off = np.abs(now - before).max(axis=(1, 2))
        says, why = "a stuck tick keeps the contact forces of the tick before", "nothing is computed anew"
        return [judged("stuck forces", says, off, FORCE, "N", why, ticks=stuck)]

    def _eq_14(self) -> Claim:
        """Eq. 14 over what touches; left out are ticks with a pair within a nanometre of the limit, or not found."""
        from scipy.spatial.transform import Rotation

        touch = float(self.options["touch"])
        close = np.abs(self._pairs.distance - touch) <= LENGTH
        unclear = np.isin(np.arange(len(self.chosen)), self._pairs.tick[close])
        if self.options["method"] == "paper":
            unclear |= self._miscounted
        chosen = np.flatnonzero(~unclear & (self.status[self.chosen] & FULL == 0))
        wanted = Posed(*(values[self.chosen] for values in self._wanted))
        turn = Rotation.from_rotvec(
            turn_between(self.configuration.orientation, self._haptic.at(self.chosen).orientation)
        ).as_matrix()
        stiffness = float(self.options["stiffness"]["contact"])
        own = np.array(
            [proxy_forces(self._touching.of(int(i)), self.graphic, wanted, turn[i], int(i), stiffness) for i in chosen]
        ).reshape(len(chosen), PALM + 1, 3)
        stored = self._stored(self.chosen[chosen])
        off = np.abs(own - stored).max(axis=(1, 2))
        size = np.abs(own).sum(axis=(1, 2))
        return judged(
            "Eq. 14",
            "each body's force is the sum of k |p_g − p_h| n over what touches",
            off,
            FORCE * (1.0 + size),
            "N",
            "a millionth: a ten-thousandth of the least force that has a rate",
            ticks=self.chosen[chosen],
            note=f"{int(unclear.sum())} ticks left out, where it is unclear which pairs touch" if unclear.any() else "",
        )
