"""The mesh type, the catalogue, and files into meshes: units, sizes, bad input, real meshes."""

import hashlib
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from conftest import sampled
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.errors import InputError, MeshError, UnknownNameError
from hhsim.mesh import repair
from hhsim.mesh.catalogue import load_object, object_description, object_names
from hhsim.mesh.file import read_own_ply, read_triangles
from hhsim.mesh.mesh import Mesh, load_mesh, mass_properties, unit_length_of
from hhsim.mesh.repair import closed_surface, winding_faults
from hhsim.trees.contact_surface import encloses
from tools.build_catalogue import derived_object, made_object
from tools.shapes.generators import GENERATORS, cube, sphere

pytestmark = pytest.mark.usefixtures("read_here")


def save(path: Path, mesh: Mesh) -> Path:
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)
    return path


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), factor=st.floats(1e-3, 1e3))
def test_volume_extent_and_hash_follow_motion_and_scale(seed: int, factor: float) -> None:
    generator = np.random.default_rng(seed)
    mesh = sphere(0.08, subdivisions=1)
    rotation, _ = np.linalg.qr(generator.normal(size=(3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    moved = mesh.transformed(rotation, generator.normal(size=3))
    assert moved.volume == pytest.approx(mesh.volume, rel=1e-9)
    np.testing.assert_allclose(moved.extent, np.ptp(moved.vertices, axis=0))
    scaled = mesh.scaled(factor)
    assert scaled.volume == pytest.approx(mesh.volume * factor**3, rel=1e-9)
    assert (scaled.sha256 == mesh.sha256) == (factor == 1.0)
    assert moved.faces.tobytes() == mesh.faces.tobytes()


def test_arrays_are_normalised_and_hashed_as_documented() -> None:
    strided = np.asfortranarray(cube().vertices.astype(np.float32))
    mesh = Mesh(strided, cube().faces.astype(np.int32))  # type: ignore[arg-type]
    assert (mesh.vertices.dtype, mesh.faces.dtype) == (np.float64, np.int64)
    assert mesh.vertices.flags.c_contiguous and mesh.faces.flags.c_contiguous
    assert mesh.sha256 == hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes()).hexdigest()
    assert mesh.triangles.shape == (12, 3, 3)
    np.testing.assert_array_equal(mesh.triangles[5, 2], mesh.vertices[mesh.faces[5, 2]])


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.zeros((4, 2)), [[0, 1, 2]], r"shape \(4, 2\), expected \(V, 3\)"),
        (np.zeros((4, 3)), np.empty((0, 3)), "no triangles"),
        (np.zeros((4, 3)), [[0, 1, 2, 3]], r"shape \(1, 4\), expected \(F, 3\)"),
        (np.zeros((4, 3)), [[0, 1, 4]], "1 of 1 .* first triangle 0; expected 0 to 3"),
        (np.zeros((4, 3)), [[0, 1, 2], [0, -1, 2]], "1 of 2 .* first triangle 1"),
        ([[0, 0, 0], [np.inf, 0, 0], [0, np.nan, 0]], [[0, 1, 2]], "2 of 3 vertices .* first at index 1"),
    ],
)
def test_arrays_that_are_no_mesh(vertices: object, faces: object, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        Mesh(np.asarray(vertices), np.asarray(faces), name="bad")


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("inch", 0.0254)])
def test_unit_of_the_file(tmp_path: Path, unit: str, factor: float) -> None:
    path = save(tmp_path / "cube.obj", cube(0.08).scaled(1.0 / factor))
    assert load_mesh(path, unit=unit).extent.max() == pytest.approx(0.08)


@pytest.mark.parametrize(
    ("side", "unit", "message"),
    [
        (11.6, "m", "longest extent 11.6 m: is the file in centimetres? pass --unit cm"),
        (500.0, "cm", "longest extent 5 m: is the file in millimetres? pass --unit mm"),
        (0.002, "m", "longest extent 2 mm: if that is wrong, pass --size with the right one"),
        *[(side, unit, "") for side, unit in [(1.3, "m"), (1300.0, "mm"), (2.1, "m"), (25.0, "mm")]],
    ],
)
def test_suspicious_size_is_warned_of(tmp_path: Path, side: float, unit: str, message: str) -> None:
    assert "".join(load_mesh(save(tmp_path / "cube.obj", cube(side)), unit=unit).warnings) == message


@pytest.mark.parametrize(
    ("unit", "size", "extent", "told"),
    [
        (None, None, 0.07, "lengths taken in millimetres, as the file states"),
        ("mm", None, 0.07, "lengths taken in millimetres, as the file states"),
        ("cm", None, 0.7, "the file states millimetres, but --unit cm is given"),
        (None, 0.2, 0.2, ""),
    ],
)
def test_a_unit_that_a_file_states_counts(
    unit: str | None, size: float | None, extent: float, told: str, tmp_path: Path
) -> None:
    path = save(tmp_path / "cube.3mf", cube().scaled(1000.0))
    mesh = load_mesh(path, unit=unit, size=size)
    assert mesh.extent == pytest.approx(extent)
    said = [line for line in (*mesh.repairs, *mesh.warnings) if "state" in line]
    assert said == ([told] if told else [])
    assert unit_length_of(path, unit, size) == pytest.approx(extent / 70.0)
    assert load_mesh(save(tmp_path / "cube.glb", cube())).repairs == (), "metres need no word"


def obj_of(size: float, old: str = "", new: str = "") -> bytes:
    """A cube of a size [m] as an OBJ, a word of which is replaced once."""
    return cube().scaled(size / 0.07).obj().replace(old, new, 1 if old else 0).encode()


CUBE = obj_of(0.07)
FAULTS: dict[str, tuple[bytes | None, dict[str, Any], str]] = {
    # Content of a file of this name, what is asked of it, and what is said.
    "gone.stl": (None, {}, "no such file; expected a mesh"),
    "empty.stl": (b"", {}, "no triangles"),
    "empty.obj": (b"", {}, "no triangles"),
    "empty.off": (b"", {}, "cannot be read as .off"),
    "noise.ply": (b"\x00\x01noise" * 20, {}, r"damaged, too large, or of another kind: Not a ply file"),
    "noise.stl": (bytes(range(256)) * 8, {}, "damaged, or of another kind$"),
    "picture.obj": (b"\x89PNG\r\n" + bytes(range(256)), {}, "damaged, or of another kind$"),
    "noise.glb": (b"\x00\x01noise" * 20, {}, "cannot be read as .glb"),
    "points.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", {}, "no triangles"),
    "mesh.doc": (b"words", {}, "unknown mesh format '.doc'; known: .*obj.*ply.*stl"),
    "mesh": (b"words", {}, "no suffix that says which mesh format it is; known: .*obj.*ply.*stl"),
    "huge.obj": (obj_of(0.07, "0.035", "1e200"), {}, r"longest extent 1e\+200 .* expected 1e-06"),
    "far.obj": (obj_of(7e6), {}, r"longest extent 7e\+06 in the file: expected 1e-06 to 1e"),
    "nan.obj": (obj_of(0.07, "0.035", "nan"), {}, "1 of 8 vertices .* first at index 0"),
    "index.obj": (CUBE + b"f 1 2 99\n", {}, "cannot be read as .obj"),
    "point.obj": (obj_of(0.0), {}, "all vertices lie in one point"),
    "flat.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 3 2\n", {}, "an open surface|no volume"),
    "long.obj": (obj_of(113.0), {}, "113 m: expected 0.001 to 20 m for a hand; is the file in millimetres"),
    "short.obj": (obj_of(0.1), {"unit": "mm"}, "0.0001 m: expected 0.001 to 20 m for a hand; is the file in metres"),
    "longer.obj": (obj_of(1e5), {"unit": "mm"}, "pass --size"),
    "unit.obj": (CUBE, {"unit": "yard"}, "unknown unit 'yard': known: m, cm, mm, inch"),
    **{f"{x}.obj": (CUBE, {"size": x}, r"expected 0\.001 to 20") for x in (0.0, -1.0, float("nan"), float("inf"))},
}


@pytest.mark.parametrize("name", FAULTS)
def test_files_that_are_no_solid_get_one_clear_line(tmp_path: Path, name: str) -> None:
    content, asked, message = FAULTS[name]
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        load_mesh(tmp_path / name, **asked)
    assert "\n" not in str(caught.value)
    assert asked or str(tmp_path / name) in str(caught.value)


CLEAN = {
    "ycb_banana.obj": 0.196,
    "ycb_mustard.obj": 0.192,
    "claw_hammer.obj": 0.158,
    "object_sim_mug.stl": 0.116,
    "object_sim_stanfordbunny.stl": 0.130,
}


@pytest.mark.parametrize("file", sampled(CLEAN, lambda place, file: place % 3 == 0))
@pytest.mark.usefixtures("few_winding_points")
def test_real_clean_meshes_need_nothing_but_merged_vertices(shared_data: Path, file: str) -> None:
    mesh = load_mesh(shared_data / "meshes" / file)
    assert mesh.extent.max() == pytest.approx(CLEAN[file], abs=6e-4)
    assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).is_watertight
    assert all(sentence.startswith("merged ") for sentence in mesh.repairs)
    assert len(mesh.repairs) <= 1


POINTS = {name: getattr(repair, name) for name in ("WINDING_WORK", "FEWEST_SAMPLES")}


@pytest.fixture
def few_winding_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """Loading looks at a tenth of the points beside the surface; `assert_sound` looks at all."""
    for name, value in POINTS.items():
        monkeypatch.setattr(repair, name, value // 10)


def assert_sound(mesh: Mesh) -> None:
    other = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    edges = np.sort(other.edges, axis=1)
    forward = (other.edges[:, 0] < other.edges[:, 1]) * 2 - 1
    _, index = np.unique(edges, axis=0, return_inverse=True)
    assert not np.bincount(index.reshape(-1), weights=forward).any()
    assert mesh.volume > 0.0
    with pytest.MonkeyPatch.context() as patch:
        for name, value in POINTS.items():
            patch.setattr(repair, name, value)
        faulty, tested, _, _ = repair.winding_faults(mesh.vertices, mesh.faces)
    assert faulty <= 0.001 * tested


@pytest.mark.parametrize(
    ("file", "repairs"),
    [
        ("nasty_bunny_94_components.ply", ("duplicate", "closed 5 holes", "is assumed", "lies outside it")),
        ("nasty_ycb_mug_nonmanifold.obj", ("degenerate", "duplicate")),
    ],
)
@pytest.mark.usefixtures("few_winding_points")
def test_meshes_in_pieces_become_solids(shared_data: Path, file: str, repairs: tuple[str, ...]) -> None:
    mesh = load_mesh(shared_data / "meshes" / file)
    assert_sound(mesh)
    for said, word in zip(mesh.repairs[1:], repairs, strict=True):
        assert word in said


@pytest.mark.parametrize("name", object_names())
def test_of_every_object_as_trimesh_has_them(name: str) -> None:
    item = load_object(name)
    found = mass_properties(item.mesh)
    other = trimesh.Trimesh(item.mesh.vertices, item.mesh.faces, process=False)
    assert found.volume == pytest.approx(other.volume, rel=1e-9)
    np.testing.assert_allclose(found.center, other.center_mass, atol=1e-12)
    np.testing.assert_allclose(found.inertia, other.moment_inertia, rtol=1e-9, atol=1e-9 * found.inertia.max())
    # Something that a hand lifts, or two by its handles, on a skin that slips less than rubber.
    assert 0.02 < item.density * found.volume < (2.0 if name == "handle-box" else 1.0)
    assert 0.2 < item.friction < 0.9


def test_what_encloses_nothing_is_refused() -> None:
    box = cube(0.07)
    with pytest.raises(MeshError, match="not closed"):
        mass_properties(replace(box, faces=box.faces[1:]))
    sheet = Mesh(np.eye(3), np.array([[0, 1, 2], [0, 2, 1]]), name="sheet")
    with pytest.raises(MeshError, match="sheet: the triangles enclose 0 cm³"):
        mass_properties(sheet)
    with pytest.raises(MeshError, match="needs a solid, wound outward"):
        mass_properties(replace(box, faces=box.faces[:, ::-1]))
    loose = Mesh(box.triangles.reshape(-1, 3), np.arange(36).reshape(12, 3))
    assert mass_properties(loose).volume == pytest.approx(0.07**3)


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), part=st.floats(0.0, 1.0), soup=st.booleans())
def test_turned_triangles_are_turned_back_whether_the_mesh_is_made_solid_or_not(
    seed: int, part: float, soup: bool
) -> None:
    ball = sphere(0.08, subdivisions=1)
    vertices, faces = ball.vertices, ball.faces
    if soup:
        vertices, faces = ball.triangles.reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)
    turned = np.random.default_rng(seed).random(len(faces)) < part
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ball.ply"
        wrong = Mesh(vertices, np.where(turned[:, None], faces[:, ::-1], faces))
        trimesh.Trimesh(wrong.vertices, wrong.faces, process=False).export(path)
        as_it_is, solid = load_mesh(path, solid=False), load_mesh(path)
    # What is stored is float32.
    assert as_it_is.volume == pytest.approx(ball.volume, rel=1e-5) and encloses(as_it_is)
    assert as_it_is.repairs == tuple(text for text in solid.repairs if not text.startswith("merged"))
    np.testing.assert_array_equal((as_it_is.faces != wrong.faces).any(axis=1), turned)
    assert bool(as_it_is.repairs) == turned.any()


SIMPLE = ["sphere", "cylinder", "triangular-prism", "cube", "hexagonal-prism"]
COMPLEX = ["rock", "shamrock", "cup", "teapot", "bunny", "handle-box"]
"""The last is not the paper's: it is for two hands."""
GENUS = {"cup": 1, "teapot": 1, "handle-box": 2}


@pytest.mark.parametrize("name", sampled(SIMPLE + COMPLEX, lambda _, name: name in ("cube", "cup", "handle-box")))
def test_mesh_is_a_sound_solid_of_graspable_size(name: str) -> None:
    mesh = load_object(name).mesh
    other = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert other.is_watertight and other.is_winding_consistent and other.body_count == 1
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices) == len(np.unique(mesh.faces))
    assert other.area_faces.min() > 1e-9 or name == "teapot"
    assert 1 - other.euler_number // 2 == GENUS.get(name, 0)
    assert 0.06 <= mesh.extent.max() <= (0.21 if name == "handle-box" else 0.13)
    np.testing.assert_allclose(mesh.bounds.mean(axis=0), 0.0, atol=1e-9)
    assert mesh.volume > 0.0
    faulty, tested, low, high = winding_faults(mesh.vertices, mesh.faces)
    assert (faulty, round(low, 6), round(high, 6)) == (0, 0.0, 1.0)
    assert tested >= 500
    surface = closed_surface(mesh.vertices, mesh.faces, name)
    assert (surface.merged, surface.repairs, surface.warnings) == ([], [], [])


@pytest.mark.parametrize("name", GENERATORS)
def test_shipped_file_is_what_the_generator_makes(name: str) -> None:
    shipped, made = load_object(name).mesh, made_object(name)
    assert shipped.vertices.tobytes() == made.vertices.tobytes()
    assert shipped.faces.tobytes() == made.faces.tobytes()


def test_teapot_is_what_its_steps_make(shared_data: Path) -> None:
    vertices, faces = read_triangles(shared_data / "meshes/nasty_teapot_open_shells.obj")
    made, shipped = derived_object("teapot", vertices, faces, object_description("teapot")), load_object("teapot").mesh
    assert len(shipped.faces) == 1118
    assert made.repairs == shipped.repairs
    assert made.sha256 == shipped.sha256


def test_unknown_name_lists_the_near_ones() -> None:
    with pytest.raises(UnknownNameError, match="unknown object 'bunni': did you mean bunny"):
        load_object("bunni")
    with pytest.raises(UnknownNameError, match="known: bunny, cube, cup, cylinder"):
        load_object("zzzzzz")
    for name in ("../hhsim/mesh", "", "cube.ply"):
        with pytest.raises(UnknownNameError):
            load_object(name)


def test_altered_mesh_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    def altered(content: bytes, name: str) -> tuple[object, object]:
        vertices, faces = read_own_ply(content, name)
        vertices[3, 1] += 1e-12
        return vertices, faces

    monkeypatch.setattr("hhsim.mesh.file.read_own_ply", altered)
    with pytest.raises(MeshError, match=r"cube\.ply: content hash .* differs from its description"):
        load_object("cube")
