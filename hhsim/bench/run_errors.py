"""How far off one run of a method is: against the spheres, the true mesh, the optimum, and in how it feels.

All figures come from the poses and forces that the run recorded, none from the solver's own tolerances.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.mesh.bvh import MeshBvh
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.kernels.tick.block import TickRecord
from hhsim.metrics import metrics
from hhsim.metrics.contact_points import find_contact_points
from hhsim.metrics.mesh_penetration import contact_error, mesh_clearance
from hhsim.metrics.run.registry import run_figure
from hhsim.metrics.run_ticks import RunTicks, hold_slices
from hhsim.motion.trajectory import TickInput
from hhsim.replay.tremor_hold import tremor_variation
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import UNLIMITED, SolverOptions
from hhsim.solver.reference_optimum import REFERENCE_LINEARISATIONS, REFERENCE_STEP_TOLERANCE, reference_excess

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

TOUCH = 1e-5
"""Spheres nearer than this [m] touch."""
NEAR = 1e-3
"""A tick is one in contact if the haptic hand is nearer than this to the finest spheres, or inside [m]."""
SAMPLES = 40
"""Ticks in contact at which the hand is held against the mesh."""
REFERENCE_TICKS = 16
"""Ticks of the first hold at which the optimum is computed."""


@dataclass(frozen=True)
class RunErrors:
    """What one run got wrong; NaN where a figure is undefined. SI units, but for what the contract states in percent.

    Each is the column of its name in `hhsim.bench.speed_error_table.COLUMNS`, which says what it is. `mesh_error` is
    NaN for a hand that hovers and touches nothing, which would be perfect otherwise.
    """

    penetration_max: float
    mesh_depth_max: float
    mesh_depth_p95: float
    contact_error_mean: float
    contact_error_max: float
    mesh_error: float
    tracking_excess: float
    off_finest_mean: float
    off_finest_max: float
    force_hold: float
    force_variation_hold: float
    force_variation_tremor: float
    force_ripple: float
    force_step: float
    posture_jump_max: float
    stuck_ticks: int
    lag_ticks: int
    lag_max: float
    samples: int


@dataclass(frozen=True)
class ErrorScene:
    """What the errors of a run are measured against, the same for every method and tree level.

    Attributes:
        hand: The hand.
        bvh: Of the true mesh, world.
        haptic: The input.
        haptic_placed: The haptic hand at every tick.
        finest: The graphic hand of the converged optimum on the finest spheres, every tick.
        contact: Ticks in contact, shape (T,); the haptic hand decides, so that they are the same for every method.
        seed: Of the tremor.
    """

    hand: HandModel
    bvh: MeshBvh
    haptic: TickInput
    haptic_placed: PlacedHand
    finest: PlacedHand
    contact: BoolArray
    seed: int = 0

    @property
    def holds(self) -> list[slice]:
        """The ticks of each hold."""
        return hold_slices(self.haptic.phases, self.haptic.tick_count)


def error_scene(
    hand: HandModel, bvh: MeshBvh, haptic: TickInput, finest: TreeArrays, options: SolverOptions, seed: int = 0
) -> ErrorScene:
    """Prepare what runs on one motion and object are measured against.

    Args:
        hand: The hand.
        bvh: Of the true mesh, world.
        haptic: The input.
        finest: The finest spheres, world.
        options: Stiffness and lengths of the runs.
        seed: Of the tremor.
    """
    converged = replace(
        options,
        method="coupled",
        qp="active-set",
        linearisations=REFERENCE_LINEARISATIONS,
        budget=UNLIMITED,
        step_tolerance=REFERENCE_STEP_TOLERANCE,
    )
    best = HandSolver(hand, finest, converged).run(*HandConfiguration.of(haptic))
    placed = forward_kinematics(hand, *HandConfiguration.of(haptic))
    return ErrorScene(
        hand=hand,
        bvh=bvh,
        haptic=haptic,
        haptic_placed=placed,
        finest=placed_of(best),
        contact=sphere_clearance(hand, finest, placed, NEAR) < NEAR,
        seed=seed,
    )


def placed_of(record: TickRecord) -> PlacedHand:
    """The graphic hand of a run."""
    return PlacedHand(record.joints, record.position, record.orientation)


def digest_of(record: TickRecord) -> str:
    """Of the poses and forces of a run: the same for the same bytes."""
    digest = hashlib.sha256()
    for values in (record.position, record.orientation, record.flexion, record.total):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def sphere_clearance(hand: HandModel, tree: TreeArrays, placed: PlacedHand, limit: float) -> FloatArray:
    """Least signed distance [m] of the hand to the leaf spheres at each tick, shape (T,); `limit` is the largest."""
    palm, finger = metrics.hand_clearance(tree, *hand_shape(hand), *placed, limit=limit)
    return np.asarray(np.minimum(palm, finger.min(axis=1)))


def run_errors(
    scene: ErrorScene, tree: TreeArrays, options: SolverOptions, record: TickRecord, window: slice = slice(None)
) -> RunErrors:
    """Measure a run.

    Args:
        scene: What to measure against.
        tree: The spheres that the run had, world.
        options: Those of the run.
        record: Its ticks.
        window: Ticks of the scene that the run did; figures of the holds need all of them and are NaN otherwise.
    """
    hand, placed = scene.hand, placed_of(record)
    ticks = len(record.position)
    contact = np.flatnonzero(scene.contact[window])
    clearance = sphere_clearance(hand, tree, placed, 2.0 * TOUCH)
    depth_max, depth_p95, error_mean, error_max, samples = _mesh_errors(scene, tree, placed, clearance, contact)
    off = np.linalg.norm(placed.ends - scene.finest.at(window).ends, axis=2).max(axis=1)[contact]
    jump = metrics.posture_jump(scene.haptic_placed.at(window).points, placed.points)
    whole = ticks == len(scene.contact)
    run = RunTicks(
        columns={
            "status": record.status,
            "lag": record.lag,
            "penetration_depth": np.maximum(0.0, -clearance),
            "force/total": record.total,
            "force_variation_rate": metrics.force_variation_rate(record.total),
        },
        ticks=ticks,
        phases=scene.haptic.phases if whole else (),
        rate=scene.haptic.rate,
        fingers=len(options.fingers),
    )
    held = whole and bool(scene.holds)
    return RunErrors(
        penetration_max=run_figure("penetration_max", run),
        mesh_depth_max=depth_max,
        mesh_depth_p95=depth_p95,
        contact_error_mean=error_mean,
        contact_error_max=error_max,
        mesh_error=float(np.maximum(depth_max, error_max)),
        tracking_excess=_excess(scene, tree, options, record, clearance) if held else np.nan,
        off_finest_mean=float(off.mean()) if off.size else np.nan,
        off_finest_max=float(off.max()) if off.size else np.nan,
        force_hold=run_figure("force_hold_mean", run),
        force_variation_hold=run_figure("force_variation_hold", run),
        force_variation_tremor=_tremor(scene, tree, options, record) if held else np.nan,
        force_ripple=run_figure("force_ripple_hold", run),
        force_step=run_figure("force_step", run),
        posture_jump_max=metrics.statistics(jump).max,
        stuck_ticks=int(run_figure("stuck_ticks", run)),
        lag_ticks=int(run_figure("lag_ticks", run)),
        lag_max=run_figure("lag_max", run),
        samples=samples,
    )


def sampled(ticks: IntArray, count: int, also: Sequence[int] = ()) -> IntArray:
    """`count` of some ticks, evenly spread with both ends, or all of them if there are fewer; and `also`."""
    spread = ticks[np.linspace(0, ticks.size - 1, min(count, ticks.size)).astype(int)] if ticks.size else ticks
    return np.unique(np.concatenate([spread, np.array(also, np.int64)]).astype(np.int64))


def _mesh_errors(
    scene: ErrorScene, tree: TreeArrays, placed: PlacedHand, clearance: FloatArray, contact: IntArray
) -> tuple[float, float, float, float, int]:
    """Depth (max, p95) and contact error (mean, max) [m] of sampled ticks and the one deepest in the spheres."""
    if contact.size == 0:
        return np.nan, np.nan, np.nan, np.nan, 0
    chosen = sampled(contact, SAMPLES, [int(np.nanargmin(clearance))] if np.isfinite(clearance).any() else [])
    shape, some = hand_shape(scene.hand), placed.at(chosen)
    depth = np.maximum(0.0, -mesh_clearance(scene.bvh, shape, some))
    error = contact_error(scene.bvh, find_contact_points(tree, shape, some, TOUCH).point)
    return float(depth.max()), float(np.percentile(depth, 95)), error.mean, error.max, chosen.size


def _excess(
    scene: ErrorScene, tree: TreeArrays, options: SolverOptions, record: TickRecord, clearance: FloatArray
) -> float:
    """Mean energy above the optimum in the first hold; of ticks without penetration, since a hand inside cheats."""
    hold = scene.holds[0]
    held = np.arange(hold.start, hold.stop)
    chosen = sampled(held[clearance[held] > -TOUCH], REFERENCE_TICKS)
    if chosen.size == 0:
        return np.nan
    haptic = HandConfiguration.of(scene.haptic)
    graphic = HandConfiguration.of(record)
    excess = reference_excess(scene.hand, tree, options, haptic, graphic, chosen)
    return metrics.statistics(excess).mean


def _tremor(scene: ErrorScene, tree: TreeArrays, options: SolverOptions, record: TickRecord) -> float:
    """Mean force variation [%] of the first hold, repeated by a hand that trembles."""
    part, haptic = scene.holds[0], HandConfiguration.of(scene.haptic)
    held, shown = haptic.at(part), HandConfiguration.of(record).at(part)
    found = tremor_variation(scene.hand, tree, options, held, shown, scene.haptic.rate, scene.seed)
    return np.nan if found is None else found.mean
