"""Displacement of the free object in a hand that is held still, by hhsim's own contacts and friction.

It is the field's simulation displacement (`hhsim.metrics.field.displacement`) without its overlap: no contact
penetrates, so a hand cannot hold the object, or push it away, by being inside. A hand that is given inside the object
presses on it by its virtual coupling instead.
"""

from collections.abc import Sequence

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.displacement import GRAVITY, MASS, STEP, STEPS
from hhsim.scene.body import USUAL_FRICTION
from hhsim.solver.free_object import FreeObject
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.trees.contact_surface import contact_surface

FIXED = Stiffness(translation=1e5, rotation=500.0, flexion=50.0)
"""Coupling of a hand that is held still, a hundred times the usual one: 1 kg moves it by 0.1 mm."""
RATE = 1000.0
"""Ticks a second [Hz]."""


def object_displacements(
    hand: HandModel,
    mesh: Mesh,
    posture: HandConfiguration,
    frames: Sequence[int],
    down: FloatArray | None = None,
    *,
    mass: float = MASS,
    friction: float = USUAL_FRICTION,
) -> FloatArray:
    """Compute how far the object's centre of mass moves in 35/240 s [m], one value a frame.

    Args:
        mesh: Closed surface of the object.
        posture: Hand at each frame of a recording, in the object's frame.
        frames: Frames at which the object is let go, from rest.
        down: Direction of gravity in the object's frame, shape (T, 3); None for -z.
        mass: Of the object [kg], a solid of uniform density.
        friction: Of hand and object.

    Raises:
        InputError: A mass or a friction out of its range.
        MeshError: A mesh that encloses nothing.
    """
    surface = contact_surface("mesh", mesh, None)
    options = SolverOptions(surface="mesh", stiffness=FIXED, period=1.0 / RATE)
    ticks = round(STEPS * STEP * RATE)
    found = np.empty(len(frames))
    for row, frame in enumerate(frames):
        x, y, z = (GRAVITY * (np.array([0.0, 0.0, -1.0]) if down is None else down[frame])).tolist()
        free = FreeObject.of_mesh(mesh, mass=mass, friction=friction, gravity=(x, y, z))
        solver = HandSolver(hand, surface, options, free)
        solver.run(*posture.part(frame, frame + 1).hold(ticks - 1))
        ends = solver.object_ticks
        turn, shift = ends.turn[-1:], ends.shift[-1]
        center = np.array(free.center)
        found[row] = np.linalg.norm((rotation_matrix(turn)[0] @ center) + shift - center)
    return found
