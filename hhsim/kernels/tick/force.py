"""Forces of the object on the hand.

`kkt`: the multipliers of the quadratic program, f = Σ λ_i n_i. They vary continuously, because a contact enters and
leaves with λ = 0. With `coupled` they balance the coupling of Eq. 1 exactly at rest, G (q_g - q_h) = Jᵀ λ. With
`progressive` each program balances its own variables: finger contacts hold the joints' torques and do not push the
palm, whose wrench balances the palm's contacts alone; totals of the two methods are therefore not the same quantity.

`paper`: Eq. 14, f_i = k |p_g - p_h| n_i over the spheres in touch, p_g the contact point on the graphic phalanx and p_h
the same point of the haptic phalanx. It jumps whenever a sphere joins or leaves that set.

Both: the fingertip's normal force of Fig. 9, perpendicular to the distal phalanx, and the palm's wrench of Eq. 1, which
is the coupling's whether anything touches or not: while the graphic hand lags behind in free air it is not zero.
"""

import math

import numpy as np

from hhsim.kernels.hand.kinematics import FINGER_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.kernels.jit import Array, Record, jit, jit_inline, jit_noinline
from hhsim.kernels.memory import copy_values
from hhsim.kernels.rotation import rotation_vector_between
from hhsim.kernels.tick.options import TickOptions

FORCE_KKT = 0
FORCE_PAPER = 1


FORCES = np.dtype(
    [
        ("phalanx", np.float64, (5, 3, 3)),  # [N]
        ("fingertip_normal", np.float64, (5, 3)),  # [N], Fig. 9
        ("palm_wrench", np.float64, (6,)),  # Eq. 1: force [N], torque about the palm's origin [N·m]
        ("before", np.float64, (5, 3, 3)),  # `phalanx` of the last tick, where the hand snaps [N]
        ("total", np.float64, (3,)),  # sum over phalanges and palm [N], with what holds back a hand that snaps
    ],
    align=True,
)
"""Forces on the hand, in the frame of its pose."""


@jit_inline
def clear_forces(forces: Record) -> None:
    """Set every force to zero."""
    forces.phalanx[:, :, :] = 0.0
    forces.fingertip_normal[:, :] = 0.0
    forces.palm_wrench[:] = 0.0
    forces.total[:] = 0.0


@jit_inline
def add_force(forces: Record, body: int, nx: float, ny: float, nz: float, magnitude: float) -> None:
    """Add a force [N] along a unit vector to that of a hand body, and to the total."""
    if body < PALM_BODY:
        f, k = body // PHALANX_COUNT, body % PHALANX_COUNT
        forces.phalanx[f, k, 0] += magnitude * nx
        forces.phalanx[f, k, 1] += magnitude * ny
        forces.phalanx[f, k, 2] += magnitude * nz
    forces.total[0] += magnitude * nx
    forces.total[1] += magnitude * ny
    forces.total[2] += magnitude * nz


@jit
def _same_point(pose: Record, haptic: Record, contacts: Record, i: int, point_out: Array) -> None:
    # The body frame is rigid, so the point keeps its coordinates along (axis, direction, their cross product).
    body = contacts.body[i]
    if body == PALM_BODY:
        for j in range(3):
            point_out[j] = haptic.position[j]
        for c in range(3):
            local = 0.0
            for j in range(3):
                local += pose.rotation[j, c] * (contacts.point[j, i] - pose.position[j])
            for j in range(3):
                point_out[j] += haptic.rotation[j, c] * local
        return
    f, k = body // PHALANX_COUNT, body % PHALANX_COUNT
    rx = contacts.point[0, i] - pose.joints[f, k, 0]
    ry = contacts.point[1, i] - pose.joints[f, k, 1]
    rz = contacts.point[2, i] - pose.joints[f, k, 2]
    ax, ay, az = pose.axis[f, 0], pose.axis[f, 1], pose.axis[f, 2]
    dx, dy, dz = pose.direction[f, k, 0], pose.direction[f, k, 1], pose.direction[f, k, 2]
    along_axis = rx * ax + ry * ay + rz * az
    along = rx * dx + ry * dy + rz * dz
    across = rx * (ay * dz - az * dy) + ry * (az * dx - ax * dz) + rz * (ax * dy - ay * dx)
    ax, ay, az = haptic.axis[f, 0], haptic.axis[f, 1], haptic.axis[f, 2]
    dx, dy, dz = haptic.direction[f, k, 0], haptic.direction[f, k, 1], haptic.direction[f, k, 2]
    point_out[0] = haptic.joints[f, k, 0] + along_axis * ax + along * dx + across * (ay * dz - az * dy)
    point_out[1] = haptic.joints[f, k, 1] + along_axis * ay + along * dy + across * (az * dx - ax * dz)
    point_out[2] = haptic.joints[f, k, 2] + along_axis * az + along * dz + across * (ax * dy - ay * dx)


@jit_inline
def proxy_forces(options: TickOptions, state: Record) -> None:
    """Add Eq. 14 over all contacts of the state that touch."""
    contacts, scratch, normal = state.contacts, state.scratch, state.contacts.normal
    for i in range(contacts.start[FINGER_COUNT + 1]):
        if contacts.distance[i] > options.touch:
            continue
        _same_point(state.pose, state.haptic, contacts, i, scratch)
        dx = contacts.point[0, i] - scratch[0]
        dy = contacts.point[1, i] - scratch[1]
        dz = contacts.point[2, i] - scratch[2]
        magnitude = options.contact_stiffness * math.sqrt(dx * dx + dy * dy + dz * dz)
        add_force(state.forces, contacts.body[i], normal[0, i], normal[1, i], normal[2, i], magnitude)


@jit_inline
def palm_wrench(state: Record) -> None:
    """Compute force and torque of the coupling on the palm, F = G (q_g - q_h) [N, N·m] (Eq. 1), shape (6,)."""
    pose, haptic, wrench = state.pose, state.haptic, state.forces.palm_wrench
    rotation_vector_between(haptic.orientation, pose.orientation, state.scratch)
    for i in range(3):
        wrench[i] = state.stiffness[i] * (pose.position[i] - haptic.position[i])
        wrench[3 + i] = state.stiffness[3 + i] * state.scratch[i]


@jit_inline
def hand_forces(options: TickOptions, snaps: bool, state: Record) -> None:
    """Compute all forces of a tick, eased where the hand snaps or did in the last tick.

    For FORCE_PAPER the state's contacts must be those of the final configuration.
    """
    if snaps:
        copy_values(state.forces.phalanx, state.forces.before)
    clear_forces(state.forces)
    if options.force_model == FORCE_PAPER:
        proxy_forces(options, state)
    else:
        active, normal = state.active, state.active.normal
        for i in range(active.count):
            # Joint limits exert no force of the object.
            if active.body[i] >= 0:
                magnitude = active.multiplier[i]
                add_force(state.forces, active.body[i], normal[0, i], normal[1, i], normal[2, i], magnitude)
    eases = snaps and options.force_model == FORCE_KKT
    if eases:
        ease_forces(state)
    finish_forces(options, state)
    if eases and state.progress.snaps:
        for i in range(3):
            state.forces.total[i] = state.forces.palm_wrench[i]


@jit_inline
def finish_forces(options: TickOptions, state: Record) -> None:
    """Compute what both models share: the palm's wrench, and the normal force at each fingertip that Fig. 9 draws.

    That is k |E E₁| along the part of E₁E perpendicular to the graphic distal phalanx, for fingers whose phalanges bear
    a force; E and E₁ are the tips of the graphic and the haptic finger, k the contact stiffness [N/m].
    """
    pose, haptic, forces = state.pose, state.haptic, state.forces
    palm_wrench(state)
    for f in range(FINGER_COUNT):
        bears = 0.0
        for k in range(PHALANX_COUNT):
            for i in range(3):
                bears += abs(forces.phalanx[f, k, i])
        if bears == 0.0:
            continue
        ex = pose.joints[f, 3, 0] - haptic.joints[f, 3, 0]
        ey = pose.joints[f, 3, 1] - haptic.joints[f, 3, 1]
        ez = pose.joints[f, 3, 2] - haptic.joints[f, 3, 2]
        dx, dy, dz = pose.direction[f, 2, 0], pose.direction[f, 2, 1], pose.direction[f, 2, 2]
        along = ex * dx + ey * dy + ez * dz
        nx, ny, nz = ex - along * dx, ey - along * dy, ez - along * dz
        across = math.sqrt(nx * nx + ny * ny + nz * nz)
        if across == 0.0:
            continue
        scale = options.contact_stiffness * math.sqrt(ex * ex + ey * ey + ez * ez) / across
        forces.fingertip_normal[f, 0] = scale * nx
        forces.fingertip_normal[f, 1] = scale * ny
        forces.fingertip_normal[f, 2] = scale * nz


@jit_noinline
def ease_forces(state: Record) -> None:
    """Bring the forces of a hand that snaps, or did in the last tick, from those of the last tick towards their own.

    A contact that gives way loses its force at once, while what holds the hand back bears the springs in its place. So
    the force on a finger goes no farther than k_t times the way that the hand may go in the tick; the total is then the
    coupling's, as at rest, and the palm has the difference. The hand snaps as long as a force has not arrived. The
    force on a finger is the sum of those on its phalanges, which share what touches their joint in any way.
    """
    progress, forces = state.progress, state.forces
    most = state.stiffness[0] * progress.bound
    for f in range(FINGER_COUNT):
        now, before, square = forces.phalanx[f], forces.before[f], 0.0
        for i in range(3):
            change = 0.0
            for k in range(PHALANX_COUNT):
                change += now[k, i] - before[k, i]
            square += change * change
        if square > most * most:
            progress.snaps = True
            share = most / math.sqrt(square)
            for k in range(PHALANX_COUNT):
                for i in range(3):
                    now[k, i] = before[k, i] + share * (now[k, i] - before[k, i])
