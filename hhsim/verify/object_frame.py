"""The referee's own look from an object that moves, by scipy's rotations, and the claims of how the file says it moves.

Nothing but the schema's word of what turns is the library's: a pose p, q of the object that was P, Q at the first tick
takes x to q Q⁻¹ (x − P) + p, and this is undone.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.motion.object_motion import ObjectMotion
from hhsim.result.object_frame import TURNS
from hhsim.result.reader import Result
from hhsim.verify.claim import Claim, judged
from hhsim.verify.kinematics import rotations

Array = NDArray[Any]

ABOVE = 1e-6
"""A free object may begin so far above its place [m]: clear of the table by the solver's offset."""


def seen_by_referee(name: str, values: Array, now: ObjectMotion, first: ObjectMotion) -> Array:
    """Rows of a dataset of /tick, world, as the object sees them; as of `hhsim.result.reader.View`."""
    here, none = rotations(now.orientation)
    there = rotations(first.orientation[None])[0]
    back = there * here.inv()
    if TURNS[name] == "orientation":
        turned, neither = rotations(values)
        seen = (back * turned).as_quat()[:, [3, 0, 1, 2]]
        none |= neither
    else:
        rows = np.asarray(values, np.float64).reshape(len(values), -1, 3)
        matrix = back.as_matrix()
        at_point = TURNS[name] == "point"
        moved = rows - now.position[:, None] if at_point else rows
        seen = np.einsum("tij,tnj->tni", matrix, moved) + (first.position if at_point else 0.0)
    seen[none] = np.nan
    return np.asarray(seen.reshape(values.shape))


def _first_step(result: Result) -> float:
    # A free object has made a step at the first tick, from its place in the file or `ABOVE` it. A quaternion changes by
    # half the turn, and the origin of its frame goes round its centre of mass.
    arm = np.linalg.norm(np.array(result.scene["free"]["center"]) - result.static["object/position"])
    turn = np.linalg.norm(result["object/angular_velocity"][0]) * max(0.5, float(arm))
    return ABOVE + float(np.linalg.norm(result["object/velocity"][0]) + turn) / result.rate


def object_motion_claims(result: Result) -> list[Claim]:
    """Of an object that moves: its poses are some, and begin where the file places the object."""
    if not result.driven:
        return []
    poses, static = result.object_motion(), result.static
    unit = np.abs(np.linalg.norm(poses.orientation, axis=1) - 1.0)
    wrong = np.where(np.isfinite(poses.position).all(axis=1) & np.isfinite(unit), unit, np.inf)
    off = max(
        float(np.abs(poses.position[0] - static["object/position"]).max()),
        float(np.abs(poses.orientation[0] - static["object/orientation"]).max()),
    )
    room = _first_step(result) if result.free else 0.0
    why = "its first step, and what it may be raised by to stand on its table" if result.free else "the same numbers"
    return [
        judged(
            *("object poses", "the object has a pose at every tick, with a unit quaternion", wrong),
            *(1e-9, "1", "rounding"),
            ticks=np.arange(result.ticks),
        ),
        judged(
            *("object at first", "the object's mesh and tree lie where its first pose has them", [off]),
            *(room, "m, 1", why),
        ),
    ]
