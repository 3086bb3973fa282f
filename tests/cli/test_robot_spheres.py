"""Commands of linkages: spheres of robots' links, and URDF as a thing of a scene."""

import json
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
import trimesh
from conftest import Run
from linkage_samples import BOX, joint, link, urdf, write_arm, write_box
from short_grasp import short_grasp_text

from hhsim.result.reader import load_result

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("read_here")]


@pytest.mark.quick("2")
@pytest.mark.parametrize("links", [2, 7])
def test_a_robot_is_built_written_drawn_and_judged(
    run: Run, tmp_path: Path, links: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_arm(tmp_path, 2 if links == 2 else 8)
    answer = run("build-tree", "arm.urdf", "--leaves", "4", "--out", "arm.yml", "--plot", "arm.png")
    assert answer.code == 0, answer.err
    assert answer.out.startswith(f"arm: {links} links\n") and "proved: every triangle of every link" in answer.out
    assert answer.out.splitlines()[-2].endswith(" spheres, written to arm.yml")
    assert (tmp_path / "arm.png").stat().st_size > 10_000
    with monkeypatch.context() as patched:
        # A second run takes the spheres from the cache.
        patched.setattr("hhsim.trees.builder.build_sphere_tree", lambda *_: pytest.fail("built again"))
        assert run("build-tree", "arm.urdf", "--leaves", "4", "--out", "again.yml").code == 0
    assert (tmp_path / "again.yml").read_bytes() == (tmp_path / "arm.yml").read_bytes()
    judged = run("build-tree", "arm.urdf", "--from", "arm.yml", "--as", "xrdf", "--out", "arm.xrdf", "--json")
    assert judged.code == 0, judged.err
    document = json.loads(judged.out)
    assert [each["link"] for each in document["links"]][:2] == ["base", "turret"]
    assert all(each["proved"] and each["surface_gap_max"] == 0.0 for each in document["links"])
    assert document["self_collision_ignore"]["base"] == ["turret"]
    one = run("build-tree", "box.obj", "--size", "300", "--from", "arm.xrdf", "--link", "base", "--json")
    assert one.code == 0, one.err
    assert json.loads(one.out)["fit"]["spheres"] == 4
    assert "in another unit" not in judged.err + one.err
    large = run("build-tree", "arm.urdf", "--from", "arm.yml", "--as", "json", "--out", "large.json")
    assert large.code == 0, large.err
    spheres = json.loads((tmp_path / "large.json").read_text())
    for factor, code, told in ((1000.0, 2, "large.json: its spheres stick out by"), (1e-3, 0, "base: its spheres are")):
        scaled = json.loads(json.dumps(spheres))
        for each in chain.from_iterable(of_link["spheres"] for of_link in scaled.values()):
            each |= {"origin": [factor * x for x in each["origin"]], "radius": factor * each["radius"]}
        (tmp_path / "large.json").write_text(json.dumps(scaled))
        answer = run("build-tree", "arm.urdf", "--from", "large.json", "--as", "json", "--out", "x.json")
        assert answer.code == code and told in answer.err and "are they in another unit" in answer.err
    several = run("build-tree", "box.obj", "--size", "300", "--from", "arm.xrdf")
    assert several.code == 2 and "expected the name of one (--link)" in several.err


FLAT, LINE = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nf 1 2 3\n", "v 0 0 0\nv .1 0 0\nv .2 0 0\nf 1 2 3\n"
MESH = '<collision><geometry><mesh filename="{}" scale="{}"/></geometry></collision>'


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "no link has collision geometry; expected <collision> elements (URDF)"),
        (MESH.format("flat.obj", "nan"), "link 'b': <mesh scale=\"nan\">; expected numbers"),
        (MESH.format("nan.obj", 1), "link 'b': <mesh>: its longest extent is nan m"),
        (MESH.format("line.obj", 1), "link 'b': its triangles have no area; expected a surface"),
        (MESH.format("many.ply", 1), "link 'b': 500,004 triangles; expected 500,000 at most: simplify"),
    ],
    ids=lambda value: value[-40:],
)
def test_bad_robots_are_one_line_and_leave_nothing(run: Run, tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "flat.obj").write_text(FLAT)
    (tmp_path / "line.obj").write_text(LINE)
    (tmp_path / "nan.obj").write_text(FLAT.replace("v .1", "v nan"))
    if "many" in content:
        write_many(tmp_path / "many.ply", 250_002)
    (tmp_path / "bad.urdf").write_text(urdf(link("a", ""), link("b", content), joint("a", "b")))
    answer = run("build-tree", "bad.urdf", "--leaves", "2", "--out", "bad.yml")
    assert (answer.code, answer.out) == (2, "")
    assert message in answer.err and answer.err.count("\n") == 1 and not (tmp_path / "bad.yml").exists()


def write_many(path: Path, strips: int) -> None:
    """Write a row of strips of two triangles each."""
    x = np.linspace(0.0, 1.0, strips + 1)
    vertices = np.stack([np.repeat(x, 2), np.tile([0.0, 0.1], strips + 1), np.zeros(2 * strips + 2)], axis=1)
    first = 2 * np.arange(strips)
    faces = np.concatenate([np.stack([first, first + 1, first + 2], 1), np.stack([first + 1, first + 3, first + 2], 1)])
    trimesh.Trimesh(vertices, faces, process=False).export(path)


def test_an_mjcf_is_a_robot_with_whatever_joints_it_has(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    write_box(tmp_path / "box.obj", (0.1, 0.06, 0.02))
    (tmp_path / "arm.xml").write_text(
        '<mujoco model="two"><asset><mesh name="box" file="box.obj"/></asset><worldbody>'
        '<geom type="plane" size="1 1 1"/>'
        '<body name="base"><geom type="cylinder" size="0.05 0.1"/><body name="arm" pos="0 0 0.2">'
        '<joint name="x" axis="1 0 0"/><joint name="y" axis="0 1 0"/><geom type="mesh" mesh="box"/>'
        '<body name="hand" pos="0 0 0.1"><joint name="ball" type="ball"/><geom type="sphere" size="0.03"/></body>'
        "</body></body></worldbody><equality><joint joint1='x' joint2='y'/></equality></mujoco>"
    )
    answer = run("build-tree", "arm.xml", "--leaves", "4", "--as", "mjcf", "--out", "two.xml", "--json")
    assert answer.code == 0, answer.err
    assert [each["link"] for each in json.loads(answer.out)["links"]] == ["base", "arm", "hand"]
    import mujoco

    assert mujoco.MjModel.from_xml_path(str(tmp_path / "two.xml")).njnt == 3
    refused = run("build-tree", "arm.xml", "--as", "curobo")
    assert refused.code == 2 and "cuRobo reads the joints from a URDF, and arm.xml is none" in refused.err


def test_what_only_looks_is_noted_and_taken_on_request(run: Run, tmp_path: Path) -> None:
    seen = '<visual><geometry><box size="0.1 0.06 0.02"/></geometry></visual>'
    twice = seen + seen.replace("<geom", '<origin xyz="1 0 0"/><geom', 1)
    links = link("a"), link("b", seen), link("c", twice)
    (tmp_path / "arm.urdf").write_text(urdf(*links, joint("a", "b"), joint("b", "c")))
    words = ("build-tree", "arm.urdf", "--leaves", "2", "--as", "urdf", "--out", "spheres.urdf")
    answer = run(*words)
    assert answer.code == 0 and "note: b, c: nothing there collides" in answer.err
    answer = run(*words, "--visual", "--json")
    assert answer.code == 0 and json.loads(answer.out)["notes"] == []
    text = (tmp_path / "spheres.urdf").read_text()
    assert text.count("<visual>") == 3 and text.count("<collision>") == 6


@pytest.mark.parametrize("kind", ["always", "default"])
def test_spheres_that_touch_in_the_start_pose_are_told_or_listed(run: Run, tmp_path: Path, kind: str) -> None:
    turns = joint("a", "b", origin='xyz="0.1 0 0"'), joint("b", "c", origin='xyz="-0.15 0 0"')
    (tmp_path / "arm.urdf").write_text(urdf(link("a"), link("b"), link("c"), *turns))
    words = f"build-tree arm.urdf --leaves 1 --ignore {kind} --as srdf --out arm.srdf --json"
    answer = run(*words.split())
    assert answer.code == 0, answer.err
    found = json.loads(answer.out)
    told = [note for note in found["notes"] if "touch in the start pose: a and c by" in note]
    assert len(told) == len(found["touching"]) == (kind == "always")
    assert ('link1="a" link2="c" reason="Default"' in (tmp_path / "arm.srdf").read_text()) is (kind == "default")
    assert found["self_collision_ignore"]["a"] == (["b", "c"] if kind == "default" else ["b"])


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
    words = ("--free", "--surface", "mesh", "--level", "1", "--out", "free.h5", "--ticks", "20")
    answer = run("replay", "block.urdf", "short.toml", *words)
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
