"""Files of all kinds in one recording: each is told by its content, and is where it says."""

from pathlib import Path

import h5py
import numpy as np
import pytest
import trimesh
from rerun_files import Recording
from short_grasp import short_result

from hhsim.errors import InputError
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object
from hhsim.motion.file import load_trajectory
from hhsim.render.triangle_soup import PIECES, piece_poses
from hhsim.result.reader import load_result
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.file import load_tree, save_tree
from hhsim.trees.options import TreeOptions
from hhsim.view.gallery import file_kind, view_files
from hhsim.view.sink import parse_target

TAP = Path(__file__).resolve().parents[2] / "trajectories" / "finger-tap.h5"


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A result twice, a motion, a tree and a mesh in millimetres, under names that say nothing."""
    folder = tmp_path_factory.mktemp("files")
    short_result(folder / "a.h5")
    (folder / "b.h5").write_bytes((folder / "a.h5").read_bytes())
    (folder / "c.h5").write_bytes(TAP.read_bytes())
    save_tree(cached_sphere_tree(load_object("cube").mesh, TreeOptions(level=2)), folder / "d.h5")
    trimesh.creation.icosphere(1, 40.0).export(folder / "e.stl")
    return sorted(folder.iterdir())


@pytest.fixture(scope="module")
def recording(files: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path = tmp_path_factory.mktemp("view") / "together.rrd"
    shown = view_files(files, parse_target(str(path)), unit="mm")
    assert [one.kind for one in shown] == ["result", "result", "motion", "tree", "mesh"]
    assert [one.samples for one in shown] == [200, 200, 89, 0, 0]
    return Recording(path)


@pytest.mark.soak
def test_each_result_has_its_own_hands_and_plots(recording: Recording, files: list[Path]) -> None:
    result = load_result(files[0])
    for root in ("/file-1", "/file-2"):
        found = recording.array(f"{root}/world/graphic/palm", "Transform3D:translation")[:, 0]
        np.testing.assert_allclose(found, result["graphic/position"], atol=1e-7)
        assert len(recording.rows(f"{root}/plots/force", "Scalars:scalars")) == result.ticks


def test_a_motion_moves_a_hand(recording: Recording) -> None:
    motion = load_trajectory(TAP)
    poses = (motion.position, motion.orientation, motion.flexion, motion.abduction)
    expected = piece_poses(HandModel.default(), *poses).translation
    for number, name in enumerate(PIECES):
        found = recording.array(f"/file-3/world/hand/{name}", "Transform3D:translation")[:, 0]
        np.testing.assert_allclose(found, expected[:, number], atol=1e-6)
    assert recording.times("/file-3/world/hand/palm")[0] == 0.0


def test_a_tree_and_a_mesh_are_there_in_metres(recording: Recording, files: list[Path]) -> None:
    tree = load_tree(files[3])
    sizes = np.array(recording.fixed["/file-4/world/spheres"]["Ellipsoids3D:half_sizes"][0])
    np.testing.assert_allclose(sizes[:, 0], tree.leaf_radius, atol=1e-8)
    vertices = np.array(recording.fixed["/file-5/world/object"]["Mesh3D:vertex_positions"][0])
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 0.04, rtol=1e-5)


@pytest.mark.parametrize("name", ["mug.glb", "mug.gltf", "MUG.GLB", "mug.obj"])
def test_a_mesh_is_known_by_its_name(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"glTF\x02\x00\x00\x00")
    assert file_kind(tmp_path / name) == "mesh"


def test_what_cannot_be_looked_at_is_told(tmp_path: Path) -> None:
    (tmp_path / "text.txt").write_text("text")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file.attrs["format"] = "hhsim-bench"
    with h5py.File(tmp_path / "foreign.h5", "w"):
        pass
    for name, message in (
        ("none.h5", "no such file"),
        ("", "is a folder"),
        ("text.txt", "expected a result"),
        ("other.h5", "its format is 'hhsim-bench'"),
        ("foreign.h5", "does not say what it holds"),
    ):
        with pytest.raises(InputError, match=message):
            file_kind(tmp_path / name)
    (tmp_path / "quest.csv").write_text("time,right_wrist_x\n0,0\n", encoding="utf-8")
    foreign = r"no column px, .*\(hhsim import makes a trajectory of another table\)"
    with pytest.raises(InputError, match=foreign):
        view_files([tmp_path / "quest.csv"], parse_target(str(tmp_path / "x.rrd")))
