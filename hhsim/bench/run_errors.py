"""How far off one run of a method is: against what it touched, the true mesh, the optimum, and in how it feels.

All figures come from the poses and forces that the run recorded, none from the solver's own tolerances. The truth is
the mesh: what is told of it is measured by an independent library, and the best pose is the optimum on its triangles.
"""

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.bench.mesh_errors import MeshReferee
from hhsim.bench.sampled_ticks import sampled
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.metrics import metrics
from hhsim.metrics.run.registry import run_figure
from hhsim.metrics.run_ticks import RunTicks, hold_slices
from hhsim.motion.trajectory import TickInput
from hhsim.replay.tremor_hold import tremor_variation
from hhsim.solver.options import SolverOptions
from hhsim.solver.reference_optimum import best_hands, reference_excess

NEAR = 1e-3
"""A tick is one in contact if the haptic hand is nearer than this to the mesh, or inside [m]."""
SAME_HAND = 1e-6
"""Hands are the same where no joint, no position [m] and no part of the orientation differ by more."""
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
    off_optimum_mean: float
    off_optimum_max: float
    force_hold: float
    force_variation_hold: float
    force_variation_tremor: float
    force_ripple: float
    force_step: float
    posture_jump_max: float
    stuck_ticks: int
    lag_ticks: int
    lag_max: float
    contact_points: int
    samples: int


@dataclass(frozen=True)
class ErrorScene:
    """What the errors of a run are measured against, the same for every method and surface.

    Attributes:
        referee: Of the true mesh, world.
        haptic_placed: The haptic hand at every tick.
        optimum: The graphic hand of the converged optimum on the mesh, every tick.
        contact: Ticks in contact, shape (T,); the haptic hand decides, so that they are the same for every method.
        seed: Of the tremor.
    """

    hand: HandModel
    referee: MeshReferee
    haptic: TickInput
    haptic_placed: PlacedHand
    optimum: PlacedHand
    contact: BoolArray
    seed: int = 0

    @property
    def holds(self) -> list[slice]:
        """The ticks of each hold."""
        return hold_slices(self.haptic.phases, self.haptic.tick_count)


def error_scene(
    hand: HandModel, referee: MeshReferee, haptic: TickInput, surface: Any, options: SolverOptions, seed: int = 0
) -> ErrorScene:
    """Prepare what runs on one motion and object are measured against.

    Args:
        referee: Of the true mesh, world.
        surface: The same mesh in the kernels' form, closed or not: the arrays of the surface `mesh`.
        options: Stiffness and lengths of the runs.
        seed: Of the tremor.

    Raises:
        HhsimError: More pairs than the solver holds: the optimum on this mesh cannot be had.
    """
    best = best_hands(hand, surface, options, HandConfiguration.of(haptic))
    placed = forward_kinematics(hand, *HandConfiguration.of(haptic))
    return ErrorScene(
        hand=hand,
        referee=referee,
        haptic=haptic,
        haptic_placed=placed,
        optimum=placed_of(best),
        contact=hand_clearance(hand, surface, placed, NEAR) < NEAR,
        seed=seed,
    )


def placed_of(record: TickRecord) -> PlacedHand:
    """The graphic hand of a run."""
    return PlacedHand(record.joints, record.position, record.orientation)


def check_finite(record: TickRecord) -> None:
    """Refuse a run that lost the hand.

    Raises:
        HhsimError: A joint of the graphic hand is nowhere; the message names the first such tick.
    """
    finite = np.isfinite(record.joints).all(axis=(1, 2, 3))
    if not finite.all():
        raise HhsimError(f"the graphic hand is not finite after tick {int(finite.argmin())}")


def first_hold_tremor(
    hand: HandModel, surface: Any, options: SolverOptions, haptic: TickInput, record: TickRecord, seed: int
) -> float:
    """Mean force variation [%] of the first hold, repeated by a hand that trembles; NaN where there is none."""
    holds = hold_slices(haptic.phases, haptic.tick_count)
    if not holds:
        return np.nan
    held, shown = (HandConfiguration.of(posed).at(holds[0]) for posed in (haptic, record))
    found = tremor_variation(hand, surface, options, held, shown, haptic.rate, seed)
    return np.nan if found is None else found.mean


def digest_of(record: TickRecord) -> str:
    """Of the poses and forces of a run: the same for the same bytes."""
    digest = hashlib.sha256()
    for values in (record.position, record.orientation, record.flexion, record.total):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def hand_clearance(hand: HandModel, surface: Any, placed: PlacedHand, limit: float) -> FloatArray:
    """Least signed distance [m] of the hand to a surface at each tick, shape (T,); `limit` is the largest."""
    palm, finger = metrics.hand_clearance(surface, *hand_shape(hand), *placed, limit=limit)
    return np.asarray(np.minimum(palm, finger.min(axis=1)))


def run_errors(
    scene: ErrorScene, surface: Any, options: SolverOptions, record: TickRecord, window: slice = slice(None)
) -> RunErrors:
    """Measure a run.

    Args:
        surface: What the run touched, world: the arrays of the surface that its options name.
        window: Ticks of the scene that the run did; figures of the holds need all of them and are NaN otherwise.
    """
    placed = placed_of(record)
    ticks = len(record.position)
    contact = np.flatnonzero(scene.contact[window])
    clearance = _clearance(scene, surface, options, placed, window)
    deepest = np.array([int(clearance.argmin())] if clearance.min(initial=0.0) < 0.0 else [], np.int64)
    # Spheres that stick out are touched before the user's hand is near the mesh.
    looked = np.flatnonzero(scene.contact[window] | (clearance < 2.0 * options.touch))
    mesh = scene.referee.errors(surface, hand_shape(scene.hand), placed, options.touch, looked, deepest)
    off = np.linalg.norm(placed.ends - scene.optimum.at(window).ends, axis=2).max(axis=1)[contact]
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
        mesh_depth_max=mesh.depth_max,
        mesh_depth_p95=mesh.depth_p95,
        contact_error_mean=mesh.contact_mean,
        contact_error_max=mesh.contact_max,
        mesh_error=float(np.maximum(mesh.depth_max, mesh.contact_max)) if scene.referee.closed else mesh.contact_max,
        tracking_excess=_excess(scene, surface, options, record, clearance) if held else np.nan,
        off_optimum_mean=float(off.mean()) if off.size else np.nan,
        off_optimum_max=float(off.max()) if off.size else np.nan,
        force_hold=run_figure("force_hold_mean", run),
        force_variation_hold=run_figure("force_variation_hold", run),
        force_variation_tremor=(
            first_hold_tremor(scene.hand, surface, options, scene.haptic, record, scene.seed) if whole else np.nan
        ),
        force_ripple=run_figure("force_ripple_hold", run),
        force_step=run_figure("force_step", run),
        posture_jump_max=metrics.statistics(jump).max,
        stuck_ticks=int(run_figure("stuck_ticks", run)),
        lag_ticks=int(run_figure("lag_ticks", run)),
        lag_max=run_figure("lag_max", run),
        contact_points=mesh.points,
        samples=mesh.ticks,
    )


def _clearance(
    scene: ErrorScene, surface: Any, options: SolverOptions, placed: PlacedHand, window: slice
) -> FloatArray:
    """Signed distance [m] of the shown hand to what it touched, shape (T,); twice the touching distance is the most."""
    limit = 2.0 * options.touch
    if options.surface != "mesh":
        return hand_clearance(scene.hand, surface, placed, limit)
    # Triangles take a millisecond a tick, and a hand that is the user's is as far away as that one.
    haptic = scene.haptic_placed.at(window)
    ticks = len(placed.position)
    parts = [np.abs(one - other).reshape(ticks, -1).max(axis=1) for one, other in zip(placed, haptic)]
    looked = np.flatnonzero(scene.contact[window] | (np.max(parts, axis=0) > SAME_HAND))
    found = np.full(ticks, limit)
    found[looked] = hand_clearance(scene.hand, surface, placed.at(looked), limit)
    return found


def _excess(
    scene: ErrorScene, surface: Any, options: SolverOptions, record: TickRecord, clearance: FloatArray
) -> float:
    """Mean energy above the optimum in the first hold; of ticks without penetration, since a hand inside cheats."""
    hold = scene.holds[0]
    held = np.arange(hold.start, hold.stop)
    chosen = sampled(held[clearance[held] > -options.touch], REFERENCE_TICKS)
    if chosen.size == 0:
        return np.nan
    haptic = HandConfiguration.of(scene.haptic)
    graphic = HandConfiguration.of(record)
    excess = reference_excess(scene.hand, surface, options, haptic, graphic, chosen)
    return metrics.statistics(excess).mean
