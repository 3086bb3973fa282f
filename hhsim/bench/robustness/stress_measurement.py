"""A case of `hhsim bench stress`, and its figures block by block, each tick from the hand that it shows."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.bench.robustness.failure import SAFE_DEPTH, not_finite
from hhsim.bench.robustness.local_optimality import way_out
from hhsim.bench.robustness.pieces import Pieces, hand_distance, pieces_of
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.bench.robustness.stress_metrics import KeptFailure, StressFigures
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_INPUT_INVALID, STATUS_LAG, STATUS_STUCK, WORK_CANDIDATES, WORK_TOUCHING
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import Penetration, hand_clearance
from hhsim.motion.tick_motion import hold_readings
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.system.log_histogram import LogHistogram
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree

DEEP = 1e-5
"""Second depth [m] over which ticks are counted; the first is `SAFE_DEPTH`."""
BRUTE_EVERY = 997
"""Ticks from one brute-force depth to the next; a prime, so that it meets every place in a hold."""
MOST_STUCK_CHECKED = 200
"""Stuck ticks of a case that are examined for a free step."""
LEAST_FORCE = 1.0
"""Least force [N] that is compared with the coupling's own."""
FAR = 0.05
"""Least clearance [m] that is not compared with brute force."""


@dataclass(frozen=True, eq=False, kw_only=True)
class StressCase:
    """One object, one method, one long motion.

    Attributes:
        object: Its name or file.
        object_options: Options of the object that a replay needs, such as "--level 3 --unit mm".
        mesh: Its triangles, in the frame of the tree; None for an object of spheres alone.
        stress: Options of the random targets.
        seed: Of the random targets.
        keep: Folder for failing stretches, made when one is kept; None keeps none.
    """

    object: str
    object_options: str = ""
    tree: SphereTree
    mesh: Mesh | None = None
    hand: HandModel
    solver: SolverOptions
    stress: StressOptions
    seed: int
    ticks: int
    keep: Path | None = None

    def targets(self) -> RandomTargets:
        """Return the motion from its start: around the object's root sphere, the first hand above it."""
        center, radius = self.tree.center[0], float(self.tree.radius[0])
        return RandomTargets(self.hand, self.seed, self.stress, center=center, height=max(0.25, radius + 0.2))

    @cached_property
    def surface(self) -> Any:
        """Arrays of the surface that the hand touches."""
        return contact_surface(self.solver.surface, self.mesh, self.tree).arrays

    @cached_property
    def pieces(self) -> Pieces:
        """Pieces of that surface, for brute force."""
        return pieces_of(self.solver.surface, self.mesh, self.tree)

    def new_solver(self) -> HandSolver:
        """Return a solver at the start of the motion."""
        return HandSolver(self.hand, self.surface, self.solver)


def coupling_force(case: StressCase, haptic: HandConfiguration, record: TickRecord) -> FloatArray:
    """Return the force of the coupling itself at each tick [N], shape (T,).

    It is the palm's force, its torque over the reach of the hand, and each joint's torque over the length of its
    phalanx. The forces of `coupled` stay near it. `progressive` holds a joint's torque where the finger touches, and on
    a lever shorter than the phalanx that takes more force.
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
        """Measure a block; return its failed ticks, shape (T,), by the name of the failure."""
        deepest = [float(np.max(values)) for values in (depth.depth, depth.palm, depth.finger)]
        self._deepest = np.maximum(self._deepest, deepest)
        penetrating, lost = ~(depth.depth <= SAFE_DEPTH), not_finite(record)
        for name, ticks in (
            ("penetrating", penetrating),
            ("penetrating_deep", ~(depth.depth <= DEEP)),
            ("not_finite", lost),
            ("stuck", (record.status & STATUS_STUCK) > 0),
            ("lag", (record.status & STATUS_LAG) > 0),
            ("held", (record.status & STATUS_INPUT_INVALID) > 0),
            ("touching", record.work[:, WORK_TOUCHING] > 0),
        ):
            self._counts[name] += int(ticks.sum())
        self._candidates = max(self._candidates, int(record.work[:, WORK_CANDIDATES].max()))
        self._cpu.add(record.duration_cpu)
        haptic = self._readings(motion)
        size = np.linalg.norm(record.total, axis=1)
        top = int(np.argmax(np.where(np.isfinite(size), size, -1.0)))
        own = coupling_force(self._case, haptic, record)
        if size[top] > self._force[0]:
            self._force = float(size[top]), float(own[top])
        pushed = size >= LEAST_FORCE
        if pushed.any():
            # A method that is not held back by its coupling can push where the coupling's own force is zero.
            with np.errstate(divide="ignore"):
                self._force_ratio = max(self._force_ratio, float((size[pushed] / own[pushed]).max()))
        self._brute(record)
        unexplained = self._explain(haptic, record)
        self.ticks += motion.ticks
        return {"penetration": penetrating, "not finite": lost, "stuck": unexplained}

    def _brute(self, record: TickRecord) -> None:
        case, shape = self._case, hand_shape(self._case.hand)
        for tick in range(-self.ticks % BRUTE_EVERY, len(record.status), BRUTE_EVERY):
            shown = record.joints[tick], record.position[tick], record.orientation[tick]
            brute = hand_distance(case.pieces, shape, *shown)
            by_tree = hand_clearance(case.surface, *shape, *PlacedHand(*(values[None] for values in shown)), limit=FAR)
            difference = abs(min(brute, FAR) - float(np.minimum(by_tree[0], by_tree[1].min(axis=1))[0]))
            self._brute_ticks += 1
            self._brute_difference = max(self._brute_difference, difference)

    def _readings(self, motion: HandConfiguration) -> HandConfiguration:
        """Readings as the solver holds them, across blocks too."""
        if self._before is None:
            held = hold_readings(motion)
        else:
            held = hold_readings(sequence(self._before, motion)).part(1, motion.ticks + 1)
        self._before = held.part(motion.ticks - 1, motion.ticks).copy()
        return held

    def _explain(self, haptic: HandConfiguration, record: TickRecord) -> BoolArray:
        stuck = (record.status & STATUS_STUCK) > 0
        unexplained = np.zeros(len(stuck), dtype=bool)
        case, shown = self._case, HandConfiguration.of(record)
        for tick, is_stuck in enumerate(stuck):
            self._stuck_run = self._stuck_run + 1 if is_stuck else 0
            self._longest_stuck = max(self._longest_stuck, self._stuck_run)
            if is_stuck and self._stuck_checked < MOST_STUCK_CHECKED:
                self._stuck_checked += 1
                goal, here = haptic.part(tick, tick + 1), shown.part(tick, tick + 1)
                unexplained[tick] = way_out(case.hand, case.pieces, case.solver, here, goal) > 0.0
        self._unexplained += int(unexplained.sum())
        return unexplained

    def figures(self, failures: tuple[KeptFailure, ...]) -> StressFigures:
        """Return the figures of all blocks."""
        case = self._case
        deepest, palm, finger = self._deepest.tolist()
        return StressFigures(
            object=case.object,
            method=case.solver.method,
            surface=case.solver.surface,
            level=case.tree.depth,
            spheres=case.tree.leaf_count,
            seed=case.seed,
            ticks=self.ticks,
            penetration=deepest,
            penetration_palm=palm,
            penetration_finger=finger,
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
