"""The exact binary PLY: read back bit for bit, and refused when it is another file."""

import pytest
import trimesh

from hhsim.errors import MeshError
from hhsim.mesh.file import read_own_ply
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
