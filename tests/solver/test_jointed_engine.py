"""Hands beside parts that move: as beside one object where they stand still, and where they leave no place."""

import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_NO_PLACE
from hhsim.mesh.shapes import box_mesh
from hhsim.metrics.moving_parts import MovingParts, TouchedObject
from hhsim.scene.motion_catalogue import resolve_trajectory
from hhsim.scene.scene import Scene, open_scene
from hhsim.scene.script import Script
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.solver.scene_solver import seen_scene
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.triangle_tree import triangle_tree

RADIUS, WALL = 0.008, 0.08
"""Radius of a finger in a book, and the distance of a wall from the book's hinge [m]."""
MICROMETRE = 1e-6


def still_laptop(surface: str, angle: float, ticks: int) -> Scene:
    motion = resolve_trajectory("close")
    assert isinstance(motion, Script)
    moved = structs.replace(motion, joints={"lid": ((0.0, angle),)})
    scene = open_scene("laptop", moved, solid=surface == "spheres", level=3 if surface == "spheres" else 1)
    return scene.first(ticks)


@pytest.mark.parametrize("surface", ["mesh", "spheres"])
@pytest.mark.quick("mesh")
def test_a_laptop_whose_lid_stands_still_gives_the_ticks_of_its_rigid_twin(surface: str) -> None:
    scene = still_laptop(surface, 1.92, 1500)
    seen, options = seen_scene(scene), SolverOptions(surface=surface)
    haptic = HandConfiguration.of(scene.hands[0].ticks)
    parts = HandSolver(scene.hands[0].model, seen.surface(surface), options).run(*haptic)
    twin = HandSolver(scene.hands[0].model, contact_surface(surface, seen.mesh, seen.tree), options).run(*haptic)
    assert np.linalg.norm(twin.total[-1]) > 1.0
    assert np.abs(parts.joints - twin.joints).max() < MICROMETRE
    # Leaves of a flat side make rows that imply each other, and which of them is kept depends on their order.
    assert np.abs(parts.total - twin.total).max() < (1e-6 if surface == "mesh" else 1e-3 * np.abs(twin.total).max())
    assert np.array_equal(parts.status, twin.status)


def trapped_finger(angles: FloatArray) -> tuple[MovingParts, HandModel, TickRecord]:
    """A straight index finger along y in a book that closes about y, between the hinge and a wall on a plate."""
    count = len(angles)
    meshes = box_mesh((0.3, 0.3, 0.01)), box_mesh((0.3, 0.3, 0.01)), box_mesh((0.01, 0.3, 0.03))
    path = np.zeros((count, 3, 7))
    path[:, :, 3] = 1.0
    path[:, 0, :3] = 0.15, 0.0, -0.005
    path[:, 2, :3] = WALL + 0.005, 0.0, 0.015
    path[:, 1, 3:] = turn = quaternion(np.outer(angles, [0.0, -1.0, 0.0]))
    path[:, 1, :3] = rotation_matrix(turn) @ np.array([0.15, 0.0, 0.005])
    # Trees are not touched.
    trees = tuple(triangle_tree(mesh, 1) for mesh in meshes)
    parts = MovingParts("book", ("back", "front", "wall"), meshes, trees, path, {"front": angles})
    default = HandModel.default("right")
    radius = default.radius.copy()
    radius[1] = RADIUS
    hand = replace(default, radius=radius)
    turned = quaternion(np.array([0.0, 0.0, -math.radians(5.0)]))
    index = hand.joints(np.zeros(3), turned, np.zeros((5, 3)), np.zeros(5))[1]
    assert np.ptp(index[:, 0]) < 1e-6
    position = np.array([0.06, -0.09, RADIUS + 5e-4]) - index[3]
    haptic = (position, turned, np.zeros((5, 3)), np.zeros(5))
    options = SolverOptions(surface="mesh", fingers=("index",))
    solver = HandSolver(hand, parts.surface("mesh"), options)
    found = solver.run(*(np.repeat(values[None], count, axis=0) for values in haptic))
    # Each way out once missed the limits by its program's tolerance, and began where the one before had ended.
    assert (found.flexion >= hand.flexion_min).all() and (found.flexion <= hand.flexion_max).all()
    return parts, hand, found


def test_a_book_that_shuts_on_a_finger_leaves_no_place_at_the_angle_that_geometry_says() -> None:
    # The circle of the finger touches both plates and the wall where it is inscribed in their angle.
    least = 2.0 * math.atan(RADIUS / (WALL - RADIUS))
    angles = np.concatenate([np.linspace(0.9, 0.18, 700), np.full(20, 0.18), np.linspace(0.18, 0.5, 300)])
    parts, hand, found = trapped_finger(angles)
    squeezed = found.status & STATUS_NO_PLACE > 0
    first = int(np.flatnonzero(squeezed)[0])
    assert angles[first] == pytest.approx(least, rel=0.01)
    assert not squeezed[angles > least + 0.01 * least].any()
    assert squeezed[(angles < 0.99 * least)].all()
    shown = PlacedHand(found.joints, found.position, found.orientation)
    fingers = np.array([False, True, False, False, False])
    touched = TouchedObject(parts.meshes[0], None, hand_shape(hand), fingers, 0.0, parts, "mesh")
    depth = touched.penetration(shown).depth
    assert depth[~squeezed].max() == 0.0
    # It yields to the wall and the lower plate, and is as deep in the other as they leave it.
    away = np.sin(angles) * (WALL - RADIUS) - np.cos(angles) * RADIUS
    assert depth[squeezed] == pytest.approx((RADIUS - away)[squeezed], rel=0.01, abs=2e-6)
    assert np.isfinite(found.total).all()
