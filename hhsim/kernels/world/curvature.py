"""Second derivatives of contact distances: how a contact's distance bends as the hand moves.

A contact between a sphere of radius r around the hand's axis point x and an object that is locally a sphere of radius R
around c has the distance D = |x - c| - r - R. With ρ = |x - c|, n the normal and V = ∂x/∂q,

    ∂²D/∂q² = Vᵀ (I - n nᵀ) V / ρ + n · ∂²x/∂q².

At an edge, which is straight along e, I - n nᵀ - e eᵀ takes the place of I - n nᵀ; on a face ρ is infinite.
Where the nearest point slides along a phalanx (axis parameter 0 < s < 1), d = min over s of D, and its Hessian is the
Schur complement D_qq - D_qs D_sq / D_ss. Only products with a vector are needed.
"""

from typing import TypeAlias

from hhsim.kernels.hand.kinematics import FINGER_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.kernels.jit import Array, Indices, Record, jit, jit_inline

Triple: TypeAlias = tuple[float, float, float]


@jit_inline
def _add_joints(
    pose: Record,
    finger: int,
    joints: int,
    place: Triple,
    normal: Triple,
    bend: Triple,
    pull: Triple,
    moment: Triple,
    force: float,
    step: Array,
    product_out: Array,
) -> None:
    """Add to Σ λ ∇²d · step what one contact gives for the first `joints` flexions of a finger.

    `place` is the contact's axis point [m], `bend` n × w with w the palm's rotation in the step [rad], `force` λ [N].
    `pull` [1] and `moment` [m] are the product's part for a translation of that point, and what a rotation adds.
    """
    (x, y, z), (nx, ny, nz), (hx, hy, hz) = place, normal, bend
    (fx, fy, fz), (mx, my, mz) = pull, moment
    if joints == 0:
        return
    ax, ay, az = pose.axis[finger, 0], pose.axis[finger, 1], pose.axis[finger, 2]
    for k in range(joints):
        qx = x - pose.joints[finger, k, 0]
        qy = y - pose.joints[finger, k, 1]
        qz = z - pose.joints[finger, k, 2]
        bx, by, bz = ay * qz - az * qy, az * qx - ax * qz, ax * qy - ay * qx
        value = bx * fx + by * fy + bz * fz + mx * ax + my * ay + mz * az
        # n · (w × b) = b · (n × w)
        value += bx * hx + by * hy + bz * hz
        for other in range(joints):
            inner = max(k, other)
            qx = x - pose.joints[finger, inner, 0]
            qy = y - pose.joints[finger, inner, 1]
            qz = z - pose.joints[finger, inner, 2]
            bx, by, bz = ay * qz - az * qy, az * qx - ax * qz, ax * qy - ay * qx
            # n · (a × b) = a · (b × n)
            value += step[6 + 3 * finger + other] * (
                ax * (by * nz - bz * ny) + ay * (bz * nx - bx * nz) + az * (bx * ny - by * nx)
            )
        product_out[6 + 3 * finger + k] += force * value


@jit
def curvature_product(
    pose: Record, contacts: Record, first: int, rows: Indices, multiplier: Array, step: Array, product_out: Array
) -> None:
    """Add Σ λ_i ∇²d_i · step, [N] and [N·m], over those of `rows` that are contacts, with multipliers λ [N].

    `first` is the row of the first contact. Step (δp, δφ, δθ) [m, rad, rad] and product have shape (21,).
    """
    total = contacts.start[FINGER_COUNT + 1]
    wx, wy, wz = step[3], step[4], step[5]
    for i in range(rows.shape[0]):
        row = rows[i] - first
        if not 0 <= row < total:
            continue
        force = multiplier[i]
        body = contacts.body[row]
        nx, ny, nz = contacts.normal[0, row], contacts.normal[1, row], contacts.normal[2, row]
        r = contacts.hand_radius[row]
        rho = r + contacts.object_radius[row] + contacts.distance[row]
        x, y, z = contacts.point[0, row] + r * nx, contacts.point[1, row] + r * ny, contacts.point[2, row] + r * nz
        rx, ry, rz = x - pose.position[0], y - pose.position[1], z - pose.position[2]
        finger = body // PHALANX_COUNT if body < PALM_BODY else -1
        joints = body % PHALANX_COUNT + 1 if body < PALM_BODY else 0
        # Velocity of the axis point: of the fingers' joints, and in all.
        ax, ay, az = 0.0, 0.0, 0.0
        jx, jy, jz = 0.0, 0.0, 0.0
        flexion = 0.0
        if finger >= 0:
            ax, ay, az = pose.axis[finger, 0], pose.axis[finger, 1], pose.axis[finger, 2]
            for k in range(joints):
                angle = step[6 + 3 * finger + k]
                flexion += angle
                qx = x - pose.joints[finger, k, 0]
                qy = y - pose.joints[finger, k, 1]
                qz = z - pose.joints[finger, k, 2]
                jx += angle * (ay * qz - az * qy)
                jy += angle * (az * qx - ax * qz)
                jz += angle * (ax * qy - ay * qx)
        tx, ty, tz = wy * rz - wz * ry, wz * rx - wx * rz, wx * ry - wy * rx
        vx, vy, vz = step[0] + tx + jx, step[1] + ty + jy, step[2] + tz + jz
        along = vx * nx + vy * ny + vz * nz
        ex, ey, ez = contacts.straight[0, row], contacts.straight[1, row], contacts.straight[2, row]
        ve = vx * ex + vy * ey + vz * ez
        fx, fy, fz = (
            (vx - along * nx - ve * ex) / rho,
            (vy - along * ny - ve * ey) / rho,
            (vz - along * nz - ve * ez) / rho,
        )
        mx, my, mz = 0.0, 0.0, 0.0
        if contacts.slides[row] == 1:
            ux = pose.direction[finger, joints - 1, 0]
            uy = pose.direction[finger, joints - 1, 1]
            uz = pose.direction[finger, joints - 1, 2]
            un = ux * nx + uy * ny + uz * nz
            ue = ux * ex + uy * ey + uz * ez
            sx, sy, sz = ux - un * nx - ue * ex, uy - un * ny - ue * ey, uz - un * nz - ue * ez
            across = (sx * sx + sy * sy + sz * sz) / rho
            if across > 0.0:
                ox, oy, oz = wx + flexion * ax, wy + flexion * ay, wz + flexion * az
                cx, cy, cz = uy * nz - uz * ny, uz * nx - ux * nz, ux * ny - uy * nx
                slide = ((sx * vx + sy * vy + sz * vz) / rho + ox * cx + oy * cy + oz * cz) / across
                fx, fy, fz = fx - slide * sx / rho, fy - slide * sy / rho, fz - slide * sz / rho
                mx, my, mz = -slide * cx, -slide * cy, -slide * cz
        # (w × r) and r × (n × w), halved: the exponential map's second derivative, symmetric in the two increments.
        hx, hy, hz = ny * wz - nz * wy, nz * wx - nx * wz, nx * wy - ny * wx
        gx = 0.5 * (ty * nz - tz * ny + ry * hz - rz * hy) + jy * nz - jz * ny
        gy = 0.5 * (tz * nx - tx * nz + rz * hx - rx * hz) + jz * nx - jx * nz
        gz = 0.5 * (tx * ny - ty * nx + rx * hy - ry * hx) + jx * ny - jy * nx
        product_out[0] += force * fx
        product_out[1] += force * fy
        product_out[2] += force * fz
        product_out[3] += force * (ry * fz - rz * fy + gx + mx)
        product_out[4] += force * (rz * fx - rx * fz + gy + my)
        product_out[5] += force * (rx * fy - ry * fx + gz + mz)
        place, normal, bend = (x, y, z), (nx, ny, nz), (hx, hy, hz)
        _add_joints(pose, finger, joints, place, normal, bend, (fx, fy, fz), (mx, my, mz), force, step, product_out)
