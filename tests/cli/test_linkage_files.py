"""URDF and MJCF files as the objects of commands."""

from pathlib import Path

import pytest
from conftest import Run
from linkage_samples import BOX, joint, link, urdf
from short_grasp import short_grasp_text

from hhsim.result.reader import load_result

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("read_here")]
INERTIAL = '<inertial><mass value="0.3"/><inertia ixx="2e-4" iyy="2e-4" izz="1e-4"/></inertial>'
BLOCK = urdf(link("block", BOX.format("0.06 0.06 0.06") + INERTIAL), name="block")
LID = BOX.format("0.06 0.06 0.01").replace("<geometry", '<origin xyz="0 0.03 0"/><geometry')


@pytest.fixture
def work(tmp_path: Path) -> Path:
    (tmp_path / "short.toml").write_text(short_grasp_text())
    (tmp_path / "opens.toml").write_text(short_grasp_text() + "\n[joint]\nhinge = [[0.0, 0.0], [0.1, 0.4]]\n")
    (tmp_path / "block.urdf").write_text(BLOCK)
    hinge = joint(
        "block", "lid", name="hinge", origin='xyz="0 -0.03 0.0351"', axis="1 0 0", limit='lower="0" upper="2"'
    )
    (tmp_path / "pot.urdf").write_text(urdf(link("block", BOX.format("0.06 0.06 0.06")), link("lid", LID), hinge))
    return tmp_path


def test_a_file_of_one_link_is_replayed_as_its_mesh_and_free_with_its_mass(run: Run, work: Path) -> None:
    answer = run("replay", "block.urdf", "short.toml", "--out", "one.h5", "--level", "2")
    assert answer.code == 0, answer.err
    assert answer.out.startswith("block, short, coupled: 200 ticks\n")
    result = load_result(work / "one.h5")
    assert result.scene["object"] == "block.urdf" and result["contacts/candidates"].max() > 0
    assert run("replay", "one.h5").code == 0
    answer = run(
        *("replay", "block.urdf", "short.toml", "--free", "--surface", "mesh"),
        *("--level", "1", "--out", "free.h5", "--ticks", "20"),
    )
    assert answer.code == 0, answer.err
    assert load_result(work / "free.h5").body.properties["mass"] == 0.3


def test_the_tree_of_a_link_is_built_by_its_name(run: Run, work: Path) -> None:
    document = run("build-tree", "pot.urdf", "--link", "lid", "--level", "1", "--out", "lid.h5", "--json").document()
    assert document["object"] == "lid" and document["extent"] == pytest.approx([0.06, 0.06, 0.01])


def test_a_scene_of_links_is_written_for_other_software(run: Run, work: Path) -> None:
    answer = run("scene", "pot.urdf", "opens.toml", "--level", "1", "--out", "folder")
    assert answer.code == 0, answer.err
    names = {"block.obj", "lid.obj", "scene.xml", "driven.csv"}
    assert names <= {path.name for path in (work / "folder").iterdir()}
