"""Mesh files with bounds; the exact binary PLY: read back bit for bit, and refused when it is another file."""

import bz2
import gzip
import json
import struct
import tarfile
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from hhsim.errors import MeshError
from hhsim.mesh import file as mesh_file
from hhsim.mesh.file import NO_END, read_mesh, read_own_ply, read_triangles
from hhsim.mesh.scene_formats import of_dae
from hhsim.mesh.topology import face_areas, signed_volume
from hhsim.system import child_reader, input_file
from hhsim.system.child_reader import read_in_child
from hhsim.system.input_file import most_unpacked
from hhsim.system.posix import call_in_child
from tools.build_catalogue import ply_bytes
from tools.shapes.generators import cube, rock

pytestmark = pytest.mark.usefixtures("read_here")


def test_written_and_read_bit_for_bit() -> None:
    mesh = rock()
    content = ply_bytes(mesh.vertices, mesh.faces)
    vertices, faces = read_own_ply(content, "rock.ply")
    assert vertices.tobytes() == mesh.vertices.tobytes()
    assert faces.tobytes() == mesh.faces.tobytes()
    assert ply_bytes(vertices, faces) == content


OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def changed_glb(content: Any, change: Callable[[dict[str, Any]], object]) -> bytes:
    """A GLB with a change of its document."""
    end = 20 + struct.unpack("<I", content[12:16])[0]
    document = json.loads(content[20:end])
    change(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(content) - end, len(text), b"JSON")
    return head + text + content[end:]


def glb(path: Path, nodes: list[dict[str, Any]], roots: list[int]) -> Path:
    """Write a cube whose only mesh these nodes name."""
    scene: dict[str, Any] = {"nodes": nodes, "scenes": [{"nodes": roots}], "scene": 0}
    whole = trimesh.Trimesh(cube().vertices, cube().faces).export(file_type="glb")
    path.write_bytes(changed_glb(whole, lambda document: document.update(scene)))
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


@pytest.mark.parametrize("name", ["mesh.zip", "mesh.tar.gz", "mesh.TAR.GZ", "mesh.tar.bz2", "mesh.obj.bz2"])
def test_a_mesh_is_read_from_every_archive_that_is_listed(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    (tmp_path / "mesh.obj").write_text(OBJ)
    if name.endswith(".zip"):
        with zipfile.ZipFile(path, "w") as archive:
            archive.write(tmp_path / "mesh.obj", "mesh.obj")
    elif "tar" in name.lower():
        with tarfile.open(path, "w:gz" if name.lower().endswith(".gz") else "w:bz2") as tar:
            tar.add(tmp_path / "mesh.obj", "mesh.obj")
    else:
        path.write_bytes(bz2.compress(OBJ.encode()))
    assert len(read_triangles(path)[1]) == 1


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("arm.urdf.xacro", "expand it: xacro FILE > FILE.urdf"),
        ("a.STEP", "a CAD model; export"),
        ("a.fbx", "a 3-D scene; export"),
    ],
)
def test_a_file_that_is_no_mesh_says_what_makes_one_of_it(name: str, said: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("x")
    with pytest.raises(MeshError, match=said):
        read_triangles(tmp_path / name)


def two_cubes() -> trimesh.Scene:
    """A scene that shows a cube of 70 mm twice, 0.25 m apart."""
    shape, scene = trimesh.Trimesh(cube().vertices, cube().faces), trimesh.Scene()
    for number in range(2):
        place = trimesh.transformations.translation_matrix([0.25 * number, 0.0, 0.0])
        scene.add_geometry(shape, node_name=f"n{number}", geom_name="cube", transform=place)
    return scene


def exported(kind: str) -> bytes:
    whole = two_cubes()
    content = (whole if kind in ("3mf", "glb") else whole.to_geometry()).export(file_type=kind)
    return content if isinstance(content, bytes) else content.encode()


def relative(content: bytes) -> bytes:
    """The same OBJ in two objects, whose faces count back from their own lines."""
    lines = [line for line in content.decode().splitlines() if line[:2] in ("v ", "f ")]
    corner, faces = lines[:16], [line.split()[1:] for line in lines[16:]]
    text = list[str]()
    for first in (0, 8):
        text += ["o part", *corner[first : first + 8]]
        mine = [face for face in faces if first < int(face[0].partition("/")[0]) <= first + 8]
        text += ["f " + " ".join(str(int(word.partition("/")[0]) - first - 9) for word in face) for face in mine]
    return "\n".join(text).encode()


def end_taken(content: bytes) -> bytes:
    """An ASCII STL of two solids without its last line."""
    lines = content.decode().strip().splitlines()
    return "\n".join([*lines[:85], "endsolid", "solid facet vertex", *lines[85:-1]]).encode()


ASCII_PLY = two_cubes().to_geometry().export(file_type="ply", encoding="ascii")
WHOLE = {
    **{f"two.{kind}": exported(kind) for kind in ("obj", "off", "stl", "stl_ascii", "ply", "glb", "3mf")},
    "relative.obj": relative(exported("obj")),
    "marked.obj": b"\xef\xbb\xbf" + exported("obj"),
    "marked.ply": b"\xef\xbb\xbf" + ASCII_PLY,
    "marked.off": b"\xef\xbb\xbf" + exported("off"),
    "wide.obj": exported("obj").decode().encode("utf-16"),
    "old.obj": exported("obj").replace(b"\n", b"\r"),
    "end.stl": end_taken(exported("stl_ascii")),
}


@pytest.mark.parametrize("name", WHOLE)
def test_each_triangle_of_a_file_is_read(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(WHOLE[name])
    found = read_mesh(path)
    assert len(found.faces) == 24
    np.testing.assert_allclose(
        np.ptp(found.vertices[found.faces].reshape(-1, 3), axis=0), [0.32, 0.07, 0.07], atol=1e-6
    )
    assert found.warnings == ((NO_END,) if name == "end.stl" else ())
    assert found.metre == {"glb": 1.0, "3mf": 1e-3}.get(path.suffix[1:])


def without(content: bytes, lines: int) -> bytes:
    return b"\n".join(content.strip().split(b"\n")[:-lines]) + b"\n"


def as_fan(document: dict[str, Any]) -> None:
    document["meshes"][0]["primitives"][0]["mode"] = 6


LOST = {
    "cut.off": (without(exported("off"), 3), "21 of 24 faces are there: is the file cut"),
    "cut.ply": (without(ASCII_PLY, 3), "21 faces are there, or some"),
    "cut.stl": (without(exported("stl_ascii"), 6), "24 facets and 70 vertices: is the file cut"),
    "back.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -4\n", "line 4 reads 'f -1 -2 -4', expected f with"),
    "null.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "line 4 reads 'f 0 1 2', expected f with"),
    "comma.obj": (b"v 0,1 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "could not convert string to float: '0,1'"),
    "fan.glb": (changed_glb(exported("glb"), as_fan), "12 triangles of the 46 that it states were read: save it anew"),
}


@pytest.mark.parametrize("name", LOST)
def test_a_file_whose_triangles_would_be_lost_is_refused(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(LOST[name][0])
    with pytest.raises(MeshError, match=rf"{name}: .*{LOST[name][1]}"):
        read_triangles(path)


def test_a_scene_of_too_many_nodes_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trimesh, "load_scene", lambda *_, **__: pytest.fail("it is read"))
    many = [{"mesh": 0}] * 100_000
    with pytest.raises(MeshError, match="a scene of 100,000 nodes; expected at most 10,000"):
        read_triangles(glb(tmp_path / "many.glb", many, list(range(len(many)))))


DAE = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="u" meter="0.01"/></asset>
<library_geometries><geometry id="g"><mesh>
<triangles count="4"><input offset="0" semantic="VERTEX" source="#v"/><p>0 1 2 0 2 3 0 3 1 1 3 2</p></triangles>
<polylist count="2"><vcount>4 3</vcount><p>0 1 2 3 0 1 2</p></polylist>
<trifans><input offset="1"/><p>0 0 1 0 2 0 3 0</p></trifans></mesh></geometry></library_geometries>
<library_controllers><controller id="c"><skin source="#g"/></controller></library_controllers>
<library_nodes><node id="part"><instance_geometry url="#g"/></node></library_nodes>
<library_visual_scenes><visual_scene id="other"><node><instance_geometry url="#g"/></node></visual_scene>
<visual_scene id="s"><node><instance_node url="#part"/><node><instance_controller url="#c"/></node></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def test_a_collada_states_its_unit_and_the_triangles_that_it_shows() -> None:
    assert of_dae(DAE.encode()) == (2 * (4 + 3 + 2), 0.01)


@pytest.mark.parametrize("kind", ["stl", "ply", "glb", "off"])
def test_numbers_that_do_not_hold_the_shape_are_refused(kind: str, tmp_path: Path) -> None:
    """Half a million metres away single numbers hold 31 mm; a text holds all."""
    shape = trimesh.Trimesh(cube().vertices + [5e5, 0.0, 0.0], cube().faces)
    path = tmp_path / f"far.{kind}"
    shape.export(path)
    if kind == "off":
        assert len(read_triangles(path)[1]) == 12
    else:
        with pytest.raises(MeshError, match=r"far\..*: its numbers, up to 500000, hold steps of 0\.031 alone, and"):
            read_triangles(path)


U = [(0, 0), (9, 0), (9, 8), (6, 8), (6, 3), (3, 3), (3, 8), (0, 8)]


@pytest.mark.parametrize(("kind", "first"), [*(("obj", first) for first in range(8)), ("off", 4), ("ply", 6)])
def test_a_concave_polygon_is_cut_without_folds(kind: str, first: int, tmp_path: Path) -> None:
    ring = U[first:] + U[:first]
    points = [f"{x} {y} {z}" for z in (0, 2) for x, y in ring]
    sides = [[n, (n + 1) % 8, 8 + (n + 1) % 8, 8 + n] for n in range(8)]
    polygons = [list(range(8))[::-1], list(range(8, 16)), *sides]
    rows = [f"{len(polygon)} {' '.join(map(str, polygon))}" for polygon in polygons]
    head = {"off": "OFF\n16 10 0", "ply": PLY_HEAD}.get(kind, "")
    if kind == "obj":
        points = [f"v {point}" for point in points]
        rows = ["f " + " ".join(str(corner + 1) for corner in polygon) for polygon in polygons]
    path = tmp_path / f"u.{kind}"
    path.write_text("\n".join([head, *points, *rows, ""]).lstrip())
    vertices, faces = read_triangles(path)
    assert len(faces) == 28
    assert signed_volume(vertices, faces) == pytest.approx(114.0)
    assert face_areas(vertices, faces).sum() == pytest.approx(202.0)


PLY_HEAD = """ply
format ascii 1.0
element vertex 16
property float x
property float y
property float z
element face 10
property list uchar int vertex_indices
end_header"""


@pytest.mark.parametrize("kind", ["zip", "bz2", "tar.gz"])
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
        path.write_bytes(bz2.compress(text) if kind == "bz2" else gzip.compress(text))
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
    monkeypatch.setattr(child_reader, "call_in_child", call_in_child)
    monkeypatch.setattr(mesh_file, "read_in_child", partial(read_in_child, seconds=0))
    monkeypatch.setattr(trimesh, "load_scene", lambda *_, **__: any(iter(int, 1)))
    with pytest.raises(MeshError, match=r"mesh\.ply: cannot be read as \.ply: .* does not end within 1 s"):
        read_triangles(tmp_path / "mesh.ply")
