"""Mesh files: any format that trimesh reads, as plain arrays in the file's own unit."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import InputError, MeshError


def read_triangles(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read the triangles of a file; the parts of a scene are joined in the scene's frame.

    Returns:
        Vertices in the file's unit, shape (V, 3), and faces, shape (F, 3), as they stand in the file: nothing is merged
        or removed.

    Raises:
        InputError: No such file, or a folder.
        MeshError: A format that trimesh does not read, a broken file, or one without triangles.
    """
    import trimesh

    if not path.exists():
        raise InputError(f"{path}: no such mesh file")
    if path.is_dir():
        raise InputError(f"{path}: a folder; expected a mesh file")
    kind = path.suffix.lower().removeprefix(".")
    known = sorted(trimesh.available_formats())
    if kind not in known:
        raise MeshError(f"{path}: unknown mesh format '.{kind}'; known: {', '.join(known)}")
    try:
        scene = trimesh.load_scene(path, process=False)
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    except MemoryError:
        raise
    except Exception as error:
        # trimesh's readers raise whatever their parser trips over: IndexError, KeyError, struct.error and more.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise MeshError(f"{path}: cannot be read as .{kind}: {reason[:200]}") from error
    if not parts:
        raise MeshError(f"{path}: no triangles; expected a surface mesh")
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    vertices = np.concatenate([np.asarray(part.vertices, dtype=np.float64) for part in parts])
    faces = np.concatenate([np.asarray(part.faces, dtype=np.int64) + start for part, start in zip(parts, starts)])
    return vertices, faces
