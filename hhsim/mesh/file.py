"""Mesh files: any format that trimesh reads, as plain arrays in the file's own unit; and exact binary PLY."""

import bz2
import gzip
import json
import warnings
import zipfile
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import DamagedFileError, InputError, MeshError
from hhsim.system.child_reader import read_in_child
from hhsim.system.input_file import check_ordinary, media_kind_of, most_unpacked, open_input

ENCODING_GUESSER = "charset_normalizer"
"""Package that trimesh asks for the encoding of a text that is not UTF-8."""
ARCHIVES = ("zip", "tar.bz2", "tar.gz", "bz2")
"""Kinds of files that hold mesh files, one that ends as another one before it."""
INSTEAD = {
    **dict.fromkeys(("step", "stp", "iges", "igs"), "a CAD model; export STL, OBJ or PLY"),
    **dict.fromkeys(("fbx", "blend", "usd", "usdc", "usdz", "3ds"), "a 3-D scene; export OBJ, PLY, STL or GLB"),
    "xacro": "a robot with macros of xacro; expand it: xacro FILE > FILE.urdf",
}
"""What a file that holds no mesh that is read is, and what to do."""
MEMORY_OF_A_BYTE = 10
"""Memory that reading a byte of a mesh's text takes [byte], or a little more."""


def read_triangles(path: Path) -> tuple[FloatArray, IntArray]:
    """Read vertices (V, 3) in the file's unit and faces (F, 3), unmerged; the parts of a scene are joined in its frame.

    Raises InputError for no such file, or a folder; MeshError for a format that trimesh does not read, a broken file,
    or one without triangles.
    """
    import trimesh

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
    known = sorted(trimesh.available_formats())
    if kind not in known:
        media = media_kind_of(path)
        if media:
            raise MeshError(f"{path}: {media}; expected a mesh: {', '.join(known)}")
        if kind in INSTEAD:
            raise MeshError(f"{path}: {INSTEAD[kind]}")
        what = f"unknown mesh format '.{kind}'" if kind else "no suffix that says which mesh format it is"
        raise MeshError(f"{path}: {what}; known: {', '.join(known)}")
    size = _unpacked_size(path)
    try:
        # The readers raise whatever their parser trips over: IndexError, KeyError, struct.error and more.
        refusal = f"cannot be read as .{kind}: damaged, too large, or of another kind"
        return read_in_child(lambda: _triangles(path, kind), refusal, size)
    except DamagedFileError as error:
        raise MeshError(f"{path}: {error}") from None


def _triangles(path: Path, kind: str) -> tuple[FloatArray, IntArray]:
    """Read vertices and faces, and import the rest of what the format needs; errors as of `read_triangles`."""
    import trimesh

    try:
        # What numpy warns of inside the readers (NaN in a normal, say) is found by the checks that follow.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = [
                part
                for file, each, resolver in _files(path, kind)
                for part in trimesh.load_scene(file, file_type=each, process=False, resolver=resolver).dump()
            ]
            parts = [part for part in found if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    except ImportError as error:
        if error.name == ENCODING_GUESSER:
            # A damaged binary STL lands here: what is no whole one, trimesh takes for text.
            raise MeshError(f"{path}: cannot be read as .{kind}, so it is damaged, or of another kind") from error
        raise MeshError(f"{path}: cannot be read as .{kind} without the package {error.name or error}") from error
    if not parts:
        raise MeshError(f"{path}: no triangles; expected a surface mesh")
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    vertices = np.concatenate([np.asarray(part.vertices, dtype=np.float64) for part in parts])
    faces = np.concatenate([np.asarray(part.faces, dtype=np.int64) + start for part, start in zip(parts, starts)])
    return vertices, faces


def _files(path: Path, kind: str) -> Iterator[tuple[Any, str, Any]]:
    """Yield the mesh files in a file, with kind and resolver: itself, or those of an archive."""
    import trimesh

    with open_input(path) as file:
        if kind not in ARCHIVES:
            _require_tree_of_nodes(file, kind, str(path))
            yield file, kind, _ordinary_files_beside(path)
            return
        alone = {path.stem: BytesIO(bz2.decompress(file.read()))} if kind == "bz2" else {}
        members: dict[str, Any] = alone or trimesh.util.decompress(file, kind.partition(".")[0])
        for name, member in members.items():
            each = Path(name).suffix.lower().removeprefix(".")
            # A Mac puts notes of its own into archives, under the names of the files.
            if each in trimesh.available_formats() and each not in ARCHIVES and "__MACOSX" not in name:
                _require_tree_of_nodes(member, each, f"{path}: {name}")
                yield member, each, trimesh.resolvers.ZipResolver(members)


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


def _require_tree_of_nodes(file: Any, kind: str, name: str) -> None:
    """Raise MeshError for a glTF document with a node under two others, or under itself; the file is at its beginning.

    Its readers leave such a node out, or take it for the root.
    """
    if kind not in ("glb", "gltf"):
        return
    head = file.read(20) if kind == "glb" else b""
    nodes = json.loads(file.read(int.from_bytes(head[12:16], "little") if head else -1)).get("nodes", [])
    file.seek(0)
    below = [node.get("children", []) for node in nodes]
    children = [child for each in below for child in each]
    reached = sorted(set(range(len(nodes))) - set(children))
    # Each node is the child of one other at most, so this ends.
    if len(set(children)) == len(children):
        for node in reached:
            reached += below[node]
    if len(reached) != len(nodes):
        raise MeshError(f"{name}: its nodes go in a circle, or one has two parents; expected a tree of nodes")


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
