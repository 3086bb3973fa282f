"""Mesh files: OBJ, OFF, STL, any other format that trimesh reads, as plain arrays; and exact binary PLY.

Of points and polygons (OBJ, OFF and STL) all that a file states is read, or it is refused.
"""

import bz2
import gzip
import re
import warnings
import zipfile
from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable, Iterator, Mapping
from io import BytesIO, TextIOWrapper
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import DamagedFileError, InputError, MeshError
from hhsim.mesh.scene_formats import STATED
from hhsim.mesh.topology import polygon_triangles
from hhsim.system.child_reader import read_in_child
from hhsim.system.counted import counted
from hhsim.system.input_file import check_ordinary, media_kind_of, most_unpacked, open_input

ARCHIVES = ("zip", "tar.bz2", "tar.gz", "bz2")
"""Kinds of files that hold mesh files, one that ends as another one before it."""
INSTEAD = {
    **dict.fromkeys(("step", "stp", "iges", "igs"), "a CAD model; export STL, OBJ or PLY"),
    **dict.fromkeys(("fbx", "blend", "usd", "usdc", "usdz", "3ds"), "a 3-D scene; export OBJ, PLY, STL or GLB"),
    "xacro": "a robot with macros of xacro; expand it: xacro FILE > FILE.urdf",
}
"""What a file that holds no mesh that is read is, and what to do."""
PACKAGES = {"dae": "pycollada", "zae": "pycollada"}
"""Kinds of files that trimesh reads with a package that does not come with hhsim."""
MEMORY_OF_A_BYTE = 10
"""Memory that reading a byte of a mesh's text takes [byte], or a little more."""
COARSEST = 1e-3
"""Largest resolution that numbers far from the origin may leave, as a share of the mesh's longest extent."""
NO_END = "its last solid has no 'endsolid': the file may be cut"

_STL_HEAD = 84
_STL_FACET = np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("attribute", "<u2")])


class Triangles(NamedTuple):
    """Triangles of a file, unmerged; the parts of a scene are joined in its frame."""

    vertices: FloatArray  # in the unit of the file, shape (V, 3)
    faces: IntArray  # corner indices, shape (F, 3)
    metre: float | None = None  # length of the unit that the file states [m]; None if it states none
    warnings: tuple[str, ...] = ()  # suspicions, a sentence each


def text_of(content: bytes) -> str:
    """Decode text with any byte-order mark or none, its lines ended by a newline; MeshError where it is none."""
    is_wide = content.startswith((BOM_UTF16_LE, BOM_UTF16_BE))
    with TextIOWrapper(BytesIO(content), "utf-16" if is_wide else "utf-8-sig", "replace") as file:
        text = file.read()
    if "\0" in text:
        raise MeshError("damaged, or of another kind")
    return text


def read_obj(content: bytes) -> Triangles:
    """Read all faces of an OBJ; a relative index counts back from its own line."""
    points, corners, sizes = list[list[str]](), list[int](), list[int]()
    for number, line in enumerate(text_of(content).replace("\\\n", " ").split("\n"), 1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if words[0] == "v":
            if len(words) < 4:
                raise MeshError(f"line {number} reads '{line.strip()[:60]}', expected v x y z")
            points.append(words[1:4])
        elif words[0] == "f":
            try:
                ring = [int(word.partition("/")[0]) for word in words[1:]]
            except ValueError:
                ring = [0]
            # Indices count from 1, or back from the last vertex so far.
            if len(ring) < 3 or 0 in ring or len(points) + min(ring) < 0:
                raise MeshError(f"line {number} reads '{line.strip()[:60]}', expected f with three vertices or more")
            corners += [index - 1 if index > 0 else len(points) + index for index in ring]
            sizes.append(len(ring))
    return _cut(points, corners, sizes)


def read_off(content: bytes) -> Triangles:
    """Read an OFF as long as its own counts say."""
    lines = [words for line in text_of(content).split("\n") if (words := line.partition("#")[0].split())]
    head = re.fullmatch(r"(ST|C|N)*OFF(.*)", " ".join(lines[0])) if lines else None
    if head is None:
        raise MeshError("the first line does not read OFF")
    counts, rows = (head[2].split(), lines[1:]) if head[2].strip() else (lines[1] if lines[1:] else [], lines[2:])
    if len(counts) < 2 or not (counts[0].isdecimal() and counts[1].isdecimal()):
        raise MeshError("expected the numbers of its vertices and faces below OFF")
    points, faces = int(counts[0]), int(counts[1])
    rings = [row[1 : 1 + int(row[0])] for row in rows[points : points + faces]]
    complete = sum(len(ring) == int(row[0]) for ring, row in zip(rings, rows[points:]))
    if complete < faces or any(len(row) < 3 for row in rows[:points]):
        raise MeshError(f"{complete:,} of {faces:,} faces are there: is the file cut?")
    corners = [int(index) for ring in rings for index in ring]
    return _cut([row[:3] for row in rows[:points]], corners, [len(ring) for ring in rings])


def read_stl(content: bytes) -> Triangles:
    """Read a binary STL of the length that it states, or all solids of one that is text."""
    stated = int.from_bytes(content[80:_STL_HEAD], "little")
    if len(content) == _STL_HEAD + stated * _STL_FACET.itemsize:
        corner = np.frombuffer(content, _STL_FACET, offset=_STL_HEAD)["corner"].reshape(-1, 3)
        return Triangles(corner.astype(np.float64), np.arange(len(corner)).reshape(-1, 3))
    text = text_of(content).lower()
    facets = len(re.findall(r"^\s*facet\b", text, re.MULTILINE))
    if text.strip() and not facets and not re.match(r"\s*solid\b", text):
        raise MeshError("damaged, or of another kind")
    rows = [row.split() for row in re.findall(r"^\s*vertex\b(.*)$", text, re.MULTILINE)]
    if len(rows) != 3 * facets or any(len(row) != 3 for row in rows):
        raise MeshError(f"{counted(facets, 'facet')} and {counted(len(rows), 'vertex')}: is the file cut?")
    ends = len(re.findall(r"^\s*endsolid\b", text, re.MULTILINE))
    is_cut = ends < len(re.findall(r"^\s*solid\b", text, re.MULTILINE))
    faces = np.arange(len(rows)).reshape(-1, 3)
    return Triangles(_numbers(rows), faces, warnings=(NO_END,) if is_cut else ())


READERS: Mapping[str, Callable[[bytes], Triangles]] = {
    "obj": read_obj,
    "off": read_off,
    "stl": read_stl,
    "stl_ascii": read_stl,
}
"""Reader of each format, which raises MeshError or ValueError for one that is not whole."""


def _cut(points: list[list[str]], corners: list[int], sizes: list[int]) -> Triangles:
    vertices, index = _numbers(points), np.array(corners, dtype=np.int64)
    if len(index) and not 0 <= index.min() <= index.max() < len(points):
        raise MeshError(f"a face names vertex {index.max() + 1:,} of {len(points):,}")
    return Triangles(vertices, polygon_triangles(vertices, index, np.array(sizes, dtype=np.int64)))


def _numbers(rows: list[list[str]]) -> FloatArray:
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def read_triangles(path: Path) -> tuple[FloatArray, IntArray]:
    """Read vertices (V, 3) and faces (F, 3) as `read_mesh`, in metres where the file states its unit, else in that."""
    found = read_mesh(path)
    return found.vertices * (found.metre or 1.0), found.faces


def read_mesh(path: Path) -> Triangles:
    """Read a mesh file.

    Raises InputError for no such file, or a folder; MeshError for an unknown format, a broken file, one without
    triangles or of which triangles are lost, or numbers so far from the origin that they do not hold the shape.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file; expected a mesh")
    if path.is_dir():
        raise InputError(f"{path}: a folder; expected a mesh file")
    try:
        check_ordinary(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; expected a mesh") from None
    name = path.name.lower()
    kind = next((each for each in ARCHIVES if name.endswith(f".{each}")), path.suffix.lower().removeprefix("."))
    if kind not in READERS:
        _require_known(path, kind)
    size = _unpacked_size(path)
    try:
        # The readers raise whatever their parser trips over: IndexError, KeyError, struct.error and more.
        refusal = f"cannot be read as .{kind}: damaged, too large, or of another kind"
        found = read_in_child(lambda: _joined(path, kind), refusal, size)
    except DamagedFileError as error:
        raise MeshError(f"{path}: {error}") from None
    _require_resolution(found.vertices, str(path))
    return found


def _require_known(path: Path, kind: str) -> None:
    """Raise MeshError for a kind of file that trimesh, which is imported, does not read."""
    import trimesh

    formats = trimesh.available_formats()
    if kind in formats:
        return
    if kind in INSTEAD:
        raise MeshError(f"{path}: {INSTEAD[kind]}")
    if kind in PACKAGES:
        raise MeshError(f"{path}: .{kind} is read with the package {PACKAGES[kind]}: pip install {PACKAGES[kind]}")
    known = ", ".join(sorted(formats))
    media = media_kind_of(path)
    if media:
        raise MeshError(f"{path}: {media}; expected a mesh: {known}")
    what = f"unknown mesh format '.{kind}'" if kind else "no suffix that says which mesh format it is"
    raise MeshError(f"{path}: {what}; known: {known}")


def _require_resolution(vertices: FloatArray, name: str) -> None:
    """Raise MeshError where the numbers' type does not hold the shape so far from the origin."""
    if not np.isfinite(vertices).all():
        return
    farthest, extent = float(np.abs(vertices).max()), float(np.ptp(vertices, axis=0).max())
    # Most formats of 3-D hold numbers of 32 bits.
    with np.errstate(over="ignore"):
        is_single = np.array_equal(vertices, vertices.astype(np.float32))
    left = float(np.spacing(np.float32(farthest)) if is_single else np.spacing(farthest))
    if left > COARSEST * extent > 0.0 or (extent == 0.0 and left > COARSEST):
        far = f"its numbers, up to {farthest:.7g}, hold steps of {left:.2g} alone, and the mesh is {extent:.3g} long"
        raise MeshError(f"{name}: {far}: move it to the origin, in the program that made it")


def _joined(path: Path, kind: str) -> Triangles:
    """Read all meshes of a file, and import the rest of what the format needs; errors as of `read_mesh`."""
    found = list[Triangles]()
    for name, content, each, resolver in _files(path, kind):
        try:
            found += _parts(content, each, resolver)
        except MeshError as error:
            raise MeshError(f"{name}: {error}") from error
    if not found:
        raise MeshError(f"{path}: no triangles; expected a surface mesh")
    metres = {part.metre for part in found}
    if len(metres) > 1:
        raise MeshError(f"{path}: it holds meshes of several units; expected those of one")
    starts = np.cumsum([0] + [len(part.vertices) for part in found[:-1]])
    return Triangles(
        np.concatenate([part.vertices for part in found]),
        np.concatenate([part.faces + start for part, start in zip(found, starts)]),
        metres.pop(),
        tuple(warning for part in found for warning in part.warnings),
    )


def _parts(content: bytes, kind: str, resolver: Any) -> list[Triangles]:
    """Return the meshes in the content of a file that have triangles.

    The number of triangles is held against what the file states.
    """
    if kind in READERS:
        try:
            read = READERS[kind](content)
        except (MeshError, ValueError) as error:
            raise MeshError(f"cannot be read as .{kind}: {error}") from error
        return [read] if len(read.faces) else []
    import trimesh

    stated = STATED[kind](content) if kind in STATED else None
    try:
        # What numpy warns of inside the readers (NaN in a normal, say) is found by the checks that follow.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            file = BytesIO(content.removeprefix(BOM_UTF8))
            scene = trimesh.load_scene(file, file_type=kind, process=False, resolver=resolver)
            meshes = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    except ImportError as error:
        raise MeshError(f"cannot be read as .{kind} without the package {error.name or error}") from error
    if kind == "ply":
        return [_of_ply(mesh, content) for mesh in meshes]
    lost = 0 if stated is None else stated.triangles - sum(len(mesh.faces) for mesh in meshes)
    if stated is not None and lost:
        what = f"{stated.triangles - lost:,} triangles of the {stated.triangles:,} that it states were read"
        raise MeshError(f"{what}: save it anew, as plain triangles")
    metre = None if stated is None else stated.metre
    return [
        Triangles(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64), metre) for mesh in meshes
    ]


def _of_ply(mesh: Any, content: bytes) -> Triangles:
    """Return the mesh of a PLY, whose polygons are cut anew, since trimesh makes a fan of each."""
    raw = mesh.metadata["_ply_raw"]
    data = raw["face"]["data"]
    names = data if isinstance(data, dict) else data.dtype.names
    name = next((name for name in names if name in ("vertex_index", "vertex_indices")), next(iter(names)))
    rings = data[name] if isinstance(data, dict) else data[name]["f1"]
    stated = re.search(rb"element\s+face\s+(\d+)", content)
    is_even = isinstance(rings, np.ndarray) and rings.ndim == 2
    sizes = np.full(len(rings), rings.shape[1]) if is_even else np.array([len(ring) for ring in rings])
    if stated is None or len(rings) != int(stated[1]) or sizes.min() < 3:
        raise MeshError(f"{len(rings):,} faces are there, or some have no three corners: is the file cut?")
    place = raw["vertex"]["data"]
    vertices = np.stack([np.ravel(place[axis]) for axis in "xyz"], axis=1).astype(np.float64)
    corners = np.ravel(rings) if is_even else np.concatenate([np.ravel(ring) for ring in rings])
    return Triangles(vertices, polygon_triangles(vertices, corners.astype(np.int64), sizes))


def _files(path: Path, kind: str) -> Iterator[tuple[str, bytes, str, Any]]:
    """Yield the mesh files in a file, with name, content, kind and resolver: itself, or those of an archive."""
    with open_input(path) as file:
        if kind not in ARCHIVES:
            yield str(path), file.read(), kind, _ordinary_files_beside(path)
            return
        import trimesh

        alone = {path.stem: BytesIO(bz2.decompress(file.read()))} if kind == "bz2" else {}
        members: dict[str, Any] = alone or trimesh.util.decompress(file, kind.partition(".")[0])
        for name, member in members.items():
            each = Path(name).suffix.lower().removeprefix(".")
            # A Mac puts notes of its own into archives, under the names of the files.
            if each in trimesh.available_formats() and each not in ARCHIVES and "__MACOSX" not in name:
                yield f"{path}: {name}", member.read(), each, trimesh.resolvers.ZipResolver(members)


def _unpacked_size(path: Path) -> int:
    """Return the size of a file's content, unpacked [byte]; MeshError for more than such a file can be of."""
    size = packed = path.stat().st_size
    most = most_unpacked(packed) // MEMORY_OF_A_BYTE
    try:
        with open_input(path) as file:
            if zipfile.is_zipfile(file):
                with zipfile.ZipFile(file) as archive:
                    size = sum(entry.file_size for entry in archive.infolist())
            elif path.suffix.lower() in (".bz2", ".gz"):
                file.seek(0)
                with (bz2 if path.suffix.lower() == ".bz2" else gzip).open(file) as unpacked:
                    size = 0
                    while size <= most and (piece := unpacked.read(1 << 20)):
                        size += len(piece)
    except (zipfile.BadZipFile, EOFError, OSError, ValueError, NotImplementedError) as error:
        raise MeshError(f"{path}: a damaged archive: {' '.join(str(error).split())[:120]}") from None
    if size > packed and size > most:
        raise MeshError(f"{path}: {size:,} bytes or more in an archive of {packed:,}; expected a mesh")
    return size


def _ordinary_files_beside(path: Path) -> Any:
    """Resolver of the buffers and materials that a mesh file names; it refuses those that are no ordinary files."""
    from trimesh.resolvers import FilePathResolver

    class Resolver(FilePathResolver):
        def get(self, name: str) -> Any:
            for word in (name.strip(), name.strip().lstrip("/"), Path(name).name):
                beside = Path(self.parent) / word
                if beside.exists():
                    check_ordinary(beside)
            return super().get(name)

    return Resolver(str(path))


PLY_VERTEX = np.dtype([("x", "<f8"), ("y", "<f8"), ("z", "<f8")])
PLY_FACE = np.dtype([("count", "u1"), ("corner", "<i4", (3,))])


def read_own_ply(content: bytes, name: str) -> tuple[FloatArray, IntArray]:
    """Read binary PLY with 64-bit coordinates, as the shipped meshes are, without trimesh, whose import costs more."""
    head, _, body = content.partition(b"end_header\n")
    counts = [
        int(line.split()[-1]) for line in head.decode("ascii", "replace").splitlines() if line.startswith("element ")
    ]
    split = counts[0] * PLY_VERTEX.itemsize if len(counts) == 2 else 0
    if len(counts) != 2 or len(body) != split + counts[1] * PLY_FACE.itemsize:
        raise MeshError(f"{name}: truncated, or no binary PLY with double coordinates and triangles")
    points = np.frombuffer(body[:split], dtype=PLY_VERTEX)
    triangles = np.frombuffer(body[split:], dtype=PLY_FACE)
    vertices = np.stack([points["x"], points["y"], points["z"]], axis=1)
    return vertices, triangles["corner"].astype(np.int64)
