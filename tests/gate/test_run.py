"""The gate as CI runs it: other pythons, planted faults, the shell and the GitHub example."""

import importlib
import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import pytest
from conftest import Run
from gate_scene import SUITE, write_suite
from own_command import hhsim_command
from sampled import sampled

from hhsim.errors import InputError
from hhsim.gate.gate import gate_suite
from hhsim.gate.metrics import RunFigures, cpu_p50, run_figures
from hhsim.gate.run import RunFailed, Side, find_side, measured
from hhsim.gate.suite import GateScene, load_suite

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_suite(tmp_path_factory.mktemp("suite"))


@pytest.fixture(scope="module")
def this_side() -> Side:
    """The hhsim that is tested here, as the head."""
    return find_side("head", Path(sys.executable))


@pytest.fixture(scope="module")
def one_result(suite: Path, this_side: Side) -> tuple[RunFigures, float]:
    """Figures and time of one replay of the suite's scene by the hhsim that is tested here."""
    (scene,) = load_suite(suite).scenes
    # Read to the end before the file is gone.
    return measured(scene, this_side, suite.parent, lambda result: (run_figures(result), cpu_p50(result)))


BROKEN = """
import os


class Broken:
    def __init__(self, scene): ...

    def begin(self, pose): ...

    def tick(self, haptic):
        os._exit(3)
"""


def test_a_head_that_breaks_is_a_miss_and_one_that_refuses_an_error(
    suite: Path, this_side: Side, tmp_path: Path
) -> None:
    (tmp_path / "broken_method.py").write_text(BROKEN)
    shutil.copytree(suite.parent, tmp_path, dirs_exist_ok=True)
    (tmp_path / suite.name).write_text(SUITE.replace("timed = true", 'method = "broken_method:Broken"'))
    report = gate_suite(load_suite(tmp_path / suite.name), this_side, timed=False)
    assert (report.exit_code, report.recorded) == (1, {})
    assert report.missed[0].reason == "exit code 3"
    scene = GateScene(name="gone", object="no-such-object", trajectory="pinch")
    with pytest.raises(RunFailed, match=r"^unknown object .no-such-object.") as failed:
        measured(scene, this_side, suite.parent, run_figures)
    assert failed.value.refused


@pytest.fixture
def one_run(one_result: tuple[RunFigures, float], monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Every run of a side is the same one, but of the sides in the set.

    These break once they are timed. What is tested is what is made of the runs.
    """
    broken: set[str] = set()

    def replay(scene: GateScene, side: Side, folder: Path, read: Callable[..., Any]) -> Any:
        if side.name in broken and read is cpu_p50:
            raise RunFailed(f"{side.name} broke", scene, side, refused=False)
        return one_result[0] if read is run_figures else one_result[1]

    for module in ("gate", "run"):
        monkeypatch.setattr(f"hhsim.gate.{module}.measured", replay)
    return broken


@pytest.mark.parametrize(
    ("failing", "kind", "code"),
    sampled([("head", "run", 1), ("base", "inputs", 3)], lambda place, case: case[0] == "base"),
)
@pytest.mark.soak
def test_a_side_that_breaks_while_it_is_timed_is_told(
    suite: Path, this_side: Side, one_run: set[str], failing: str, kind: str, code: int
) -> None:
    one_run.add(failing)
    base = replace(this_side, name="base")
    report = gate_suite(load_suite(suite), this_side, base=base)
    assert report.exit_code == code
    told = [(row.kind, row.reason) for row in report.rows if "broke" in row.reason]
    assert [kind for kind, _ in told] == [kind] and told[0][1].endswith(f"{failing} broke")
    assert bool(report.recorded) == (failing == "base")


def test_a_baseline_is_kept_where_not_every_scene_runs(
    run: Run, suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(scene: GateScene, side: Side, *_: Any) -> NoReturn:
        raise RunFailed("planted", scene, side, refused=False)

    monkeypatch.setattr("hhsim.gate.gate.measured", broken)
    kept = tmp_path / "baseline.json"
    kept.write_text(before := '{"format": "hhsim-gate-baseline", "is": "as it was"}')
    answer = run("gate", str(suite), "--write-baseline", str(kept), "--json")
    assert (answer.code, json.loads(answer.out)["baseline_written"]) == (1, None)
    assert f"not every scene ran, so {kept} is not written" in answer.err
    assert kept.read_text() == before


def test_what_is_no_python_with_hhsim_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--base-python .* cannot be run"):
        find_side("base", tmp_path / "python")
    empty = tmp_path / "empty"
    empty.write_text("#!/bin/sh\nexit 1\n")
    empty.chmod(0o755)
    with pytest.raises(InputError, match="has no hhsim"):
        find_side("base", empty)


@pytest.mark.soak
def test_the_folder_that_the_gate_runs_in_is_not_where_modules_come_from(tmp_path: Path) -> None:
    (tmp_path / "hhsim").mkdir()
    (tmp_path / "hhsim" / "__init__.py").write_text("raise ImportError('the wrong hhsim')\n")
    script = "import sys; from hhsim.gate.run import *; print(find_side('head', Path(sys.executable)).version)"
    answer = subprocess.run([sys.executable, "-P", "-c", script], cwd=tmp_path, capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr


def test_times_are_judged_beside_a_base_alone(
    run: Run, suite: Path, this_side: Side, tmp_path: Path, one_run: set[str]
) -> None:
    assert run("gate", str(suite), "--write-baseline", "baseline.json").code == 0
    answer = run("gate", str(suite), "--baseline", "baseline.json")
    assert answer.code == 0, answer.out
    assert "no time was judged: that takes --base-python" in answer.out
    report = gate_suite(load_suite(suite), this_side, base=replace(this_side, name="base"))
    assert {row.verdict for row in report.rows if row.kind == "counter"} == {"same"}
    assert [(row.verdict, row.passed) for row in report.rows if row.kind == "time"] == [("within noise", True)]


@pytest.mark.soak
@pytest.mark.parametrize("timed", [False, True])
def test_the_shell_example_gates_base_and_head(repository: Path, tmp_path: Path, timed: bool) -> None:
    folder = tmp_path / "suite"
    folder.mkdir()
    write_suite(folder).write_text(SUITE if timed else SUITE.replace("timed = true", "timed = false"))
    script = repository / "examples" / "gate.sh"
    named = {"HHSIM": hhsim_command(tmp_path), "BASE_PYTHON": sys.executable, "REPORTS": tmp_path / "reports"}
    environment = {**os.environ, **{name: str(path) for name, path in named.items()}}
    answer = subprocess.run([str(script)], cwd=folder, env=environment, capture_output=True, text=True)
    assert answer.returncode == 0, answer.stdout + answer.stderr
    assert ("tick in contact, CPU, p50" in answer.stdout) == timed
    assert (tmp_path / "reports" / "gate.md").read_text().startswith("## ✅ hhsim gate")


def test_the_github_example_is_yaml_whose_gate_line_the_command_takes(repository: Path) -> None:
    yaml = pytest.importorskip("yaml", reason="pip install 'hhsim[test]' brings pyyaml")
    command = importlib.import_module("hhsim.cli.gate").command
    workflow = yaml.safe_load((repository / "examples" / "gate-github-actions.yml").read_text())
    assert set(workflow) == {"name", True, "permissions", "env", "jobs"}, "on: is read as true"
    (job,) = workflow["jobs"].values()
    steps = {step["name"]: step for step in job["steps"] if "name" in step}
    assert {step["with"]["path"] for step in job["steps"] if "checkout" in step.get("uses", "")} == {"base", "head"}
    program, *arguments = shlex.split(steps["Gate"]["run"])
    assert (program, arguments[0]) == (".venv/bin/hhsim", "gate")
    context = command.make_context("gate", arguments[1:])
    assert steps["Summary"]["run"] == 'cat head/gate.md >> "$GITHUB_STEP_SUMMARY"' and context.params["markdown"]
    assert context.params["base_python"] == Path("../base/.venv/bin/python")
    assert context.params["base_folder"] == Path("../base")
    answer = subprocess.run(["sh", "-n", "-c", steps["Install both"]["run"]], capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
