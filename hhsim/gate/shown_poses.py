"""Difference between the poses and forces of two runs, in words."""

from collections.abc import Mapping

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.fingers import FINGERS
from hhsim.result.reader import Result

ShownPoses = Mapping[str, FloatArray]
"""Places [m], turns (unit quaternions) and the total force [N] by name, world, each (T, 3) or (T, 4)."""

KEPT = 16
"""Ticks that a baseline keeps of each run."""
FORCE, TURN = "total force", "turn of the "
ROUNDING = {"mm": 1e-6, "mrad": 1e-5, "N": 1e-6}
"""Differences that are rounding, by their unit; a baseline keeps whole nanometres."""


def shown_poses(result: Result) -> dict[str, FloatArray]:
    """Return the shown hand, the total force, and a free object's pose at each tick, world."""
    joints = result["graphic/joints"]
    found = {"palm": result["graphic/position"], f"{TURN}palm": result["graphic/orientation"]}
    found |= {f"tip of the {name}": joints[:, finger, -1] for finger, name in enumerate(FINGERS)}
    if result.free:
        found |= {"object": result["object/position"], f"{TURN}object": result["object/orientation"]}
    return {**found, FORCE: result["force/total"]}


def kept_ticks(ticks: int) -> IntArray:
    """Return the ticks of which a baseline keeps the poses."""
    return np.linspace(0, ticks - 1, min(ticks, KEPT)).astype(np.int64)


def told_difference(head: ShownPoses, base: ShownPoses) -> tuple[str, bool]:
    """Return the largest differences in words, and True if all ticks are known to differ by rounding alone.

    Where one side is a baseline's, the ticks that it keeps are compared.
    """
    largest: dict[str, tuple[float, str]] = {}
    both = [name for name in head if name in base]
    whole = all(len(head[name]) == len(base[name]) for name in both)
    for name in both:
        one, other = (
            values if whole or len(values) <= KEPT else values[kept_ticks(len(values))]
            for values in (head[name], base[name])
        )
        unit = "N" if name == FORCE else "mrad" if name.startswith(TURN) else "mm"
        between = np.linalg.norm(one - other, axis=1)
        if unit == "mrad":  # each turn is two unit quaternions, and the angle between turns twice that between these
            between = np.minimum(between, np.linalg.norm(one + other, axis=1))
        apart = {"N": 1.0, "mrad": 2e3, "mm": 1e3}[unit] * float(np.nan_to_num(between, nan=np.inf).max(initial=0.0))
        largest[unit] = max(largest.get(unit, (0.0, "")), (apart, name))
    where = "" if whole else f" at the {KEPT} ticks that the baseline keeps"
    beyond = [
        f"{name} by up to {apart:.3g} {unit}" for unit, (apart, name) in largest.items() if apart > ROUNDING[unit]
    ]
    if not largest:
        return "by how much is not known, since the baseline keeps no poses", False
    if beyond:
        return ", ".join(beyond) + where, False
    # What differs may be elsewhere: in a knuckle, in the force of a phalanx, or between the kept ticks.
    if not whole or not any(apart for apart, _ in largest.values()):
        return f"palm, fingertips and total force are the same{where}", False
    return "by rounding alone", True
