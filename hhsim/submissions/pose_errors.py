"""Errors of a submission's poses: depth in the true mesh, and distance from the least-energy pose."""

from typing import NamedTuple

import numpy as np

from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.metrics.mesh_penetration import mesh_clearance, ticks_looked_at
from hhsim.metrics.metrics import hand_clearance
from hhsim.metrics.run_metric import Figure
from hhsim.scene.scene import Scene
from hhsim.solver.options import SolverOptions
from hhsim.solver.reference_optimum import best_hands
from hhsim.trees.contact_surface import contact_surface, encloses

NEAR = 1e-3
"""Distance of the user's hand from the mesh [m] below which a tick counts for the least-energy pose."""

MESH_DEPTH = Figure("mesh_depth_max", "in the mesh, max", 3, "mm")
OFF_BEST = Figure("off_best_mean", "off the least-energy pose, mean", 3, "mm")
OFF_BEST_MAX = Figure("off_best_max", "off the least-energy pose, max", 3, "mm")


class PoseErrors(NamedTuple):
    """Measures of poses besides the figures of a run; NaN where undefined.

    Attributes:
        mesh_depth_max: Largest depth of the hand in the mesh [m]; undefined if the mesh encloses nothing.
        off_best_mean, off_best_max: Largest distance of the fingertips and the palm from the pose of least coupling
            energy outside the mesh (`hhsim.solver.reference_optimum.best_hands`) [m], over the ticks in contact.
    """

    mesh_depth_max: float
    off_best_mean: float
    off_best_max: float


def pose_errors(scene: Scene, options: SolverOptions, poses: HandConfiguration) -> PoseErrors:
    """Measure poses, one a tick of the scene; `options` give the stiffness of the coupling energy."""
    placed = forward_kinematics(scene.hand, *poses)
    mean, most = _off_best(scene, options, placed)
    return PoseErrors(_mesh_depth(scene, placed), mean, most)


def _mesh_depth(scene: Scene, placed: PlacedHand) -> float:
    if not encloses(scene.mesh):
        return np.nan
    palm, finger = hand_clearance(scene.tree.arrays(), *hand_shape(scene.hand), *placed, limit=NEAR)
    # The spheres cover the mesh: a hand outside of them is outside of the mesh.
    inside = ticks_looked_at(np.minimum(palm, finger.min(axis=1)) < 0.0)
    if inside.size == 0:
        return 0.0
    bvh = build_mesh_bvh(scene.mesh.vertices, scene.mesh.faces)
    return max(0.0, -float(mesh_clearance(bvh, hand_shape(scene.hand), placed.at(inside)).min()))


def _off_best(scene: Scene, options: SolverOptions, placed: PlacedHand) -> tuple[float, float]:
    haptic = HandConfiguration.of(scene.ticks)
    surface = contact_surface("mesh", scene.mesh, scene.tree).arrays
    users = forward_kinematics(scene.hand, *haptic)
    palm, finger = hand_clearance(surface, *hand_shape(scene.hand), *users, limit=NEAR)
    contact = np.minimum(palm, finger.min(axis=1)) < NEAR
    if not contact.any():
        return np.nan, np.nan
    try:
        best = best_hands(scene.hand, surface, options, haptic)
    except HhsimError:
        return np.nan, np.nan
    off = np.linalg.norm(placed.ends - PlacedHand(best.joints, best.position, best.orientation).ends, axis=2)
    most = off.max(axis=1)[contact]
    return float(most.mean()), float(most.max())
