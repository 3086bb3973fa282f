"""Warm-up: every kernel of a replay is compiled, or loaded from the cache, before the first tick is timed."""

import time
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.callee import collector_at_rest
from hhsim.kernels.jit import JIT_ENABLED
from hhsim.kernels.kernel_cache import compiled_kernels
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.kernels.tick.shown_hand import look_at
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import penetration
from hhsim.scene.free_object import FreeObject
from hhsim.solver.free_engine import Thing
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.known_methods import find_method
from hhsim.solver.options import SolverOptions
from hhsim.trees.contact_surface import ContactSurface, contact_surface
from hhsim.trees.jointed_surface import jointed_surface
from hhsim.trees.sphere_tree import SphereTree


class WarmUp(NamedTuple):
    """Wall time of the warm-up [s], and True if anything was compiled instead of loaded."""

    seconds: float
    compiled: bool


def start_numba() -> None:
    """Make numba start, a third of a second, by the smallest kernel that every replay runs."""
    quaternion_to_matrix(np.array([1.0, 0.0, 0.0, 0.0]), np.empty((3, 3)))


def _ball(place: FloatArray) -> SphereTree:
    return SphereTree(place[:1], np.array([0.01]), np.zeros(1, np.int64), np.full(1, -1))


@collector_at_rest()
def warm_up(
    hand: HandModel, options: SolverOptions, free: FreeObject | None = None, *, jointed: bool = False, others: int = 0
) -> WarmUp:
    """Run one tick of a hand far from a small object, fixed, free, of parts or beside others, with every kernel."""
    began = time.perf_counter()
    before = compiled_kernels()
    far = np.full((3, 3), 100.0) + 0.01 * np.eye(3)
    places = (far + 10.0 * k for k in range(1 + others))
    surface: Any
    surface, *beside = (contact_surface(options.surface, Mesh(at, np.array([[0, 1, 2]])), _ball(at)) for at in places)
    one = surface = surface.arrays
    if jointed:
        surface = jointed_surface([one], np.array([[[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]]))
    # A method from outside is not for a scene like this; what is compiled for it is what its hands are measured with.
    method = find_method(options.method)
    solver = HandSolver(
        hand,
        surface,
        options if method.compiled or free is not None else replace(options, method="coupled"),
        None if free is None else replace(free, table=None),
        [Thing(ContactSurface(more.arrays), free, fixed=True) for more in beside] if free is not None else (),
    )
    orientation = np.array([[1.0, 0.0, 0.0, 0.0]])
    block = solver.run(np.zeros((1, 3)), orientation, np.zeros((1, 5, 3)), np.zeros((1, 5)))
    penetration(one, hand_shape(hand), PlacedHand(block.joints, block.position, block.orientation))
    if not method.compiled:
        look_at(solver.workspace.hand, surface, solver.workspace.tick_options, solver.workspace.states)
    return WarmUp(time.perf_counter() - began, JIT_ENABLED and compiled_kernels() > before)
