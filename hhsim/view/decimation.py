"""What a viewer is shown of some ticks: poses and forces of the shown ones; plots that lose no spike between them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import AnyArray, FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.motion.object_motion import RigidMotion
from hhsim.view.plots import (
    CONTACTS,
    DEPTH,
    FORCE,
    TIME,
    VARIATION,
    Plot,
    depth_values,
    force_values,
    time_values,
)


@dataclass(frozen=True)
class ShownTicks:
    """What a viewer gets of T ticks.

    Attributes:
        tick: Their numbers, shape (T,).
        time: [s], shape (T,).
        haptic: The user's hand.
        graphic: The hand that is shown to the user.
        joints: Of the graphic hand [m], shape (T, 5, 4, 3).
        phalanx: Contact force on each phalanx [N], shape (T, 5, 3, 3).
        total: Of all contact forces [N], shape (T, 3).
        touching: Ticks in which something may touch, indices from 0; all others are not looked at.
        plots: Values of each plot, shape (T, its series).
        moved: How the object moved since the first tick; None where it stands still.
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
    """Choose from ticks what a viewer gets of them.

    Args:
        column: Gives a dataset of a result's /tick by its name, for all these ticks.
        tick: Their numbers, shape (N,).
        shown: Which of them are shown, indices from 0, shape (T,).
        starts: Where the ticks begin that each shown one stands for, shape (T,); they end where the next ones begin.
        more: Further plots and their values, shape (N, series).
        moved: How the object moved since the first tick, of all these ticks; None where it stands still.
    """
    kept, begins = np.asarray(shown), np.asarray(starts)
    haptic, graphic = (
        HandConfiguration(*(column(f"{whose}/{name}")[kept] for name in HandConfiguration._fields))
        for whose in ("haptic", "graphic")
    )
    phalanx, total, touching = column("force/phalanx"), column("force/total"), column("contacts/touching")
    parts = np.column_stack([column(f"duration/{name}") for name in ("detect", "palm", "fingers", "force")])
    plots = {
        FORCE: force_values(phalanx, total),
        DEPTH: depth_values(*(column(f"penetration_{name}") for name in ("depth", "finger", "palm"))),
        VARIATION: np.column_stack([column("force_variation_rate"), column("force_variation_finger")]),
        TIME: time_values(column("duration/total"), parts),
        CONTACTS: np.column_stack([column("contacts/candidates"), touching]).astype(np.float64),
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
