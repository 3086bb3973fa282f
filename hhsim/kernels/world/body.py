"""A free rigid body from tick to tick: its pose, its velocities, and where it would go by itself.

All is solved in the *object's frame*: the frame of its surface's arrays, which goes with the object. There the surface
stands still and the hand is what moves, so that finding pairs and lists of near ones are as beside a fixed object.

A tick is a step of the implicit Euler method: without contacts the body goes to c + Δt v + Δt² g and turns by Δt ω,
where ω solves Euler's equation with its gyroscopic term at the end of the step, by Newton's method (Catto: Numerical
methods, GDC 2015). It loses energy and gains none.
"""

import math
from typing import NamedTuple

import numpy as np

from hhsim.kernels.arithmetic import sine_cosine
from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.jit import Array, Record, jit, jit_inline
from hhsim.kernels.memory import copy_values
from hhsim.kernels.rotation import (
    quaternion_product,
    quaternion_to_matrix,
    rotate_quaternion,
    rotation_vector_between,
    turned,
    turned_back,
)

OBJECT_DOF = 6
"""Translation of the centre of mass [m], then the rotation vector about the principal axes [rad]."""
HINGE, SLIDER = 1, 2
"""Joints that a body may have."""


@by_reference
class Support(NamedTuple):
    """Parts of the object that can stand on a plane: spheres, or points, on its convex hull, in the object's frame."""

    point: Array  # centres [m], (S, 3)
    radius: Array  # [m], 0 for a vertex, (S,)


BODY = np.dtype(
    [
        ("is_free", np.int64),  # 1, or 0 for a body that stays where it is: its `inverse_root` is 0
        ("is_driven", np.int64),  # 1 for a body whose goal is given, and whose `inverse_root` is almost 0
        ("period", np.float64),  # Δt [s]
        ("center", np.float64, (3,)),  # centre of mass [m], object's frame
        ("axes", np.float64, (3, 3)),  # principal axes as rows, object's frame
        ("moment", np.float64, (3,)),  # principal moments [kg·m²]
        # Δt / √m [m/√J], Δt / √I of each principal axis [rad/√J]: 1 / √(M/Δt²)
        ("inverse_root", np.float64, (OBJECT_DOF,)),
        ("gravity", np.float64, (3,)),  # [m/s²], 0 on a hinge, of a slider its part along the axis
        # HINGE, SLIDER, or 0 without a joint. The joint's axis is the last of `axes`, and `inverse_root` is 0 but for
        # the last on a hinge, on whose axis `center` is, and the first three on a slider.
        ("joint", np.int64),
        ("lever", np.float64, (3,)),  # of a hinged body's centre of mass from `center` [m], object's frame
        ("start_lever", np.float64, (3,)),  # the same at the start of the tick, world
        ("pull", np.float64, (3,)),  # angular acceleration by gravity of such a lever [1/(m·s²)]
        ("pair_joint", np.int64),  # the same of a joint on another free body, beside which all of `inverse_root` counts
        ("pair", np.int64),  # pair of both, which is in the other one's frame
        ("joint_origin", np.float64, (3,)),  # a point of the axis at the start [m]
        ("joint_axes", np.float64, (3, 3)),  # then, as rows: two directions across the axis, and the axis
        ("limits", np.float64, (2,)),  # of the joint's value since the start [rad] or [m], infinite without
        ("joint_friction", np.float64),  # largest moment [N·m] or force [N] of the joint's friction
        ("joint_start", np.float64),  # value of a joint of two free bodies at the start of the tick
        ("joint_motion", np.float64),  # how far a joint is foreseen to move in the tick
        ("damping", np.float64),  # [1/s]
        ("friction", np.float64),  # μ of the hand's contacts
        ("torsion", np.float64),  # torsional moment over normal force of the hand's contacts [m]
        ("has_table", np.int64),  # 1 where there is a plane
        ("table", np.float64),  # its height [m]
        ("table_friction", np.float64),  # μ of table and body; of two bodies the geometric mean of both
        ("table_distance", np.float64),  # of the body's lowest point from the table [m], infinite without one
        ("measured_distance", np.float64),  # the same of a step that is not accepted yet
        ("position", np.float64, (3,)),  # centre of mass [m]
        ("orientation", np.float64, (4,)),  # object's frame to world
        ("rotation", np.float64, (3, 3)),  # the same as a matrix
        ("safe_position", np.float64, (3,)),  # where nothing penetrates
        ("safe_orientation", np.float64, (4,)),
        ("start_position", np.float64, (3,)),  # at the start of the tick
        ("start_orientation", np.float64, (4,)),
        ("goal_position", np.float64, (3,)),  # where the body would be at the end of the tick by itself
        ("goal_orientation", np.float64, (4,)),
        ("left", np.float64, (OBJECT_DOF,)),  # of the last step, what was not made, as `body_target` gives it
        ("safe_left", np.float64, (OBJECT_DOF,)),  # the same of the last step that ended without penetration
        ("clipped", np.float64, (OBJECT_DOF,)),  # what the present program's step was shortened by, as `left`
        ("pushed", np.float64, (3, 3)),  # `rotation` at the start of the last step, in whose directions its forces are
        ("safe_pushed", np.float64, (3, 3)),  # the same of the last step that ended without penetration
        ("velocity", np.float64, (3,)),  # of the centre [m/s]
        ("spin", np.float64, (3,)),  # angular velocity about the principal axes [rad/s]
        ("quaternion", np.float64, (4,)),  # scratch, as the next two
        ("other", np.float64, (4,)),
        ("vector", np.float64, (3,)),
    ],
    align=True,
)
"""World body; world frame unless said otherwise."""


@jit
def _gyrate(moment: Array, period: float, spin: Array, spin_out: Array) -> None:
    # I (w' - w) / Δt + w' × I w' = 0 in the body's axes.
    ix, iy, iz = moment[0], moment[1], moment[2]
    x, y, z = spin[0], spin[1], spin[2]
    h = period
    for _ in range(3):
        fx = ix * (x - spin[0]) + h * (iz - iy) * y * z
        fy = iy * (y - spin[1]) + h * (ix - iz) * z * x
        fz = iz * (z - spin[2]) + h * (iy - ix) * x * y
        a, b, c = h * (iz - iy), h * (ix - iz), h * (iy - ix)
        # Jacobian rows (ix, a z, a y), (b z, iy, b x), (c y, c x, iz).
        m00, m01, m02 = iy * iz - b * x * c * x, a * y * c * x - a * z * iz, a * z * b * x - a * y * iy
        m10, m11, m12 = b * x * c * y - b * z * iz, ix * iz - a * y * c * y, a * y * b * z - ix * b * x
        m20, m21, m22 = b * z * c * x - iy * c * y, a * z * c * y - ix * c * x, ix * iy - a * z * b * z
        determinant = ix * m00 + a * z * m10 + a * y * m20
        x -= (m00 * fx + m01 * fy + m02 * fz) / determinant
        y -= (m10 * fx + m11 * fy + m12 * fz) / determinant
        z -= (m20 * fx + m21 * fy + m22 * fz) / determinant
    spin_out[0], spin_out[1], spin_out[2] = x, y, z


@jit
def _gravity_acceleration(body: Record, turn: float, x: float, y: float, z: float) -> float:
    # Angular acceleration by gravity [rad/s²] of a hinged body whose lever (x, y, z) [m], world, has turned by a small
    # angle [rad]. Taken in the middle of a tick its work is that of the weight, and no energy is gained.
    ux, uy, uz = body.axes[2, 0], body.axes[2, 1], body.axes[2, 2]
    x, y, z = x + turn * (uy * z - uz * y), y + turn * (uz * x - ux * z), z + turn * (ux * y - uy * x)
    return x * body.pull[0] + y * body.pull[1] + z * body.pull[2]


@jit
def turn_body(body: Record, orientation: Array, x: float, y: float, z: float, orientation_out: Array) -> None:
    """Turn an orientation by a rotation vector [rad] of the object's frame; to the bit what it was where that is 0."""
    if x == 0.0 and y == 0.0 and z == 0.0:
        copy_values(orientation, body.quaternion[:])
        copy_values(body.quaternion[:], orientation_out)
        return
    wx, wy, wz = turned(body.rotation, x, y, z)
    rotate_quaternion(orientation, wx, wy, wz, orientation_out)


@jit
def predict(body: Record) -> None:
    """Compute the body's pose at the end of the tick without contacts; that of a driven one is given."""
    period = body.period
    kept = 1.0 / (1.0 + body.damping * period)
    body.left[:] = 0.0
    copy_values(body.rotation[:], body.pushed[:])
    copy_values(body.position[:], body.start_position[:])
    copy_values(body.orientation[:], body.start_orientation[:])
    if body.is_free == 0:
        copy_values(body.position[:], body.goal_position[:])
        copy_values(body.orientation[:], body.goal_orientation[:])
        return
    if body.is_driven == 1:
        return
    for j in range(3):
        body.goal_position[j] = body.position[j] + period * kept * (body.velocity[j] + period * body.gravity[j])
    if body.joint == HINGE:
        x, y, z = turned(body.rotation, body.lever[0], body.lever[1], body.lever[2])
        body.start_lever[0], body.start_lever[1], body.start_lever[2] = x, y, z
        body.vector[0] = body.vector[1] = 0.0
        foreseen = body.spin[2] + period * _gravity_acceleration(body, 0.5 * period * body.spin[2], x, y, z)
        body.vector[2] = body.spin[2] + period * _gravity_acceleration(body, 0.5 * period * foreseen, x, y, z)
    else:
        _gyrate(body.moment[:], period, body.spin[:], body.vector[:])
    turn = period * kept
    x, y, z = turned_back(body.axes, turn * body.vector[0], turn * body.vector[1], turn * body.vector[2])
    turn_body(body, body.orientation[:], x, y, z, body.goal_orientation[:])


@jit
def keep_body(body: Record) -> None:
    """Make the present pose the safe one."""
    copy_values(body.position[:], body.safe_position[:])
    copy_values(body.orientation[:], body.safe_orientation[:])
    copy_values(body.left[:], body.safe_left[:])
    copy_values(body.pushed[:], body.safe_pushed[:])


@jit
def restore_body(body: Record) -> None:
    """Return to the safe pose."""
    copy_values(body.safe_left[:], body.left[:])
    copy_values(body.safe_pushed[:], body.pushed[:])
    copy_values(body.safe_position[:], body.position[:])
    copy_values(body.safe_orientation[:], body.orientation[:])
    quaternion_to_matrix(body.orientation[:], body.rotation[:])


@jit
def body_target(body: Record, target_out: Array) -> None:
    """Compute the step to the body's pose without contacts, shape (6,): object's frame [m], principal axes [rad]."""
    if body.is_free == 0:
        target_out[:] = 0.0
        return
    goal, position = body.goal_position, body.position
    x, y, z = turned_back(body.rotation, goal[0] - position[0], goal[1] - position[1], goal[2] - position[2])
    target_out[0], target_out[1], target_out[2] = x, y, z
    rotation_vector_between(body.orientation[:], body.goal_orientation[:], body.vector[:])
    x, y, z = turned_back(body.rotation, body.vector[0], body.vector[1], body.vector[2])
    x, y, z = turned(body.axes, x, y, z)
    if body.joint == HINGE:
        target_out[0:5] = 0.0
        target_out[5] = z
        return
    target_out[3], target_out[4], target_out[5] = x, y, z


@jit
def along_axis(body: Record, step: Array) -> float:
    """Compute the part of a step along a joint's axis, [m] of a slider's translation, [rad] of a hinge's rotation."""
    if body.joint == HINGE:
        return float(step[5])
    axis = body.axes[2]
    return float(axis[0] * step[0] + axis[1] * step[1] + axis[2] * step[2])


@jit
def joint_value(body: Record) -> float:
    """Compute how far a body has turned [rad], in (-π, π], or moved [m] along its joint's axis since the start."""
    if body.joint == SLIDER:
        vector, center, position = body.vector, body.center, body.position
        # The frame of the object was the world's at the start.
        vector[0], vector[1], vector[2] = position[0] - center[0], position[1] - center[1], position[2] - center[2]
        return along_axis(body, vector)
    start = body.other
    start[0], start[1], start[2], start[3] = 1.0, 0.0, 0.0, 0.0
    rotation_vector_between(start[:], body.orientation[:], body.vector[:])
    return turned(body.axes, body.vector[0], body.vector[1], body.vector[2])[2]


@jit
def move_body(body: Record, step: Array, fraction: float) -> None:
    """Move by `fraction` of a step, shape (6,), as `body_target` gives it; `left` is the rest, and what was clipped."""
    copy_values(body.rotation[:], body.pushed[:])
    for j in range(OBJECT_DOF):
        body.left[j] = (1.0 - fraction) * step[j] + body.clipped[j]
    x, y, z = turned(body.rotation, fraction * step[0], fraction * step[1], fraction * step[2])
    turn_x, turn_y, turn_z = turned_back(body.axes, fraction * step[3], fraction * step[4], fraction * step[5])
    body.position[0] += x
    body.position[1] += y
    body.position[2] += z
    turn_body(body, body.orientation[:], turn_x, turn_y, turn_z, body.orientation[:])
    quaternion_to_matrix(body.orientation[:], body.rotation[:])


@jit
def take_velocity(body: Record) -> None:
    """Compute the velocities of the tick that ends, from what was moved over the period.

    A tick that lags has made a share of its last program's way: the velocities change by that share of what the whole
    way would have changed them by, else the springs would push for a whole tick, and again for what is left. Those of
    a driven body are of what it has moved.
    """
    if body.is_free == 0:
        return
    if body.is_driven == 1:
        body.left[:] = 0.0
    rate, left, root = 1.0 / body.period, body.left, body.inverse_root
    start, vector = body.start_position, body.vector
    along, square = 0.0, 0.0
    vector[0], vector[1], vector[2] = turned(body.pushed, left[0], left[1], left[2])
    for j in range(3):
        moved = body.position[j] - start[j]
        vector[j] = moved + vector[j]
        if root[j] > 0.0:
            along += moved * vector[j] / root[j] ** 2
            square += vector[j] * vector[j] / root[j] ** 2
    x, y, z = vector[0], vector[1], vector[2]
    rotation_vector_between(body.start_orientation[:], body.orientation[:], vector[:])
    a, b, c = turned_back(body.rotation, vector[0], vector[1], vector[2])
    vector[0], vector[1], vector[2] = turned(body.axes, a, b, c)
    for j in range(3):
        angle = vector[j]
        vector[j] = angle + left[3 + j]
        if root[3 + j] > 0.0:
            along += angle * vector[j] / root[3 + j] ** 2
            square += vector[j] * vector[j] / root[3 + j] ** 2
    share = min(max(along / square, 0.0), 1.0) if square > 0.0 else 1.0
    _approach(body.velocity[:], share, rate * x, rate * y, rate * z)
    _approach(body.spin[:], share, rate * vector[0], rate * vector[1], rate * vector[2])
    if body.joint == HINGE:
        x, y, z = turned(body.rotation, body.lever[0], body.lever[1], body.lever[2])
        begin = body.start_lever
        _approach(body.velocity[:], 1.0, rate * (x - begin[0]), rate * (y - begin[1]), rate * (z - begin[2]))


@jit
def _approach(vector: Array, share: float, x: float, y: float, z: float) -> None:
    if share == 1.0:
        vector[0], vector[1], vector[2] = x, y, z
    else:
        vector[0] += share * (x - vector[0])
        vector[1] += share * (y - vector[1])
        vector[2] += share * (z - vector[2])


@jit
def turn_back(body: Record, step: Array, fraction: float, vector: Array) -> None:
    """Take a vector of the object's frame to what it is after `fraction` of a step, to second order in its turn."""
    wx, wy, wz = turned_back(body.axes, fraction * step[3], fraction * step[4], fraction * step[5])
    x, y, z = vector[0], vector[1], vector[2]
    qx, qy, qz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
    vector[0] = x - qx + 0.5 * (wy * qz - wz * qy)
    vector[1] = y - qy + 0.5 * (wz * qx - wx * qz)
    vector[2] = z - qz + 0.5 * (wx * qy - wy * qx)


@jit
def as_other_moves(body: Record, rotation: Array, step: Array, step_out: Array) -> None:
    """Take a body's step, of `body_target`, to a frame by `rotation`: (δp, δφ) of its centre there, shape (6,)."""
    x, y, z = turned(rotation, step[0], step[1], step[2])
    step_out[0], step_out[1], step_out[2] = x, y, z
    x, y, z = turned_back(body.axes, step[3], step[4], step[5])
    x, y, z = turned(rotation, x, y, z)
    step_out[3], step_out[4], step_out[5] = x, y, z


@jit
def as_object_moves(body: Record, origin: Array, hand: Array, step: Array, relative_out: Array) -> None:
    """Compute a palm's step past a body, (δp, δφ), shape (6,), in the body's frame after its own step.

    `origin` of the palm [m], shape (3,), and the palm's step `hand` are in the body's frame before the step; `step` is
    the body's, as of `body_target`.
    """
    center = body.center
    wx, wy, wz = turned_back(body.axes, step[3], step[4], step[5])
    angle = math.sqrt(wx * wx + wy * wy + wz * wz)
    if angle < 1e-4:
        sine, cosine = 1.0 - angle * angle / 6.0, 0.5 - angle * angle / 24.0
    else:
        sine, cosine = sine_cosine(angle)
        sine, cosine = sine / angle, (1.0 - cosine) / (angle * angle)
    px = origin[0] + hand[0] - center[0] - step[0]
    py = origin[1] + hand[1] - center[1] - step[1]
    pz = origin[2] + hand[2] - center[2] - step[2]
    qx, qy, qz = wy * pz - wz * py, wz * px - wx * pz, wx * py - wy * px
    relative_out[0] = hand[0] - step[0] - sine * qx + cosine * (wy * qz - wz * qy)
    relative_out[1] = hand[1] - step[1] - sine * qy + cosine * (wz * qx - wx * qz)
    relative_out[2] = hand[2] - step[2] - sine * qz + cosine * (wx * qy - wy * qx)
    # exp(-w) exp(δφ), as a vector.
    first, second = body.quaternion, body.other
    first[0], first[1], first[2], first[3] = 1.0, 0.0, 0.0, 0.0
    rotate_quaternion(first[:], -hand[3], -hand[4], -hand[5], second[:])
    rotate_quaternion(first[:], -wx, -wy, -wz, first[:])
    rotation_vector_between(second[:], first[:], body.vector[:])
    for j in range(3):
        relative_out[3 + j] = body.vector[j]


@jit_inline
def _four(values: Array) -> tuple[float, float, float, float]:
    return values[0], values[1], values[2], values[3]


@jit
def world_to_body(
    body: Record, position: Array, orientation: Array, position_out: Array, orientation_out: Array
) -> None:
    """Write a pose of the world in the body's frame; shapes (3,) and (4,)."""
    center = body.center
    x, y, z = (position[0] - body.position[0], position[1] - body.position[1], position[2] - body.position[2])
    x, y, z = turned_back(body.rotation, x, y, z)
    position_out[0], position_out[1], position_out[2] = x + center[0], y + center[1], z + center[2]
    turn = body.orientation
    w, x, y, z = quaternion_product(turn[0], -turn[1], -turn[2], -turn[3], *_four(orientation))
    orientation_out[0], orientation_out[1], orientation_out[2], orientation_out[3] = w, x, y, z


@jit
def body_to_world(
    body: Record, position: Array, orientation: Array, position_out: Array, orientation_out: Array
) -> None:
    """Write a pose of the body's frame in the world; shapes (3,) and (4,)."""
    center, place, turn = body.center, body.position, body.orientation
    x, y, z = turned(body.rotation, position[0] - center[0], position[1] - center[1], position[2] - center[2])
    position_out[0], position_out[1], position_out[2] = x + place[0], y + place[1], z + place[2]
    w, x, y, z = quaternion_product(*_four(turn), *_four(orientation))
    orientation_out[0], orientation_out[1], orientation_out[2], orientation_out[3] = w, x, y, z
