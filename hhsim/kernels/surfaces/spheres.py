"""Contacts with the leaf spheres of the object's sphere tree, as in the paper."""

import math

import numpy as np

from hhsim.kernels.contact.lists import CAPACITY, Probe, list_fields, put_in_order
from hhsim.kernels.contact.surface import (
    COUNT_NODE_TESTS,
    ContactPoints,
    Surface,
    Walk,
    at_distance,
    cone_contacts,
    cone_distance,
    list_pieces,
    measure_pieces,
    record_pieces,
    write_contact,
)
from hhsim.kernels.jit import Array, Indices, Record, as_int64, jit, jit_inline
from hhsim.kernels.round_cone import RoundCone, Spheres, round_cone_distances, round_cone_parameter, sphere_distances
from hhsim.kernels.sphere_tree import TreeArrays, gather_pieces, nearest_piece, node_distance

CANDIDATES = np.dtype([*list_fields(1), ("sphere", np.float64, (4, CAPACITY))], align=True)
"""Gathered leaves, copies of their centres and radii [m], and their distances; a parameter is a share of the axis."""


@list_pieces.of(TreeArrays)
@jit_inline
def _list(
    tree: TreeArrays,
    probe: Probe,
    most: int,
    most_found: int,
    reach: float,
    look_out: float,
    candidates: Record,
    walk: Walk,
) -> float:
    number, cone, start = probe
    count, slack, tests = gather_pieces(tree, cone, reach, look_out, walk.stack, walk.scratch[:most])
    walk.work[COUNT_NODE_TESTS] += tests
    if count < 0:
        return -np.inf
    piece, near, sphere = candidates.piece[0], candidates.distance[0], candidates.sphere
    for i in range(count):
        piece[start + i], near[start + i] = walk.scratch[i], node_distance(tree, cone, walk.scratch[i])
    put_in_order(number, as_int64(0), start, start + count, candidates, walk.scratch)
    for i in range(start, start + count):
        node = piece[i]
        sphere[0, i], sphere[1, i], sphere[2, i] = tree.x[node], tree.y[node], tree.z[node]
        sphere[3, i] = tree.radius[node]
    return slack


@measure_pieces.of(TreeArrays)
@jit_inline
def _measure(tree: TreeArrays, kind: int, cone: RoundCone, start: int, stop: int, candidates: Record) -> None:
    of, distance, parameter = candidates.sphere, candidates.distance[0], candidates.parameter[0]
    leaves = Spheres(of[0], of[1], of[2], of[3])
    if cone.length > 0.0:
        round_cone_distances(leaves, start, stop, cone, distance, parameter)
    else:
        # The parameter stays 0.
        sphere_distances(leaves, start, stop, cone, distance)


@record_pieces.of(TreeArrays)
@jit_inline
def _record(
    tree: TreeArrays, probe: Probe, pose: Record, candidates: Record, limit: float, row: int, contacts: Record
) -> int:
    number, cone, start = probe
    of, distance, parameter, leaf = candidates.sphere, candidates.distance, candidates.parameter, candidates.piece
    ux, uy, uz = cone.length * cone.ux, cone.length * cone.uy, cone.length * cone.uz
    for i in range(start, start + candidates.measured[number, 0]):
        d = distance[0, i]
        if d > limit:
            continue
        if row >= contacts.key.shape[0]:
            return -1
        s, center, radius = parameter[0, i], (of[0, i], of[1, i], of[2, i]), of[3, i]
        nx, ny, nz = cone.x + s * ux - center[0], cone.y + s * uy - center[1], cone.z + s * uz - center[2]
        square = nx * nx + ny * ny + nz * nz
        if square > 0.0:
            scale = 1.0 / math.sqrt(square)
            normal = (nx * scale, ny * scale, nz * scale)
        else:
            # Concentric spheres: any direction is as good, and the hand can retreat out of its back.
            normal = (pose.rotation[0, 2], pose.rotation[1, 2], pose.rotation[2, 2])
        radii, key = (cone.radius - s * cone.drop, radius), number * tree.radius.shape[0] + leaf[0, i]
        write_contact(contacts, row, at_distance(center, normal, radius + d), normal, d, radii, key)
        contacts.slides[row] = 1 if 0.0 < s < 1.0 else 0
        row += 1
    return row


@cone_contacts.of(TreeArrays)
@jit
def _cone_contacts(
    tree: TreeArrays, cone: RoundCone, limit: float, walk: Walk, row: int, pairs_out: ContactPoints
) -> tuple[int, float]:
    found, clearance, _ = gather_pieces(tree, cone, limit, limit, walk.stack, walk.scratch)
    if found < 0 or row + found > pairs_out.tick.shape[0]:
        return -1, 0.0
    for i in range(found):
        leaf = walk.scratch[i]
        dx, dy, dz = tree.x[leaf] - cone.x, tree.y[leaf] - cone.y, tree.z[leaf] - cone.z
        s = round_cone_parameter(dx, dy, dz, cone.ux, cone.uy, cone.uz, cone.tan_slope, cone.inverse_length)
        qx, qy, qz = dx - s * cone.length * cone.ux, dy - s * cone.length * cone.uy, dz - s * cone.length * cone.uz
        away = math.sqrt(qx * qx + qy * qy + qz * qz)
        # A leaf centred on the axis has no nearest point; any is as good.
        inverse = 1.0 / away if away > 0.0 else 0.0
        share = (cone.radius - s * cone.drop) * inverse
        pairs_out.point[row, 0] = tree.x[leaf] - qx + share * qx
        pairs_out.point[row, 1] = tree.y[leaf] - qy + share * qy
        pairs_out.point[row, 2] = tree.z[leaf] - qz + share * qz
        pairs_out.normal[row, 0] = -inverse * qx
        pairs_out.normal[row, 1] = -inverse * qy
        pairs_out.normal[row, 2] = -inverse * qz
        row += 1
    return row, clearance


@cone_distance.of(TreeArrays)
@jit
def _cone_distance(tree: TreeArrays, cone: RoundCone, limit: float, stack: Indices) -> float:
    return nearest_piece(tree, cone, limit, stack)[0]


def _center(tree: TreeArrays) -> Array:
    return np.array([tree.x[0], tree.y[0], tree.z[0]])


SURFACE = Surface(
    summary="the leaf spheres of the object's sphere tree",
    arrays=TreeArrays,
    candidates=CANDIDATES,
    center=_center,
    coarser="a coarser sphere tree",
)
