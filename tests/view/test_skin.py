"""Skin of a result: stored beside its ticks, read back, and shown in place of the hand's own pieces."""

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from driven_scenes import swung_result
from rerun_files import Recording
from sealed_change import changed
from short_grasp import short_grasp, short_result, short_scene

from hhsim.errors import InputError, OutputError
from hhsim.result.reader import Result, load_result
from hhsim.result.writer import add_skin
from hhsim.view.moment import moment
from hhsim.view.scene_log import vertex_normals
from hhsim.view.sink import parse_target
from hhsim.view.viewer import shown_scene, view_result
from tools.shapes.generators import sphere

BALL = sphere(0.05, subdivisions=1)


def skin_of(result: Result) -> np.ndarray:
    """A ball that goes with the palm, shape (T, V, 3)."""
    return np.asarray(BALL.vertices + result["graphic/position"][:, None])


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("bare") / "bare.h5", short_grasp(hold=0.03))


@pytest.fixture
def skinned(bare: Result, tmp_path: Path) -> Result:
    path = Path(shutil.copy(bare.path, tmp_path / "skin.h5"))
    add_skin(path, skin_of(bare), BALL.faces)
    return load_result(path)


def test_a_skin_is_read_back_and_all_else_stays(bare: Result, skinned: Result) -> None:
    assert bare.skin_faces is None and skinned.complete
    assert skinned.skin_faces is not None
    np.testing.assert_array_equal(skinned.skin_faces, BALL.faces)
    expected = skin_of(bare).astype(np.float32)
    np.testing.assert_array_equal(skinned.skin(slice(None)), expected)
    np.testing.assert_array_equal(skinned.skin(slice(3, 20, 5)), expected[3:20:5])
    assert skinned.keys() == bare.keys()
    for name in ("graphic/position", "force/total", "status"):
        np.testing.assert_array_equal(skinned[name], bare[name])


def test_a_skin_beside_a_moving_object_is_seen_from_it(tmp_path: Path) -> None:
    world = skin_of(swung_result(short_scene(short_grasp(hold=0.01)), tmp_path / "moving.h5"))
    add_skin(tmp_path / "moving.h5", world, BALL.faces)
    result = load_result(tmp_path / "moving.h5")
    seen = result.seen_from_object.skin(slice(None))
    palm = result.seen_from_object["graphic/position"]
    np.testing.assert_allclose(seen.mean(axis=1), palm, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(seen - palm[:, None], axis=2), 0.025, atol=1e-6)
    assert np.abs(result.skin(slice(None)) - seen).max() > 1e-3


@pytest.mark.parametrize("fault", ["ticks", "faces", "lacks", "shape"])
def test_a_skin_that_does_not_fit_is_damage(skinned: Result, fault: str) -> None:
    with changed(skinned.path) as file:
        group: h5py.Group = file["hands/right/skin"]
        values = {name: group[name][...] for name in group}
        if fault == "faces":
            values["faces"][0, 0] = len(BALL.vertices)
        elif fault == "lacks":
            del values["faces"]
        else:
            values["vertices"] = values["vertices"][:-1] if fault == "ticks" else values["vertices"][:, :, :2]
        del file["hands/right/skin"]
        for name, array in values.items():
            file[f"hands/right/skin/{name}"] = array
    with pytest.raises(InputError, match=r"skin|faces|vertices"):
        _ = load_result(skinned.path).skin_faces


def test_what_cannot_be_stored_is_told(bare: Result, skinned: Result, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="vertices has shape"):
        add_skin(skinned.path, BALL.vertices, BALL.faces)
    with pytest.raises(OutputError, match="cannot write"):
        add_skin(tmp_path / "none.h5", skin_of(bare), BALL.faces)
    add_skin(skinned.path, 2.0 * skin_of(bare), BALL.faces[:9])
    again = load_result(skinned.path)
    assert again.skin_faces is not None and len(again.skin_faces) == 9
    np.testing.assert_array_equal(again.skin(slice(None)), (2.0 * skin_of(bare)).astype(np.float32))


def test_pictures_show_the_skin(skinned: Result) -> None:
    shown = moment(skinned, shown_scene(skinned), 7)
    corners = skin_of(skinned)[7].astype(np.float32)[BALL.faces].reshape(-1, 3)
    np.testing.assert_array_equal(shown.graphic.points[shown.graphic.faces].reshape(-1, 3), corners)


def test_rerun_gets_the_skin_of_each_shown_tick(skinned: Result, tmp_path: Path) -> None:
    path = tmp_path / "skin.rrd"
    view_result(skinned, parse_target(str(path)), every=9)
    recording = Recording(path)
    positions = recording.array("/world/skin", "Mesh3D:vertex_positions")
    np.testing.assert_array_equal(positions, skin_of(skinned)[::9].astype(np.float32))
    normals = recording.array("/world/skin", "Mesh3D:vertex_normals")
    # A ball's normals lead away from its middle, as nearly as its triangles are.
    away = BALL.vertices / np.linalg.norm(BALL.vertices, axis=1, keepdims=True)
    assert (np.einsum("tvi,vi->tv", normals, away) > np.cos(np.radians(1.0))).all()


def test_normals_are_the_means_of_the_triangles_around() -> None:
    rng = np.random.default_rng(0)
    vertices, faces = rng.normal(size=(9, 3)), rng.integers(0, 8, size=(12, 3))
    found = vertex_normals(vertices, faces)
    for vertex in range(9):
        total = np.zeros(3)
        for face in faces:
            a, b, c = vertices[face]
            total += np.count_nonzero(face == vertex) * np.cross(b - a, c - a)
        np.testing.assert_allclose(found[vertex] * np.linalg.norm(total), total, atol=1e-12)
