"""Distance of the graphic hand to the object, and the nearest free place of a hand inside of it."""

from collections.abc import Callable, Sequence

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.forward_kinematics import hand_shape
from hhsim.hand.self_pairs import self_clearance
from hhsim.kernels.contact.penetration import clearances
from hhsim.kernels.contact.self_pairs import NoPairs
from hhsim.kernels.hand.hand_shape import StoredHands
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.reproducible import norm
from hhsim.solver.workspace import TickWorkspace

SHARES = 64
"""Number of postures that are tried between a hand that is in itself and the straight one."""


def clearance(workspace: TickWorkspace) -> float:
    """Signed distance [m] of the graphic hand to the surface, also deep inside, up to ten times the margin."""
    pose, options = workspace.states[0].pose, workspace.options
    joints = workspace.model.joints(pose.position, pose.orientation, pose.flexion, pose.abduction)
    rotation = np.empty((3, 3))
    quaternion_to_matrix(np.array(pose.orientation), rotation)
    palm, finger, shape = np.empty(1), np.empty((1, FINGER_COUNT)), hand_shape(workspace.model)
    placed = StoredHands(shape, np.ascontiguousarray(joints)[None], np.array(pose.position)[None], rotation[None])
    clearances(workspace.surface, placed, 10.0 * options.margin, palm, finger)
    used = options.modelled()[:PALM_BODY:PHALANX_COUNT]
    return float(min(palm[0], finger[0, used].min(initial=np.inf)))


def part_fingers(workspace: TickWorkspace) -> bool:
    """Straighten the fingers of a hand that is in itself until it is not; return whether it was."""
    own = workspace.tick_options.own
    if isinstance(own, NoPairs):
        return False
    pose, share = workspace.states[0].pose, np.linspace(1.0, 0.0, SHARES + 1)
    flexion, abduction = (share.reshape(-1, *[1] * values.ndim) * values for values in (pose.flexion, pose.abduction))
    flexion = np.clip(flexion, workspace.hand.flexion_min, workspace.hand.flexion_max)
    # The straight hand is the last one: its parts that may meet are apart.
    first = int(np.argmax(self_clearance(workspace.model, own, flexion, abduction) >= workspace.options.offset))
    pose.flexion[:], pose.abduction[:] = flexion[first], abduction[first]
    return first > 0


def retreat(workspace: TickWorkspace) -> None:
    """Shift the hand by the least distance that frees it, over 26 directions and the one away from the object."""
    pose = workspace.states[0].pose
    joints = workspace.model.joints(pose.position, pose.orientation, pose.flexion, pose.abduction)
    away = joints.reshape(-1, 3).mean(axis=0) - workspace.center()
    shift_until([pose.position], away, lambda: clearance(workspace), workspace.options.margin)


def shift_until(positions: Sequence[FloatArray], away: FloatArray, distance: Callable[[], float], clear: float) -> None:
    """Shift palms least, in 26 directions and `away`, to a signed distance `clear` [m]; a second one opposite."""
    origins = [position.copy() for position in positions]
    directions = [np.array(d) - 1.0 for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)]
    if norm(away) > 0.0:
        directions.insert(0, away)
    best, nearest = np.inf, np.zeros(3)

    def place(shift: FloatArray) -> None:
        for position, origin, sign in zip(positions, origins, (1.0, -1.0)):
            position[:] = origin + sign * shift

    for direction in directions:
        unit = direction / norm(direction)
        shift = 0.0
        while shift < best:
            place(shift * unit)
            found = distance()
            if found >= clear:
                best, nearest = shift, shift * unit
                break
            shift += max(clear, -found / len(positions))
    place(nearest)
