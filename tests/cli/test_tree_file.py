"""Sphere trees in files and pictures, as users meet them: `build-tree --from`, `--plot` and `replay --tree`."""

from pathlib import Path

import numpy as np
import pytest
from conftest import Run
from linkage_samples import write_box
from short_grasp import short_grasp_text

from hhsim.result.reader import load_result
from hhsim.trees.file import load_tree
from hhsim.trees.foreign_tree import save_sph

pytestmark = pytest.mark.usefixtures("read_here")


@pytest.fixture
def box(tmp_path: Path) -> Path:
    """A box away from the origin, in millimetres."""
    return write_box(tmp_path / "box.obj", (70.0, 70.0, 70.0), (200.0, 0.0, 30.0))


def test_a_file_of_the_toolkit_becomes_a_measured_tree(run: Run, tmp_path: Path, box: Path) -> None:
    assert run("build-tree", box.name, "--unit", "mm", "--level", "1", "--out", "own.h5", "--quiet").code == 0
    own = load_tree(tmp_path / "own.h5")
    # In the unit of the mesh file, counted from the middle of the box.
    save_sph(own.transformed(np.eye(3), [-0.2, 0.0, -0.03]).scaled(1e3), tmp_path / "theirs.sph")
    answer = run("build-tree", box.name, "--unit", "mm", "--from", "theirs.sph", "--out", "found.h5")
    assert answer.code == 0, answer.err
    assert "note: taken to count from the centre of the mesh's bounding box: mean gap " in answer.out
    assert answer.out.splitlines()[-1] == "8 leaves, read from theirs.sph, written to found.h5"
    assert "proved" not in answer.out.replace("proved bound", ""), "a file without proofs has none"
    found = load_tree(tmp_path / "found.h5")
    np.testing.assert_allclose(found.center, own.center, atol=1e-12)
    assert found.mesh_sha256 == own.mesh_sha256
    wrong = run("build-tree", box.name, "--unit", "mm", "--from", "theirs.sph", "--from-unit", "m")
    assert wrong.code == 2
    assert "is it in another unit" in wrong.err


def test_a_replay_takes_the_tree_of_a_file(run: Run, tmp_path: Path, box: Path) -> None:
    (tmp_path / "short.toml").write_text(short_grasp_text())
    assert run("build-tree", "cube", "--level", "2", "--out", "cube.h5", "--quiet").code == 0
    assert run("build-tree", "cube", "--level", "2", "--out", "cube.sph", "--quiet").code == 0
    joints = []
    for options in (["--level", "2"], ["--tree", "cube.h5"], ["--tree", "cube.sph"]):
        answer = run("replay", "cube", "short.toml", *options, "--out", "run.h5")
        assert answer.code == 0, answer.err
        result = load_result(tmp_path / "run.h5")
        assert result.scene["level"] == 2
        assert result.scene["tree"] == (options[1] if options[0] == "--tree" else None)
        assert (f"note: the sphere tree is that of {options[1]}" in answer.out) == (options[0] == "--tree")
        joints.append(result["graphic/joints"])
    # What ships was built on another processor, whose last bits differ.
    assert joints[0] == pytest.approx(joints[1], rel=0.0, abs=1e-9)
    assert np.array_equal(joints[1], joints[2])
    other = run("replay", box.name, "short.toml", "--unit", "mm", "--tree", "cube.h5")
    assert other.code == 2
    assert "cube.h5: built for the mesh" in other.err
