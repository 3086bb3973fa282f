"""Scenes of spheres, demanding motions, and distances by brute force for the tests of the solver.

The distances use no code of the kernels: the round cone's is the case table of Quilez ("Round cone", 2018), not the
kernels' clamped parameter, which `test_round_cone` holds against a search along the axis.
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numba
import numpy as np
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.detection import ListDistances, evaluate_surface
from hhsim.kernels.contact.surface import Surface
from hhsim.kernels.hand.pose import update_kinematics
from hhsim.kernels.round_cone import Spheres
from hhsim.kernels.surfaces.spheres import SURFACE as SPHERES
from hhsim.kernels.tick.block import HapticBlock, TickRecord, set_haptic
from hhsim.kernels.tick.state import tick_state_dtype
from hhsim.kernels.tick.tick import begin_tick
from hhsim.kernels.world.linearisation import prepare, solve_with_pairs
from hhsim.mesh.catalogue import load_object
from hhsim.motion import analytic_motion
from hhsim.result.reader import Result
from hhsim.solver.solver import HandSolver
from hhsim.solver.workspace import fresh_state
from hhsim.solver.world_engine import WorldEngine
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree, enclosing_radius

BALL_RADIUS = 0.038
PALM = 15
"""Row of the palm's first sphere, behind the 15 phalanges."""
CURL = np.array([[0.3, 0.5, 0.4], [0.6, 0.7, 0.5], [0.7, 0.7, 0.5], [0.6, 0.7, 0.5], [0.5, 0.7, 0.4]])
"""Flexion [rad] of a hand around a ball."""
UNTIMED = [name for name in TickRecord._fields if not name.startswith("duration")]
"""What ticks of the same input have in common."""


def sphere_tree(center: FloatArray, radius: FloatArray, branching: int = 8) -> SphereTree:
    """A tree over these leaves, shapes (L, 3) and (L,) [m]: near ones are grouped until a single node is left."""
    order = _near_order(center, np.arange(len(radius)))
    centers, sizes = [center[order]], [len(radius)]
    groups: list[IntArray] = []
    while sizes[0] > 1 or len(sizes) == 1:
        group = np.arange(sizes[0]) // branching
        groups.insert(0, group)
        sizes.insert(0, int(group[-1]) + 1)
        centers.insert(0, np.array([centers[0][group == g].mean(axis=0) for g in range(sizes[0])]))
    level = np.repeat(np.arange(len(sizes)), sizes)
    first = np.concatenate([[0], np.cumsum(sizes)])
    parent = np.concatenate([[-1], *(first[i] + group for i, group in enumerate(groups))]).astype(np.int64)
    all_center = np.concatenate(centers)
    all_radius = np.concatenate([np.zeros(len(all_center) - len(radius)), radius[order]])
    return SphereTree(
        center=all_center, radius=enclosing_radius(all_center, all_radius, level, parent), level=level, parent=parent
    )


def ball(radius: float = BALL_RADIUS) -> SphereTree:
    """One sphere about the origin [m]."""
    return sphere_tree(np.zeros((1, 3)), np.array([radius]))


def row(axis: Sequence[float], count: int = 41, length: float = 0.2) -> SphereTree:
    """Balls of 20 mm radius in a row along a unit axis, a length [m] from first to last middle."""
    return sphere_tree(np.linspace(-length / 2, length / 2, count)[:, None] * axis, np.full(count, 0.02))


@cache
def object_tree(name: str, level: int | None = None) -> SphereTree:
    """The sphere tree of a catalogue object, by default of its own level."""
    item = load_object(name)
    return cached_sphere_tree(item.mesh, TreeOptions(level=level or item.level))


def _near_order(center: FloatArray, index: IntArray) -> IntArray:
    if len(index) <= 2:
        return index
    points = center[index]
    axis = int(np.argmax(np.ptp(points, axis=0)))
    index = index[np.argsort(points[:, axis], kind="stable")]
    half = len(index) // 2
    return np.concatenate([_near_order(center, index[:half]), _near_order(center, index[half:])])


def bumpy_ball(leaves: int) -> SphereTree:
    """A ball whose surface is made of `leaves` overlapping spheres on a Fibonacci lattice [m]."""
    i = np.arange(leaves) + 0.5
    height = 1.0 - 2.0 * i / leaves
    turn = math.pi * (1.0 + math.sqrt(5.0)) * i
    around = np.sqrt(1.0 - height**2)
    surface = np.stack([around * np.cos(turn), around * np.sin(turn), height], axis=1)
    small = min(0.35 * BALL_RADIUS, 4.0 * BALL_RADIUS / math.sqrt(leaves))
    return sphere_tree((BALL_RADIUS - small) * surface, np.full(leaves, small))


def cloud(random: np.random.Generator, leaves: int, spread: float = 0.05) -> SphereTree:
    """Random spheres of many sizes within ± `spread` [m]."""
    center = random.uniform(-spread, spread, (leaves, 3))
    return sphere_tree(center, 10.0 ** random.uniform(-4.0, -2.0, leaves), int(random.integers(2, 9)))


def random_targets(hand: HandModel, ticks: int, seed: int, hold: int = 60, sweep: bool = False) -> HandConfiguration:
    """A new random hand every `hold` ticks, at a jump: position σ 60 mm, rotation σ 0.8 rad, flexion within its limits.

    With `sweep` the abduction is random within its limits too. The first hand is 250 mm above the origin.
    """
    motion = analytic_motion.random_targets(hand, ticks, np.random.default_rng(seed), hold=hold)
    return motion if sweep else motion._replace(abduction=np.zeros((ticks, 5)))


def random_hand(random: np.random.Generator, hand: HandModel, spread: float) -> HandConfiguration:
    """One hand within its joint limits, the palm σ `spread` [m] about the origin."""
    return HandConfiguration(
        random.normal(0.0, spread, (1, 3)),
        Rotation.random(1, rng=random).as_quat(scalar_first=True),
        random.uniform(hand.flexion_min, hand.flexion_max, (1, 5, 3)),
        random.uniform(hand.abduction_min, hand.abduction_max, (1, 5)),
    )


def pose_of(state: Any) -> HandConfiguration:
    """The graphic hand of a tick's state."""
    return analytic_motion.still(*HandConfiguration.of(state.pose))


def tick_state(stiffness: FloatArray, surface: Surface = SPHERES) -> Any:
    """A fresh state of a tick, with all lists of a surface; `stiffness` is G, shape (21,)."""
    return fresh_state(tick_state_dtype(surface.candidates), stiffness, True)[0]


def set_pose(hand: HandModel, pose: Any, motion: HandConfiguration) -> None:
    """Write the first configuration of a motion into a HAND_POSE record, kinematics included."""
    for name, values in zip(HandConfiguration._fields, motion):
        pose[name][:] = values[0]
    update_kinematics(hand.arrays(), pose)


def prepared(solver: HandSolver, motion: HandConfiguration, tick: int) -> int:
    """Bring a solver that stands before `tick` to that tick's first program; returns the number of contacts."""
    state, options = solver.workspace.states[0], solver.workspace.tick_options
    assert set_haptic(solver.workspace.hand, HapticBlock(*motion), tick, state) == 0
    begin_tick(options, state)
    state.trust.reach = options.margin
    state.fallback.is_relaxed = False
    hand, surface = solver.workspace.hand, solver.workspace.code
    # Whole lists, as a tick has them made where its step goes beyond those that wait.
    state.candidates.allowed_deficit = 0.0
    evaluate_surface(
        hand,
        state.pose,
        surface,
        ListDistances(options.margin, options.margin, options.skin),
        state.candidates,
        state.work,
    )
    return int(prepare(engine_of(solver).method, 0.0, state))


def engine_of(solver: HandSolver) -> WorldEngine:
    """The solver's engine of hands and bodies."""
    assert isinstance(solver.engine, WorldEngine)
    return solver.engine


def solve_prepared(solver: HandSolver) -> int:
    """Solve the prepared program by the solver's method; the step is in the state. Returns the kernel's status."""
    engine, state = engine_of(solver), solver.workspace.states[0]
    state.fallback.is_coupled = False  # as harvested, a tick may have given up on palm and fingers apart
    return int(solve_with_pairs(engine.method, 1, False, state, engine.qp))


def spheres_of(center: FloatArray, radius: FloatArray) -> Spheres:
    x, y, z = np.ascontiguousarray(center.T)
    return Spheres(x, y, z, np.ascontiguousarray(radius))


@numba.njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "arcp"})  # type: ignore[untyped-decorator]
def _cone_distances(leaves: Spheres, a: FloatArray, b: FloatArray, ra: float, rb: float, out: FloatArray) -> None:
    bax, bay, baz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    square = bax * bax + bay * bay + baz * baz
    drop = ra - rb
    slant = square - drop * drop
    inverse = 1.0 / square
    for i in range(leaves.x.shape[0]):
        px, py, pz = leaves.x[i] - a[0], leaves.y[i] - a[1], leaves.z[i] - a[2]
        t = px * bax + py * bay + pz * baz
        u = t - square
        vx, vy, vz = px * square - bax * t, py * square - bay * t, pz * square - baz * t
        h2 = vx * vx + vy * vy + vz * vz
        t2, u2 = t * t * square, u * u * square
        k = drop * drop * h2
        tip = math.sqrt(h2 + u2) * inverse - rb
        base = math.sqrt(h2 + t2) * inverse - ra
        side = (math.sqrt(h2 * slant * inverse) + t * drop) * inverse - ra
        signed_u = slant * u2 if u > 0.0 else -slant * u2
        signed_t = slant * t2 if t > 0.0 else -slant * t2
        distance = base if signed_t < k else side
        distance = tip if signed_u > k else distance
        out[i] = distance - leaves.radius[i]


@numba.njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _all_pairs(
    leaves: Spheres, joints: FloatArray, phalanx: FloatArray, palm: FloatArray, palm_radius: FloatArray, out: FloatArray
) -> None:
    for f in range(5):
        for k in range(3):
            ends, ra, rb = joints[f, k : k + 2], phalanx[f, k], phalanx[f, k + 1]
            _cone_distances(leaves, ends[0], ends[1], ra, rb, out[3 * f + k])
    for p in range(palm_radius.shape[0]):
        for i in range(leaves.x.shape[0]):
            dx, dy, dz = leaves.x[i] - palm[p, 0], leaves.y[i] - palm[p, 1], leaves.z[i] - palm[p, 2]
            out[15 + p, i] = math.sqrt(dx * dx + dy * dy + dz * dz) - leaves.radius[i] - palm_radius[p]


def palm_spheres(palm_center: FloatArray, position: FloatArray, orientation: FloatArray) -> FloatArray:
    """World centres of the palm's spheres [m], shape (T, P, 3)."""
    matrix = Rotation.from_quat(orientation, scalar_first=True).as_matrix()
    return np.ascontiguousarray(np.einsum("tij,pj->tpi", matrix, palm_center) + position[:, None])


def brute_pairs(
    hand: HandModel, leaf_center: FloatArray, leaf_radius: FloatArray, motion: HandConfiguration, tick: int = 0
) -> FloatArray:
    """Signed distance [m] of every pair at one configuration: 15 phalanges, then palm spheres, shape (15 + P, L)."""
    position, orientation, flexion, abduction = motion.at(tick)
    joints = hand.joints(position, orientation, flexion, abduction)
    center = palm_spheres(hand.palm_tree.leaf_center, position[None], orientation[None])[0]
    palm_radius = hand.palm_tree.leaf_radius
    out = np.empty((PALM + len(palm_radius), len(leaf_radius)))
    _all_pairs(spheres_of(leaf_center, leaf_radius), joints, hand.radius, center, palm_radius, out)
    return out


def brute_clearance(
    leaf_center: FloatArray,
    leaf_radius: FloatArray,
    phalanx_radius: FloatArray,
    palm_center: FloatArray,
    palm_radius: FloatArray,
    joints: FloatArray,
    position: FloatArray,
    orientation: FloatArray,
) -> FloatArray:
    """Least signed distance [m] of each body (15 phalanges, palm) to all leaves, one by one, shape (T, 16).

    NaN for a hand that is nowhere. Arguments as in a result file: joints (T, 5, 4, 3), position (T, 3), orientation
    (T, 4) of the graphic hand; the palm's spheres in its own frame.
    """
    leaves, palm = spheres_of(leaf_center, leaf_radius), palm_spheres(palm_center, position, orientation)
    pairs, out = np.empty((PALM + len(palm_radius), len(leaf_radius))), np.empty((len(joints), PALM + 1))
    placed, sizes, small = map(np.ascontiguousarray, (joints, phalanx_radius, palm_radius))
    for t in range(len(joints)):
        _all_pairs(leaves, placed[t], sizes, palm[t], small, pairs)
        least = pairs.min(axis=1)
        out[t] = *least[:PALM], least[PALM:].min()
    lost = ~(np.isfinite(joints).all(axis=(1, 2, 3)) & np.isfinite(position).all(axis=1))
    out[lost] = np.nan
    return out


def record_clearance(hand: HandModel, tree: SphereTree, record: TickRecord | PlacedHand) -> FloatArray:
    """`brute_clearance` of a block of ticks, shape (T, 16)."""
    palm, shown = hand.palm_tree, (record.joints, record.position, record.orientation)
    sizes = (hand.radius, palm.leaf_center, palm.leaf_radius)
    return brute_clearance(tree.leaf_center, tree.leaf_radius, *sizes, *shown)


def result_clearance(result: Result, ticks: Any = slice(None)) -> FloatArray:
    """`brute_clearance` of some ticks of a result, from nothing but the file, shape (T, 16)."""
    static, level = result.static, result.body.static["tree/level"]
    leaves = [result.body.static[f"tree/{name}"][level == level.max()] for name in ("center", "radius")]
    sizes = [static[f"hand/{name}"] for name in ("phalanx_radius", "palm_center", "palm_radius")]
    return brute_clearance(
        *leaves, *sizes, *(result[f"graphic/{name}"][ticks] for name in ("joints", "position", "orientation"))
    )
