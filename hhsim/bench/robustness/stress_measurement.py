"""Measures a case of `hhsim bench stress` block by block, each tick from the hand that it shows."""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.bench.robustness.failure import SAFE_DEPTH, not_finite
from hhsim.bench.robustness.local_optimality import way_out
from hhsim.bench.robustness.pieces import hand_distance
from hhsim.bench.robustness.stress_case import StressCase
from hhsim.bench.robustness.stress_metrics import KeptFailure, StressFigures
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_INPUT_INVALID, STATUS_LAG, STATUS_STUCK, WORK_CANDIDATES, WORK_TOUCHING
from hhsim.metrics.metrics import Penetration, hand_clearance
from hhsim.motion.tick_motion import hold_readings
from hhsim.system.log_histogram import LogHistogram

DEEP = 1e-5
"""The second depth [m] that ticks are counted over; the first is `SAFE_DEPTH`."""
BRUTE_EVERY = 997
"""Every how many ticks the depth is recomputed by brute force; a prime, so that it meets every place in a hold."""
MOST_STUCK_CHECKED = 200
"""Stuck ticks of a case that are looked into for a way out."""
LEAST_FORCE = 1.0
"""Forces [N] from here on are compared with the coupling's own."""
FAR = 0.05
"""Clearances from here on [m] are not compared with brute force."""


def coupling_force(case: StressCase, haptic: HandConfiguration, record: TickRecord) -> FloatArray:
    """What the coupling itself pulls with at each tick [N], shape (T,).

    The palm's force, its torque over the reach of the hand, and each joint's torque over the length of its phalanx.
    The forces of `coupled` stay near it. `progressive` holds a joint's torque where the finger touches, and on a lever
    that is shorter than the phalanx that takes more force.

    Args:
        case: For the hand and its stiffness.
        haptic: Readings of a hand at every tick.
    """
    bend = np.clip(haptic.flexion, case.hand.flexion_min, case.hand.flexion_max) - record.flexion
    joint = case.solver.stiffness.flexion * np.abs(bend) / case.hand.length
    reach = float(case.hand.arrays().reach.max())
    force, torque = (np.linalg.norm(part, axis=1) for part in (record.palm_wrench[:, :3], record.palm_wrench[:, 3:]))
    whole: FloatArray = force + torque / reach + joint.sum(axis=(1, 2))
    return whole


class StressMeasure:
    """Figures of a case, block by block."""

    def __init__(self, case: StressCase) -> None:
        self._case = case
        self._surface, self._pieces = case.surface, case.pieces
        self._cpu = LogHistogram()
        self._deepest = np.zeros(3)
        self._force = (-np.inf, np.nan)
        self._force_ratio = 0.0
        self._counts = dict.fromkeys(
            ("penetrating", "penetrating_deep", "not_finite", "stuck", "lag", "held", "touching"), 0
        )
        self._candidates = 0
        self._stuck_run = self._longest_stuck = 0
        self._stuck_checked = self._unexplained = 0
        self._brute_ticks, self._brute_difference = 0, 0.0
        self._before: HandConfiguration | None = None
        self.ticks = 0

    def add(self, motion: HandConfiguration, record: TickRecord, depth: Penetration) -> dict[str, BoolArray]:
        """Measure a block; returns which of its ticks failed, shape (T,), by the name of the failure."""
        counts, case = self._counts, self._case
        deepest = [depth.depth, depth.palm, depth.finger]
        self._deepest = np.maximum(self._deepest, [float(np.max(values)) for values in deepest])
        penetrating, lost = ~(depth.depth <= SAFE_DEPTH), not_finite(record)
        counts["penetrating"] += int(penetrating.sum())
        counts["penetrating_deep"] += int((~(depth.depth <= DEEP)).sum())
        counts["not_finite"] += int(lost.sum())
        for name, bit in (("stuck", STATUS_STUCK), ("lag", STATUS_LAG), ("held", STATUS_INPUT_INVALID)):
            counts[name] += int(((record.status & bit) > 0).sum())
        counts["touching"] += int((record.work[:, WORK_TOUCHING] > 0).sum())
        self._candidates = max(self._candidates, int(record.work[:, WORK_CANDIDATES].max()))
        self._cpu.add(record.duration_cpu)
        haptic = self._readings(motion)
        size = np.linalg.norm(record.total, axis=1)
        top = int(np.argmax(np.where(np.isfinite(size), size, -1.0)))
        own = coupling_force(case, haptic, record)
        if size[top] > self._force[0]:
            self._force = float(size[top]), float(own[top])
        pushed = size >= LEAST_FORCE
        if pushed.any():
            # A method that is not held back by its coupling can push where the coupling pulls at nothing.
            with np.errstate(divide="ignore"):
                self._force_ratio = max(self._force_ratio, float((size[pushed] / own[pushed]).max()))
        self._brute(record)
        unexplained = self._explain(haptic, record)
        self.ticks += motion.ticks
        return {"penetration": penetrating, "not finite": lost, "stuck": unexplained}

    def _brute(self, record: TickRecord) -> None:
        shape = hand_shape(self._case.hand)
        for tick in range(-self.ticks % BRUTE_EVERY, len(record.status), BRUTE_EVERY):
            shown = record.joints[tick], record.position[tick], record.orientation[tick]
            brute = hand_distance(self._pieces, shape, *shown)
            by_tree = hand_clearance(self._surface, *shape, *PlacedHand(*(values[None] for values in shown)), limit=FAR)
            difference = abs(min(brute, FAR) - float(np.minimum(by_tree[0], by_tree[1].min(axis=1))[0]))
            self._brute_ticks += 1
            self._brute_difference = max(self._brute_difference, difference)

    def _readings(self, motion: HandConfiguration) -> HandConfiguration:
        # As the solver holds them, across blocks too.
        if self._before is None:
            held = hold_readings(motion)
        else:
            held = hold_readings(sequence(self._before, motion)).part(1, motion.ticks + 1)
        self._before = held.part(motion.ticks - 1, motion.ticks).copy()
        return held

    def _explain(self, haptic: HandConfiguration, record: TickRecord) -> BoolArray:
        stuck = (record.status & STATUS_STUCK) > 0
        unexplained = np.zeros(len(stuck), dtype=bool)
        shown = HandConfiguration.of(record)
        for tick, is_stuck in enumerate(stuck):
            self._stuck_run = self._stuck_run + 1 if is_stuck else 0
            self._longest_stuck = max(self._longest_stuck, self._stuck_run)
            if is_stuck and self._stuck_checked < MOST_STUCK_CHECKED:
                self._stuck_checked += 1
                case = self._case
                goal, here = haptic.part(tick, tick + 1), shown.part(tick, tick + 1)
                unexplained[tick] = way_out(case.hand, self._pieces, case.solver, here, goal) > 0.0
        self._unexplained += int(unexplained.sum())
        return unexplained

    def figures(self, failures: tuple[KeptFailure, ...]) -> StressFigures:
        """Everything so far."""
        case = self._case
        return StressFigures(
            object=case.object,
            method=case.solver.method,
            surface=case.solver.surface,
            level=case.tree.depth,
            spheres=case.tree.leaf_count,
            seed=case.seed,
            ticks=self.ticks,
            penetration=float(self._deepest[0]),
            penetration_palm=float(self._deepest[1]),
            penetration_finger=float(self._deepest[2]),
            unexplained=self._unexplained,
            longest_stuck=self._longest_stuck,
            candidates_max=self._candidates,
            force_max=max(self._force[0], 0.0),
            coupling_force=self._force[1],
            force_ratio=self._force_ratio,
            brute_ticks=self._brute_ticks,
            brute_difference=self._brute_difference,
            cpu=self._cpu,
            failures=failures,
            **self._counts,
        )
