"""A triangle mesh in metres, and how a file becomes one."""

import hashlib
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, MeshError
from hhsim.mesh.file import read_mesh
from hhsim.mesh.topology import Shell, is_closed, merged_vertices
from hhsim.ranges import check_range
from hhsim.reproducible import dot, matmul, norm

METRES_PER_UNIT = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254}
"""Units that `load_mesh` takes, and their length [m]."""

UNIT_NAMES = {"mm": "millimetres", "m": "metres", "cm": "centimetres", "inch": "inches"}
"""Their names in words, the most usual first."""
SMALLEST_USUAL_EXTENT = 0.02
LARGEST_USUAL_EXTENT = 3.0
"""Outside of this range [m], from a bottle's cap to a door, the unit is doubted."""
SMALLEST_EXTENT = 0.001
LARGEST_EXTENT = 20.0
"""Outside of this range [m] a mesh is refused: no hand can use it, and the unit is wrong."""
SMALLEST_NUMBER = 1e-6
LARGEST_NUMBER = 1e6
"""Outside of this range a file's own extent is refused: its squares and cubes lose their digits."""


@dataclass(frozen=True, eq=False, repr=False)
class Mesh:
    """A surface of triangles: closed and counter-clockwise seen from outside, unless it was taken as it is.

    Raises MeshError for wrong shapes, no triangle, non-finite vertices, or an index that no vertex has.
    """

    vertices: FloatArray  # corner positions [m], shape (V, 3), float64, C-contiguous
    faces: IntArray  # corner indices of each triangle, shape (F, 3), int64, C-contiguous
    name: str = "mesh"  # short name for tables and messages
    source: str = ""  # path, or the generator with its parameters
    repairs: tuple[str, ...] = field(default=())  # repairs and assumptions, one plain sentence each
    warnings: tuple[str, ...] = field(default=())  # suspicions that do not stop the work, one plain sentence each
    shell: Shell | None = field(default=None)  # None of a solid; else the faces are a skin: the file's, as they are

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, dtype=np.float64, order="C")
        faces = np.array(self.faces, dtype=np.int64, order="C")
        require_usable_arrays(vertices, faces, self.name)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)

    def __eq__(self, other: object) -> bool:
        """Return True for a mesh of the same vertices and triangles, whatever it is called."""
        return isinstance(other, Mesh) and self.sha256 == other.sha256

    def __hash__(self) -> int:
        return hash(self.sha256)

    def __repr__(self) -> str:
        size = " x ".join(f"{1e3 * length:.1f}" for length in self.extent)
        return f"Mesh({self.name}: {len(self.vertices):,} vertices, {len(self.faces):,} triangles, {size} mm)"

    @cached_property
    def triangles(self) -> FloatArray:
        """Corner positions of each triangle [m], shape (F, 3, 3)."""
        return np.ascontiguousarray(self.vertices[self.faces])

    @cached_property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the axis-aligned box around the triangles [m], shape (2, 3)."""
        corners = self.triangles.reshape(-1, 3)
        return np.stack([corners.min(axis=0), corners.max(axis=0)])

    @property
    def box_corners(self) -> FloatArray:
        """Eight corners of that box [m], shape (8, 3)."""
        return np.array(np.meshgrid(*self.bounds.T)).reshape(3, -1).T

    @property
    def extent(self) -> FloatArray:
        """Edge lengths of the axis-aligned box [m], shape (3,)."""
        return np.asarray(self.bounds[1] - self.bounds[0], dtype=np.float64)

    @cached_property
    def volume(self) -> float:
        """Enclosed volume [m³]; negative when the triangles are wound inside out."""
        a, b, c = (self.triangles - self.bounds.mean(axis=0)).transpose(1, 0, 2)
        return float(dot(a, np.cross(b, c)).sum() / 6.0)

    @cached_property
    def sha256(self) -> str:
        """Content hash (hex) of the vertices as little-endian float64 and the faces as little-endian int64."""
        digest = hashlib.sha256(self.vertices.astype("<f8").tobytes())
        digest.update(self.faces.astype("<i8").tobytes())
        return digest.hexdigest()

    def obj(self) -> str:
        """Return the text of a Wavefront OBJ file [m], in full precision."""
        lines = [f"# {self.name or 'object'} [m], right-handed, z up"]
        lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in self.vertices.tolist()]
        return "\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in (self.faces + 1).tolist()), ""])

    def scaled(self, factor: float) -> "Mesh":
        """Return the mesh scaled about the origin by a positive factor [-]."""
        shell = self.shell and self.shell._replace(vertices=self.shell.vertices * factor)
        return replace(self, vertices=self.vertices * factor, shell=shell)

    def transformed(self, rotation: ArrayLike, translation: ArrayLike) -> "Mesh":
        """Return the mesh moved by `rotation @ vertex + translation`; shapes (3, 3) and (3,) [m]."""

        def moved(points: FloatArray) -> FloatArray:
            return matmul(points, np.asarray(rotation, np.float64).T) + np.asarray(translation, np.float64)

        shell = self.shell and self.shell._replace(vertices=moved(self.shell.vertices))
        return replace(self, vertices=moved(self.vertices), shell=shell)


def most_protrusion(mesh: Mesh) -> float:
    """Return the diagonal of a mesh's box, and 1 % for rounding [m]: the ball around the box sticks out by no more."""
    return 1.01 * float(norm(mesh.extent))


def require_usable_arrays(vertices: FloatArray, faces: IntArray, name: str) -> None:
    """Raise a MeshError unless these are finite (V, 3) vertices and at least one (F, 3) triangle of valid indices."""
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise MeshError(f"{name}: vertices have shape {vertices.shape}, expected (V, 3)")
    if faces.size == 0:
        raise MeshError(f"{name}: no triangles; expected a surface mesh")
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise MeshError(f"{name}: faces have shape {faces.shape}, expected (F, 3)")
    broken = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if broken.size:
        count = f"{broken.size} of {len(vertices)} vertices"
        raise MeshError(f"{name}: {count} are NaN or infinite, first at index {broken[0]}; export the mesh again")
    bad = np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))
    if bad.size:
        count = f"{bad.size} of {len(faces)} triangles"
        where = f"first triangle {bad[0]}; expected 0 to {len(vertices) - 1}"
        raise MeshError(f"{name}: {count} name a vertex that does not exist, {where}")


def unit_length_of(path: str | Path, unit: str | None = None, size: float | None = None) -> float:
    """Return the length [m] of a mesh file's unit: the one given, that which gives it its size [m], or its own."""
    if unit is not None:
        return METRES_PER_UNIT[unit]
    found = read_mesh(Path(path))
    return found.metre or 1.0 if size is None else size / float(Mesh(found.vertices, found.faces).extent.max())


def load_mesh(path: str | Path, unit: str | None = None, size: float | None = None, solid: bool | None = True) -> Mesh:
    """Read a mesh file, scale it to metres, check it and give it an inside.

    What is safe to repair is repaired. Otherwise the inside is where the winding number of the triangles exceeds 1/2,
    if they enclose nearly all of it; else the mesh is refused.

    Args:
        path: Any format that trimesh reads (.obj .stl .ply .off .glb …); the parts of a scene are joined.
        unit: Length unit of the file: m, cm, mm or inch. None for the one that the file states, or else m.
        size: Longest extent of the mesh [m]; replaces `unit`.
        solid: False takes the triangles as they are, closed or not, and turns those whose turning alone gives them an
            inside: for contact with the mesh itself. None makes a solid where that leaves the triangles as they are;
            else they are a skin for a sphere tree to cover, see `hhsim.mesh.own_triangles`.

    Raises:
        InputError: No such file, an unknown unit, or a size out of its range.
        MeshError: Unreadable, empty, not finite, of absurd size, or without an inside where it is to be solid.
    """
    path = Path(path)
    if unit is not None and unit not in METRES_PER_UNIT:
        raise InputError(f"unknown unit '{unit}': known: {', '.join(METRES_PER_UNIT)}")
    if size is not None:
        check_range("size", size)
    vertices, faces, stated, warnings = read_mesh(path)
    require_usable_arrays(vertices, faces, str(path))
    mesh = Mesh(vertices, faces, name=path.stem, source=str(path))
    longest = float(mesh.extent.max())
    if longest == 0.0:
        raise MeshError(f"{path}: all vertices lie in one point; expected a surface mesh")
    unit_length = (METRES_PER_UNIT[unit] if unit else stated or 1.0) if size is None else size / longest
    if not SMALLEST_NUMBER <= longest <= LARGEST_NUMBER:
        expected = f"expected {SMALLEST_NUMBER:g} to {LARGEST_NUMBER:g}; is a vertex damaged?"
        raise MeshError(f"{path}: longest extent {longest:.3g} in the file: {expected}")
    hint = "is --size wrong?" if size is not None else size_hint(longest * unit_length, unit_length)
    mesh = with_inside(mesh, unit_length, hint, solid)
    longest = float(mesh.extent.max())
    if size is None and not SMALLEST_USUAL_EXTENT <= longest <= LARGEST_USUAL_EXTENT:
        shown = f"{longest:.3g} m" if longest > 1.0 else f"{1000.0 * longest:.3g} mm"
        warnings = (f"longest extent {shown}: {size_hint(longest, unit_length)}", *warnings)
    repairs = mesh.repairs
    if stated is not None and stated != 1.0 and unit_length == stated:
        repairs = (f"lengths taken in {_unit_name(stated)}, as the file states", *repairs)
    elif stated is not None and unit is not None and unit_length != stated:
        warnings = (f"the file states {_unit_name(stated)}, but --unit {unit} is given", *warnings)
    return replace(mesh, repairs=repairs, warnings=(*warnings, *mesh.warnings))


def with_inside(mesh: Mesh, unit_length: float = 1.0, hint: str = "", solid: bool | None = True) -> Mesh:
    """Return triangles in a unit of so many metres as a mesh in metres that has an inside, as of `load_mesh`.

    `hint` ends the message for a mesh that no hand can use. Raises MeshError, which begins with the mesh's source.
    """
    # The checks bring the compiler; who only reads the catalogue does without it.
    from hhsim.mesh.repair import turned_triangles
    from hhsim.mesh.solidify import solid_surface

    longest = float(mesh.extent.max()) * unit_length
    if not SMALLEST_EXTENT <= longest <= LARGEST_EXTENT:
        expected = f"expected {SMALLEST_EXTENT:g} to {LARGEST_EXTENT:g} m for a hand; {hint}"
        raise MeshError(f"{mesh.source}: longest extent {longest:.3g} m: {expected}")
    if solid:
        surface = solid_surface(mesh.vertices, mesh.faces, mesh.source, unit_length)
        repairs = (*surface.merged, *surface.repairs)
        found = replace(
            mesh, vertices=surface.vertices, faces=surface.faces, repairs=repairs, warnings=tuple(surface.warnings)
        )
        return found.scaled(unit_length)
    if solid is None:
        from hhsim.mesh.own_triangles import own_triangles

        return own_triangles(mesh, unit_length).scaled(unit_length)
    turned, said = turned_triangles(mesh.vertices, mesh.faces)
    if turned.any():
        faces = np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces)
        mesh = replace(mesh, faces=faces, repairs=tuple(said))
    return mesh.scaled(unit_length)


def _unit_name(metre: float) -> str:
    """Return the name of the unit of this length [m], such as "millimetres"."""
    return next((UNIT_NAMES[unit] for unit, length in METRES_PER_UNIT.items() if length == metre), f"{metre:g} m")


def size_hint(longest: float, unit_length: float) -> str:
    """Return a hint at the right unit of a file whose mesh is so long [m] in a unit of that length [m]."""
    for other, name in UNIT_NAMES.items():
        extent = longest * METRES_PER_UNIT[other] / unit_length
        if METRES_PER_UNIT[other] != unit_length and SMALLEST_USUAL_EXTENT <= extent <= LARGEST_USUAL_EXTENT:
            return f"is the file in {name}? pass --unit {other}"
    return "if that is wrong, pass --size with the right one"


LEAST_FILLED = 1e-6
"""A mesh that encloses less than this share of its longest extent cubed has sides that cancel out."""


class MassProperties(NamedTuple):
    """Volume [m³], centre of mass [m], (3,), in the mesh's frame, and inertia [m⁵], (3, 3), of a solid of density 1.

    The inertia is about the centre, in the mesh's axes; times a density [kg/m³] it is in kg·m².
    """

    volume: float
    center: FloatArray
    inertia: FloatArray


def mass_properties(mesh: Mesh) -> MassProperties:
    """Compute volume, centre and inertia of the inside of a mesh; MeshError if it has none, or is wound inside out."""
    # Corners of equal places are one: a file may have given each triangle its own.
    if not is_closed(merged_vertices(mesh.vertices, mesh.faces)[1]):
        raise MeshError(
            f"{mesh.name}: not closed, so it has no mass; let hhsim close it (--surface spheres), or let the object "
            "stand still"
        )
    if mesh.volume <= LEAST_FILLED * float(mesh.extent.max()) ** 3:
        filled = f"the triangles enclose {1e6 * mesh.volume:.3g} cm³"
        raise MeshError(f"{mesh.name}: {filled}: no mass; a free object needs a solid, wound outward")
    origin = mesh.bounds.mean(axis=0)
    corners = mesh.triangles - origin
    a, b, c = corners.transpose(1, 0, 2)
    volumes = dot(a, np.cross(b, c)) / 6.0
    volume = float(volumes.sum())
    sums = corners.sum(axis=1)
    center = dot(sums.T, volumes) / (4.0 * volume)
    places = [*corners.transpose(1, 2, 0), sums.T]
    products = np.array([[sum(dot(volumes * p[i], p[j]) for p in places) for j in range(3)] for i in range(3)])
    second = products / 20.0 - volume * np.outer(center, center)
    return MassProperties(volume, center + origin, np.trace(second) * np.eye(3) - second)
