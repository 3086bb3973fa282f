"""From tree to hand: replays with certified trees, judged against the true mesh by an independent library.

A hand that stays out of spheres that cover the mesh stays out of the mesh, and where it touches them it hovers over the
mesh by no more than the spheres protrude. Both are held against coal's distances, tick by tick.

    python -m tools.tree_to_hand --object bunny,cube --level 3,4
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.bench.run_errors import placed_of
from hhsim.errors import HhsimError, InputError
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.contact_points import find_contact_points
from hhsim.metrics.metrics import hand_clearance
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import make_scene
from hhsim.solver.hand_solver import HandSolver, warm_up
from hhsim.solver.options import SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.verify.coal_distance import HandReferee
from hhsim.verify.contacts import BODIES

TOUCH = 1e-5
"""Spheres nearer than this [m] touch."""
FAR = 5e-3
"""Distances from here on are not looked for [m]; a coarse tree's hover can reach it."""
DEEPEST = 1e-6
"""Most mesh penetration of a run that passes [m]."""


def palm_centers(palm_center: ArrayLike, position: ArrayLike, orientation: ArrayLike) -> FloatArray:
    """Compute centres of the palm's spheres [m], world, (P, 3), from the palm's position and orientation w x y z."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = np.asarray(orientation, np.float64)
    return np.asarray(Rotation.from_quat([x, y, z, w]).apply(np.asarray(palm_center)) + np.asarray(position))


@dataclass(frozen=True)
class EndToEnd:
    """One motion on one object, with the tree of one level.

    Attributes:
        object, motion, level: What.
        leaves: Of the tree.
        bound: How far its leaves may protrude from the mesh, as proved [m].
        ticks: Ticks in contact that were looked at.
        mesh_penetration: Deepest of the hand in the true mesh [m].
        sphere_penetration: Deepest in the leaves, all ticks [m].
        hover: Of the bodies that touch, the farthest from the true mesh, less what they are from their sphere [m].
        hover_hold: The same in the hold [m].
        touching: Bodies that touched in those ticks, counted in each.
        contact_error_mean, contact_error_max: From points that touch to the true mesh [m].
        tick_cpu_p50, tick_cpu_p99: CPU time of a tick in contact, of this one run [s].
    """

    object: str
    motion: str
    level: int
    leaves: int
    bound: float
    ticks: int
    mesh_penetration: float
    sphere_penetration: float
    hover: float
    hover_hold: float
    touching: int
    contact_error_mean: float
    contact_error_max: float
    tick_cpu_p50: float
    tick_cpu_p99: float

    @property
    def passed(self) -> bool:
        """Whether the mesh is kept out of and the hover is within the proved bound."""
        return self.mesh_penetration <= DEEPEST and self.hover <= self.bound and self.touching > 0


def end_to_end(
    mesh: Mesh, level: int, motion: str, *, method: str = "coupled", every: int = 20, leaves: int | None = None
) -> EndToEnd:
    """Replay a motion on an object and judge the graphic hand against the true mesh.

    Args:
        mesh: Watertight and wound outward [m].
        level: Of the tree's leaves.
        motion: Name of a script of the catalogue.
        method: Of the solver.
        every: Of the ticks in contact, one in so many is looked at.
        leaves: Most leaves of the tree; None for 8 to the level.

    Raises:
        HhsimError: What the replay, the builder or the referee raises.
    """
    hand, options = HandModel.default(), SolverOptions(method=method)
    tree = cached_sphere_tree(mesh, TreeOptions(level=level, leaves=leaves))
    scene = make_scene(mesh, tree, hand, load_script(motion))
    options = replace(options, period=1.0 / scene.ticks.rate)
    warm_up(hand, options)
    arrays, shape, ticks = (
        scene.solids[0].placed_tree.arrays(),
        hand_shape(hand),
        scene.hands[0].ticks.seen_from_object(),
    )
    record = HandSolver(hand, arrays, options).run(ticks.position, ticks.orientation, ticks.flexion, ticks.abduction)
    placed = placed_of(record)
    palm, finger = hand_clearance(arrays, shape, placed, limit=2.0 * TOUCH)
    clearance = np.minimum(palm, finger.min(axis=1))
    contact = np.flatnonzero(clearance <= TOUCH)
    if contact.size == 0:
        raise InputError(f"{motion} on {mesh.name}: the hand never touches, there is nothing to judge")
    held = np.zeros(ticks.tick_count, bool)
    for phase in ticks.phases:
        held[phase.first_tick : phase.last_tick + 1] = phase.name == "hold"
    chosen = np.unique(np.concatenate([contact[::every], contact[-1:], [int(clearance.argmin())]]))
    # A hold that rests shows the same hand over and over.
    chosen = chosen[np.unique(placed.joints[chosen].reshape(len(chosen), -1), axis=0, return_index=True)[1]]
    some = placed.at(chosen)
    referee = HandReferee(scene.solids[0].placed_mesh)
    true = referee.clearances(shape, some, FAR)
    own = sphere_distances(
        scene.solids[0].placed_tree.leaf_center, scene.solids[0].placed_tree.leaf_radius, shape, some
    )
    touching = own <= TOUCH
    hover = np.where(touching, true - np.maximum(own, 0.0), -np.inf).max(axis=1)
    points = find_contact_points(arrays, shape, some, TOUCH).point
    off = np.abs(referee.surface.signed_distance(points))
    cpu = 1e-9 * record.duration_cpu[contact].astype(np.float64)
    return EndToEnd(
        object=mesh.name,
        motion=motion,
        level=level,
        leaves=tree.leaf_count,
        bound=tree.errors[-1].bound,
        ticks=len(chosen),
        mesh_penetration=float(np.maximum(0.0, -true).max()),
        sphere_penetration=float(np.maximum(0.0, -clearance).max()),
        hover=float(hover.max()),
        hover_hold=float(hover[held[chosen]].max(initial=-np.inf)),
        touching=int(touching.sum()),
        contact_error_mean=float(off.mean()),
        contact_error_max=float(off.max()),
        tick_cpu_p50=float(np.percentile(cpu, 50.0)),
        tick_cpu_p99=float(np.percentile(cpu, 99.0)),
    )


def sphere_distances(center: FloatArray, radius: FloatArray, shape: HandShape, placed: PlacedHand) -> FloatArray:
    """Least signed distance [m] of each body to spheres, one by one, shape (T, 16); bodies as in `HandReferee`."""
    from hhsim.metrics.brute_force_distance import round_cone_distance

    found = np.empty((len(placed.joints), BODIES))
    for tick in range(len(found)):
        for f in range(5):
            for k in range(3):
                ends, radii = placed.joints[tick, f, k : k + 2], shape.phalanx_radius[f, k : k + 2]
                distance = round_cone_distance(center, ends[0], ends[1], float(radii[0]), float(radii[1]))
                found[tick, 3 * f + k] = (distance - radius).min()
        palm = palm_centers(shape.palm_center, placed.position[tick], placed.orientation[tick])
        found[tick, BODIES - 1] = min(
            float((np.linalg.norm(center - place, axis=1) - radius - size).min())
            for place, size in zip(palm, shape.palm_radius)
        )
    return found


HEADINGS = (
    *("object", "motion", "level", "leaves", "in the mesh [µm]", "hover, most [mm]", "in the hold [mm]"),
    *("proved bound [mm]", "contacts off the mesh, mean [mm]", "most [mm]", "tick p50 [µs]", "p99 [µs]", ""),
)


def cells(row: EndToEnd) -> tuple[str, ...]:
    """A row of the table for people, in the order of `HEADINGS`."""
    lengths = (row.hover, row.hover_hold, row.bound, row.contact_error_mean, row.contact_error_max)
    return (
        *(row.object, row.motion, str(row.level), f"{row.leaves:,}", f"{1e6 * row.mesh_penetration:.3f}"),
        *(f"{1e3 * length:.4f}" for length in lengths),
        *(f"{1e6 * row.tick_cpu_p50:.1f}", f"{1e6 * row.tick_cpu_p99:.1f}", "ok" if row.passed else "MISSED"),
    )


def main(arguments: Sequence[str], progress: Callable[[str], None] = lambda line: print(line, file=sys.stderr)) -> int:
    """Run the command; returns 1 where a bar was missed."""
    import json

    parser = argparse.ArgumentParser(prog="python -m tools.tree_to_hand", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--object", default=",".join(object_names()), metavar="NAMES", help="default: all")
    parser.add_argument("--level", default="3,4", metavar="NUMBERS", help="default: 3,4")
    parser.add_argument("--leaves", type=int, metavar="N", help="most leaves of a tree; default: 8 to the level")
    parser.add_argument("--motion", default="whole-hand", metavar="NAMES", help="default: whole-hand")
    parser.add_argument("--method", default="coupled", help="default: coupled")
    parser.add_argument("--size", type=float, metavar="MM", help="scale objects to this longest extent [mm]")
    parser.add_argument("--every", type=int, default=20, metavar="N", help="look at one tick in contact in N; 20")
    parser.add_argument("--json", action="store_true", help="print JSON, SI units")
    options = parser.parse_args(arguments)
    rows = []
    try:
        for name in options.object.split(","):
            mesh = load_object(name).mesh
            if options.size is not None:
                mesh = mesh.scaled(1e-3 * options.size / float(mesh.extent.max()))
            for motion in options.motion.split(","):
                for level in options.level.split(","):
                    chosen = {"method": options.method, "every": options.every, "leaves": options.leaves}
                    rows.append(end_to_end(mesh, int(level), motion, **chosen))
                    progress(" | ".join(cells(rows[-1])))
    except HhsimError as error:
        raise SystemExit(str(error)) from error
    if options.json:
        print(json.dumps([asdict(row) | {"passed": row.passed} for row in rows], indent=2))
    else:
        print("| " + " | ".join(HEADINGS) + " |")
        print("|" + "---|" * len(HEADINGS))
        for row in rows:
            print("| " + " | ".join(cells(row)) + " |")
    return 0 if all(row.passed for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
