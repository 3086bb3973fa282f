"""Errors of one run of a method: penetration, distance from the true mesh and from the optimum, force variation.

All figures come from the recorded poses and forces, none from the solver's tolerances. Contact points are searched on
the surface of the run; their distances from the true mesh, and the hand's depth in it, are measured by the referee
(`hhsim.verify.mesh_distance`), which shares no code with the solver. The best pose is the optimum on the triangles of
the mesh.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.bench.figure_fields import figure, mean, metric, metrics_of, worst
from hhsim.errors import HhsimError, InputError, check_known
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import WORK_TOUCHING
from hhsim.mesh.catalogue import object_names
from hhsim.mesh.mesh import Mesh
from hhsim.metrics import metrics
from hhsim.metrics.contact_points import find_contact_points
from hhsim.metrics.mesh_penetration import sampled
from hhsim.metrics.run_ticks import RunTicks, hold_slices
from hhsim.motion.trajectory import TickInput
from hhsim.replay.summary import tremor_variation
from hhsim.scene.motion_catalogue import load_script, script_names
from hhsim.solver.options import SolverOptions
from hhsim.solver.reference_optimum import best_hands, reference_excess
from hhsim.verify.mesh_distance import HandReferee

STEPS = ("posture_jump_max", "posture_jump_p999", "force_contact_step", "force_contact_step_share")
"""Figures of the paper's criterion that nothing jumps between two adjacent ticks (Section V, 2)."""
MOST_HANDS = 400
"""Hands of a run whose depth is measured, 6 to 18 ms each: all that differ in a grasp, two in five in a slide."""
SAME = 12
"""Decimals to which equal lengths [m] agree."""
NAN = float("nan")


@dataclass(frozen=True, kw_only=True)
class MeshErrors:
    """Distances of a run from the true mesh; NaN where undefined."""

    mesh_depth_max: float = figure("deepest penetration of the true mesh, at `samples` ticks", "µm", worst, NAN)
    mesh_depth_p95: float = figure(
        "95th percentile of the penetration of the true mesh, at `samples` ticks", "µm", mean, NAN
    )
    contact_error_mean: float = figure("mean distance of contact points from the true mesh, all ticks", "µm", mean, NAN)
    contact_error_max: float = figure(
        "largest distance of contact points from the true mesh, all ticks", "µm", worst, NAN
    )
    contact_points: int = figure(
        "contact points whose distance from the true mesh was measured, those of one place once", "", sum, 0
    )
    samples: int = figure("ticks at which the depth in the true mesh was measured", "", sum, 0)


class MeshReferee:
    """Measures runs against one mesh [m], world.

    The depth of at most `most_hands` of a run is measured; identical ones count once.
    """

    def __init__(self, mesh: Mesh, most_hands: int = MOST_HANDS) -> None:
        self.most_hands = most_hands
        self._hands = HandReferee(mesh, open_too=True)

    @property
    def closed(self) -> bool:
        """True if the mesh is watertight; otherwise a depth in it is undefined."""
        return self._hands.surface.closed

    def errors(
        self, surface: Any, shape: HandShape, placed: PlacedHand, touch: float, contact: IntArray, also: IntArray
    ) -> MeshErrors:
        """Measure a run on a surface, world, from the graphic hand of every tick.

        A body and a piece of the surface touch within `touch` [m]. Contact points are measured at the ticks `contact`,
        ascending, depth in any case at those of `also`.
        """
        if contact.size == 0:
            return MeshErrors()
        found = find_contact_points(surface, shape, placed, touch, chosen=contact)
        # A hand at rest touches at the same points over and over.
        points, times = np.unique(np.round(found.point, SAME), axis=0, return_counts=True)
        away = self._hands.surface.nearest(points)[0]
        depth = self._depth(shape, placed, np.union1d(contact, also), also)
        return MeshErrors(
            mesh_depth_max=worst(depth),
            mesh_depth_p95=float(np.percentile(depth, 95)) if depth.size else np.nan,
            contact_error_mean=float(np.average(away, weights=times)) if away.size else np.nan,
            contact_error_max=worst(away),
            contact_points=len(points),
            samples=depth.size,
        )

    def _depth(self, shape: HandShape, placed: PlacedHand, ticks: IntArray, also: IntArray) -> FloatArray:
        """Depth [m] at the measured ticks; empty for a mesh that is not closed."""
        if not self.closed:
            return np.zeros(0)
        some = placed.at(ticks)
        poses = np.concatenate([values.reshape(len(ticks), -1) for values in some], axis=1)
        _, first, hand = np.unique(np.round(poses, SAME), axis=0, return_index=True, return_inverse=True)
        hand = hand.ravel()
        besides = np.flatnonzero(np.isin(ticks, also)).tolist()
        measured = np.unique(hand[sampled(np.sort(first), self.most_hands, besides)])
        depth = np.full(len(first), np.nan)
        # 0 - x and not -x: a free hand has depth 0, not minus 0.
        depth[measured] = 0.0 - self._hands.clearances(shape, some.at(first[measured]), 0.0).min(axis=1)
        return np.asarray(depth[hand][np.isin(hand, measured)])


NEAR = 1e-3
"""Largest distance of the haptic hand from the mesh in a tick in contact [m]."""
SAME_HAND = 1e-6
"""Largest difference of joints, position [m] and orientation of two hands that are the same."""
REFERENCE_TICKS = 16
"""Ticks of the first hold at which the optimum is computed."""


def check_scenes(objects: Sequence[str], motions: Sequence[str]) -> None:
    """Raise InputError for an object or a motion that the catalogue lacks, or a motion that touches nothing."""
    check_known("object", objects, object_names())
    check_known("trajectory", motions, script_names())
    for motion in motions:
        if not load_script(motion).contact:
            raise InputError(f"the motion '{motion}' touches nothing: there is no error to measure")


@dataclass(frozen=True, kw_only=True)
class RunErrors(MeshErrors):
    """Errors of one run; NaN where undefined, as `mesh_error` of a hand that touches nothing, which is not perfect."""

    penetration_max: float = metric(worst)
    mesh_error: float = figure("the larger of mesh_depth_max and contact_error_max", "µm", worst)
    tracking_excess: float = figure(
        "coupling energy over the optimum on the same surface, mean of the hold, (E - E*) / E*", "", mean
    )
    off_optimum_mean: float = figure(
        "farthest of palm and fingertips from the converged optimum on the mesh, mean", "mm", mean
    )
    off_optimum_max: float = figure(
        "farthest of palm and fingertips from the converged optimum on the mesh, most", "mm", worst
    )
    force_hold: float = metric(mean, of="force_hold_mean")
    force_variation_hold: float = metric(mean)
    force_variation_tremor: float = metric(mean)
    force_ripple: float = metric(worst, of="force_ripple_hold")
    force_step: float = metric(worst)
    posture_jump_max: float = metric(worst)
    posture_jump_p999: float = metric(worst)
    force_contact_step: float = metric(worst)
    force_contact_step_share: float = metric(worst)
    stuck_ticks: int = metric(sum)
    lag_ticks: int = metric(sum)
    lag_max: float = metric(worst)


@dataclass(frozen=True)
class ErrorScene:
    """Reference of the errors of a run, the same for every method and surface."""

    hand: HandModel
    referee: MeshReferee  # of the true mesh, world
    haptic: TickInput
    haptic_placed: PlacedHand  # haptic hand of every tick
    optimum: PlacedHand  # graphic hand of the converged optimum on the mesh, every tick
    contact: BoolArray  # ticks in contact of the haptic hand, shape (T,)
    seed: int = 0  # of the tremor

    @property
    def holds(self) -> list[slice]:
        """Ticks of each hold."""
        return hold_slices(self.haptic.phases, self.haptic.tick_count)


def error_scene(
    hand: HandModel, referee: MeshReferee, haptic: TickInput, surface: Any, options: SolverOptions, seed: int = 0
) -> ErrorScene:
    """Return the reference of runs of one motion on one object, by the options' stiffness and lengths.

    `surface` is the mesh's, closed or not. Raises HhsimError where the optimum on this mesh has more candidate pairs
    than the solver holds.
    """
    placed = forward_kinematics(hand, *HandConfiguration.of(haptic))
    return ErrorScene(
        hand=hand,
        referee=referee,
        haptic=haptic,
        haptic_placed=placed,
        optimum=placed_of(best_hands(hand, surface, options, HandConfiguration.of(haptic))),
        contact=hand_clearance(hand, surface, placed, NEAR) < NEAR,
        seed=seed,
    )


def placed_of(record: TickRecord) -> PlacedHand:
    """Return the graphic hand of a run."""
    return PlacedHand(record.joints, record.position, record.orientation)


def check_finite(record: TickRecord) -> None:
    """Raise HhsimError, with the first such tick, if a joint of the graphic hand is not finite."""
    finite = np.isfinite(record.joints).all(axis=(1, 2, 3))
    if not finite.all():
        raise HhsimError(f"the graphic hand is not finite after tick {int(finite.argmin())}")


def first_hold_tremor(
    hand: HandModel, surface: Any, options: SolverOptions, haptic: TickInput, record: TickRecord, seed: int
) -> float:
    """Return the mean force variation [%] of the first hold, repeated with a tremor; NaN without a hold."""
    holds = hold_slices(haptic.phases, haptic.tick_count)
    if not holds:
        return np.nan
    held, shown = (HandConfiguration.of(posed).at(holds[0]) for posed in (haptic, record))
    found = tremor_variation(hand, surface, options, held, shown, haptic.rate, seed)
    return np.nan if found is None else found.mean


def digest_of(record: TickRecord) -> str:
    """Return a digest of the poses and forces of a run."""
    digest = hashlib.sha256()
    for values in (record.position, record.orientation, record.flexion, record.total):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def hand_clearance(hand: HandModel, surface: Any, placed: PlacedHand, limit: float) -> FloatArray:
    """Return the least signed distance [m] of hand and surface at each tick, shape (T,), at most `limit`."""
    palm, finger = metrics.hand_clearance(surface, hand_shape(hand), placed, limit)
    return np.asarray(np.minimum(palm, finger.min(axis=1)))


def run_errors(
    scene: ErrorScene, surface: Any, options: SolverOptions, record: TickRecord, window: slice = slice(None)
) -> RunErrors:
    """Measure a run on the surface of its options, world; figures of holds are NaN unless `window` has all ticks."""
    placed = placed_of(record)
    ticks = len(record.position)
    contact = np.flatnonzero(scene.contact[window])
    clearance = _clearance(scene, surface, options, placed, window)
    deepest = np.array([int(clearance.argmin())] if clearance.min(initial=0.0) < 0.0 else [], np.int64)
    # Spheres that protrude are touched before the haptic hand is near the mesh.
    looked = np.flatnonzero(scene.contact[window] | (clearance < 2.0 * options.touch))
    mesh = scene.referee.errors(surface, hand_shape(scene.hand), placed, options.touch, looked, deepest)
    off = np.linalg.norm(placed.ends - scene.optimum.at(window).ends, axis=2).max(axis=1)[contact]
    whole, closed = ticks == len(scene.contact), scene.referee.closed
    run = RunTicks(
        columns={
            "status": record.status,
            "lag": record.lag,
            "penetration_depth": np.maximum(0.0, -clearance),
            "contacts/touching": record.work[:, WORK_TOUCHING],
            "force/total": record.total,
            "graphic/joints": record.joints,
            "force_variation_rate": metrics.force_variation_rate(record.total),
        },
        ticks=ticks,
        phases=scene.haptic.phases if whole else (),
        rate=scene.haptic.rate,
        fingers=len(options.fingers),
        user=scene.haptic_placed.at(window).joints,
    )
    held = whole and bool(scene.holds)
    return RunErrors(
        **metrics_of(RunErrors, run),
        force_variation_tremor=(
            first_hold_tremor(scene.hand, surface, options, scene.haptic, record, scene.seed) if whole else np.nan
        ),
        **asdict(mesh),
        mesh_error=float(np.maximum(mesh.mesh_depth_max, mesh.contact_error_max) if closed else mesh.contact_error_max),
        tracking_excess=_excess(scene, surface, options, record, clearance) if held else np.nan,
        off_optimum_mean=mean(off),
        off_optimum_max=worst(off),
    )


def _clearance(
    scene: ErrorScene, surface: Any, options: SolverOptions, placed: PlacedHand, window: slice
) -> FloatArray:
    """Signed distance [m] of graphic hand and surface, shape (T,), at most twice the touching distance."""
    limit = 2.0 * options.touch
    if options.surface != "mesh":
        return hand_clearance(scene.hand, surface, placed, limit)
    # Triangles take a millisecond a tick, and a graphic hand on the free haptic one is as far away.
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
    """Mean energy above the optimum in the first hold; of ticks without penetration: a hand inside has too little."""
    hold = scene.holds[0]
    held = np.arange(hold.start, hold.stop)
    chosen = sampled(held[clearance[held] > -options.touch], REFERENCE_TICKS)
    if chosen.size == 0:
        return np.nan
    haptic = HandConfiguration.of(scene.haptic)
    graphic = HandConfiguration.of(record)
    excess = reference_excess(scene.hand, surface, options, haptic, graphic, chosen)
    return metrics.statistics(excess).mean
