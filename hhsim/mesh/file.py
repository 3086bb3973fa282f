"""Mesh files: any format that trimesh reads, as plain arrays in the file's own unit; and exact binary PLY."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, MeshError
from hhsim.system.input_file import check_ordinary, media_kind_of

ENCODING_GUESSER = "charset_normalizer"
"""Package that trimesh asks for the encoding of a text that is not UTF-8."""


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
    kind = path.suffix.lower().removeprefix(".")
    known = sorted(trimesh.available_formats())
    if kind not in known:
        media = media_kind_of(path)
        if media:
            raise MeshError(f"{path}: {media}; expected a mesh: {', '.join(known)}")
        what = f"unknown mesh format '.{kind}'" if kind else "no suffix that says which mesh format it is"
        raise MeshError(f"{path}: {what}; known: {', '.join(known)}")
    try:
        # What numpy warns of inside the readers (NaN in a normal, say) is found by the checks that follow.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            scene = trimesh.load_scene(path, process=False, resolver=_ordinary_files_beside(path))
            parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    except MemoryError:
        raise
    except ImportError as error:
        if error.name == ENCODING_GUESSER:
            # A damaged binary STL lands here: what is no whole one, trimesh takes for text.
            raise MeshError(f"{path}: cannot be read as .{kind}, so it is damaged, or of another kind") from error
        raise MeshError(f"{path}: cannot be read as .{kind} without the package {error.name or error}") from error
    except Exception as error:
        # The readers raise whatever their parser trips over: IndexError, KeyError, struct.error and more.
        reason = " ".join(f"{type(error).__name__}: {error}".rstrip(": ").split())
        raise MeshError(f"{path}: cannot be read as .{kind}: damaged, or of another kind ({reason[:200]})") from error
    if not parts:
        raise MeshError(f"{path}: no triangles; expected a surface mesh")
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    vertices = np.concatenate([np.asarray(part.vertices, dtype=np.float64) for part in parts])
    faces = np.concatenate([np.asarray(part.faces, dtype=np.int64) + start for part, start in zip(parts, starts)])
    return vertices, faces


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
