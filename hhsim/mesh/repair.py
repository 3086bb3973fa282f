"""Checks of a triangle mesh, and the safe repairs: each is named, and what is not safe is refused.

Parts that overlap are joined, so that the winding number of the closed surface is 0 or 1.
"""

from contextlib import suppress
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.kernels.mesh.bvh import MeshBvh, build_mesh_bvh, face_normals, fast_winding_numbers
from hhsim.mesh import topology
from hhsim.system.counted import counted

NEAR_VERTEX = 1e-5
"""Vertices closer than this share of the longest extent are merged where that closes open edges."""

FRAGMENT_AREA = 0.01
"""Loose open fragments may be dropped up to this share of the surface."""

CAP_AREA = 0.4
"""Holes are closed up to this share of caps in the surface; beyond it the surface is called open."""

SHEET_VOLUME = 1e-3
"""A part whose volume with caps is below this share of its area to the power of 3/2 is a sheet, and no cap helps."""

WIDE_HOLE = 0.1
"""A hole wider than this share of the longest extent must be flat to be closed, and gives a warning."""

BENT_HOLE = 0.2
"""Largest distance of a wide hole's edge from its plane, as a share of its width."""

CROSSING_SHARE = 0.001
"""Share of test points that may lie where the surface crosses itself; more is refused."""

WINDING_WORK = 3.0e7
"""Largest product of the numbers of points and triangles in one winding test."""

FEWEST_SAMPLES = 600
"""Fewer triangles are tested at more than one place each."""

FOLD_SAMPLES = 20_000
"""Number of points at which it is tested whether triangles that may be folded have an inside behind them."""

BESIDE = 1e-5
"""Distance from a triangle at which its two sides are evaluated, as a share of the longest extent."""

SAMPLE_OFFSET = 1e-4
"""Distance of the test points from the surface, as a share of the longest extent."""


@dataclass
class MeshInRepair:
    """A mesh under repair, in the unit of its source, so that round numbers stay round until the end."""

    vertices: FloatArray  # corners [unit of the source], shape (V, 3)
    faces: IntArray  # corner indices, shape (F, 3)
    name: str  # name of the mesh in messages
    unit_length: float = 1.0  # length of the unit [m], for messages
    # Changes that every mesh file needs, repairs, and suspicions, a sentence each.
    merged: list[str] = field(default_factory=list)
    repairs: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def size(self) -> float:
        """Longest extent of the faces [unit of the source]."""
        return float(np.ptp(self.vertices[self.faces].reshape(-1, 3), axis=0).max())

    def error(self, message: str) -> MeshError:
        """Return an error that names the mesh."""
        return MeshError(f"{self.name}: {message}")

    def millimetres(self, length: float) -> str:
        """Return a length [unit of the source] as text."""
        # Adding zero takes the sign off a negative one.
        return f"{1000.0 * self.unit_length * length + 0.0:.3g} mm"


def percent(share: float) -> str:
    """Return a share as text: two digits, or a whole number from 10 % on."""
    return f"{100.0 * share:.0f} %" if share >= 0.0995 else f"{100.0 * share:.2g} %"


def closed_surface(vertices: FloatArray, faces: IntArray, name: str, unit_length: float = 1.0) -> MeshInRepair:
    """Check a mesh and repair it to a closed surface, wound outward, whose winding number is 0 or 1.

    Arguments as the fields of `MeshInRepair`: finite corners, and valid indices, F > 0. Raises MeshError where no safe
    repair gives the mesh an inside.
    """
    surface = MeshInRepair(vertices, faces, name, unit_length)
    merge_and_clean(surface)
    _drop_fragments(surface)
    surface.faces, turned, one_sided = topology.alike_wound(surface.faces)
    if one_sided:
        raise surface.error("one-sided like a Möbius strip, so it has no inside")
    if turned:
        surface.repairs.append(_turned(turned))
    _close_holes(surface)
    _require_closed(surface)
    turn_outward(surface)
    surface.faces, cut, may_fold = topology.unfolded(surface.vertices, surface.faces)
    if cut:
        surface.repairs.append(f"cut {counted(cut, 'flat polygon')} anew, whose triangles were folded over each other")
    faulty, tested, low, high = found = _join(surface)
    share = faulty / tested if tested else 1.0
    if share > CROSSING_SHARE:
        raise surface.error(f"crosses itself: {_crossing(found)}")
    if faulty:
        surface.warnings.append(
            f"crosses itself at about {percent(share)} of its surface (winding number {low:.2f} to {high:.2f})"
        )
    if may_fold:
        _require_unfolded(surface)
    surface.vertices, surface.faces = topology.used_vertices(surface.vertices, surface.faces)
    return surface


def turned_triangles(vertices: FloatArray, faces: IntArray) -> tuple[BoolArray, list[str]]:
    """Mark the faces (F,) to turn where that alone gives triangles an inside, all else as it is; and say so.

    None is marked where the surface is open, one-sided, or without volume whichever way it is wound.
    """
    surface = MeshInRepair(*topology.merged_vertices(vertices, faces), "")
    before = surface.faces
    unchanged = np.zeros(len(faces), dtype=bool), list[str]()
    surface.faces, turned, one_sided = topology.alike_wound(before.copy())
    if one_sided or not topology.is_closed(surface.faces):
        return unchanged
    if turned:
        surface.repairs.append(_turned(turned))
    try:
        turn_outward(surface)
    except MeshError:
        return unchanged
    return (surface.faces != before).any(axis=1), surface.repairs


def _turned(count: int) -> str:
    return f"turned {counted(count, 'triangle')} wound against the neighbours"


def merge_and_clean(surface: MeshInRepair) -> None:
    """Merge vertices at the same place, drop degenerate and repeated triangles; MeshError if none is left."""
    before = len(surface.vertices)
    surface.vertices, surface.faces = topology.merged_vertices(surface.vertices, surface.faces)
    if len(surface.vertices) < before:
        surface.merged.append(
            f"merged {counted(before, 'vertex')} into {len(surface.vertices)}: equal places, or used by no triangle"
        )
    _drop_useless_faces(surface)
    _merge_near_vertices(surface)


def _drop_useless_faces(surface: MeshInRepair) -> None:
    faces = surface.faces
    degenerate = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    if degenerate.any():
        surface.repairs.append(f"removed {counted(int(degenerate.sum()), 'degenerate triangle')}")
        faces = faces[~degenerate]
    keep = _once(faces)
    if not keep.all():
        surface.repairs.append(f"removed {counted(int((~keep).sum()), 'duplicate triangle')}")
        faces = faces[keep]
    if len(faces) == 0:
        raise surface.error("no volume: its triangles are degenerate or cancel each other")
    surface.faces = faces


def _once(faces: IntArray) -> BoolArray:
    """Mark the faces to keep so that none occurs twice, shape (F,).

    A face and its reverse cancel, unless most faces have their reverse: such a file holds both sides of one surface,
    and one of each is kept.
    """
    first = np.argmin(faces, axis=1)
    turned = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
    sign = np.where(turned[:, 1] < turned[:, 2], 1, -1)
    group = topology.distinct_rows(np.sort(faces, axis=1))[1]
    count = np.bincount(group)
    net = np.bincount(group, weights=sign)
    both_sides = np.abs(net) < count
    wanted = (np.sign(net[group]) == sign) | (2 * np.count_nonzero(both_sides) > len(count))
    keep = np.zeros(len(faces), dtype=bool)
    keep[np.flatnonzero(wanted)[np.unique(group[wanted], return_index=True)[1]]] = True
    return keep


def _open_edges(faces: IntArray) -> int:
    return int(np.count_nonzero(topology.undirected_edges(faces)[1] == 1))


def _merge_near_vertices(surface: MeshInRepair) -> None:
    before = _open_edges(surface.faces)
    if before == 0:
        return
    distance = NEAR_VERTEX * surface.size
    vertices, faces = topology.merged_vertices(surface.vertices, surface.faces, distance)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    if len(faces) and _open_edges(faces) < before:
        merged = len(surface.vertices) - len(vertices)
        surface.repairs.append(
            f"merged {counted(merged, 'vertex')} closer than {surface.millimetres(distance)} to another"
        )
        surface.vertices, surface.faces = vertices, faces
        _drop_useless_faces(surface)


def _drop_fragments(surface: MeshInRepair) -> None:
    label = topology.part_labels(surface.faces)
    if label.max() == 0:
        return
    area = topology.face_areas(surface.vertices, surface.faces)
    part_area = np.bincount(label, weights=area)
    index, count, _ = topology.undirected_edges(surface.faces)
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


def _close_holes(surface: MeshInRepair) -> None:
    caps = topology.hole_caps(surface.vertices, surface.faces)
    holes = len(caps.width)
    if holes == 0:
        return
    wide = caps.width > WIDE_HOLE * surface.size
    bent = np.flatnonzero(wide & (caps.bend > BENT_HOLE * caps.width))
    if len(bent):
        width, bend = surface.millimetres(caps.width[bent[0]]), surface.millimetres(caps.bend[bent[0]])
        bent_hole = f"a hole {width} wide is bent by {bend}, too much to close safely"
        raise surface.error(f"open: {bent_hole}; close it in a mesh editor")
    widest = surface.millimetres(float(caps.width.max()))
    faces = np.concatenate([surface.faces, caps.faces])
    label = topology.part_labels(faces)
    area = topology.face_areas(caps.vertices, faces)
    is_cap = np.arange(len(faces)) >= len(surface.faces)
    share = float(area[is_cap].sum() / area[~is_cap].sum())
    sheets = 0
    for part in np.unique(label[is_cap]):
        inside = abs(topology.signed_volume(caps.vertices, faces[label == part]))
        sheets += inside < SHEET_VOLUME * float(area[label == part].sum()) ** 1.5
    if share > CAP_AREA or sheets:
        caps_area = f"whose caps would have {100.0 * share:.0f} % of its area; give it a thickness"
        raise surface.error(f"an open surface: {counted(holes, 'hole')} up to {widest} wide, {caps_area}")
    surface.repairs.append(f"closed {counted(holes, 'hole')} up to {widest} wide")
    if wide.any():
        small = holes - int(wide.sum())
        surface.warnings.append(
            f"{counted(int(wide.sum()), 'hole')} up to {widest} wide closed{f', and {small} small' if small else ''}: "
            "it is solid there; if it should be hollow, give the wall a thickness"
        )
    surface.vertices, surface.faces = caps.vertices, faces


def _require_closed(surface: MeshInRepair) -> None:
    _, count, balance = topology.undirected_edges(surface.faces)
    if not np.any(balance):
        return
    fanned, open_edges = int(np.count_nonzero(count > 2)), int(np.count_nonzero(count == 1))
    faults = [f"{counted(fanned, 'edge')} shared by more than two triangles"] if fanned else []
    what = " and ".join(faults + ([counted(open_edges, "open edge")] if open_edges else []))
    raise surface.error(f"not watertight: {what or 'neighbours wound against each other'}; no safe repair")


def _require_unfolded(surface: MeshInRepair) -> None:
    """Raise MeshError where the triangles that have no inside behind them are more than a few."""
    vertices, faces = surface.vertices, surface.faces
    bvh = build_mesh_bvh(vertices, faces, signed=False, by_winding=True)
    area = topology.face_areas(vertices, faces)
    if len(faces) > FOLD_SAMPLES:
        # Of very many triangles those at even steps of the area decide, unless they leave a doubt.
        steps = area.sum() * (np.arange(FOLD_SAMPLES) + 0.5) / FOLD_SAMPLES
        chosen, times = np.unique(np.searchsorted(np.cumsum(area), steps), return_counts=True)
        if times[~parting_faces(bvh, vertices, faces[chosen], 0)].sum() <= 0.5 * CROSSING_SHARE * FOLD_SAMPLES:
            return
    folded = ~parting_faces(bvh, vertices, faces)
    if area[folded].sum() > CROSSING_SHARE * area.sum():
        count = counted(int(folded.sum()), "triangle")
        raise surface.error(f"folded over itself: {count} with no inside behind; no safe repair")


class Border(NamedTuple):
    """Points (n, 3) on triangles (n,), the area of each, and the winding numbers in front of it and behind it."""

    point: FloatArray
    face: IntArray
    area: FloatArray
    front: FloatArray
    back: FloatArray

    @property
    def turns(self) -> FloatArray:
        """Mean winding number of both sides: 1/2 between inside and outside, 0 where nothing is enclosed."""
        return 0.5 * (self.front + self.back)

    def share(self, chosen: BoolArray) -> float:
        """Return the share of the chosen points (n,) in the area."""
        return float(self.area[chosen].sum() / self.area.sum())


def windings_beside(bvh: MeshBvh, vertices: FloatArray, faces: IntArray, count: int, seed: int) -> Border:
    """Sample points on faces, as `hhsim.mesh.topology.face_samples`, with the winding numbers on both sides."""
    point, face, area = topology.face_samples(vertices, faces, count, np.random.default_rng(seed))
    away = BESIDE * float(np.ptp(vertices[faces].reshape(-1, 3), axis=0).max()) * face_normals(vertices, faces)[face]
    return Border(point, face, area, fast_winding_numbers(bvh, point + away), fast_winding_numbers(bvh, point - away))


def parting_faces(bvh: MeshBvh, vertices: FloatArray, faces: IntArray, samples: int = FOLD_SAMPLES) -> BoolArray:
    """Mark the faces, shape (F,), with the inside of a surface behind them and the outside before them, by winding.

    It is looked at one point of each, and at so many `samples` spread by area.
    """
    border = windings_beside(bvh, vertices, faces, samples, 0)
    wrong = (border.front > 0.5) | (border.back < 0.5)
    return np.asarray(np.bincount(border.face, weights=wrong, minlength=len(faces)) == 0.0)


def winding_faults(vertices: FloatArray, faces: IntArray) -> tuple[int, int, float, float]:
    """Count points beside both sides of a closed surface, spread evenly, whose winding number is neither 0 nor 1.

    Returns their number, that of all tested points, and the lowest and highest winding number found.
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
    bvh = build_mesh_bvh(vertices, faces, signed=False, by_winding=True)
    # Of a closed surface it is whole, and the approximation off by less than a half.
    winding = np.round(fast_winding_numbers(bvh, points))
    faulty = (winding != 0.0) & (winding != 1.0)
    return int(faulty.sum()), len(points), float(winding.min(initial=0.0)), float(winding.max(initial=0.0))


def lie_within(vertices: FloatArray, faces: IntArray, others: IntArray) -> bool:
    """Return True if the middles of all faces lie within others by winding number: what overlaps them does not."""
    if not len(others):
        return False
    bvh = build_mesh_bvh(vertices, others, signed=False, by_winding=True)
    return bool((np.abs(fast_winding_numbers(bvh, vertices[faces].mean(axis=1))) > 0.5).all())


def turn_outward(surface: MeshInRepair) -> None:
    """Wind closed parts outward; a part inside another may be wound inward: a cavity. MeshError without volume."""
    label = topology.part_labels(surface.faces)
    if not all(topology.is_closed(surface.faces[label == part]) for part in range(label.max() + 1)):
        # Parts that share an edge close each other: they are one.
        label = np.zeros_like(label)
    parts = int(label.max()) + 1
    turned = np.zeros(parts, dtype=bool)
    if topology.signed_volume(surface.vertices, surface.faces) < 0.0:
        surface.faces = surface.faces[:, ::-1].copy()
        turned[:] = True
    for part in range(parts):
        faces = surface.faces[label == part]
        if topology.signed_volume(surface.vertices, faces) >= 0.0:
            continue
        if not lie_within(surface.vertices, faces, surface.faces[label != part]):
            surface.faces[label == part] = faces[:, ::-1]
            turned[part] = not turned[part]
    if turned.any():
        which = "" if parts == 1 else f"{np.count_nonzero(turned)} of {parts} parts "
        surface.repairs.append(f"{which}wound inside out: turned")
    volume = topology.signed_volume(surface.vertices, surface.faces)
    if volume <= 1e-9 * surface.size**3:
        raise surface.error(f"no volume: it encloses {1e9 * volume * surface.unit_length**3:.3g} mm³; expected a solid")


def joined_parts(surface: MeshInRepair) -> bool:
    """Join parts that overlap where that is safe; return False, and leave all as it is, where a part crosses itself."""
    with suppress(MeshError):
        faulty, tested, _, _ = _join(surface)
        return faulty <= CROSSING_SHARE * tested
    return False


def _join(surface: MeshInRepair) -> tuple[int, int, float, float]:
    """Join parts that overlap, and return what `winding_faults` finds then; MeshError if a part crosses itself."""
    found = winding_faults(surface.vertices, surface.faces)
    if found[0] and (parts := int(topology.part_labels(surface.faces).max()) + 1) > 1:
        _require_sound_parts(surface)
        joined = _union_of_parts(surface)
        if joined is not None:
            surface.vertices, surface.faces = joined
            left = int(topology.part_labels(surface.faces).max()) + 1
            surface.repairs.append(f"joined {parts} overlapping parts into {left}")
            found = winding_faults(surface.vertices, surface.faces)
    return found


def _crossing(found: tuple[int, int, float, float]) -> str:
    faulty, tested, low, high = found
    where = f"at {faulty} of {tested} points beside the surface (from {low:.2f} to {high:.2f})"
    return f"the winding number is neither 0 nor 1 {where}; no safe repair"


def _require_sound_parts(surface: MeshInRepair) -> None:
    """Raise a MeshError where a part crosses itself: a union would lose what is inside out there."""
    label = topology.part_labels(surface.faces)
    for part in range(int(label.max()) + 1):
        faces = surface.faces[label == part]
        inward = topology.signed_volume(surface.vertices, faces) < 0.0
        found = winding_faults(surface.vertices, faces[:, ::-1] if inward else faces)
        if found[0] > CROSSING_SHARE * found[1]:
            raise surface.error(f"a part crosses itself: {_crossing(found)}")


def _union_of_parts(surface: MeshInRepair) -> tuple[FloatArray, IntArray] | None:
    """Union of the parts; None where one is a cavity, or no manifold."""
    from manifold3d import Manifold, OpType

    label, solids = topology.part_labels(surface.faces), list[Manifold]()
    for part in range(int(label.max()) + 1):
        faces = surface.faces[label == part]
        solid = topology.manifold_of(*topology.merged_vertices(surface.vertices, faces))
        if solid is None or topology.signed_volume(surface.vertices, faces) < 0.0:
            return None
        solids.append(solid)
    vertices, faces = topology.triangles_of(Manifold.batch_boolean(solids, OpType.Add))
    if len(faces) == 0 or not topology.is_closed(faces):
        return None
    return topology.in_fixed_order(vertices, faces)
