"""Every block of code of the pages runs, or is named here with what it needs that no test has.

Lines of README.md and docs/cli.md are run by test_readme_commands.py, notebooks by test_tutorials.py, examples by
test_examples.py, those of the gallery by `make gallery`; a page's other lines here, in order, among `given` files.
"""

import os
import re
import shutil
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from conftest import REPOSITORY
from markdown_pages import Page
from own_command import hhsim_command, paste

import hhsim
from hhsim.recordings.column_map import read_column_map

pytestmark = pytest.mark.slow

PASTED = ("README.md", "docs/cli.md")
ELSEWHERE = {*PASTED, "docs/gallery.md", "examples/README.md"}
NEEDS = {
    r"--device (?!left=sim)|udp_bridge|openxr_bridge|kill %1": "a glove, its server or its bridge: tests/live/drivers",
    r"hhsim live glove(?!.*--duration)": "a key that ends it: tests/live/session",
    r"umetrack|three-claps|laptop_use_01|mouse\.h5": "a public sample that does not ship",
    r"quest\.csv --fit-hand|quest\.h5": "a headset's recording: tests/recordings",
    r"import (session|other)\.csv": "a glove's table: tests/recordings",
    r"^(uvx|pipx|docker|pip|make|git) ": "a network, or an environment of its own: test_readme_commands.py",
    r"sudo ": "rights to change the system",
    r"--rerun (spawn|connect)|hhsim view (?!.*(--video|\.rrd))|…": "a display",
    r"\.mp4": "ffmpeg",
    r"mujoco|peers|door\.xml": "another engine, an extra",
    r"^dask |--scheduler": "a cluster",
    r"--base-(python|folder)": "another checkout: tests/gate",
    r"pytest|ruff": "to test the tests",
    r"hhsim doctor": "a machine that keeps 1 kHz",
    r"tracker \|": "a tracker: tests/repair/test_follow.py",
    r"theirs\.": "spheres of another program: tests/robots",
}
"""What lines need that match a pattern."""
METHOD = """
class MyMethod:
    '''Follows the user.'''
    def __init__(self, scene): pass
    def begin(self, pose): pass
    def tick(self, haptic): return haptic
"""
LINK = '<link name="{0}"><collision><geometry><box size="{1} {1} {1}"/></geometry></collision></link>'
DRAWER = LINK.format("case", 0.06) + LINK.format("handle", 0.02) + (
    '<joint name="slide" type="prismatic"><parent link="case"/><child link="handle"/><axis xyz="1 0 0"/>'
    '<origin xyz="0.06 0 0"/><limit lower="0" upper="0.05" effort="1" velocity="1"/></joint>'
)  # fmt: skip
SUITE = 'version = 1\n[limits]\n[[scene]]\nname = "touch"\nobject = "sphere"\ntrajectory = "touch"\n'


def page_of(name: str) -> Page:
    return Page.read(REPOSITORY / name)


PAGES = sorted({"README.md", "CONTRIBUTING.md", "examples/README.md"} | {
    path.relative_to(REPOSITORY).as_posix() for path in (REPOSITORY / "docs").rglob("*.md")
})  # fmt: skip
PASTED_LINES = {line for name in PASTED for line in page_of(name).command_lines()}


def lines_of(name: str) -> list[str]:
    """Return the lines of a page that are run here."""
    lines = [] if name in ELSEWHERE else page_of(name).command_lines()
    return [line for line in lines if line not in PASTED_LINES and not any(re.search(need, line) for need in NEEDS)]


def test_what_is_not_run_needs_something_and_what_is_needed_is_on_a_page() -> None:
    left = [line for name in PAGES for line in page_of(name).command_lines() if name not in ELSEWHERE]
    assert [need for need in NEEDS if not any(re.search(need, line) for line in left)] == []
    assert sum(len(lines_of(name)) for name in PAGES) > 30


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    commands = tmp_path_factory.mktemp("bin")
    hhsim_command(commands)
    return {"PATH": f"{commands}:{os.environ['PATH']}"}


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory, environment: dict[str, str]) -> Path:
    """Return a folder of the files that pages take for the reader's own."""
    folder = tmp_path_factory.mktemp("given")
    shutil.copytree(REPOSITORY / "examples", folder / "examples")
    for name in ("results", "meshes", "poses", "sequences"):
        (folder / name).mkdir()
    setup = [
        "cp examples/laptop.urdf examples/grab.csv .; cp laptop.urdf arm.urdf; cp grab.csv quest.csv",
        "hhsim replay cube pinch --ticks 1500 --out grasp.h5",
        "hhsim replay cube pinch --ticks 1500 --method paper --out paper.h5",
        "hhsim replay cube grasp --hand both --ticks 600 --out both.h5",
        "hhsim live glove cube --duration 2 --out session.h5",
        "for name in a b coupled results/before results/after results/grasp; do cp grasp.h5 $name.h5; done",
        "cp paper.h5 progressive.h5; cp session.h5 results/",
        "hhsim import grab.csv --out motion.h5",
    ]
    paste(setup, folder, environment)
    for name, links in (("drawer", DRAWER), ("box", LINK.format("box", 0.06))):
        (folder / f"{name}.urdf").write_text(f'<robot name="{name}">{links}</robot>')
    (folder / "my_module.py").write_text(METHOD)
    (folder / "hhsim-gate.toml").write_text(SUITE)
    mug: Any = trimesh.load_mesh(REPOSITORY / "examples" / "mug.stl")
    mug.apply_scale(1e-3)
    for path in ("mug.stl", "meshes/mug.obj"):
        mug.export(folder / path)
    hand = hhsim.load_trajectory(folder / "motion.h5")
    arrays: dict[str, Any] = {"wrist_pos": hand.position, "wrist_quat_wxyz": hand.orientation, "flex": hand.flexion}
    for path in ("grab.npz", "grasp.npz", "sequences/mug_1.npz"):
        np.savez(folder / path, t=hand.time, abd=hand.abduction, hand="right", **arrays)
    np.save(folder / "poses" / "mug_1.npy", np.eye(4).reshape(1, 16))
    (folder / "manifest.toml").write_text(page_of("docs/repair.md").blocks("toml")[0])
    return folder


@pytest.mark.soak
@pytest.mark.parametrize("name", [name for name in PAGES if lines_of(name)])
def test_every_line_of_a_page_can_be_pasted(
    name: str, given: Path, environment: dict[str, str], tmp_path: Path
) -> None:
    paste(lines_of(name), shutil.copytree(given, tmp_path / "work"), environment)


IN_PYTHON = {"docs/results.md", "docs/files.md", "docs/outside-methods.md", "docs/lab/recordings.md", "docs/repair.md"}
IN_PYTHON |= {"docs/faq.md", "examples/README.md"}


def test_python_blocks_do_what_they_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from repair_scenes import HAND, scene_case
    from short_grasp import short_result

    from hhsim.repair.recorded_scene import model_joints

    assert {name for name in PAGES if page_of(name).blocks("python")} == IN_PYTHON
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(hhsim, "view_result", lambda result: None, raising=False)  # needs rerun's notebook package
    ticks = short_result(tmp_path / "grasp.h5").ticks
    Path("results").mkdir()
    take: Any = {"params": {"transl": np.zeros((2, 3)), "fullpose": np.zeros((2, 45))}}
    np.savez("mug_drink_1.npz", rhand=take, lhand=take, object=take, framerate=120.0)
    joints = model_joints(HAND, scene_case("sphere", "grasp", 100, 3, 15).frames)
    still = np.tile([1.0, 0.0, 0.0, 0.0], (len(joints), 1))
    given: dict[str, Any] = {"joints": joints, "places": np.zeros((len(joints), 3)), "turns": still}
    names = {page: dict(given) for page in sorted(IN_PYTHON)}
    mesh = trimesh.load_mesh(str(files("hhsim.objects") / "sphere.ply"))
    mesh.export("mug.stl")
    for name, of_page in names.items():
        for block in page_of(name).blocks("python"):
            for result in re.findall(r'"(results/[^"]+)"', block):
                shutil.copyfile("grasp.h5", result)
            if "session" not in block:
                exec(compile(block.replace("(result, 1500)", "(result, 150)"), name, "exec"), of_page)
    assert not names["docs/repair.md"]["motion"].depth_after.any()
    # What the FAQ exports, and the user's own hand, which goes in as deep as it is told to.
    assert np.genfromtxt("grasp.csv", delimiter=",", skip_header=1).shape == (ticks, 3)
    assert 5e-3 < names["docs/faq.md"]["found"].depth.max() < 20e-3
    assert set(np.load("mug.npz")) == {f"{p}_{k}" for p in ("rhand", "lhand", "object") for k in take["params"]} | {
        "framerate"
    }


def test_toml_blocks_are_toml(tmp_path: Path) -> None:
    for name in PAGES:
        for block in page_of(name).blocks("toml"):
            tomllib.loads(block)
    (tmp_path / "columns.toml").write_text(page_of("docs/recordings.md").blocks("toml")[0])
    assert read_column_map(tmp_path / "columns.toml").hand == "right"
