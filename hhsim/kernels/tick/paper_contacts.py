"""Contacts of method `paper`: which pairs meet as both trees are walked, and their constraints.

Pairs are those of Eq. 3 to 7 and 13. Every part of the graphic hand is grown by Δr first (the paper's contact
constraint prediction, Section IV-B2), so that the pairs found bound a step before they touch. Growing a part by Δr is
the same as growing the object's spheres.

Each test is monotone: a node that encloses a leaf meets it whenever the leaf does, so the walk tests nodes by the very
equations of the leaves. (Eq. 13's narrower range of k is not monotone, so it is asked of leaves alone.)

Palm: its sphere tree against the object's, and the spheres of the five knuckles, which no finger joint moves. Phalanx:
its cone frustum, and the sphere at its thin end: the joint's (Section III-B), or the fingertip's hemisphere.

The paper's constraints, linearised once (Eq. 8, 10, 12 and 13) in the rows of `active_set`, are squared distances,

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
from hhsim.kernels.contact.surface import COUNT_NODE_TESTS, at_distance, write_contact
from hhsim.kernels.hand.hand_shape import foot, in_range, place_frustum, threshold
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PALM_BODY, PHALANX_COUNT, HandArrays
from hhsim.kernels.jit import Record, as_bool, as_int64, jit, jit_inline
from hhsim.kernels.round_cone import sphere_cone
from hhsim.kernels.sphere_tree import STACK_SIZE, TreeArrays, gather_pieces

ON_FRUSTUM = 1
ON_SPHERE = 2
"""Bits of `kind`: which part of its phalanx a sphere of the object is paired with."""

PHALANX_PAIRS, PALM_PAIRS = 4088, 8 * 4088
"""Most pairs of a phalanx, and of the palm; the paper's heaviest scenes have a few hundred."""
PALM_STACK = 2 * STACK_SIZE
"""A pair of nodes each."""


@jit_inline
def _write_palm_pair(
    paper: Record, place: int, x: float, y: float, z: float, radius: float, tree: TreeArrays, node: int
) -> None:
    """Write a pair of a sphere of the palm, by its centre and radius [m], palm frame, and a node of the tree."""
    paper.hand_x[place], paper.hand_y[place], paper.hand_z[place], paper.hand_radius[place] = x, y, z, radius
    paper.object_x[place], paper.object_y[place], paper.object_z[place] = tree.x[node], tree.y[node], tree.z[node]
    paper.object_radius[place] = tree.radius[node]


@jit
def gather_palm(
    palm: TreeArrays, tree: TreeArrays, pose: Record, growth: float, capacity: int, state: Record, paper: Record
) -> int:
    """Eq. 3: pairs of leaves of the palm's tree (palm frame) and the object's (world) within `growth` [m].

    Returns how many; -1 where there are more than `capacity`, so that a capacity of 0 asks whether the palm is free.
    """
    position, rotation, stack = pose.position, pose.rotation, paper.stack
    work = state.work
    p0, p1, p2 = position[0], position[1], position[2]
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    count = 0
    tests = 0
    top = 0
    hand_first, hand_stop = 0, 1
    object_first, object_stop = 0, 1
    while True:
        # Children of one node against one node of the other tree; the roots to begin with.
        for h in range(hand_first, hand_stop):
            hx, hy, hz = palm.x[h], palm.y[h], palm.z[h]
            x = p0 + r00 * hx + r01 * hy + r02 * hz
            y = p1 + r10 * hx + r11 * hy + r12 * hz
            z = p2 + r20 * hx + r21 * hy + r22 * hz
            reach = palm.radius[h] + growth
            tests += object_stop - object_first
            for o in range(object_first, object_stop):
                dx, dy, dz = x - tree.x[o], y - tree.y[o], z - tree.z[o]
                total = reach + tree.radius[o]
                if dx * dx + dy * dy + dz * dz <= total * total:
                    if palm.first_child[h] < 0 and tree.first_child[o] < 0:
                        if count >= capacity:
                            work[COUNT_NODE_TESTS] += tests
                            return -1
                        _write_palm_pair(paper, count, hx, hy, hz, palm.radius[h], tree, o)
                        count += 1
                    else:
                        stack[top] = h
                        stack[top + 1] = o
                        top += 2
        if top == 0:
            break
        top -= 2
        h, o = stack[top], stack[top + 1]
        hand_first, hand_stop = h, h + 1
        object_first, object_stop = o, o + 1
        if palm.first_child[h] < 0:
            object_first = tree.first_child[o]
            object_stop = object_first + tree.child_count[o]
        else:
            hand_first = palm.first_child[h]
            hand_stop = hand_first + palm.child_count[h]
    work[COUNT_NODE_TESTS] += tests
    return count


@jit
def gather_knuckles(
    hand: HandArrays, tree: TreeArrays, pose: Record, growth: float, most: int, count: int, state: Record, paper: Record
) -> int:
    """Append the pairs of the fingers' first joint spheres, which belong to the palm; returns as `gather_palm`."""
    for f in range(FINGER_COUNT if count >= 0 else 0):
        if state.modelled[PHALANX_COUNT * f] == 0:
            continue
        center, radius = pose.joints[f, 0], hand.radius[f, 0]
        cone = sphere_cone(center[0], center[1], center[2], radius)
        found, _, tests = gather_pieces(tree, cone, growth, growth, paper.stack[:], paper.scratch[:])
        state.work[COUNT_NODE_TESTS] += tests
        if found < 0 or count + found > most:
            return -1
        for i in range(found):
            x, y, z = hand.base[f, 0], hand.base[f, 1], hand.base[f, 2]
            _write_palm_pair(paper, count, x, y, z, radius, tree, paper.scratch[i])
            count += 1
    return count


@jit
def gather_phalanx(
    tree: TreeArrays, pose: Record, body: int, growth: float, capacity: int, state: Record, paper: Record
) -> int:
    """Gather leaves within `growth` [m] by Eq. 7 (frustum) or Eq. 3 (end sphere); return how many, -1 if too many."""
    frustum, closed, kind_out = paper.frustum[body], paper.closed, paper.kind
    place_frustum(pose, body // PHALANX_COUNT, body % PHALANX_COUNT, frustum)
    work = state.work
    distal = body % PHALANX_COUNT == PHALANX_COUNT - 1
    ex, ey, ez = frustum.end[0], frustum.end[1], frustum.end[2]
    ux, uy, uz = frustum.axis[0], frustum.axis[1], frustum.axis[2]
    sx, sy, sz = frustum.sphere[0], frustum.sphere[1], frustum.sphere[2]
    length, thin, end_radius = frustum.length, frustum.radius, frustum.sphere_radius
    tangent, cosine, sine = frustum.tangent, frustum.cosine, frustum.sine
    exists = length > 0.0
    stack = paper.stack
    count = 0
    tests = 0
    top = 0
    first, stop = 0, 1
    while True:
        tests += stop - first
        for node in range(first, stop):
            x, y, z = tree.x[node], tree.y[node], tree.z[node]
            radius = tree.radius[node] + growth
            along, cx, cy, cz = foot(ex, ey, ez, ux, uy, uz, x, y, z)
            limit = threshold(along, radius, thin, tangent, cosine)
            beside = exists and cx * cx + cy * cy + cz * cz <= limit * limit
            on_frustum = beside and in_range(along, radius, length, sine, as_bool(False), as_bool(False))
            reach = end_radius + radius
            on_sphere = (x - sx) ** 2 + (y - sy) ** 2 + (z - sz) ** 2 <= reach * reach
            if not (on_frustum or on_sphere):
                continue
            if tree.first_child[node] >= 0:
                stack[top] = node
                top += 1
                continue
            kind = 0
            if on_frustum and in_range(along, radius, length, sine, closed or distal, closed):
                kind |= ON_FRUSTUM
            if on_sphere:
                kind |= ON_SPHERE
            if kind == 0:
                continue
            if count >= capacity:
                work[COUNT_NODE_TESTS] += tests
                return -1
            paper.x[body, count] = x
            paper.y[body, count] = y
            paper.z[body, count] = z
            paper.radius[body, count] = tree.radius[node]
            kind_out[body, count] = kind
            count += 1
        if top == 0:
            break
        top -= 1
        first = tree.first_child[stack[top]]
        stop = first + tree.child_count[stack[top]]
    work[COUNT_NODE_TESTS] += tests
    return count


@jit
def detect(hand: HandArrays, palm: TreeArrays, tree: TreeArrays, growth: float, state: Record, paper: Record) -> None:
    """Find all pairs of the graphic hand grown by `growth` [m], into the state's candidates.

    paper.full says which parts have more than there is room for: the palm, then the fingers.
    """
    pose, candidates = state.pose, state.candidates
    count = gather_palm(palm, tree, pose, growth, as_int64(PALM_PAIRS), state, paper)
    count = gather_knuckles(hand, tree, pose, growth, as_int64(PALM_PAIRS), count, state, paper)
    paper.full[0] = 1 if count < 0 else 0
    candidates.count[PALM_BODY] = max(count, 0)
    for f in range(FINGER_COUNT):
        paper.full[f + 1] = 0
        for k in range(PHALANX_COUNT):
            body = PHALANX_COUNT * f + k
            candidates.count[body] = 0
            if state.modelled[body] == 0:
                continue
            count = gather_phalanx(tree, pose, body, growth, as_int64(PHALANX_PAIRS), state, paper)
            if count < 0:
                paper.full[f + 1] = 1
            candidates.count[body] = max(count, 0)


@jit
def palm_is_free(
    hand: HandArrays, palm: TreeArrays, tree: TreeArrays, pose: Record, state: Record, paper: Record
) -> bool:
    """Return True if the palm and the knuckles of `pose` touch nothing."""
    count = gather_palm(palm, tree, pose, 0.0, as_int64(0), state, paper)
    return gather_knuckles(hand, tree, pose, 0.0, as_int64(0), count, state, paper) == 0


@jit
def finger_is_free(tree: TreeArrays, pose: Record, finger: int, state: Record, paper: Record) -> bool:
    """Return True if the phalanges of a finger of `pose` touch nothing."""
    for k in range(PHALANX_COUNT):
        if gather_phalanx(tree, pose, PHALANX_COUNT * finger + k, 0.0, as_int64(0), state, paper) != 0:
            return False
    return True


LIMITS = 2 * PHALANX_COUNT
"""Rows of a finger's joint limits, which follow its contacts."""


@jit
def palm_rows(count: int, state: Record, paper: Record) -> None:
    """Write the rows of the palm's `count` pairs: columns, right-hand sides, normals from object to hand."""
    position, rotation = state.pose.position, state.pose.rotation
    axes, weight = paper.axes, state.problem.inverse_root
    common_out, rhs_out, normal_out = state.problem.common, state.problem.rhs, paper.normal
    for i in range(count):
        hx, hy, hz = paper.hand_x[i], paper.hand_y[i], paper.hand_z[i]
        rx = rotation[0, 0] * hx + rotation[0, 1] * hy + rotation[0, 2] * hz
        ry = rotation[1, 0] * hx + rotation[1, 1] * hy + rotation[1, 2] * hz
        rz = rotation[2, 0] * hx + rotation[2, 1] * hy + rotation[2, 2] * hz
        vx = position[0] + rx - paper.object_x[i]
        vy = position[1] + ry - paper.object_y[i]
        vz = position[2] + rz - paper.object_z[i]
        total = paper.hand_radius[i] + paper.object_radius[i]
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
    problem, kind, frustum = state.problem, paper.kind, paper.frustum[body]
    finger, phalanx = body // PHALANX_COUNT, body % PHALANX_COUNT
    joints, axis = state.pose.joints[finger], state.pose.axis[finger]
    weight = problem.inverse_root[6 + PHALANX_COUNT * finger : 9 + PHALANX_COUNT * finger]
    ex, ey, ez = frustum.end[0], frustum.end[1], frustum.end[2]
    ux, uy, uz = frustum.axis[0], frustum.axis[1], frustum.axis[2]
    for i in range(state.candidates.count[body]):
        x, y, z = paper.x[body, i], paper.y[body, i], paper.z[body, i]
        radius = paper.radius[body, i]
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
def palm_contacts(touch: float, state: Record, paper: Record) -> int:
    """Write contact records of the palm's pairs within `touch` [m]; returns how many."""
    contacts = state.contacts
    position, rotation = state.pose.position, state.pose.rotation
    row = as_int64(0)
    for i in range(state.candidates.count[PALM_BODY]):
        hx, hy, hz = paper.hand_x[i], paper.hand_y[i], paper.hand_z[i]
        x, y, z = paper.object_x[i], paper.object_y[i], paper.object_z[i]
        vx = position[0] + rotation[0, 0] * hx + rotation[0, 1] * hy + rotation[0, 2] * hz - x
        vy = position[1] + rotation[1, 0] * hx + rotation[1, 1] * hy + rotation[1, 2] * hz - y
        vz = position[2] + rotation[2, 0] * hx + rotation[2, 1] * hy + rotation[2, 2] * hz - z
        length = math.sqrt(vx * vx + vy * vy + vz * vz)
        radius = paper.object_radius[i]
        distance = length - paper.hand_radius[i] - radius
        if distance > touch or length == 0.0 or row >= CONTACT_ROWS:
            continue
        normal = vx / length, vy / length, vz / length
        point, radii = at_distance((x, y, z), normal, radius + distance), (paper.hand_radius[i], radius)
        write_contact(contacts, row, point, normal, distance, radii, i)
        contacts.body[row] = PALM_BODY
        row += 1
    return row


@jit
def phalanx_contacts(body: int, touch: float, row: int, state: Record, paper: Record) -> int:
    """Append contact records of a phalanx's pairs within `touch` [m], each sphere once; returns the next free row.

    A sphere is in contact with the frustum where Eq. 7 or 13 says so of the graphic phalanx at t, else with its end
    sphere. The distance is that along the normal of the part.
    """
    contacts = state.contacts
    kind, frustum, closed = paper.kind, paper.frustum[body], paper.closed
    distal = body % PHALANX_COUNT == PHALANX_COUNT - 1
    ex, ey, ez = frustum.end[0], frustum.end[1], frustum.end[2]
    ux, uy, uz = frustum.axis[0], frustum.axis[1], frustum.axis[2]
    cosine, sine = frustum.cosine, frustum.sine
    for i in range(state.candidates.count[body]):
        x, y, z = paper.x[body, i], paper.y[body, i], paper.z[body, i]
        radius = paper.radius[body, i]
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
        point = at_distance((x, y, z), (nx, ny, nz), radius + distance)
        write_contact(contacts, row, point, (nx, ny, nz), distance, (0.0, radius), i)
        contacts.body[row] = body
        row += 1
    return row
