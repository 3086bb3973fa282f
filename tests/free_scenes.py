"""Free objects alone, and between two fingers that are each other's mirror image; short runs with one on a table."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike
from short_grasp import result_of, short_grasp, short_scene

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.motion.analytic_motion import still
from hhsim.result.reader import Result
from hhsim.scene.body import Body, BodyMotion, Free, HalfSpace, Joint
from hhsim.scene.scene import Scene
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.solver.solver import HandSolver
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree

GRAVITY = 9.81


def box(size: Sequence[float], center: ArrayLike = (0.0, 0.0, 0.0)) -> Mesh:
    """A box of these edges [m] around a centre [m]."""
    solid = trimesh.creation.box(size)
    return Mesh(solid.vertices + np.asarray(center), solid.faces, name="box")


UNTOUCHED = SphereTree(np.zeros((1, 3)), np.ones(1), np.zeros(1, np.int64), np.full(1, -1))
"""Tree of a body of which the mesh itself is touched."""


def body_of(
    mesh: Mesh,
    name: str = "body",
    *,
    friction: float = 0.6,
    torsion: float = 0.0,
    joint: Joint | None = None,
    moves: BodyMotion | None = None,
    **free: Any,
) -> Body:
    """A body, free unless it `moves` otherwise, whose mesh is in the world; `free` are arguments of `Free.of_mesh`."""
    motion = Free.of_mesh(mesh, **free) if moves is None else moves
    return Body(name, mesh, UNTOUCHED, motion=motion, joint=joint, friction=friction, torsion=torsion)


def solver_of(
    body: Body,
    hand: HandModel | None = None,
    others: Sequence[Body] = (),
    *,
    table: float | None = None,
    table_friction: float | None = None,
    **options: Any,
) -> HandSolver:
    """A solver that touches the mesh itself, of a free body over a table at a height [m], if there is one."""
    chosen, surface = SolverOptions(surface="mesh", **options), contact_surface("mesh", body.mesh, None)
    plane = () if table is None else (HalfSpace("table", table, table_friction),)
    return HandSolver(hand or HandModel.default(), surface, chosen, body, (*others, *plane))


def far_hand(ticks: int) -> HandConfiguration:
    """A hand that is 1.7 m from the origin and stands still."""
    return still((1.0, 1.0, 1.0), ticks=ticks)


TIP = 0.008
"""Radius of the tongs' fingers [m]."""
REACH = 0.09
HALF_APART = 0.03


def tongs() -> HandModel:
    """A hand whose thumb and index lie along x, 60 mm apart, and close on each other."""
    hand = HandModel.default()
    fields = {name: getattr(hand, name).copy() for name in ("base", "distal", "dorsal", "length", "radius")}
    limits = {name: getattr(hand, name).copy() for name in ("flexion_min", "flexion_max")}
    for finger, side in ((0, -1.0), (1, 1.0)):
        fields["base"][finger] = (0.0, HALF_APART * side, 0.0)
        fields["distal"][finger] = (1.0, 0.0, 0.0)
        fields["dorsal"][finger] = (0.0, side, 0.0)
        fields["length"][finger] = (0.04, 0.03, 0.02)
        fields["radius"][finger] = TIP
        limits["flexion_min"][finger], limits["flexion_max"][finger] = -0.5, 1.5
    return replace(hand, **fields, **limits)


def tongs_at(flexion: ArrayLike, shift: ArrayLike = (0.0, 0.0, 0.0)) -> HandConfiguration:
    """The tongs closed to a flexion [rad] at each tick, and shifted [m]."""
    closed = np.atleast_1d(flexion)
    held = still(np.zeros(3), ticks=len(closed))
    held.flexion[:, :2, 0] = closed[:, None]
    return held._replace(position=held.position + shift)


WIDTH = 0.03


def gripped(mass: float, friction: float, squeeze: float, **others: float) -> tuple[HandSolver, float]:
    """A box that the tongs hold without gravity with a force [N], and their flexion [rad]."""
    # Where they touch both faces.
    touch = float(np.arcsin((HALF_APART - 0.5 * WIDTH - TIP) / REACH))
    mesh = box((0.02, WIDTH, 0.02), (REACH * np.cos(touch), 0.0, 0.0))
    # Each finger closes by 20 µm more than to touch; what swings dies out.
    stiffness = Stiffness(translation=1e5, rotation=1e3, flexion=50.0 * squeeze)
    body = body_of(mesh, mass=mass, friction=friction, gravity=(0.0, 0.0, 0.0), damping=20.0, **others)
    solver = solver_of(body, tongs(), fingers=("thumb", "index"), stiffness=stiffness)
    closed = touch + REACH / 50.0
    solver.run(*tongs_at(np.r_[np.linspace(touch - 0.05, closed, 200), np.full(100, closed)]))
    return solver, closed


def squeeze_of(solver: HandSolver) -> float:
    """Sum of the normal forces [N] at the last tick."""
    held = solver.object_ticks
    return float(held.normal_force[held.contact[-2] : held.contact[-1]].sum())


def free_scene(mass: float = 50.0, friction: float = 2.0, object_name: str = "cylinder") -> Scene:
    """An object that is too heavy and too rough to go far, on a table, grasped."""
    scene = short_scene(short_grasp(hold=0.09), object_name)
    table = float(scene.solids[0].placed_mesh.bounds[0, 2])
    free = {"mass": mass, "friction": friction, "torsion": 0.01, "table": table}
    return scene.freed(**free)


def free_result(path: Path, object_name: str = "cylinder") -> Result:
    """That replayed into a file, on the triangles themselves."""
    return result_of(free_scene(object_name=object_name), path, {"hand_file": None}, surface="mesh")
