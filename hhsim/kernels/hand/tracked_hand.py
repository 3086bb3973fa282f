"""Fit of our hand to the joints of a tracked hand, within a tick.

The same as `hhsim.recordings.finger_ik` for whole recordings: the same frame of wrist and knuckles, the same plane
nearest to a finger's three bones, the same angles in it.
"""

import math
from typing import NamedTuple

from hhsim.kernels.arithmetic import arc_tangent, hypotenuse, sine_cosine
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.jit import Array, jit
from hhsim.kernels.rotation import turned, turned_back

STRAIGHT = 0.05
"""Weight of zero abduction against three measured unit bones: it decides if they are parallel."""
EXACT = 1e-8
"""Squared distance from their plane below which bones were not measured and need no such weight."""
LEAST = 1e-15
"""Remainder of that weight for them, below an angle's resolution."""


class OurHand(NamedTuple):
    """Our own hand, to which the joints are fitted."""

    axes: Array  # of each straight finger: distal, dorsal, towards the thumb's side; palm frame, (5, 3, 3)
    palm: Array  # palm frame in that of wrist and knuckles, a rotation matrix, (3, 3)
    middle: Array  # mean of the knuckles of index to little finger [m], palm frame, (3,)
    world: Array  # from the tracker's world to ours, a rotation matrix, (3, 3)
    mirror: Array  # 1 for a right hand, -1 for a left one, (1,)


@jit
def fit_tracked_hand(
    joints: Array,
    ours: OurHand,
    rotation_out: Array,
    position_out: Array,
    orientation_out: Array,
    flexion_out: Array,
    abduction_out: Array,
) -> float:
    """Compute palm position [m], orientation (w, x, y, z), flexion and abduction [rad] of our hand, our world.

    Joints are the wrist, then four of each finger from base to tip [m], tracker's world, shape (21, 3), of a hand of
    the same side; `rotation_out`, shape (3, 3), is scratch. Returns the length from the wrist along the bones to the
    tip of the middle finger [m]; NaN if anything of the hand is not finite.
    """
    mx = 0.25 * (joints[5, 0] + joints[9, 0] + joints[13, 0] + joints[17, 0])
    my = 0.25 * (joints[5, 1] + joints[9, 1] + joints[13, 1] + joints[17, 1])
    mz = 0.25 * (joints[5, 2] + joints[9, 2] + joints[13, 2] + joints[17, 2])
    _lay_palm(joints, ours, mx, my, mz, rotation_out)
    whole = 0.0
    for f in range(FINGER_COUNT):
        whole += _fit_finger(joints, ours.axes, rotation_out, f, flexion_out, abduction_out)
    # Our knuckles lie on the tracked ones.
    middle, world = ours.middle, ours.world
    x, y, z = turned(rotation_out, middle[0], middle[1], middle[2])
    position_out[0], position_out[1], position_out[2] = turned(world, mx - x, my - y, mz - z)
    for i in range(3):
        whole += position_out[i]
    for j in range(3):
        a, b, c = turned(world, rotation_out[0, j], rotation_out[1, j], rotation_out[2, j])
        rotation_out[0, j], rotation_out[1, j], rotation_out[2, j] = a, b, c
    _to_quaternion(rotation_out, orientation_out)
    for i in range(4):
        whole += orientation_out[i]
    length = _distance(joints, 0, 9) + _distance(joints, 9, 10) + _distance(joints, 10, 11) + _distance(joints, 11, 12)
    # A value that is not finite makes the sum NaN.
    return length + 0.0 * whole


@jit
def _lay_palm(joints: Array, ours: OurHand, mx: float, my: float, mz: float, rotation_out: Array) -> None:
    """Compute our palm frame, a rotation matrix, from the wrist, the knuckles and their mean."""
    yx, yy, yz = mx - joints[0, 0], my - joints[0, 1], mz - joints[0, 2]
    size = math.sqrt(yx * yx + yy * yy + yz * yz)
    yx, yy, yz = yx / size, yy / size, yz / size
    mirror = ours.mirror[0]
    ax, ay, az = joints[17, 0] - joints[5, 0], joints[17, 1] - joints[5, 1], joints[17, 2] - joints[5, 2]
    # Out of the back; across y already.
    zx, zy, zz = mirror * (ay * yz - az * yy), mirror * (az * yx - ax * yz), mirror * (ax * yy - ay * yx)
    size = math.sqrt(zx * zx + zy * zy + zz * zz)
    zx, zy, zz = zx / size, zy / size, zz / size
    xx, xy, xz = yy * zz - yz * zy, yz * zx - yx * zz, yx * zy - yy * zx
    palm = ours.palm
    for j in range(3):
        a, b, c = palm[0, j], palm[1, j], palm[2, j]
        rotation_out[0, j] = xx * a + yx * b + zx * c
        rotation_out[1, j] = xy * a + yy * b + zy * c
        rotation_out[2, j] = xz * a + yz * b + zz * c


@jit
def _fit_finger(joints: Array, axes: Array, rotation: Array, f: int, flexion_out: Array, abduction_out: Array) -> float:
    """Compute the angles of one finger; return their sum."""
    first = 1 + 4 * f
    pp = pq = qq = 0.0
    for k in range(PHALANX_COUNT):
        aside, along, _ = _bone(joints, first + k, rotation, axes, f)
        pp += aside * aside
        pq += aside * along
        qq += along * along
    off_plane = max(0.5 * (pp + qq - hypotenuse(pp - qq, 2.0 * pq)), 0.0)
    qq += STRAIGHT * off_plane / (off_plane + EXACT) + LEAST
    abduction = 0.5 * arc_tangent(2.0 * pq, qq - pp)
    abduction_out[f] = abduction
    sine, cosine = sine_cosine(abduction)
    whole, before = abduction, 0.0
    for k in range(PHALANX_COUNT):
        aside, along, above = _bone(joints, first + k, rotation, axes, f)
        total = arc_tangent(-above, cosine * along + sine * aside)
        turn = total - before
        if k > 0:
            # A finger that curls past straight back has flexed further, not less.
            turn = (turn + 0.5 * math.pi) % (2.0 * math.pi) - 0.5 * math.pi
        flexion_out[f, k] = turn
        whole += turn
        before = total
    return whole


@jit
def _bone(joints: Array, k: int, rotation: Array, axes: Array, f: int) -> tuple[float, float, float]:
    """Return the components of unit bone k: towards the thumb's side, along the finger, out of its back."""
    bx, by, bz = joints[k + 1, 0] - joints[k, 0], joints[k + 1, 1] - joints[k, 1], joints[k + 1, 2] - joints[k, 2]
    size = math.sqrt(bx * bx + by * by + bz * bz)
    px, py, pz = turned_back(rotation, bx, by, bz)
    along, above, aside = turned(axes[f], px / size, py / size, pz / size)
    return aside, along, above


@jit
def _distance(joints: Array, a: int, b: int) -> float:
    x, y, z = joints[b, 0] - joints[a, 0], joints[b, 1] - joints[a, 1], joints[b, 2] - joints[a, 2]
    return math.sqrt(x * x + y * y + z * z)


@jit
def _to_quaternion(matrix: Array, quaternion_out: Array) -> None:
    """Compute the unit quaternion with w >= 0 of a rotation matrix, NaN of NaN."""
    a, b, c = matrix[0, 0], matrix[1, 1], matrix[2, 2]
    wx, wy, wz = matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]
    xy, xz, yz = matrix[0, 1] + matrix[1, 0], matrix[0, 2] + matrix[2, 0], matrix[1, 2] + matrix[2, 1]
    ww, xx, yy, zz = 1.0 + a + b + c, 1.0 + a - b - c, 1.0 - a + b - c, 1.0 - a - b + c
    # Each row is the quaternion times one of its components; the largest loses no digits.
    if ww >= xx and ww >= yy and ww >= zz:
        w, x, y, z = ww, wx, wy, wz
    elif xx >= yy and xx >= zz:
        w, x, y, z = wx, xx, xy, xz
    elif yy >= zz:
        w, x, y, z = wy, xy, yy, yz
    else:
        w, x, y, z = wz, xz, yz, zz
    size = math.sqrt(w * w + x * x + y * y + z * z)
    if w < 0.0:
        size = -size
    quaternion_out[0], quaternion_out[1], quaternion_out[2], quaternion_out[3] = w / size, x / size, y / size, z / size
