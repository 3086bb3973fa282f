"""Checks of a triangle mesh, and the repairs that are safe: each is named, and what is not safe is refused."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import MeshError
from hhsim.kernels.winding import winding_numbers
from hhsim.mesh_holes import hole_caps
from hhsim.mesh_topology import (
    alike_wound,
    face_areas,
    in_fixed_order,
    is_closed,
    merged_vertices,
    part_labels,
    signed_volume,
    undirected_edges,
    used_vertices,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

NEAR_VERTEX = 1e-5
"""Vertices closer than this share of the longest extent are merged where that closes open edges."""

FRAGMENT_AREA = 0.01
"""Loose open fragments may be dropped while they make at most this share of the surface."""

CAP_AREA = 0.4
"""Holes are closed while the caps make at most this share of the surface; the rest is called an open surface."""

SHEET_VOLUME = 1e-3
"""A part whose volume with caps is below this share of its area to the power of 3/2 is a sheet, and no cap helps."""

WIDE_HOLE = 0.1
"""A hole wider than this share of the longest extent must be flat to be closed, and is warned of."""

BENT_HOLE = 0.2
"""Largest distance of a wide hole's edge from its plane, as a share of its width."""

WINDING_TOLERANCE = 0.05
CROSSING_SHARE = 0.001
"""Share of test points that may lie where the surface crosses itself; more is refused."""

WINDING_WORK = 3.0e7
"""Largest number of point-triangle pairs in one winding test, about a third of a second."""

FEWEST_SAMPLES = 600
"""Triangles that are fewer are tested at more than one place each."""

CAVITY_POINTS = 50
"""At about so many points a part wound inward has to lie within the others to be a cavity."""

SAMPLE_OFFSET = 1e-4
"""Distance of the test points from the surface, as a share of the longest extent."""


@dataclass
class Surface:
    """A mesh under repair, in the unit of its source, so that round numbers stay round until the end.

    Attributes:
        vertices: Corners [unit of the source], shape (V, 3).
        faces: Corner indices, shape (F, 3).
        name: What messages call the mesh.
        unit_length: Length of the unit [m], for messages.
        merged: What was done that every mesh file needs.
        repairs: What was repaired.
        warnings: What looks wrong and was kept.
    """

    vertices: FloatArray
    faces: IntArray
    name: str
    unit_length: float = 1.0
    merged: list[str] = field(default_factory=list)
    repairs: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def size(self) -> float:
        """Longest extent of the faces [unit of the source]."""
        return float(np.ptp(self.vertices[self.faces].reshape(-1, 3), axis=0).max())

    def millimetres(self, length: float) -> str:
        """A length [unit of the source] as people read it."""
        return f"{1000.0 * self.unit_length * length:.3g} mm"


def closed_surface(
    vertices: FloatArray, faces: IntArray, name: str, unit_length: float = 1.0, repair: bool = True
) -> Surface:
    """Check a mesh and repair it to a closed surface, wound outward, whose winding number is 0 or 1.

    Args:
        vertices: Finite corners [unit of the source], shape (V, 3).
        faces: Valid indices, shape (F, 3), F > 0.
        name: What messages call the mesh.
        unit_length: Length of the unit [m].
        repair: False refuses a mesh that needs more than merging vertices at equal places.

    Returns:
        The closed surface, still in the unit of the source, with its repairs and warnings in plain sentences.

    Raises:
        MeshError: The mesh has no inside that a safe repair would give; or it needs a repair and `repair` is False.
    """
    surface = Surface(vertices, faces, name, unit_length)
    merge_and_clean(surface)
    _drop_fragments(surface)
    _wind_alike(surface)
    _close_holes(surface)
    _require_closed(surface)
    _turn_outward(surface)
    _resolve_overlaps(surface)
    surface.vertices, surface.faces = used_vertices(surface.vertices, surface.faces)
    if surface.repairs and not repair:
        raise MeshError(f"{name}: needs repair, which is switched off: {'; '.join(surface.repairs)}")
    return surface


def merge_and_clean(surface: Surface) -> None:
    """Merge vertices at the same place, drop triangles that are degenerate or occur twice.

    Raises:
        MeshError: No triangle is left.
    """
    _merge_equal_vertices(surface)
    _drop_useless_faces(surface)
    _merge_near_vertices(surface)


def winding_faults(vertices: FloatArray, faces: IntArray) -> tuple[int, int, float, float]:
    """Winding number at points close to both sides of the faces, spread evenly over them.

    Returns:
        How many points are neither inside (1) nor outside (0), how many were tested, and the lowest and highest
        winding number found.
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


def counted(count: int, noun: str) -> str:
    """A number with its noun, in the plural where it is not 1."""
    plural = "vertices" if noun == "vertex" else noun + "s"
    return f"{count} {noun if count == 1 else plural}"


def _merge_equal_vertices(surface: Surface) -> None:
    before = len(surface.vertices)
    surface.vertices, surface.faces = merged_vertices(surface.vertices, surface.faces)
    if len(surface.vertices) < before:
        surface.merged.append(
            f"merged {counted(before, 'vertex')} into {len(surface.vertices)}: equal places, or used by no triangle"
        )


def _drop_useless_faces(surface: Surface) -> None:
    faces = surface.faces
    a, b, c = faces.T
    degenerate = (a == b) | (b == c) | (c == a)
    if degenerate.any():
        surface.repairs.append(f"removed {counted(int(degenerate.sum()), 'degenerate triangle')}")
        faces = faces[~degenerate]
    keep = _once(faces)
    if not keep.all():
        surface.repairs.append(f"removed {counted(int((~keep).sum()), 'duplicate triangle')}")
        faces = faces[keep]
    if len(faces) == 0:
        raise MeshError(f"{surface.name}: no volume: its triangles are degenerate or cancel each other")
    surface.faces = faces


def _once(faces: IntArray) -> BoolArray:
    """Which faces to keep so that none occurs twice, shape (F,).

    A face and its reverse enclose nothing and cancel; unless most faces have their reverse: then the file holds both
    sides of one surface, and one of each is kept.
    """
    first = np.argmin(faces, axis=1)
    turned = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
    sign = np.where(turned[:, 1] < turned[:, 2], 1, -1)
    group = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True)[1].reshape(-1)
    count = np.bincount(group)
    net = np.bincount(group, weights=sign)
    both_sides = np.abs(net) < count
    if 2 * np.count_nonzero(both_sides) > len(count):
        wanted = np.ones(len(faces), dtype=bool)
    else:
        wanted = np.sign(net[group]) == sign
    keep = np.zeros(len(faces), dtype=bool)
    candidates = np.flatnonzero(wanted)
    keep[candidates[np.unique(group[wanted], return_index=True)[1]]] = True
    return keep


def _open_edges(faces: IntArray) -> int:
    return int(np.count_nonzero(undirected_edges(faces)[1] == 1))


def _merge_near_vertices(surface: Surface) -> None:
    before = _open_edges(surface.faces)
    if before == 0:
        return
    distance = NEAR_VERTEX * surface.size
    vertices, faces = merged_vertices(surface.vertices, surface.faces, distance)
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    if len(faces) and _open_edges(faces) < before:
        merged = len(surface.vertices) - len(vertices)
        surface.repairs.append(
            f"merged {counted(merged, 'vertex')} closer than {surface.millimetres(distance)} to another"
        )
        surface.vertices, surface.faces = vertices, faces
        _drop_useless_faces(surface)


def _drop_fragments(surface: Surface) -> None:
    label = part_labels(surface.faces)
    if label.max() == 0:
        return
    area = face_areas(surface.vertices, surface.faces)
    part_area = np.bincount(label, weights=area)
    index, count, _ = undirected_edges(surface.faces)
    # Open: the part has an edge that is not shared by two faces.
    loose = np.zeros(len(part_area), dtype=bool)
    loose[label[np.flatnonzero(count[index] != 2) // 3]] = True
    loose[np.argmax(part_area)] = False
    small = loose & (part_area <= FRAGMENT_AREA * area.sum())
    share = float(part_area[small].sum() / area.sum()) if area.sum() > 0.0 else 0.0
    if not small.any() or share > FRAGMENT_AREA:
        return
    surface.faces = surface.faces[~small[label]]
    surface.repairs.append(
        f"dropped {counted(int(small.sum()), 'loose open fragment')}, {100.0 * share:.2g} % of the surface"
    )


def _wind_alike(surface: Surface) -> None:
    result = alike_wound(surface.faces)
    if result is None:
        raise MeshError(f"{surface.name}: one-sided like a Möbius strip, so it has no inside")
    surface.faces, turned = result
    if turned:
        surface.repairs.append(f"turned {counted(turned, 'triangle')} wound against the neighbours")


def _close_holes(surface: Surface) -> None:
    caps = hole_caps(surface.vertices, surface.faces)
    holes = len(caps.width)
    if holes == 0:
        return
    wide = caps.width > WIDE_HOLE * surface.size
    bent = np.flatnonzero(wide & (caps.bend > BENT_HOLE * caps.width))
    if len(bent):
        width, bend = surface.millimetres(caps.width[bent[0]]), surface.millimetres(caps.bend[bent[0]])
        raise MeshError(
            f"{surface.name}: open: a hole {width} wide is bent by {bend}, too much to close safely; "
            "close it in a mesh editor"
        )
    widest = surface.millimetres(float(caps.width.max()))
    faces = np.concatenate([surface.faces, caps.faces])
    label = part_labels(faces)
    area = face_areas(caps.vertices, faces)
    is_cap = np.arange(len(faces)) >= len(surface.faces)
    share = float(area[is_cap].sum() / area[~is_cap].sum())
    sheets = 0
    for part in np.unique(label[is_cap]):
        inside = abs(signed_volume(caps.vertices, faces[label == part]))
        sheets += inside < SHEET_VOLUME * float(area[label == part].sum()) ** 1.5
    if share > CAP_AREA or sheets:
        raise MeshError(
            f"{surface.name}: an open surface: {counted(holes, 'hole')} up to {widest} wide, whose caps would have "
            f"{100.0 * share:.0f} % of its area; give it a thickness"
        )
    surface.repairs.append(f"closed {counted(holes, 'hole')} up to {widest} wide")
    if wide.any():
        surface.warnings.append(
            f"{counted(int(wide.sum()), 'hole')} up to {widest} wide closed: it is solid there; if it should be "
            "hollow, give the wall a thickness"
        )
    surface.vertices, surface.faces = caps.vertices, faces


def _require_closed(surface: Surface) -> None:
    _, count, balance = undirected_edges(surface.faces)
    if not np.any(balance):
        return
    fanned = int(np.count_nonzero(count > 2))
    open_edges = int(np.count_nonzero(count == 1))
    what = " and ".join(
        part
        for part in (
            f"{counted(fanned, 'edge')} shared by more than two triangles" if fanned else "",
            f"{counted(open_edges, 'open edge')}" if open_edges else "",
        )
        if part
    )
    raise MeshError(f"{surface.name}: not watertight: {what or 'neighbours wound against each other'}; no safe repair")


def _winding_at(vertices: FloatArray, faces: IntArray, points: FloatArray) -> FloatArray:
    winding = np.empty(len(points))
    winding_numbers(np.ascontiguousarray(vertices[faces]), np.ascontiguousarray(points), winding)
    return winding


def _middles(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Middles of about `CAVITY_POINTS` faces, shape (n, 3)."""
    return np.asarray(vertices[faces[:: max(1, len(faces) // CAVITY_POINTS)]].mean(axis=1))


def _turn_outward(surface: Surface) -> None:
    """Wind closed parts outward; a part inside another may be wound inward: a cavity."""
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
        raise MeshError(
            f"{surface.name}: no volume: it encloses {1e9 * volume * surface.unit_length**3:.3g} mm³; expected a solid"
        )


def _resolve_overlaps(surface: Surface) -> None:
    faulty, tested, low, high = winding_faults(surface.vertices, surface.faces)
    if faulty and part_labels(surface.faces).max() > 0:
        _require_sound_parts(surface)
        joined = _union_of_parts(surface)
        if joined is not None:
            parts = int(part_labels(surface.faces).max()) + 1
            surface.vertices, surface.faces = joined
            left = int(part_labels(surface.faces).max()) + 1
            surface.repairs.append(f"joined {parts} overlapping parts into {left}")
            faulty, tested, low, high = winding_faults(surface.vertices, surface.faces)
    share = faulty / tested if tested else 1.0
    if share > CROSSING_SHARE:
        raise MeshError(
            f"{surface.name}: crosses itself: the winding number is neither 0 nor 1 at {faulty} of {tested} points "
            f"beside the surface (from {low:.2f} to {high:.2f}); no safe repair"
        )
    if faulty:
        surface.warnings.append(
            f"crosses itself at about {100.0 * share:.2g} % of its surface (winding number {low:.2f} to {high:.2f})"
        )


def _require_sound_parts(surface: Surface) -> None:
    """Raise a MeshError where a part crosses itself: a union would lose what is inside out there."""
    label = part_labels(surface.faces)
    for part in range(int(label.max()) + 1):
        faces = surface.faces[label == part]
        inward = signed_volume(surface.vertices, faces) < 0.0
        faulty, tested, low, high = winding_faults(surface.vertices, faces[:, ::-1] if inward else faces)
        if faulty > CROSSING_SHARE * tested:
            raise MeshError(
                f"{surface.name}: a part crosses itself: the winding number is neither 0 nor 1 at {faulty} of {tested} "
                f"points beside its surface (from {low:.2f} to {high:.2f}); no safe repair"
            )


def _union_of_parts(surface: Surface) -> tuple[FloatArray, IntArray] | None:
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
