"""Method `paper`: nonpenetration constraints, linearised once (Eq. 8, 10, 12 and 13), in the rows of `active_set`.

The paper's constraints are squared distances,

    C = |x_H - x_O|² - (r_H + r_O)²                          sphere and sphere (Eq. 8, C² of Eq. 13)
    C = |OC|² - (R / cos φ + k (r₁ - r₂) + r₂)²              frustum and sphere (Eq. 10, C¹ of Eq. 13)

and C + ∇C · δ >= 0 is what their first Taylor polynomial asks of a step δ. Each row is divided by 2 (r_H + r_O), or by
2 |OC|_Γ / cos φ: a positive factor changes nothing in the constraint, and rows then count in metres like the QP's
tolerance, with multipliers in N. Columns are divided by √G, which makes the Hessian the identity.

Palm: δ = (δp, δα, δβ, δγ) about the graphic palm of t - 1. Finger: δ = (δθ₁, δθ₂, δθ₃) about the joint angles of t - 1
on the palm of t. What moves with a body turns about its axes: ∂x/∂angle = axis × (x - centre); for a frustum it is
easier to turn the object's sphere the other way, which is the same to C.
"""

import math

import numpy as np

from hhsim.kernels.contact.detection import CONTACT_ROWS
from hhsim.kernels.hand.frustum import foot, in_range, threshold
from hhsim.kernels.hand.kinematics import PALM_BODY, PHALANX_COUNT
from hhsim.kernels.jit import Record, as_int64, jit
from hhsim.kernels.surfaces.spheres import sphere_candidates, write_contact
from hhsim.kernels.tick.paper_detection import ON_FRUSTUM, ON_SPHERE

LIMITS = 2 * PHALANX_COUNT
"""Rows of a finger's joint limits, which follow its contacts."""


@jit
def palm_rows(count: int, state: Record, paper: Record) -> None:
    """Write the rows of the palm's `count` pairs: columns, right-hand sides, normals from object to hand."""
    candidates, position, rotation = sphere_candidates(state.candidates), state.pose.position, state.pose.rotation
    axes, weight = paper.axes, state.problem.inverse_root
    common_out, rhs_out, normal_out = state.problem.common, state.problem.rhs, paper.normal
    for i in range(count):
        hx, hy, hz = candidates.hand_x[i], candidates.hand_y[i], candidates.hand_z[i]
        rx = rotation[0, 0] * hx + rotation[0, 1] * hy + rotation[0, 2] * hz
        ry = rotation[1, 0] * hx + rotation[1, 1] * hy + rotation[1, 2] * hz
        rz = rotation[2, 0] * hx + rotation[2, 1] * hy + rotation[2, 2] * hz
        vx = position[0] + rx - candidates.object_x[i]
        vy = position[1] + ry - candidates.object_y[i]
        vz = position[2] + rz - candidates.object_z[i]
        total = candidates.hand_radius[i] + candidates.object_radius[i]
        scale = 0.5 / total if total > 0.0 else 1.0
        rhs_out[i] = -scale * (vx * vx + vy * vy + vz * vz - total * total)
        gx, gy, gz = 2.0 * scale * vx, 2.0 * scale * vy, 2.0 * scale * vz
        normal_out[0, i], normal_out[1, i], normal_out[2, i] = gx, gy, gz
        common_out[0, i] = gx * weight[0]
        common_out[1, i] = gy * weight[1]
        common_out[2, i] = gz * weight[2]
        mx, my, mz = ry * gz - rz * gy, rz * gx - rx * gz, rx * gy - ry * gx
        for j in range(3):
            turn = axes[j, 0] * mx + axes[j, 1] * my + axes[j, 2] * mz
            common_out[3 + j, i] = turn * weight[3 + j]


@jit
def phalanx_rows(body: int, row: int, state: Record, paper: Record) -> int:
    """Append the rows of one phalanx's pairs, from `row` on; returns the next free row, -1 where there is no room.

    The frustum is that of the phalanx at the palm of t and the joint angles of t - 1.
    """
    candidates, problem, kind, frustum = sphere_candidates(state.candidates), state.problem, paper.kind, paper.frustum
    finger, phalanx = body // PHALANX_COUNT, body % PHALANX_COUNT
    joints, axis = state.pose.joints[finger], state.pose.axis[finger]
    weight = problem.inverse_root[6 + PHALANX_COUNT * finger : 9 + PHALANX_COUNT * finger]
    ex, ey, ez = frustum.end[0], frustum.end[1], frustum.end[2]
    ux, uy, uz = frustum.axis[0], frustum.axis[1], frustum.axis[2]
    for i in range(candidates.count[body]):
        x, y, z = candidates.x[body, i], candidates.y[body, i], candidates.z[body, i]
        radius = candidates.radius[body, i]
        for part in (ON_FRUSTUM, ON_SPHERE):
            if not kind[body, i] & part:
                continue
            if row >= CONTACT_ROWS:
                return -1
            if part == ON_FRUSTUM:
                along, cx, cy, cz = foot(ex, ey, ez, ux, uy, uz, x, y, z)
                limit = threshold(along, radius, frustum.radius, frustum.tangent, frustum.cosine)
                if limit <= 0.0:
                    # The palm has carried the finger so far that the sphere lies beyond the tip of the cone.
                    continue
                scale = 0.5 * frustum.cosine / limit
                value = scale * (cx * cx + cy * cy + cz * cz - limit * limit)
                slope = limit * frustum.tangent
                nx = -2.0 * scale * (cx + slope * ux)
                ny = -2.0 * scale * (cy + slope * uy)
                nz = -2.0 * scale * (cz + slope * uz)
            else:
                vx, vy, vz = frustum.sphere[0] - x, frustum.sphere[1] - y, frustum.sphere[2] - z
                total = frustum.sphere_radius + radius
                scale = 0.5 / total if total > 0.0 else 1.0
                value = scale * (vx * vx + vy * vy + vz * vz - total * total)
                nx, ny, nz = 2.0 * scale * vx, 2.0 * scale * vy, 2.0 * scale * vz
            problem.rhs[row] = -value
            paper.normal[0, row], paper.normal[1, row], paper.normal[2, row] = nx, ny, nz
            paper.body[row] = body
            # n · (axis × r) = r · (n × axis), r from the joint to the sphere's centre.
            mx, my, mz = ny * axis[2] - nz * axis[1], nz * axis[0] - nx * axis[2], nx * axis[1] - ny * axis[0]
            for j in range(PHALANX_COUNT):
                lever = 0.0
                if j <= phalanx:
                    lever = mx * (x - joints[j, 0]) + my * (y - joints[j, 1]) + mz * (z - joints[j, 2])
                problem.block[j, row] = lever * weight[j]
            row += 1
    return row


@jit
def palm_contacts(touch: float, state: Record) -> int:
    """Write contact records of the palm's pairs within `touch` [m]; returns how many."""
    candidates, contacts = sphere_candidates(state.candidates), state.contacts
    position, rotation = state.pose.position, state.pose.rotation
    row = as_int64(0)
    for i in range(candidates.count[PALM_BODY]):
        hx, hy, hz = candidates.hand_x[i], candidates.hand_y[i], candidates.hand_z[i]
        x, y, z = candidates.object_x[i], candidates.object_y[i], candidates.object_z[i]
        vx = position[0] + rotation[0, 0] * hx + rotation[0, 1] * hy + rotation[0, 2] * hz - x
        vy = position[1] + rotation[1, 0] * hx + rotation[1, 1] * hy + rotation[1, 2] * hz - y
        vz = position[2] + rotation[2, 0] * hx + rotation[2, 1] * hy + rotation[2, 2] * hz - z
        length = math.sqrt(vx * vx + vy * vy + vz * vz)
        radius = candidates.object_radius[i]
        distance = length - candidates.hand_radius[i] - radius
        if distance > touch or length == 0.0 or row >= CONTACT_ROWS:
            continue
        nx, ny, nz = vx / length, vy / length, vz / length
        write_contact(contacts, row, (x, y, z), radius, (nx, ny, nz), distance, candidates.hand_radius[i])
        contacts.body[row], contacts.key[row] = PALM_BODY, i
        row += 1
    return row


@jit
def phalanx_contacts(body: int, touch: float, row: int, state: Record, paper: Record) -> int:
    """Append contact records of a phalanx's pairs within `touch` [m], each sphere once; returns the next free row.

    A sphere is in contact with the frustum where Eq. 7 or 13 says so of the graphic phalanx at t, else with its end
    sphere. The distance is that along the normal of the part.
    """
    candidates, contacts = sphere_candidates(state.candidates), state.contacts
    kind, frustum, closed = paper.kind, paper.frustum, paper.closed
    distal = body % PHALANX_COUNT == PHALANX_COUNT - 1
    ex, ey, ez = frustum.end[0], frustum.end[1], frustum.end[2]
    ux, uy, uz = frustum.axis[0], frustum.axis[1], frustum.axis[2]
    cosine, sine = frustum.cosine, frustum.sine
    for i in range(candidates.count[body]):
        x, y, z = candidates.x[body, i], candidates.y[body, i], candidates.z[body, i]
        radius = candidates.radius[body, i]
        distance, nx, ny, nz = np.inf, 0.0, 0.0, 0.0
        if kind[body, i] & ON_FRUSTUM:
            along, cx, cy, cz = foot(ex, ey, ez, ux, uy, uz, x, y, z)
            radial = math.sqrt(cx * cx + cy * cy + cz * cz)
            limit = threshold(along, radius, frustum.radius, frustum.tangent, cosine)
            if radial > 0.0 and in_range(along, radius, frustum.length, sine, closed or distal, closed):
                distance = (radial - limit) * cosine
                nx = -cosine * cx / radial - sine * ux
                ny = -cosine * cy / radial - sine * uy
                nz = -cosine * cz / radial - sine * uz
        if kind[body, i] & ON_SPHERE:
            vx, vy, vz = frustum.sphere[0] - x, frustum.sphere[1] - y, frustum.sphere[2] - z
            length = math.sqrt(vx * vx + vy * vy + vz * vz)
            gap = length - frustum.sphere_radius - radius
            if length > 0.0 and distance > touch:
                distance, nx, ny, nz = gap, vx / length, vy / length, vz / length
        if distance > touch or row >= CONTACT_ROWS:
            continue
        # The forces of Eq. 14 need no radius of the hand.
        write_contact(contacts, row, (x, y, z), radius, (nx, ny, nz), distance, 0.0)
        contacts.body[row], contacts.key[row] = body, i
        row += 1
    return row
