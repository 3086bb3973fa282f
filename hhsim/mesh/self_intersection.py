"""Winding of a closed surface, and overlaps with itself: its winding number is made to be 0 or 1."""

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.mesh.winding_number import winding_numbers
from hhsim.mesh.repair_log import MeshInRepair, percent
from hhsim.mesh.topology import in_fixed_order, is_closed, merged_vertices, part_labels, signed_volume

WINDING_TOLERANCE = 0.05
CROSSING_SHARE = 0.001
"""Share of test points that may lie where the surface crosses itself; more is refused."""

WINDING_WORK = 3.0e7
"""Largest number of point-triangle pairs in one winding test, about a third of a second."""

FEWEST_SAMPLES = 600
"""Fewer triangles are tested at more than one place each."""

CAVITY_POINTS = 50
"""Approximate number of points at which a part wound inward has to lie within the others to be a cavity."""

SAMPLE_OFFSET = 1e-4
"""Distance of the test points from the surface, as a share of the longest extent."""


def winding_faults(vertices: FloatArray, faces: IntArray) -> tuple[int, int, float, float]:
    """Count points beside both sides of the faces, spread evenly, whose winding number is neither 0 nor 1.

    Returns:
        Number of such points, number of tested points, and the lowest and highest winding number found.
    """
    triangles = np.ascontiguousarray(vertices[faces])
    step = max(1, int(np.ceil(2.0 * len(faces) ** 2 / WINDING_WORK)))
    tested = triangles[::step]
    edge_b, edge_c = tested[:, 1] - tested[:, 0], tested[:, 2] - tested[:, 0]
    normal = np.cross(edge_b, edge_c)
    length = np.linalg.norm(normal, axis=1)
    wide = length > 0.0
    distance = SAMPLE_OFFSET * float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    offset = normal[wide] / length[wide, None] * distance
    # A mesh of few triangles needs several points on each: the R2 sequence (plastic number) fills a triangle evenly.
    number = np.arange(max(1, FEWEST_SAMPLES // len(tested)))
    share = np.mod(1.0 / 3.0 + np.outer(number, (0.7548776662466927, 0.5698402909980532)), 1.0)
    share = np.where(share.sum(axis=1, keepdims=True) > 1.0, 1.0 - share, share)
    places = [tested[wide, 0] + b * edge_b[wide] + c * edge_c[wide] for b, c in share]
    points = np.concatenate([place + side * offset for place in places for side in (1.0, -1.0)])
    winding = np.empty(len(points))
    winding_numbers(triangles, points, winding)
    faulty = np.minimum(np.abs(winding), np.abs(winding - 1.0)) > WINDING_TOLERANCE
    return int(faulty.sum()), len(points), float(winding.min(initial=0.0)), float(winding.max(initial=0.0))


def _winding_at(vertices: FloatArray, faces: IntArray, points: FloatArray) -> FloatArray:
    winding = np.empty(len(points))
    winding_numbers(np.ascontiguousarray(vertices[faces]), np.ascontiguousarray(points), winding)
    return winding


def _middles(vertices: FloatArray, faces: IntArray) -> FloatArray:
    return np.asarray(vertices[faces[:: max(1, len(faces) // CAVITY_POINTS)]].mean(axis=1))


def turn_outward(surface: MeshInRepair) -> None:
    """Wind closed parts outward; a part inside another may be wound inward: a cavity. MeshError without volume."""
    label = part_labels(surface.faces)
    if not all(is_closed(surface.faces[label == part]) for part in range(label.max() + 1)):
        # Parts that share an edge close each other: they are one.
        label = np.zeros_like(label)
    parts = int(label.max()) + 1
    turned = np.zeros(parts, dtype=bool)
    if signed_volume(surface.vertices, surface.faces) < 0.0:
        surface.faces = surface.faces[:, ::-1].copy()
        turned[:] = True
    for part in range(parts):
        faces = surface.faces[label == part]
        if signed_volume(surface.vertices, faces) >= 0.0:
            continue
        others = surface.faces[label != part]
        # What only overlaps another part is no cavity of it, so one point is not enough.
        points = _middles(surface.vertices, faces)
        enclosed = len(others) > 0 and bool((np.abs(_winding_at(surface.vertices, others, points)) > 0.5).all())
        if not enclosed:
            surface.faces[label == part] = faces[:, ::-1]
            turned[part] = not turned[part]
    if turned.any():
        which = "" if parts == 1 else f"{np.count_nonzero(turned)} of {parts} parts "
        surface.repairs.append(f"{which}wound inside out: turned")
    volume = signed_volume(surface.vertices, surface.faces)
    if volume <= 1e-9 * surface.size**3:
        raise surface.error(f"no volume: it encloses {1e9 * volume * surface.unit_length**3:.3g} mm³; expected a solid")


def resolve_overlaps(surface: MeshInRepair) -> None:
    """Join parts that overlap, so that the winding number is 0 or 1; MeshError if a part crosses itself."""
    found = winding_faults(surface.vertices, surface.faces)
    if found[0] and part_labels(surface.faces).max() > 0:
        _require_sound_parts(surface)
        joined = _union_of_parts(surface)
        if joined is not None:
            parts = int(part_labels(surface.faces).max()) + 1
            surface.vertices, surface.faces = joined
            left = int(part_labels(surface.faces).max()) + 1
            surface.repairs.append(f"joined {parts} overlapping parts into {left}")
            found = winding_faults(surface.vertices, surface.faces)
    faulty, tested, low, high = found
    share = faulty / tested if tested else 1.0
    if share > CROSSING_SHARE:
        raise surface.error(f"crosses itself: {_crossing(found)}")
    if faulty:
        surface.warnings.append(
            f"crosses itself at about {percent(share)} of its surface (winding number {low:.2f} to {high:.2f})"
        )


def _crossing(found: tuple[int, int, float, float]) -> str:
    faulty, tested, low, high = found
    where = f"at {faulty} of {tested} points beside the surface (from {low:.2f} to {high:.2f})"
    return f"the winding number is neither 0 nor 1 {where}; no safe repair"


def _require_sound_parts(surface: MeshInRepair) -> None:
    """Raise a MeshError where a part crosses itself: a union would lose what is inside out there."""
    label = part_labels(surface.faces)
    for part in range(int(label.max()) + 1):
        faces = surface.faces[label == part]
        inward = signed_volume(surface.vertices, faces) < 0.0
        found = winding_faults(surface.vertices, faces[:, ::-1] if inward else faces)
        if found[0] > CROSSING_SHARE * found[1]:
            raise surface.error(f"a part crosses itself: {_crossing(found)}")


def _union_of_parts(surface: MeshInRepair) -> tuple[FloatArray, IntArray] | None:
    """Union of the parts wound outward, each less the cavities in it; None where that is not clear."""
    from manifold3d import Error, Manifold, Mesh64, OpType

    label = part_labels(surface.faces)
    solids: list[Manifold] = []
    outlines: list[IntArray] = []
    inward: list[int] = []
    for part in range(int(label.max()) + 1):
        faces = surface.faces[label == part]
        if signed_volume(surface.vertices, faces) < 0.0:
            faces = faces[:, ::-1]
            inward.append(part)
        points, corners = merged_vertices(surface.vertices, faces)
        solids.append(Manifold(Mesh64(points, corners.astype(np.uint64))))
        if solids[-1].status() != Error.NoError:
            return None
        outlines.append(faces)
    for cavity in inward:
        points = _middles(surface.vertices, outlines[cavity])
        holders = [
            number
            for number, faces in enumerate(outlines)
            if number != cavity and (_winding_at(surface.vertices, faces, points) > 0.5).any()
        ]
        # With two solids around it, or another cavity across it, counting windings is more than a union can do.
        if len(holders) != 1 or holders[0] in inward:
            return None
        solids[holders[0]] -= solids[cavity]
    solids = [solid for part, solid in enumerate(solids) if part not in inward]
    whole = Manifold.batch_boolean(solids, OpType.Add)
    result = whole.to_mesh64()
    vertices = np.asarray(result.vert_properties, dtype=np.float64)[:, :3]
    faces = np.asarray(result.tri_verts).astype(np.int64)
    if len(faces) == 0 or not is_closed(faces):
        return None
    return in_fixed_order(vertices, faces)
