"""Mesh files with bounds; the exact binary PLY: read back bit for bit, and refused when it is another file."""

import bz2
import json
import struct
import zipfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from hhsim.errors import MeshError
from hhsim.mesh import file as mesh_file
from hhsim.mesh.file import read_own_ply, read_triangles
from hhsim.system import input_file
from hhsim.system.child_reader import read_in_child
from hhsim.system.input_file import most_unpacked
from tools.build_catalogue import ply_bytes
from tools.shapes.generators import cube, rock


def test_written_and_read_bit_for_bit() -> None:
    mesh = rock()
    content = ply_bytes(mesh.vertices, mesh.faces)
    vertices, faces = read_own_ply(content, "rock.ply")
    assert vertices.tobytes() == mesh.vertices.tobytes()
    assert faces.tobytes() == mesh.faces.tobytes()
    assert ply_bytes(vertices, faces) == content


def test_another_kind_of_ply_is_refused() -> None:
    mesh = cube()
    other = trimesh.Trimesh(mesh.vertices, mesh.faces).export(file_type="ply")
    assert isinstance(other, bytes)
    with pytest.raises(MeshError, match=r"cube\.ply: .* no binary PLY"):
        read_own_ply(other, "cube.ply")
    for content in (b"", b"ply\n", b"end_header\n", b"\xff" * 40):
        with pytest.raises(MeshError, match="no binary PLY"):
            read_own_ply(content, "cube.ply")


def test_truncated_file_is_refused() -> None:
    mesh = cube()
    with pytest.raises(MeshError, match="truncated"):
        read_own_ply(ply_bytes(mesh.vertices, mesh.faces)[:-1], "cube.ply")


OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def glb(path: Path, nodes: list[dict[str, Any]], roots: list[int]) -> Path:
    """Write a cube whose only mesh these nodes name."""
    mesh = cube()
    whole = trimesh.Trimesh(mesh.vertices, mesh.faces).export(file_type="glb")
    assert isinstance(whole, bytes)
    end = 20 + struct.unpack("<I", whole[12:16])[0]
    document = json.loads(whole[20:end]) | {"nodes": nodes, "scenes": [{"nodes": roots}], "scene": 0}
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(whole) - end, len(text), b"JSON")
    path.write_bytes(head + text + whole[end:])
    return path


@pytest.mark.parametrize(
    ("nodes", "roots"),
    [
        ([{"children": [0], "mesh": 0}], [0]),
        ([{"children": [1], "mesh": 0}, {"children": [0]}], [0]),
        ([{"mesh": 0}, {"children": [2], "mesh": 0}, {"children": [1]}], [0]),
        ([{"children": [1, 2]}, {"children": [3]}, {"children": [3]}, {"mesh": 0}], [0]),
        ([{"children": [number + 1] * 2} for number in range(30)] + [{"mesh": 0}], [0]),
    ],
    ids=["itself", "another", "aside", "parents", "doubled"],
)
def test_a_scene_whose_nodes_are_no_tree_is_refused(
    nodes: list[dict[str, Any]], roots: list[int], tmp_path: Path
) -> None:
    path = glb(tmp_path / "cube.glb", nodes, roots)
    with pytest.raises(
        MeshError, match=r"cube\.glb: its nodes go in a circle, or one has two parents; expected a tree"
    ):
        read_triangles(path)
    with zipfile.ZipFile(tmp_path / "cube.zip", "w") as archive:
        archive.write(path, "cube.glb")
    with pytest.raises(MeshError, match="its nodes go in a circle"):
        read_triangles(tmp_path / "cube.zip")


def test_a_scene_whose_nodes_are_a_tree_is_read(tmp_path: Path) -> None:
    shift: dict[str, Any] = {"translation": [1.0, 0.0, 0.0]}
    nodes: list[dict[str, Any]] = [
        {"children": [1, 2]},
        {"mesh": 0, **shift},
        {"children": [3], **shift},
        {"mesh": 0, **shift},
    ]
    vertices, faces = read_triangles(glb(tmp_path / "cube.glb", nodes, [0]))
    assert len(faces) == 2 * len(cube().faces)
    np.testing.assert_allclose(np.ptp(vertices, axis=0), np.ptp(cube().vertices, axis=0) + [1.0, 0.0, 0.0], atol=1e-7)


@pytest.mark.parametrize("kind", ["zip", "bz2"])
def test_a_small_archive_of_much_is_refused_before_it_is_read(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An OBJ of 160 MB in 312 kB would be, as is one of 917 kB where an archive may hold a tenth of a MiB."""
    assert most_unpacked(312_000) // mesh_file.MEMORY_OF_A_BYTE < 160_000_000
    monkeypatch.setattr(input_file, "ALWAYS", 1 << 20)
    path, text = tmp_path / f"mesh.{kind}", b"v 0.0 0.0 0.0\n" * (1 << 16)
    if kind == "zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("mesh.obj", text)
    else:
        path.write_bytes(bz2.compress(text))
    monkeypatch.setattr(mesh_file, "read_in_child", lambda *_: pytest.fail("it is read"))
    with pytest.raises(MeshError, match=r"[\d,]+ bytes or more in an archive of [\d,]+; expected a mesh"):
        read_triangles(path)


def test_an_archive_is_read_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "mesh.zip"
    for other, whole in (("__MACOSX/._b.stl", True), ("readme.txt", True), ("b.glb", False)):
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("a.obj", OBJ)
            archive.writestr(other, b"\0\1noise" * 30)
        if whole:
            assert len(read_triangles(path)[1]) == 1
        else:
            with pytest.raises(MeshError, match=r"cannot be read as \.zip"):
                read_triangles(path)


def test_a_reader_that_never_ends_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mesh.ply").write_bytes(ply_bytes(cube().vertices, cube().faces))
    monkeypatch.setattr(mesh_file, "read_in_child", partial(read_in_child, seconds=0))
    monkeypatch.setattr(trimesh, "load_scene", lambda *_, **__: any(iter(int, 1)))
    with pytest.raises(MeshError, match=r"mesh\.ply: cannot be read as \.ply: .* does not end within 1 s"):
        read_triangles(tmp_path / "mesh.ply")
