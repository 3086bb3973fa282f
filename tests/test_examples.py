"""Examples and tutorials run, and show what they say."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_lines import parse
from conftest import REPOSITORY
from own_command import hhsim_command
from short_grasp import short_grasp, short_scene

from hhsim import HandConfiguration, MethodScene, SolverOptions, load_result, replay_scene
from hhsim.hand.model import Side
from hhsim.replay.conformance import NOTE, OK, check_method
from hhsim.trees.file import load_tree
from tools.notebooks import run, run_cell

pytestmark = pytest.mark.slow

EXAMPLES = REPOSITORY / "examples"
RUN_HERE = {"cpp_method", "library.py", "notebook.ipynb", "custom_object.sh", "custom_object.py", "custom_motion.toml"}
RUN_ELSEWHERE = {
    "feed_dex_retargeting.py": "repair/test_follow.py",
    "gate.sh": "gate/test_run.py",
    "gate-github-actions.yml": "gate/test_run.py",
    "laptop.urdf": "linkage/test_urdf.py",
    "project_out.py": "replay/test_outside_replay.py",
    "sweep.toml": "sweep/test_plan.py",
    "udp_bridge.py": "live/drivers/test_udp.py",
    "openxr_bridge.py": "live/drivers/test_openxr.py",
    "mug.stl": "test_readme_commands.py",
    "grab.csv": "test_readme_commands.py",
}


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """With commands that are this hhsim and this python, whatever is on the PATH."""
    return {**os.environ, "HHSIM": str(hhsim_command(tmp_path)), "PYTHON": sys.executable, "NO_COLOR": "1"}


def test_every_example_is_told_of_and_run_by_a_test() -> None:
    files = {path.name for path in EXAMPLES.iterdir() if path.name not in ("__init__.py", "__pycache__")}
    assert files == {"README.md", *RUN_HERE, *RUN_ELSEWHERE}
    page = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert files - {"README.md"} == {
        file for word, file in re.findall(r"\[([^\]]+)\]\(([^)#]+)\)", page) if word == file
    }
    for file, test in RUN_ELSEWHERE.items():
        assert f'"{file}"' in (REPOSITORY / "tests" / test).read_text(encoding="utf-8")


def test_the_library_in_twenty_lines(tmp_path: Path) -> None:
    text = (EXAMPLES / "library.py").read_text(encoding="utf-8")
    assert len([line for line in text.splitlines() if line.strip()]) <= 20
    answer = subprocess.run(
        [sys.executable, str(EXAMPLES / "library.py")], cwd=tmp_path, capture_output=True, text=True
    )
    assert answer.returncode == 0, answer.stderr
    for method in ("coupled", "progressive"):
        result = load_result(tmp_path / f"pinch-{method}.h5")
        assert result.complete and result.scene["solver"]["method"] == method
        assert f"{method}: {result.ticks:,} ticks, 0.000 µm deep, " in answer.stdout
        said = f"the hold takes {result.summary['force_hold_mean']:.2f} N; all of it is in {result.path.name}"
        assert said in answer.stdout and said in (EXAMPLES / "README.md").read_text(encoding="utf-8")


RUN_CELLS = """\
import ast, json, sys

names = {}
for cell in json.load(open(sys.argv[1], encoding="utf-8"))["cells"]:
    if cell["cell_type"] == "code":
        *statements, last = ast.parse("".join(cell["source"])).body
        exec(compile(ast.Module(statements, []), "cell", "exec"), names)
        if not isinstance(last, ast.Expr):
            exec(compile(ast.Module([last], []), "cell", "exec"), names)
        elif (value := eval(compile(ast.Expression(last.value), "cell", "eval"), names)) is not None:
            print(repr(value), "PNG" if getattr(value, "_repr_png_", bytes)()[1:4] == b"PNG" else "")
"""


@pytest.mark.soak
def test_the_notebook_runs_cell_by_cell(tmp_path: Path) -> None:
    document = json.loads((EXAMPLES / "notebook.ipynb").read_text(encoding="utf-8"))
    assert (document["nbformat"], document["nbformat_minor"]) == (4, 5)
    cells = [cell for cell in document["cells"] if cell["cell_type"] == "code"]
    assert len(cells) >= 4 and not any(cell["outputs"] or cell["execution_count"] for cell in cells)
    answer = subprocess.run(
        *([sys.executable, "-c", RUN_CELLS, str(EXAMPLES / "notebook.ipynb")],),
        cwd=tmp_path, env={**os.environ, "MPLBACKEND": "agg"}, capture_output=True, text=True,
    )  # fmt: skip
    assert answer.returncode == 0, answer.stderr
    scene, summary, result, picture = (line.rstrip() for line in answer.stdout.splitlines())
    assert scene.startswith("Scene(cube with ") and summary.startswith("ReplaySummary(cube, pinch, coupled")
    assert summary.rstrip().endswith("figures by name, SI: .attributes())")
    assert result.startswith("Result(pinch.h5: cube, pinch, coupled on spheres, 3,000 ticks")
    assert picture.startswith("ReportFigure(tick-") and picture.endswith("PNG")


@pytest.fixture
def cpp_method(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The example's module beside its library, built by the line that it says."""
    if shutil.which("c++") is None:
        pytest.skip("there is no C++ compiler (c++) to build the example with")
    folder = tmp_path / "cpp_method"
    shutil.copytree(EXAMPLES / "cpp_method", folder)
    (build,) = re.findall(r"(?m)^c\+\+ .*$", (folder / "cpp_method.py").read_text(encoding="utf-8"))
    subprocess.run([*build.split(), "-Wall", "-Wextra", "-Werror"], cwd=folder, check=True)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(sys.modules, "cpp_method", raising=False)
    return importlib.import_module("cpp_method")


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_kinematics_of_the_header_are_those_of_the_hand(cpp_method: Any, side: Side) -> None:
    scene = short_scene(short_grasp(), "cylinder", 2, side)
    method = cpp_method.CppMethod(
        MethodScene(scene.hands[0].model, scene.solids[0].placed_mesh, scene.solids[0].placed_tree, SolverOptions())
    )
    random, hand = np.random.default_rng(3), scene.hands[0].model
    for _ in range(50):
        turn = random.normal(size=4)
        flexion = random.uniform(hand.flexion_min, hand.flexion_max)
        abduction = random.uniform(hand.abduction_min, hand.abduction_max)
        pose = HandConfiguration(random.normal(size=3), turn / np.linalg.norm(turn), flexion, abduction)
        np.testing.assert_allclose(method.joints(pose), hand.joints(*pose), rtol=0.0, atol=1e-12)


@pytest.mark.soak
def test_a_method_in_cpp_can_be_measured(cpp_method: Any) -> None:
    found = {finding.name: finding.verdict for finding in check_method("cpp_method:CppMethod")}
    assert found == {**dict.fromkeys(found, OK), "depth": NOTE}, "phalanges between its balls are not looked at"
    assert "time" in found


def test_a_loop_of_ones_own_is_what_a_replay_runs(tmp_path: Path) -> None:
    (block,) = re.findall(r"(?ms)^```python\n(.*?)^```", (EXAMPLES / "README.md").read_text(encoding="utf-8"))
    forces: list[Any] = []
    names: dict[str, Any] = {"keep": forces.append}
    exec(f"{block}    keep((joints.copy(), force.copy()))\n", names)
    replay_scene(names["scene"], SolverOptions(), tmp_path / "touch.h5")
    result = load_result(tmp_path / "touch.h5")
    assert np.array_equal(np.array([joints for joints, _ in forces]), result["graphic/joints"])
    assert np.array_equal(np.array([force for _, force in forces]), result["force/total"])
    assert np.abs(result["force/total"]).max() > 0.1


def test_the_commands_of_an_object_of_ones_own_are_ones_that_are_taken() -> None:
    lines = (EXAMPLES / "custom_object.sh").read_text(encoding="utf-8").splitlines()
    commands = [line.replace("$hhsim", "hhsim") for line in lines if line.startswith("$hhsim ")]
    assert [line.split()[1] for line in commands] == ["build-tree", "replay", "verify"]
    for line in commands:
        parse(line.replace("$here", str(EXAMPLES)))


@pytest.mark.soak
def test_an_object_and_a_motion_of_ones_own(tmp_path: Path, environment: dict[str, str]) -> None:
    command = ["sh", str(EXAMPLES / "custom_object.sh"), "mine"]
    answer = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    folder = tmp_path / "mine"
    assert sorted(path.name for path in folder.iterdir()) == ["pawn-tree.h5", "pawn.h5", "pawn.stl"], answer.stderr
    assert "proved and checked: each level covers the whole mesh" in answer.stdout
    result, tree = load_result(folder / "pawn.h5"), load_tree(folder / "pawn-tree.h5")
    # The pawn is 69 mm high, and has the spheres that were built for it.
    assert result.body.mesh.extent == pytest.approx([0.044, 0.044, 0.069], abs=1e-5)
    assert result.scene["object_spheres"] == tree.leaf_count
    assert [phase.name for phase in result.phases] == ["approach", "pinch", "hold", "slide", "release"]
    assert result["penetration_depth"].max() == 0.0
    assert (result["contacts/touching"][result.phase("hold")] >= 2).all()
    assert answer.returncode == 0, answer.stderr
    assert "every claim that could be judged holds" in answer.stdout


NOTEBOOKS = sorted((REPOSITORY / "docs" / "tutorials").glob("*.ipynb"))
EACH = pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)


@EACH
@pytest.mark.soak
def test_every_cell_runs(notebook: Path, tmp_path: Path) -> None:
    stored = json.loads(notebook.read_text(encoding="utf-8"))
    made = run(notebook, tmp_path)
    for before, after in zip(stored["cells"], made["cells"], strict=True):
        if before["cell_type"] == "code":
            kinds = [
                [(output["output_type"], *output.get("data", {})) for output in cell["outputs"]]
                for cell in (before, after)
            ]
            assert kinds[0] == kinds[1], "python -m tools.notebooks writes what the cells show now"


@EACH
def test_its_outputs_are_shown(notebook: Path) -> None:
    cells = [cell for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert sum(bool(cell["outputs"]) for cell in cells) >= len(cells) // 2
    for cell in cells:
        assert (
            not any("image/png" in output.get("data", {}) for output in cell["outputs"])
            or len(cell["metadata"]["alt"]) > 30
        )
        assert "/tmp" not in json.dumps(cell["outputs"]) and str(REPOSITORY) not in json.dumps(cell["outputs"])


def test_a_cell_that_fails_is_told() -> None:
    def cell(source: str, **metadata: int) -> dict[str, object]:
        return {"source": [source], "metadata": metadata}

    assert run_cell(cell("a = 2\na + 1"), {})[0]["data"] == {"text/plain": "3"}
    assert run_cell(cell("print('said');"), {})[0]["text"] == ["said\n"]
    assert run_cell(cell("!exit 1", exit_code=1), {})[0]["text"] == []
    with pytest.raises(RuntimeError, match="exit code 3"):
        run_cell(cell("!exit 3"), {})
    with pytest.raises(ZeroDivisionError):
        run_cell(cell("1 / 0"), {})
