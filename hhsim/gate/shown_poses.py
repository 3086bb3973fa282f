"""Difference between the poses and forces of two runs, in words."""

from collections.abc import Mapping

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.fingers import FINGERS
from hhsim.result.reader import Result

ShownPoses = Mapping[str, FloatArray]
"""Places [m], and the total force [N], by name, world, each (T, 3)."""
KEPT = 16
"""Ticks that a baseline keeps of each run."""
FORCE = "total force"
ROUNDING = {"m": 1e-9, "N": 1e-6}
"""Differences of ticks that are rounding; a baseline keeps whole nanometres."""


def shown_poses(result: Result) -> dict[str, FloatArray]:
    """Return the shown palm and fingertips, the place of a free object and the total force at each tick."""
    tips = {f"tip of the {name}": result["graphic/joints"][:, finger, -1] for finger, name in enumerate(FINGERS)}
    free = {"object": result.body["position"]} if result.body.is_free else {}
    return {"palm": result["graphic/position"], **tips, **free, FORCE: result["force/total"]}


def kept_ticks(ticks: int) -> IntArray:
    """Return the ticks of which a baseline keeps the poses."""
    return np.linspace(0, ticks - 1, min(ticks, KEPT)).astype(np.int64)


def told_difference(head: ShownPoses, base: ShownPoses) -> tuple[str, bool]:
    """Return the largest differences in words, and True if all ticks are known to differ by rounding alone.

    Where one side is a baseline's, the ticks that it keeps are compared.
    """
    apart: dict[str, float] = {}
    where = "" if len(head[FORCE]) == len(base.get(FORCE, ())) else f" at the {KEPT} ticks that the baseline keeps"
    for name in (name for name in head if name in base):
        one, other = (values[kept_ticks(len(values))] if where else values for values in (head[name], base[name]))
        apart[name] = float(np.nan_to_num(np.linalg.norm(one - other, axis=1), nan=np.inf).max(initial=0.0))
    if not apart:
        return "by how much is not known, since the baseline keeps no poses", False
    force, place = apart.pop(FORCE, 0.0), max(apart, key=lambda name: apart[name])
    told = [f"{place} by up to {1e3 * apart[place]:.3g} mm"] if apart[place] > ROUNDING["m"] else []
    told += [f"{FORCE} by up to {force:.3g} N"] if force > ROUNDING["N"] else []
    # Else it may be elsewhere: in a turn, in a knuckle, in the force of a phalanx, or between the kept ticks.
    rounding = not told and not where and apart[place] > 0.0
    same = "by rounding alone" if rounding else f"palm, fingertips and {FORCE} are the same"
    return f"{', '.join(told) or same}{where}", rounding
