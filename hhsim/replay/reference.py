"""Reference of the tracking: the least-energy pose outside the object, which `coupled` converges to."""

from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_STUCK
from hhsim.metrics.metrics import tracking_energy, tracking_excess
from hhsim.solver.options import UNBOUNDED, UNLIMITED, USUAL, SolverOptions
from hhsim.solver.solver import HandSolver

REFERENCE_LINEARISATIONS = 400
REFERENCE_STEP_TOLERANCE = 1e-8
"""Largest move of any point of the hand [m] in the last linearisation of a converged reference."""


def best_hands(hand: HandModel, mesh_surface: Any, options: SolverOptions, haptic: HandConfiguration) -> TickRecord:
    """Return the least-energy pose of every tick: `coupled` on the triangles, converged, from the haptic hand on.

    `mesh_surface` is the object's surface `mesh`, world; the options give stiffness and lengths. Raises HhsimError
    where the optimum has more pairs than the solver holds.
    """
    on_mesh = _converged(options, surface="mesh", skin=USUAL, touch=USUAL)
    return HandSolver(hand, mesh_surface, on_mesh).run(*haptic)


def _converged(options: SolverOptions, **changed: Any) -> SolverOptions:
    return replace(
        options,
        method="coupled",
        threads=1,
        qp="active-set",
        linearisations=REFERENCE_LINEARISATIONS,
        budget=UNLIMITED,
        step_tolerance=REFERENCE_STEP_TOLERANCE,
        snap_speed=UNBOUNDED,
        **changed,
    )


def reference_excess(
    hand: HandModel,
    surface: Any,
    options: SolverOptions,
    haptic: HandConfiguration,
    graphic: HandConfiguration,
    ticks: IntArray,
) -> FloatArray:
    """Compute the coupling energy above the reference optimum, (E - E*) / E*, at some ticks, shape (len(ticks),).

    The optimum is the local one that `coupled` converges to from the method's own graphic hand with the input held,
    with the stiffness and lengths of the options. NaN in free space, and where the graphic hand is too deep inside for
    the reference. The surface is in the world, as `HandSolver` takes it; the hands are those of every tick.
    """
    solver = HandSolver(hand, surface, _converged(options))
    diagonal = options.stiffness.diagonal()
    found, wanted = graphic.at(ticks), haptic.at(ticks)
    best = found.copy()
    for i in range(len(ticks)):
        block = None
        # So deep inside that there are more pairs than the solver holds.
        with suppress(HhsimError):
            solver.place(*found.at(i))
            block = solver.run(*wanted.part(i, i + 1)._replace(abduction=found.abduction[i : i + 1]))
        if block is None or block.status[0] & STATUS_STUCK:
            best.position[i] = np.nan
            continue
        for name in ("position", "orientation", "flexion"):
            getattr(best, name)[i] = getattr(block, name)[0]
    return tracking_excess(tracking_energy(wanted, found, diagonal), tracking_energy(wanted, best, diagonal))
