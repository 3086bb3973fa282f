"""What the gate says of results, suites and baselines; nothing here is run in another process."""

import json
import math
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import Run
from file_faults import changed, forge_scene, shortened
from gate_scene import SUITE, write_suite
from hypothesis import given
from hypothesis import strategies as st

from hhsim.errors import InputError
from hhsim.gate.gate import GateReport, gate_result, load_baseline, write_baseline
from hhsim.gate.metrics import COUNTERS, RunFigures, compared_metrics, cpu_p50, run_figures
from hhsim.gate.report import COLUMNS, headline, markdown, number_text, reasons
from hhsim.gate.run import RunFailed, Side, process_times
from hhsim.gate.suite import GateScene, default_suite, default_suite_text, load_suite, parse_suite, usual_limits
from hhsim.gate.verdict import GateRow, judge_figures, judge_run, judge_time, overall
from hhsim.metrics.run.registry import judged_metrics
from hhsim.replay.replay import replay_scene
from hhsim.replay.run_inputs import TOLERANCE, differences
from hhsim.replay.summary_table import default_limits
from hhsim.result.reader import load_result
from hhsim.scene.scene import open_scene
from hhsim.solver.method import METHODS, PROMISES
from hhsim.solver.options import SolverOptions

TINY = parse_suite(SUITE, Path(), "tiny")
SLACK = dict.fromkeys(COUNTERS, 0.005)
MESH_DIFFERS: Callable[[dict[str, Any]], object] = lambda scene: scene.update(object_mesh="0" * 64)  # noqa: E731


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result of the tiny suite's scene."""
    folder = tmp_path_factory.mktemp("gate")
    write_suite(folder)
    replay_scene(open_scene("cube", folder / "short.toml", level=3), SolverOptions(), folder / "stored.h5")
    return folder / "stored.h5"


@pytest.fixture
def result(stored: Path, tmp_path: Path) -> Path:
    """A copy of it to change."""
    return Path(shutil.copy(stored, tmp_path / "changed.h5"))


@pytest.fixture(scope="module")
def figures(stored: Path) -> RunFigures:
    return run_figures(load_result(stored))


def change_scene(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    with changed(path) as file:
        forge_scene(file, change)


def cells(row: GateRow) -> tuple[str, ...]:
    return tuple(column.shown(row) for column in COLUMNS)


def missed(report: GateReport) -> list[str]:
    return [row.name for row in report.missed]


def test_figures_are_those_of_the_runs_own_table(stored: Path, figures: RunFigures) -> None:
    summary = load_result(stored).summary
    for name in judged_metrics():
        if name in summary:
            assert figures.errors[name] == pytest.approx(summary[name], nan_ok=True, abs=1e-12), name
    assert figures.counters["work_units"] == round(summary["work_mean"] * summary["ticks"])
    assert cpu_p50(load_result(stored)) == pytest.approx(summary["tick_cpu_p50"])


def test_a_planted_penetration_of_5_um_is_caught_though_the_file_says_there_is_none(result: Path) -> None:
    with changed(result) as file:
        force = file["hands/right/tick/force/fingertip_normal"][...]
        tick, finger = np.unravel_index(np.linalg.norm(force, axis=2).argmax(), force.shape[:2])
        # Against the object's push, that is into it.
        into = -force[tick, finger] / np.linalg.norm(force[tick, finger])
        joints = file["hands/right/tick/graphic/joints"][...]
        joints[tick, finger] += 5e-6 * into
        file["hands/right/tick/graphic/joints"][...] = joints
        assert file["hands/right/tick/penetration_depth"][...].max() == 0.0
    report = gate_result(load_result(result), TINY, None)
    assert report.exit_code == 1
    assert missed(report) == ["penetration_max"]
    # The push is the sum of those of several spheres: each is entered by the share of the 5 µm along its own normal.
    assert 2e-6 < report.missed[0].head <= 5e-6


@pytest.mark.parametrize(
    ("dataset", "value", "name"),
    [
        ("penetration_depth", 2e-6, "penetration_max"),
        ("status", 1, "stuck_ticks"),
        ("status", 2, "lag_ticks"),
        ("graphic/joints", math.nan, "penetration_max"),
        ("graphic/orientation", math.nan, "penetration_max"),
        ("penetration_depth", math.nan, "penetration_max"),
    ],
)
def test_an_error_in_a_single_tick_is_caught(result: Path, dataset: str, value: float, name: str) -> None:
    with changed(result) as file:
        file[f"hands/right/tick/{dataset}"][77] = value
    report = gate_result(load_result(result), TINY, None)
    assert missed(report)[-1:] == [name] and report.exit_code == 1
    assert not math.isnan(value) or report.missed[0].reason == f"not finite: {dataset}"


@pytest.mark.parametrize("dataset", ["lag", "penetration_palm", "force/total", "force/phalanx", "graphic/joints"])
@pytest.mark.quick("lag", "graphic/joints")
def test_a_dataset_that_holds_no_number_is_missed_and_is_no_base(result: Path, stored: Path, dataset: str) -> None:
    with changed(result) as file:
        file[f"hands/right/tick/{dataset}"][...] = math.nan
    report = gate_result(load_result(result), TINY, load_result(stored))
    assert report.exit_code == 1
    assert report.missed[0].name == "run" and report.missed[0].reason == f"not finite: {dataset}"
    report = gate_result(load_result(stored), TINY, load_result(result))
    assert report.exit_code == 3 and f"base: not finite: {dataset}" in report.rows[0].reason


def sunk(stored: Path, name: str, more: float, last: int = 200) -> Path:
    """A copy whose palm is 9.459 mm deep from tick 150 on, and whose index is `more` [m] deep from there to `last`."""
    path = Path(shutil.copy(stored, stored.with_name(name)))
    with changed(path) as file:
        palm, finger = file["hands/right/tick/penetration_palm"][...], file["hands/right/tick/penetration_finger"][...]
        palm[150:], finger[150:last, 1] = 9.459e-3, more
        for column, values in (("palm", palm), ("finger", finger), ("depth", np.maximum(palm, finger.max(axis=1)))):
            file[f"hands/right/tick/penetration_{column}"][...] = values
        joints = file["hands/right/tick/graphic/joints"][...]
        joints[150:last, 1, -1, 2] -= more
        file["hands/right/tick/graphic/joints"][...] = joints
        flexion = file["hands/right/tick/graphic/flexion"][...]
        flexion[150:last, 1] += more
        file["hands/right/tick/graphic/flexion"][...] = flexion
    return path


@pytest.mark.parametrize("recorded", [False, True])
def test_a_finger_that_sinks_beside_a_deeper_palm_is_caught(stored: Path, recorded: bool) -> None:
    deep = parse_suite(SUITE.replace("penetration_max = 1e-6", "penetration_max = 1e-2"), Path(), "deep")
    before, after, brief = (load_result(sunk(stored, f"{more}-{last}.h5", more, last)) for more, last in SUNK)
    base = load_result_of(run_figures(before), stored) if recorded else before
    assert gate_result(before, deep, base).verdict == "same"
    report = gate_result(after, deep, base)
    assert (missed(report), report.exit_code) == (["penetration_index_max", "penetration_index_mean"], 1)
    assert [row.head for row in report.missed] == pytest.approx([0.4e-3, 0.1e-3])
    # A finger that is as deep for longer is deeper in the mean.
    (row,) = gate_result(after, deep, brief).missed
    assert (row.verdict, row.name) == ("worse", "penetration_index_mean")
    assert row.reason == "more than 1 µm above the base"
    wanted = "penetration_max = 1e-2\npenetration_index_max = 5e-4\npenetration_index_mean = false"
    report = gate_result(after, parse_suite(SUITE.replace("penetration_max = 1e-6", wanted), Path(), "own"), base)
    assert (report.verdict, report.exit_code) == ("worse within limits", 0)


SUNK = ((0.0, 200), (0.4e-3, 200), (0.4e-3, 151))


def test_other_poses_are_told_and_no_miss(stored: Path) -> None:
    before, after = (load_result(sunk(stored, name, depth)) for name, depth in (("a.h5", 0.0), ("b.h5", 1e-12)))
    for base in (before, load_result_of(run_figures(before), stored)):
        for head, word in ((after, "changed"), (before, "same")):
            assert [row.verdict for row in gate_result(head, TINY, base).rows if row.kind == "bits"] == [word]
    assert overall([GateRow("s", "bits", "digest", "", verdict="changed")]) == ("changed", 0)


def test_a_suite_that_names_no_slack_has_half_a_percent(repository: Path) -> None:
    suite = parse_suite(SUITE.replace("[counters]\nslack = 0.005\n", ""), Path(), "without")
    assert suite.slack == suite.scenes[0].slack == default_suite().slack == dict.fromkeys(COUNTERS, 0.005)
    assert "`slack`, 0.5 % by default" in (repository / "docs" / "gate.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda file: file.attrs.update(complete=0), "the run was stopped: it has only the first 200 ticks"),
        (lambda file: forge_scene(file, lambda scene: scene.update(ticks=200)), "only the first 200 ticks were run"),
        (lambda file: shortened(file, 60), "its summary is not of its 60 ticks"),
    ],
)
def test_a_run_that_is_not_whole_is_missed(
    result: Path, stored: Path, change: Callable[[h5py.File], object], reason: str
) -> None:
    with changed(result) as file:
        change(file)
    report = gate_result(load_result(result), TINY, None)
    assert report.exit_code == 1
    assert [(row.name, row.reason.startswith(reason)) for row in report.missed] == [("run", True)]
    # Beside a base of as many ticks, the first ones are what was wanted.
    wanted = "ticks were run" in reason
    assert (gate_result(load_result(result), TINY, load_result(stored)).exit_code == 0) == wanted


def test_one_pair_test_more_than_the_slack_is_a_miss(result: Path, figures: RunFigures) -> None:
    allowed = math.floor(0.005 * figures.counters["pair_tests"])
    for more, code in ((allowed, 0), (allowed + 1, 1)):
        with changed(result) as file:
            before = int(file["hands/right/tick/work/pair_tests"][100])
            file["hands/right/tick/work/pair_tests"][100] = before + more
        report = gate_result(load_result(result), TINY, load_result_of(figures, result))
        assert report.exit_code == code
        with changed(result) as file:
            file["hands/right/tick/work/pair_tests"][100] = before


def load_result_of(figures: RunFigures, beside: Path) -> Any:
    """A baseline of these figures, written and read."""
    path = beside.with_name("baseline.json")
    write_baseline(path, {"tiny": figures})
    return load_baseline(path)


def test_a_baseline_comes_back_as_it_was_written(figures: RunFigures, tmp_path: Path) -> None:
    path = tmp_path / "baseline.json"
    write_baseline(path, {"a": figures})
    scene = load_baseline(path).scenes["a"]
    assert differences(scene.figures.inputs, figures.inputs) == []
    assert scene.figures.counters == figures.counters
    assert scene.figures.errors == pytest.approx(figures.errors, nan_ok=True)
    assert "machine" not in json.loads(path.read_text())


@pytest.mark.parametrize(
    "change",
    [
        lambda scene: scene.update(errors={}),
        lambda scene: scene["errors"].update(penetration_max=math.nan),
        lambda scene: scene["errors"].update(penetration_max=1e300),
        lambda scene: scene.update(counters={}),
        lambda scene: scene["counters"].update(work_units=2 * scene["counters"]["work_units"]),
        lambda scene: scene["inputs"]["motion"].clear(),
        lambda scene: scene.update(digest=""),
        lambda scene: scene.pop("checksum"),
    ],
)
def test_a_baseline_that_is_not_as_it_was_recorded_is_refused(
    figures: RunFigures, tmp_path: Path, change: Callable[[dict[str, Any]], object]
) -> None:
    path = tmp_path / "baseline.json"
    write_baseline(path, {"tiny": figures})
    document = json.loads(path.read_text())
    path.write_text(json.dumps(document, indent=4))
    load_baseline(path)
    change(document["scenes"]["tiny"])
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"scene tiny is not as it was recorded.*record it anew with hhsim gate"):
        load_baseline(path)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": "hhsim-gate-baseline"}', '{"format": "x"}'])
def test_what_is_no_baseline_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "baseline.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"baseline\.json"):
        load_baseline(path)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (MESH_DIFFERS, "object mesh"),
        (lambda scene: scene["solver"].update(margin=2e-3), "margin: 0.001 and 0.002"),
        (lambda scene: scene["solver"]["stiffness"].update(rotation=4.0), "stiffness.rotation"),
        (lambda scene: scene.update(seed=1), "seed: 0 and 1"),
    ],
)
def test_different_inputs_cannot_be_compared(
    result: Path, stored: Path, change: Callable[[dict[str, Any]], object], reason: str
) -> None:
    change_scene(result, change)
    report = gate_result(load_result(result), TINY, load_result(stored))
    assert (report.verdict, report.exit_code) == ("not comparable", 3)
    assert reason in report.rows[0].reason
    assert not any(row.kind == "counter" for row in report.rows)
    assert all(math.isnan(row.base) and not row.verdict for row in report.rows[1:]), "no word beside another input"


@pytest.mark.parametrize(
    ("dataset", "reason"),
    [
        ("hands/right/tick/haptic/position", "trajectory"),
        ("bodies/cube/tree/radius", "sphere tree"),
        ("hands/right/phalanx_radius", "hand"),
    ],
)
def test_a_number_that_differs_by_a_micrometre_is_another_input(
    result: Path, stored: Path, dataset: str, reason: str
) -> None:
    for shift, found in ((1e-6, [reason]), (0.01 * TOLERANCE, [])):
        shutil.copy(stored, result)
        with changed(result) as file:
            values = file[dataset][...]
            values.reshape(-1)[17] += shift
            file[dataset][...] = values
        inputs = [run_figures(load_result(path)).inputs for path in (stored, result)]
        assert differences(*inputs) == found


def test_siblings_in_another_order_are_the_same_tree(result: Path, stored: Path) -> None:
    with changed(result) as file:
        for name in ("center", "radius"):
            values = file[f"bodies/cube/tree/{name}"][...]
            values[[-1, -2]] = values[[-2, -1]]
            file[f"bodies/cube/tree/{name}"][...] = values
    assert differences(*(run_figures(load_result(path)).inputs for path in (stored, result))) == []


def test_an_option_that_only_one_side_has_is_told_and_does_not_stop(figures: RunFigures) -> None:
    newer = replace(figures, inputs=replace(figures.inputs, solver={**figures.inputs.solver, "novel": 1}))
    row = judge_run("tiny", newer, figures, {}, SLACK)[0]
    assert (row.verdict, row.reason) == ("same", "options that only one side has: novel")


def judge_one(figures: RunFigures, name: str, value: float, before: float | None, limit: float) -> GateRow:
    head, base = (replace(figures, errors={**figures.errors, name: each or 0.0}) for each in (value, before))
    rows = judge_figures("tiny", head, None if before is None else base, {name: limit}, SLACK)
    return next(row for row in rows if row.name == name)


@pytest.mark.parametrize(
    ("name", "value", "before", "word"),
    [
        ("force_step", 1.0, 1.0, "same"),
        ("force_step", 1.0, 1.0 + 1e-12, "same"),
        ("force_step", 1.0, 1.0005, "within noise"),
        ("force_step", 1.0, 1.1, "better"),
        ("force_step", 1.2, 1.1, "worse"),
        # An energy below the optimum is as wrong as one above it.
        ("tracking_excess", -20.0, 0.5, "worse"),
        ("tracking_excess", 0.5, -20.0, "better"),
    ],
)
def test_an_error_has_a_word_beside_its_limit(
    figures: RunFigures, name: str, value: float, before: float, word: str
) -> None:
    found = judge_one(figures, name, value, before, 1.1)
    assert (found.verdict, found.passed) == (word, value <= 1.1)


@pytest.mark.parametrize(
    ("before", "passed", "reason"),
    [
        (None, True, "undefined here"),
        (math.nan, True, "undefined here"),
        (0.5, False, "undefined here, and the base has it"),
    ],
)
def test_what_is_undefined_is_not_missed_unless_the_base_has_it(
    figures: RunFigures, before: float | None, passed: bool, reason: str
) -> None:
    found = judge_one(figures, "force_step", math.nan, before, 1.1)
    assert (found.passed, found.reason) == (passed, reason)


def test_what_neither_side_tells_has_no_row_and_what_is_suspected_is_missed(figures: RunFigures) -> None:
    silent = replace(figures, errors={}, suspicions=("the hand stands still",))
    (row,) = judge_figures("tiny", silent, None, {}, SLACK)
    assert (row.kind, row.passed, row.reason) == ("run", False, "the hand stands still")
    assert row.to_json()["head"] == 1.0 and row.to_json()["base"] is None
    assert reasons([row, replace(row, passed=True)]) == [
        "tiny, suspected: the hand stands still (1, limit 0)",
        "tiny, suspected: the hand stands still",
    ]


@pytest.mark.parametrize("limits", [{}, {"stuck_ticks": 1e9}])
def test_no_suite_allows_a_run_of_which_most_ticks_are_stuck(figures: RunFigures, limits: dict[str, float]) -> None:
    head = replace(figures, errors={**figures.errors, "stuck_ticks": 900.0}, mostly_stuck=True)
    (row,) = (row for row in judge_figures("tiny", head, None, limits, SLACK) if row.name == "stuck_ticks")
    assert (row.passed, row.reason) == (False, "more than half of the ticks")


def row(verdict: str, passed: bool = True, kind: str = "counter") -> GateRow:
    return GateRow("s", kind, "n", "label", verdict=verdict, passed=passed)


def test_a_folder_without_a_suite_is_told_before_the_default_one_is_run(
    run: Run, figures: RunFigures, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hhsim.gate.gate.measured", lambda scene, side, folder, read: figures)
    answer = run("gate", "--no-time")
    told = f"hhsim: note: no hhsim-gate.toml in {Path.cwd()}: hhsim's own default suite is run"
    assert answer.err.splitlines()[0] == told
    (tmp_path / "own.toml").write_text(SUITE.replace("version = 1", 'version = 1\nbaseline = "none.json"'))
    answer = run("gate", str(tmp_path / "own.toml"))
    made = f"hhsim gate SUITE --write-baseline {tmp_path / 'none.json'}"
    assert (answer.code, f"record it with {made}" in answer.err) == (2, True)


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([row("same"), row("same")], ("same", 0)),
        ([row("same"), row("within noise")], ("within noise", 0)),
        ([row("same"), row("better")], ("better", 0)),
        ([row("better"), row("worse", kind="error")], ("worse within limits", 0)),
        ([row("better"), row("not comparable")], ("not comparable", 3)),
        ([row("not comparable"), row("worse", passed=False)], ("worse", 1)),
        ([row("worse", passed=False), row("refused"), row("not comparable")], ("refused", 2)),
        ([row("", kind="error")], ("", 0)),
        ([row("better", kind="error")], ("", 0)),
    ],
)
def test_the_verdict_of_all_rows(rows: list[GateRow], expected: tuple[str, int]) -> None:
    assert overall(rows) == expected


def test_the_projects_own_suite_is_read_and_has_a_baseline_of_each_scene(repository: Path) -> None:
    suite = load_suite(repository / "hhsim-gate.toml")
    baseline = load_baseline(suite.folder / suite.baseline)
    assert set(baseline.scenes) == {scene.name for scene in suite.scenes}


@pytest.mark.parametrize("method", METHODS)
def test_every_limit_that_a_suite_has_is_applied_to_a_result(result: Path, method: str) -> None:
    with changed(result) as file:
        file["hands/right/tick/penetration_depth"][77] = 8e-4
    change_scene(result, lambda scene: scene["solver"].update(method=method))
    suite = parse_suite(SUITE, Path(), "own")
    assert missed(gate_result(load_result(result), suite)) == ["penetration_max"]
    # Without one, a method is held to what it promises.
    promised = ["penetration_max"] if METHODS[method].never_penetrates else []
    assert missed(gate_result(load_result(result))) == promised


def test_a_figure_has_one_limit_for_all_methods_or_is_not_promised() -> None:
    # The objects of the default suite are fixed.
    free = {name: metric.judged for name, metric in judged_metrics().items() if metric.free_only}
    limited_ones = {name: by.limit for name, by in free.items() if by is not None and by.limit is not None}
    usual = {**usual_limits("replay", default_suite().limits), **limited_ones}
    figures = dict(zip(PROMISES, ("penetration_max", "tracking_excess", "free_off_max"), strict=True))
    for method in METHODS.values():
        limits = default_limits(method.promises)
        assert all(limits[name] == usual[name] for name in limits)
        assert usual.keys() - limits.keys() == {figures[lacked] for lacked in {*PROMISES} - method.promises}
    assert default_limits(PROMISES) == usual
    promises = {metric.judged.promise for metric in judged_metrics().values() if metric.judged} - {""}
    assert promises == {*PROMISES}


def test_limits_and_slack_of_a_scene_come_before_the_usual_ones() -> None:
    limits = "[scene.limits]\nstuck_ticks = false\nlag_max = 1e-3\n[scene.counters]\nslack = 0.02\npair_tests = 0\n"
    (scene,) = parse_suite(SUITE + limits, Path(), "suite").scenes
    limited = {name for name, limit in scene.limits.items() if limit is not False}
    assert limited == {"penetration_max", "lag_ticks", "tracking_excess", "lag_max"}
    assert (scene.slack["pair_tests"], scene.slack["node_tests"]) == (0.0, 0.02)
    assert scene.command() == ["replay", "cube", "short.toml", "--method", "coupled"]


def limited(limits: str) -> Any:
    return parse_suite(SUITE.replace("[limits]", f"[limits]\n{limits}"), Path(), "own")


def test_a_suite_limits_any_figure_and_times_by_whose_clock_it_runs(result: Path) -> None:
    found = load_result(result)
    cpu, force = (float(found.summary[name]) for name in ("tick_cpu_p99", "force_contact_max"))
    close = limited(f"tick_cpu_p99 = {0.9 * cpu!r}\nforce_contact_max = {0.9 * force!r}")
    report = gate_result(found, close, None)
    assert (missed(report), report.exit_code) == (["force_contact_max", "tick_cpu_p99"], 1)
    row = report.missed[1]
    assert (row.head, row.limit) == pytest.approx((cpu, 0.9 * cpu))
    assert cells(row)[3:] == ("—", number_text(0.9e6 * cpu), "µs", "limit only", "MISSED")
    assert missed(gate_result(found, close, None, timed=False)) == ["force_contact_max"]
    wide = gate_result(found, limited(f"tick_cpu_p99 = {1.1 * cpu!r}"), None)
    assert [cells(row)[-1] for row in wide.rows if row.name == "tick_cpu_p99"] == ["ok"]
    assert wide.exit_code == 0


def test_figures_of_a_session_are_limited_beside_those_of_scenes(result: Path) -> None:
    with changed(result) as file:
        file["summary/right"].attrs.update({"latency_p99": 3e-3, "missed": 2})
    suite = limited("latency_p99 = 2e-3\nmissed = 2\nfreed_share = 5.0\nended_early = false\nmesh_depth_max = 1e-6")
    of_sessions = {"latency_p99", "missed", "freed_share", "ended_early", "malformed_share", "faults"}
    assert not of_sessions & suite.scenes[0].limits.keys()
    replayed = load_result(result)
    assert not of_sessions & {row.name for row in gate_result(replayed, suite).rows}
    limits = {name: limit for name, limit in usual_limits("session", suite.limits).items() if limit is not False}
    assert limits.keys() & of_sessions == of_sessions - {"ended_early"} and limits["freed_share"] == 5.0
    assert "mesh_depth_max" not in limits and "mesh_depth_max" in usual_limits("submission", suite.limits)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("stuck_ticks = 0", "stuck = 0", "did you mean stuck_ticks"),
        ("stuck_ticks = 0", "stuck_ticks = -1", "from 0 on"),
        ("stuck_ticks = 0", "stuck_ticks = nan", "from 0 on"),
        ("processes = 3", "processes = 2", "time.processes = 2"),
        ("limit = 1.0 ", "limit = 5 ", "time.limit = 5"),
        ('object = "cube"', "", "object"),
        ('object = "cube"', 'object = "cube"\nsession = "a.h5"', "unknown key 'session'"),
        ('object = "cube"', 'objekt = "cube"', "scene[1]: unknown key 'objekt': did you mean object?"),
        ('object = "cube"', "object = 5", "scene[1].object = 5"),
        ("timed = true", "[scene.limits]\nlatency_p99 = 1.0", "only a session has latency_p99"),
        ("timed = true", "[scene.limits]\nmesh_depth_max = 1.0", "only a submission has mesh_depth_max"),
        ('object = "cube"', 'object = "--out"', "no option"),
        ("timed = true", 'timed = "yes"', "true or false"),
        ("timed = true", 'method = "best"', "unknown method 'best'"),
        ("timed = true", "level = 9", "1 to 5"),
        ("timed = true", 'hand = "left"', "hand is of a run of two"),
        ("timed = true", 'arguments = ["--hand", "both"]', "which of them is judged"),
        ("timed = true", "level = 3.0", "1 to 5"),
        ("version = 1", f"version = {5_000 * '['}", "not TOML"),
        ("timed = true", 'arguments = ["--out=x"]', "--out=x"),
        ("[[scene]]", "[scene]", "expected [[scene]]"),
        ("timed = true", '[[scene]]\nname = "tiny"\nobject = "cube"\ntrajectory = "pinch"', "two scenes named tiny"),
    ],
)
def test_a_wrong_suite_says_what_and_where(old: str, new: str, message: str) -> None:
    assert old in SUITE
    with pytest.raises(InputError) as error:
        parse_suite(SUITE.replace(old, new, 1), Path(), "my.toml")
    assert message in str(error.value)
    assert "my.toml" in str(error.value)


def test_the_docs_show_the_suites_own_names(repository: Path) -> None:
    page = (repository / "docs" / "gate.md").read_text(encoding="utf-8")
    text = page.split("```toml\n")[1].split("```")[0]
    (scene,) = parse_suite(text, Path(), "docs/gate.md").scenes
    assert scene.timed
    # The means of parts of the hand are told by their ending.
    assert "the mean in names that end with `_mean`" in page
    names = [re.sub("^(penetration_.+)_mean$", r"\1_max", name) for name in compared_metrics()]
    assert all(f"`{name}`" in page for name in names)
    assert parse_suite(default_suite_text(), Path(), "default").time.limit == 0.05


def report_of(*rows: GateRow) -> GateReport:
    return GateReport("suite", "base", rows, ("a note",))


def test_what_has_no_limit_or_is_undefined_is_not_within_its_limit() -> None:
    held = GateRow("s", "error", "a", "a", head=1.0, limit=2.0)
    without_limit = GateRow("s", "error", "b", "b", head=49.0)
    undefined = GateRow("s", "error", "c", "c", limit=1.0, reason="undefined here")
    over = GateRow("s", "error", "d", "d", head=3.0, limit=2.0, passed=False)
    cases = (held, without_limit, undefined), (held, without_limit, undefined, over), (without_limit, undefined)
    assert [headline(GateReport("suite", "", rows, ())) for rows in cases] == [
        "1 of 3 figures judged, all within their limits",
        "worse: 1 of 2 figures missed their limit",
        "0 of 2 figures judged, none has a limit and a value",
    ]
    worse = replace(held, verdict="worse", base=0.5)
    compared = GateReport("suite", "", (worse, without_limit, replace(undefined, verdict="same")), ())
    assert headline(compared) == "worse within limits: 1 of 1 figures compared (a)"
    assert [cells(each)[-1] for each in (held, without_limit, undefined, over)] == ["ok", "", "", "MISSED"]
    assert cells(replace(held, head=1e-14))[2] == "0.000", "nearly none is not none"


def test_markdown_shows_what_changed_and_folds_the_rest() -> None:
    bad = GateRow("s|x", "error", "n", "a_label", "µm", 5e-6, 0.0, 1e-6, "worse", False, "over the limit")
    text = markdown(report_of(bad, row("same")))
    assert text.startswith("## ❌ hhsim gate\n\nworse: 1 of 2 figures missed their limit, against base\n")
    shown, folded = text.split("<details>")
    assert "| s\\|x | a\\_label | 5 | 0 | 1 | µm | worse | MISSED |" in shown
    assert "- a note" in shown
    assert "| s | label |" in folded
    assert all(line.count("|") - line.count("\\|") == 9 for line in text.splitlines() if line.startswith("|"))
    assert markdown(report_of(row("same"))).startswith("## ✅")
    assert markdown(report_of(row("not comparable"))).startswith("## ⚠️")


def test_the_command_judges_a_result(run: Run, stored: Path, result: Path, tmp_path: Path) -> None:
    write_suite(tmp_path)
    answer = run("gate", str(stored), "--baseline", str(stored), "--json")
    document = json.loads(answer.out)
    assert (answer.code, document["verdict"], document["missed"]) == (0, "same", 0)
    change_scene(result, MESH_DIFFERS)
    answer = run("gate", str(result), "--baseline", str(stored), "--quiet")
    assert (answer.code, answer.out) == (3, "")
    assert "different inputs: object mesh" in answer.err
    assert run("gate", str(result), "--base-python", "python").code == 2


def test_the_command_prints_what_is_the_same_in_one_line(run: Run, stored: Path, result: Path) -> None:
    short, whole = (run("gate", str(stored), "--baseline", str(stored), *more).out for more in ((), ("--all",)))
    assert "penetration, max" in whole and "tree nodes tested" in whole and "(--all" not in whole
    told, verdict = short.splitlines()
    assert told.startswith(f"{stored}: ") and " same" in told and told.endswith("(--all shows them)")
    assert verdict == whole.splitlines()[-1]
    with changed(result) as file:
        file["hands/right/tick/work/pair_tests"][100] += 10**6
    lines = run("gate", str(result), "--baseline", str(stored)).out.splitlines()
    assert [line.split("  ")[1].strip() for line in lines if "MISSED" in line] == ["exact distances"]
    assert not any("penetration, max" in line for line in lines)


def test_a_scene_that_cannot_be_run_is_refused_in_every_report(
    run: Run, figures: RunFigures, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def measured(scene: GateScene, side: Side, folder: Path, read: Any) -> RunFigures:
        if scene.name == "gone":
            raise RunFailed("unknown object 'cub'", scene, side, refused=True)
        return figures

    monkeypatch.setattr("hhsim.gate.gate.measured", measured)
    suite = tmp_path / "own.toml"
    suite.write_text(SUITE + '[[scene]]\nname = "gone"\nobject = "cub"\ntrajectory = "pinch"\n')
    answer = run("gate", "own.toml", "--no-time", "--markdown", "gate.md", "--write-baseline", "baseline.json")
    assert (answer.code, (answer.err + answer.out).count("unknown object 'cub'")) == (2, 1)
    assert "hhsim: error: gone: unknown object 'cub'" in answer.err and not (tmp_path / "baseline.json").exists()
    assert (tmp_path / "gate.md").read_text().startswith("## ❌ hhsim gate\n\nrefused: 1 cannot be run")
    document = json.loads(run("gate", "own.toml", "--no-time", "--json").out)
    assert (document["exit_code"], document["error"]) == (2, "gone: unknown object 'cub'")


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("broken.toml",), "not TOML"),
        (("none.toml",), "no such file"),
        (("tiny.toml", "--baseline", "none.json"), "record it with hhsim gate SUITE"),
        (("none.h5",), "none.h5"),
    ],
)
def test_what_cannot_be_gated_at_all_is_one_line_and_one_error(
    run: Run, tmp_path: Path, arguments: tuple[str, ...], why: str
) -> None:
    (tmp_path / "broken.toml").write_text("version = ")
    (tmp_path / "tiny.toml").write_text(SUITE)
    answer = run("gate", *arguments, "--markdown", "gate.md")
    assert answer.code == 2 and why in answer.err and len(answer.err.splitlines()) == 1
    assert "refused: 1 cannot be run" in (tmp_path / "gate.md").read_text()


times = st.lists(st.integers(1, 10**6).map(float), min_size=3, max_size=9)


@given(times, times)
def test_the_verdict_is_that_of_exact_arithmetic(base: list[float], head: list[float]) -> None:
    def median(values: list[float]) -> Fraction:
        ordered, half = sorted(Fraction(value) for value in values), len(values) // 2
        return ordered[half] if len(values) % 2 else (ordered[half - 1] + ordered[half]) / 2

    found = judge_time("tiny", head, base, 0.25)
    ratio = median(head) / median(base)
    assert found.head / found.base == pytest.approx(float(ratio))
    assert found.limit == 1.25 * found.base and found.reason.startswith(f"{100 * (float(ratio) - 1):+.1f} %")
    if ratio not in (Fraction(5, 4), Fraction(4, 5)):
        expected = "worse" if ratio > Fraction(5, 4) else "better" if ratio < Fraction(4, 5) else "within noise"
        assert found.verdict == expected


def test_the_wider_side_is_told() -> None:
    found = judge_time("tiny", [1.0, 1.0, 1.1], [2.0, 2.0, 2.0], 0.25)
    assert found.reason == "-50.0 %, processes of a side within 10 %"


@pytest.mark.parametrize("wrong", [[1.0, 1.0, 0.0], [1.0, 1.0, math.nan]])
def test_times_that_say_nothing_are_refused(wrong: list[float]) -> None:
    with pytest.raises(InputError, match="base"):
        judge_time("tiny", [1.0, 1.0, 1.0], wrong, 0.05)


def test_a_steady_drift_favours_neither_side(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(range(8))
    monkeypatch.setattr("hhsim.gate.run.measured", lambda *_: next(clock))
    sides = [Side(name, Path(), "", "") for name in ("head", "base")]
    scene = GateScene(name="tiny", object="cube", trajectory="pinch")
    head, base = process_times(scene, Path(), *sides, 4, lambda _: None)
    assert sum(head) == sum(base) == 14
