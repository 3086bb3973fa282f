"""Figures of safety of a run of any length, which is measured and dropped block by block, and the judge of stuck ticks.

The judge searches for a step that a hand which stood still could have taken. It shares nothing with a tick but the QP
solver: kinematics and distances to leaf spheres or triangles are those of `hhsim verify`, and a step is free if the
distances at its end say so.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.bench.figures import placed_of
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.rotation import rotate_quaternion, rotation_vector_between
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK, WORK_TOUCHING
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import Penetration, penetration
from hhsim.motion.analytic_motion import hold_readings
from hhsim.solver.method import METHODS
from hhsim.solver.options import SolverOptions
from hhsim.solver.qp import QpProblem, QpStatus, solve
from hhsim.system.settings_file import Names
from hhsim.trees.sphere_tree import SphereTree
from hhsim.verify.contacts import PALM, Pairs, Pieces, near_pairs
from hhsim.verify.kinematics import OwnHand, Posed, pose

Pose = tuple[FloatArray, FloatArray, FloatArray, FloatArray]

SAFE_DEPTH = 1e-6
"""Penetration [m] that a method which promises none may show."""
BLOCK = 2048
"""Ticks that are run and measured together."""
WORTH = 0.01
"""A step must lower the coupling energy by this share of what the same step lowers it in free space."""
SHARES = (1.0, 0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-4)
"""Shares of the program's step that are tried."""
ARRIVED = 1e-9
"""A hand this near to the haptic one [m] has arrived."""
MOST_CHECKS = 40
"""Different stuck ticks of a run, or of a block of it, that are examined; those beyond count as having a way out."""


def pieces_of(surface: str, mesh: Mesh | None, tree: SphereTree | None) -> Pieces:
    """Return the pieces of a surface by its name, in the frame of mesh and tree; InputError if there is no such one."""
    if surface == "spheres" and tree is not None:
        return Pieces.of_balls(np.asarray(tree.leaf_center), np.asarray(tree.leaf_radius))
    if surface == "mesh" and mesh is not None:
        return Pieces.of_triangles(mesh.triangles)
    raise InputError(f"this object has no {surface}")


def pairs_near(hand: HandModel, pieces: Pieces, at: HandConfiguration, limit: float) -> tuple[Pairs, Posed]:
    """Return all pairs of a body of a hand and a piece no more than `limit` [m] apart, and the posed hand."""
    palm = hand.palm_tree
    sizes = (getattr(hand, name) for name in OwnHand._fields[:7])
    own = OwnHand._make([*sizes, palm.leaf_center, palm.leaf_radius, hand.abduction_sign])
    posed = pose(own, at)
    return near_pairs(own, posed, pieces, np.ones(len(FINGERS), bool), limit), posed


def stuck_with_way_out(
    hand: HandModel, pieces: Pieces, options: SolverOptions, haptic: HandConfiguration, record: TickRecord
) -> BoolArray:
    """Return the stuck ticks of a run for which `way_out` finds a step, shape (T,); readings as of `hold_readings`."""
    found = np.zeros(len(record.status), bool)
    shown = HandConfiguration.of(record)
    verdicts: dict[bytes, bool] = {}
    for tick in np.flatnonzero(record.status & STATUS_STUCK).tolist():
        here, goal = shown.part(tick, tick + 1), haptic.part(tick, tick + 1)
        key = b"".join(np.ascontiguousarray(values).tobytes() for values in (*here, *goal))
        if key not in verdicts and len(verdicts) < MOST_CHECKS:
            verdicts[key] = way_out(hand, pieces, options, here, goal) > 0.0
        found[tick] = verdicts.get(key, True)
    return found


def way_out(
    hand: HandModel, pieces: Pieces, options: SolverOptions, graphic: HandConfiguration, haptic: HandConfiguration
) -> float:
    """Return the fraction of a step towards the haptic hand that was free and worth taking; 0 if there is none.

    The step is as long as the solver's longest near the object, follows the optimum of the linearised contacts, and
    keeps the abduction. It counts if all pieces stay clear of the hand and the energy falls as the program promised.
    `graphic` is one tick, at which the hand stood still, `haptic` one, a reading of a hand; pieces are in the world.
    """
    here: Pose = tuple(values[0] for values in graphic)
    goal: Pose = tuple(values[0] for values in haptic)
    stiffness = options.stiffness.diagonal()
    target = _between(hand, here, goal)
    lever = float((hand.arrays().reach + hand.radius[:, 1:]).max())
    longest = np.linalg.norm(target[:3]) + lever * (np.linalg.norm(target[3:6]) + np.abs(target[6:]).max())
    if longest < ARRIVED:
        return 0.0
    clipped = target * min(1.0, options.margin / longest)
    near = 4.0 * options.margin
    pairs, posed = pairs_near(hand, pieces, graphic, near)
    distance, limits = pairs.distance, np.concatenate([np.zeros((15, 6)), np.eye(15)], axis=1)
    bounds = np.concatenate([(hand.flexion_min - here[2]).ravel(), (here[2] - hand.flexion_max).ravel()])
    # A little clear of what touches: the second order of a short step then cannot take it in.
    closer = np.minimum(options.offset, np.maximum(distance, 0.0) + 0.1 * options.offset) - distance
    problem = QpProblem(
        stiffness=stiffness,
        matrix=np.concatenate([distance_rows(pairs, posed), limits, -limits]),
        rhs=np.concatenate([closer, np.minimum(bounds, 0.0)]),
        target=clipped,
    )
    solution = solve(problem)
    if solution.status is not QpStatus.OPTIMAL:
        return 0.0

    def energy(offset: FloatArray) -> float:
        return 0.5 * float(offset @ (stiffness * offset))

    promised = energy(target) - energy(target - solution.x)
    free = energy(target) - energy(target - clipped)
    if not promised > WORTH * free:
        return 0.0
    deepest = min(0.0, float(distance.min(initial=0.0)))
    for share in SHARES:
        there = _moved(here, share * solution.x)
        gained = energy(target) - energy(_between(hand, there, goal))
        if gained > 0.1 * share * promised:
            at = HandConfiguration(*(np.array(values)[None] for values in there))
            moved = pairs_near(hand, pieces, at, near)[0]
            if moved.distance.min(initial=np.inf) >= deepest:
                return share
    return 0.0


def distance_rows(pairs: Pairs, posed: Posed) -> FloatArray:
    """Return the derivatives of the distances of one hand's pairs by its 21 variables, shape (N, 21).

    The nearest point of the hand moves with its body, along the pair's normal.
    """
    rows = np.zeros((len(pairs.distance), 21))
    rows[:, :3] = pairs.normal
    rows[:, 3:6] = np.cross(pairs.point - posed.position[0], pairs.normal)
    for row in np.flatnonzero(pairs.body < PALM).tolist():
        finger, last = divmod(int(pairs.body[row]), 3)
        lever = pairs.point[row] - posed.joints[0, finger, : last + 1]
        first = 6 + 3 * finger
        rows[row, first : first + last + 1] = np.cross(posed.axes[0, finger], lever) @ pairs.normal[row]
    return rows


def _between(hand: HandModel, here: Pose, goal: Pose) -> FloatArray:
    turn = np.empty(3)
    rotation_vector_between(np.array(here[1]), goal[1] / np.linalg.norm(goal[1]), turn)
    bend = np.clip(goal[2], hand.flexion_min, hand.flexion_max) - here[2]
    return np.concatenate([goal[0] - here[0], turn, bend.ravel()])


def _moved(here: Pose, step: FloatArray) -> Pose:
    orientation = np.array(here[1])
    rotate_quaternion(orientation, step[3], step[4], step[5], orientation)
    return here[0] + step[:3], orientation, here[2] + step[6:].reshape(5, 3), here[3]


def solvers_of(methods: Names | None, surfaces: Names, **options: Any) -> list[SolverOptions]:
    """Return the options of every solver; without named methods those of all that take the surface.

    Raises InputError if a method does not take a surface, or an option is out of its range; UnknownNameError for no
    such method or surface.
    """
    return [
        SolverOptions(method=method, surface=surface, **options)
        for surface in surfaces
        for method in methods or METHODS
        if methods or surface == "spheres" or not METHODS[method].refuses_surfaces
    ]


def recorded_penetration(hand: HandModel, surface: Any, record: TickRecord) -> Penetration:
    """Return the depths [m] of the recorded hand, computed by `hhsim.metrics.metrics` and not by the solver."""
    return penetration(surface, hand_shape(hand), placed_of(record))


def not_finite(record: TickRecord) -> BoolArray:
    """Return the ticks whose graphic hand or force is not finite, shape (T,)."""
    bad = np.zeros(len(record.status), dtype=bool)
    for name in ("position", "orientation", "flexion", "abduction", "joints", "phalanx", "palm_wrench", "total"):
        values = getattr(record, name)
        bad |= ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    return bad


# np.max: NaN if one depth is, that of a hand that is not finite.
TOTALS: dict[str, Callable[[Sequence[Any]], Any]] = {
    "ticks": sum,
    "penetration": lambda depths: float(np.max(depths)),
    **dict.fromkeys(("penetrating", "not_finite", "touching", "stuck", "unexplained", "lagging"), sum),
    "lag": max,
}
"""What sums up the figures of a run of any length, which the plan of `stress` describes."""


def summed(blocks: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the figures of several blocks of ticks together, NaN for one that a block does not have."""
    return {name: total([block.get(name, math.nan) for block in blocks]) for name, total in TOTALS.items()}


def is_safe(figures: Mapping[str, Any]) -> bool:
    """Return True if the hand stayed within 1 µm and finite, and no stuck tick had a free step; figures of `TOTALS`."""
    return bool(figures["penetration"] <= SAFE_DEPTH and not figures["not_finite"] and not figures["unexplained"])


class SafetyMeasure:
    """Measures a run, block by block, beside the pieces of the surface that the hand touches, world."""

    def __init__(self, hand: HandModel, pieces: Pieces, options: SolverOptions) -> None:
        self._hand, self._pieces, self._options = hand, pieces, options
        self._before: HandConfiguration | None = None
        self.figures: dict[str, Any] = {}  # of `TOTALS`, of all blocks so far; none before the first

    def readings(self, motion: HandConfiguration) -> HandConfiguration:
        """Return a block of the haptic motion with readings held as the solver holds them, across blocks too."""
        if self._before is None:
            held = hold_readings(motion)
        else:
            held = hold_readings(sequence(self._before, motion)).part(1, motion.ticks + 1)
        self._before = held.part(motion.ticks - 1, motion.ticks).copy()
        return held

    def add(self, haptic: HandConfiguration, record: TickRecord, depth: FloatArray) -> dict[str, BoolArray]:
        """Measure a block of known depths [m]; return its failed ticks, shape (T,), by the name of the failure."""
        penetrating, lost = ~(depth <= SAFE_DEPTH), not_finite(record)
        unexplained = stuck_with_way_out(self._hand, self._pieces, self._options, haptic, record)
        stuck = (record.status & STATUS_STUCK) > 0
        block = {
            "ticks": len(stuck),
            "penetration": float(depth.max()),
            "penetrating": int(penetrating.sum()),
            "not_finite": int(lost.sum()),
            "touching": int((record.work[:, WORK_TOUCHING] > 0).sum()),
            "stuck": int(stuck.sum()),
            "unexplained": int(unexplained.sum()),
            "lagging": int(((record.status & STATUS_LAG) > 0).sum()),
            "lag": float(record.lag.max()),
        }
        self.figures = summed([self.figures, block] if self.figures else [block])
        return {"penetration": penetrating, "not finite": lost, "stuck": unexplained}
