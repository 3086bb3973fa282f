"""Two hands at one free object, against closed forms, each other's mirror image and a hand that is alone."""

from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from free_scenes import GRAVITY, TIP, box, far_hand, gripped, tongs, tongs_at

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.free.record import ObjectRecord
from hhsim.kernels.tick.block import TickRecord
from hhsim.scene.free_object import FreeObject
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.solver.two_hands import TwoHandedSolver
from hhsim.trees.contact_surface import contact_surface

EDGE = 0.04
"""Of the block [m]."""
REACH, ASIDE = 0.09, 0.03
"""Length of a pressing finger, and how far beside its palm it lies [m]."""
SPRING = 2e4
"""Of each palm [N/m]."""
SQUEEZE = 4.0
"""Of each hand [N]."""
FRICTION, MASS = 0.5, 0.5
MOST = 2.0 * FRICTION * SQUEEZE
"""Weight that two hands just hold [N]."""


class Run(NamedTuple):
    """Ticks of both hands, and the object's."""

    hands: tuple[TickRecord, TickRecord]
    object: ObjectRecord
    solver: TwoHandedSolver


def two_handed(free: FreeObject, mesh: Any, hands: tuple[HandModel, HandModel], **options: Any) -> TwoHandedSolver:
    surface = contact_surface("mesh", mesh, None)
    solver_options = SolverOptions(surface="mesh", **options)
    return TwoHandedSolver([HandSolver(hand, surface, solver_options) for hand in hands], free)


def pressing(ticks: int, squeeze: float, height: float = 0.0, twist: float = 0.0) -> list[HandConfiguration]:
    """Two fingers along x that press a block from both sides, at heights of opposite sign [m], turned by `twist`."""
    straight = np.zeros((ticks, 5, 3)), np.zeros((ticks, 5))
    found = []
    for side in (1.0, -1.0):
        depth = np.minimum(np.linspace(-0.001, 0.001 + 2.0 * squeeze / SPRING, ticks), squeeze / SPRING)
        away = 0.5 * EDGE + TIP + REACH - depth
        position = np.stack([-side * away, np.full(ticks, -side * ASIDE), np.full(ticks, side * height)], axis=1)
        turn = [np.cos(0.5 * twist), side * np.sin(0.5 * twist), 0.0, 0.0] if side > 0.0 else [0.0, 0.0, 0.0, 1.0]
        found.append(HandConfiguration(position, np.tile(turn, (ticks, 1)), *straight))
    return found


class Pressed:
    """A block that two fingers press, and that weighs nothing until it is loaded."""

    def __init__(self, height: float = 0.0) -> None:
        mesh, stiffness = box([EDGE] * 3), Stiffness(SPRING, 1e4, 1e4)
        free = FreeObject.of_mesh(mesh, mass=MASS, friction=FRICTION, gravity=(0.0, 0.0, 0.0))
        self.solver = two_handed(free, mesh, (tongs(), tongs()), fingers=("index",), stiffness=stiffness)
        approach = pressing(60, SQUEEZE, height)
        self.solver.run(*approach)
        self.last = [HandConfiguration(*(values[-1:] for values in one)) for one in approach]

    def load(self, weight: float, ticks: int) -> Run:
        """Run some ticks with a weight [N]."""
        self.solver.engine.states[0].body.gravity[2] = -weight / MASS
        held = [HandConfiguration(*(np.repeat(values, ticks, axis=0) for values in one)) for one in self.last]
        return Run(self.solver.run(*held), self.solver.object_ticks(0), self.solver)
