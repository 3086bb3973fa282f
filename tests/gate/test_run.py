"""The gate as CI runs it: other pythons, methods of others, a session, the shell and the GitHub example."""

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
from conftest import Run, sampled
from file_faults import changed
from gate_scene import SUITE, write_suite
from live_scripted import write_session
from own_command import hhsim_command
from short_grasp import short_result

from hhsim.errors import InputError
from hhsim.gate.gate import gate_result, gate_suite
from hhsim.gate.metrics import RunFigures, cpu_p50, run_figures
from hhsim.gate.report import not_judged
from hhsim.gate.run import RunFailed, Side, find_side, measured
from hhsim.gate.suite import GateScene, load_suite, parse_suite
from hhsim.gate.verdict import LOST
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK
from hhsim.result.reader import load_result
from hhsim.result.safety import Safety
from hhsim.solver.method import outside_class

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


OTHERS = "outside_methods:OurOwn"
LIMITED = SUITE.replace("[limits]", "[limits]\nlag_max = 1e-6\nrows_max = 0\nforce_contact_max = 20.0")


def test_what_a_method_of_others_does_not_tell_is_no_miss_unless_it_told_it_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    suite = parse_suite(LIMITED, Path(), "own")
    base = short_result(tmp_path / "base.h5", method=OTHERS)
    report = gate_result(base, suite, base)
    (untold,) = (line for line in not_judged(report) if "does not tell it" in line)
    assert report.exit_code == 0 and "limit on stuck_ticks, lag_ticks, lag_max, rows_max not judged" in untold
    monkeypatch.setattr(outside_class(OTHERS), "gives_forces", False)
    head = gate_result(short_result(tmp_path / "head.h5", method=OTHERS), suite, base)
    assert head.exit_code == 1 and {row.reason for row in head.missed} == {LOST}
    assert {"force_step", "force_contact_step"} <= {row.name for row in head.missed}


def test_a_result_is_judged_without_the_module_of_its_method(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in (("own", "from outside_methods import Promises as Own\n"), ("broken", "raise SystemExit(3)")):
        Path("own_method.py").write_text(text)
        sys.modules.pop("own_method", None)
        if name == "own":
            path = short_result(tmp_path / "own.h5", method="own_method:Own").path
    Path("hhsim-gate.toml").write_text("version = ")
    assert run("gate", str(path), "--quiet").code == 1
    (row,) = (row for row in gate_result(load_result(path)).rows if row.name == "penetration_max")
    assert row.limit == 1e-6, "its file says that the method promises it"


def test_a_scene_that_the_base_folder_lacks_is_judged_by_its_limits(
    run: Run, suite: Path, this_side: Side, one_result: tuple[RunFigures, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    def replay(scene: GateScene, side: Side, *_: Any) -> RunFigures:
        if side.name == "base":
            raise RunFailed("no such object", scene, side, refused=True)
        return one_result[0]

    monkeypatch.setattr("hhsim.gate.gate.measured", replay)
    base = replace(this_side, name="base", folder=suite.parent)
    report = gate_suite(load_suite(suite), this_side, base=base, timed=False)
    assert report.exit_code == 0
    assert any("new, so judged by limits alone: base" in row.reason for row in report.rows)
    assert "no such folder" in run("gate", str(suite), "--base-folder", "nowhere").err


def test_a_session_is_judged_by_its_file_and_its_faults_are_named(tmp_path: Path) -> None:
    path = tmp_path / "session.h5"
    write_session(path)
    figures = {"stuck_ticks", "lag_ticks", "ended_early", "malformed_share", "freed_share"}
    assert not {row.name for row in gate_result(load_result(path)).missed} & figures
    with changed(path) as file:
        hand = file["hands/right"]
        hand["tick/status"][50:60] = STATUS_STUCK | STATUS_LAG
        hand["live/tick/safety"][50:60] = Safety.STALE_INPUT
        counters = {**json.loads(hand["live"].attrs["counters"]), "frames": 60_000, "malformed": 1280}
        hand["live"].attrs.update({"counters": json.dumps(counters), "ended": "the loop failed or was killed"})
    assert figures <= {row.name for row in gate_result(load_result(path)).missed}
