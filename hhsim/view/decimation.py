"""Ticks for a viewer: poses and forces of the shown ticks; plots that lose no spike between them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import AnyArray, FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.motion.object_motion import RigidMotion
from hhsim.view.plots import CONTACTS, DEPTH, FORCE, TIME, VARIATION, Plot, force_values


@dataclass(frozen=True)
class ShownTicks:
    """T ticks as a viewer gets them.

    Attributes:
        tick: Their numbers, shape (T,).
        time: [s], shape (T,).
        joints: Joints of the graphic hand [m], shape (T, 5, 4, 3).
        phalanx: Contact force on each phalanx [N], shape (T, 5, 3, 3).
        total: Sum of all contact forces [N], shape (T, 3).
        touching: Ticks in which something may touch, indices from 0.
        plots: Values of each plot, shape (T, its series).
        moved: Motion of the object since the first tick; None where it stands still.
    """

    tick: IntArray
    time: FloatArray
    haptic: HandConfiguration
    graphic: HandConfiguration
    joints: FloatArray
    phalanx: FloatArray
    total: FloatArray
    touching: IntArray
    plots: Mapping[Plot, FloatArray]
    moved: RigidMotion | None = None


def shown_ticks(
    column: Callable[[str], AnyArray],
    tick: ArrayLike,
    shown: ArrayLike,
    starts: ArrayLike,
    more: Mapping[Plot, FloatArray] | None = None,
    moved: RigidMotion | None = None,
) -> ShownTicks:
    """Return what a viewer gets of N ticks.

    Args:
        column: Returns a dataset of a result's /tick by its name, for all these ticks.
        shown: Indices of the ticks that are shown, shape (T,).
        starts: First index of the ticks that each shown one stands for, shape (T,).
        more: Further plots and their values, shape (N, series).
    """
    kept, begins = np.asarray(shown), np.asarray(starts)
    haptic, graphic = (
        HandConfiguration(*(column(f"{whose}/{name}")[kept] for name in HandConfiguration._fields))
        for whose in ("haptic", "graphic")
    )
    phalanx, total, touching = column("force/phalanx"), column("force/total"), column("contacts/touching")

    def stacked(*names: str) -> FloatArray:
        return np.column_stack([column(name) for name in names])

    plots = {
        FORCE: force_values(phalanx, total),
        DEPTH: 1e6 * stacked("penetration_depth", "penetration_finger", "penetration_palm"),
        VARIATION: stacked("force_variation_rate", "force_variation_finger"),
        TIME: 1e-3 * stacked(*(f"duration/{name}" for name in ("detect", "palm", "fingers", "force", "total"))),
        CONTACTS: stacked("contacts/candidates", "contacts/touching").astype(np.float64),
        **(more or {}),
    }
    return ShownTicks(
        tick=np.asarray(tick)[kept],
        time=column("time")[kept],
        haptic=haptic,
        graphic=graphic,
        joints=column("graphic/joints")[kept],
        phalanx=phalanx[kept],
        total=total[kept],
        touching=np.flatnonzero(touching[kept]),
        plots={plot: plot.thinned(values, kept, begins) for plot, values in plots.items()},
        moved=moved and RigidMotion(moved.turn[kept], moved.shift[kept]),
    )
