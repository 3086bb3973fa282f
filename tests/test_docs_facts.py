"""What the documentation says is what the code does: names, defaults, figures that stand twice, answers of the FAQ."""

import inspect
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fault_table import FAULTS
from markdown_pages import Page
from short_grasp import short_scene

from hhsim.bench.suites.hard import hard_cases
from hhsim.gate.gate import load_baseline
from hhsim.gate.metrics import OUTSIDE_DEFAULTS
from hhsim.hand.model import HandModel
from hhsim.kernels.live import plausibility
from hhsim.live import doctor
from hhsim.live.drivers import poses
from hhsim.live.drivers.udp import SILENCE_NS
from hhsim.live.gloves import configure
from hhsim.live.open_packet import SESSION_SILENCE_NS
from hhsim.live.session import loop, supervisor
from hhsim.live.session.setup import OutputLimits, SafetyLimits
from hhsim.live.session.watchdog import RELEASE_NS
from hhsim.metrics import metrics
from hhsim.metrics.run.registry import run_metrics
from hhsim.metrics.session_faults import SESSION_FAULTS
from hhsim.recordings import cleaning
from hhsim.recordings.cleaning import JOINT, ORIENTATION, POSITION
from hhsim.recordings.dexmo_regression import LEAST_SPAN
from hhsim.replay.replay import replay_scene
from hhsim.replay.summary import ReplaySummary
from hhsim.replay.summary_table import short_table
from hhsim.replay.verdict import OK
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import TICK_COLUMNS
from hhsim.scene.script import parse_script
from hhsim.solver.method import METHODS, USUAL
from hhsim.solver.options import TOUCH, SolverOptions, Stiffness

DOCS = Path(__file__).resolve().parent.parent / "docs"
README = Page.read(DOCS.parent / "README.md")
METRICS, METHODS_PAGE, FAQ = (Page.read(DOCS / name) for name in ("metrics.md", "methods.md", "faq.md"))
PAPER, MEASURED = (Page.read(DOCS / "lab" / name) for name in ("paper.md", "methods.md"))

MOTION = """
title = "short"
depth = 0.015
[[phase]]
name = "approach"
duration = 0.05
[[phase]]
name = "pinch"
duration = 0.1
[[phase]]
name = "hold"
duration = 0.12
[[phase]]
name = "release"
duration = 0.03
"""


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> tuple[ReplaySummary, Result]:
    path = tmp_path_factory.mktemp("docs") / "short.h5"
    scene = short_scene(parse_script(MOTION, name="short", where="short"), "cube")
    return replay_scene(scene, SolverOptions(), path, description={"hand_file": None}), load_result(path)


def spans(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


def test_each_line_of_the_table_is_explained_in_order(short: tuple[ReplaySummary, Result]) -> None:
    documented = [(row[0], *spans(row[1])) for row in METRICS.rows() if len(row) == 3 and len(spans(row[1])) == 1]
    lines = [(row.label, row.name) for row in short[0].rows]
    first = documented.index(lines[0])
    assert documented[first : first + len(lines)] == lines


def test_the_first_result_of_the_readme_has_these_lines(short: tuple[ReplaySummary, Result]) -> None:
    block = next(block for block in README.blocks("console") if "penetration, max" in block)
    shown = [line for line in block.splitlines() if line[:1].isalpha() and "  " in line]
    assert [re.split(r" {2,}", line)[0] for line in shown] == [row.label for row in short_table(short[0].rows)]
    assert f"\n{OK}. The shown hand stays out" in block


def test_the_first_result_of_the_readme_is_what_the_gate_holds_and_its_limits_those_of_the_table() -> None:
    errors = load_baseline(DOCS.parent / "tests" / "gate-baseline.json").scenes["bunny-grasp"].figures.errors
    block = next(block for block in README.blocks("console") if "penetration, max" in block)
    lines = {
        cells[0]: cells[1:] for cells in (re.split(r" {2,}", line) for line in block.splitlines()) if len(cells) > 1
    }
    held = [metric for name, metric in run_metrics().items() if metric.label in lines and name in errors]
    assert len(held) == 7
    for metric in held:
        assert lines[metric.label][0] == metric.shown(errors[metric.name]), metric.label
        limit = None if metric.judged is None else metric.judged.limit
        assert limit is None or f"{limit / metric.scale:g}" in lines[metric.label][1:], metric.label


def test_counts_are_those_of_the_registries() -> None:
    assert f"In {len(hard_cases())} hard cases and" in README.text
    assert f"pass all {len(hard_cases())} cases" in Page.read(DOCS / "lab" / "measurements.md").text


def test_every_measure_and_dataset_is_documented() -> None:
    table = [row for row in METRICS.rows() if len(row) == 4]
    datasets = {name for row in table for name in spans(row[2])}
    columns = {column.name for column in TICK_COLUMNS}
    assert datasets <= columns
    measured = {name for name in columns if re.match("penetration|force_|duration|contacts|work|status|lag", name)}
    assert measured == datasets
    functions = {
        name
        for name, function in inspect.getmembers(metrics, inspect.isfunction)
        if function.__module__ == metrics.__name__ and not name.startswith("_")
    }
    named = {name.removeprefix("hhsim.metrics.metrics.") for row in table for name in spans(row[3])}
    helpers = {"statistics", "hand_clearance"}
    assert functions - helpers <= named


SAFETY, OUTPUT = SafetyLimits(), OutputLimits()
UDP: Any = configure("udp").options
SESSION_LIMITS = {fault.name: fault.limit for fault in SESSION_FAULTS}


LIMITS = (
    ("live-safety.md", f"when input is older than {1e3 * SAFETY.stale:g} ms (`--stale`)"),
    ("live-safety.md", f"{SAFETY.overruns} periods in a row missed"),
    ("live-safety.md", f"the watchdog sends stiffness 0 every {1e-6 * RELEASE_NS:g} ms |"),
    ("live-safety.md", f"{1e3 * SAFETY.heartbeat_stale:g} ms after its last heartbeat"),
    ("live-safety.md", f"| {SAFETY.watchdog_stale:g} s after its last sign of life | ramp |"),
    ("live-safety.md", f"the stiffness rises from 0 over {OUTPUT.ramp:g} s."),
    ("live-safety.md", f"A set point moves by at most {OUTPUT.bend_speed:g} of its range a second."),
    ("live-safety.md", f"falls by a full stiffness in {OUTPUT.ease:g} s"),
    ("live-safety.md", f"where two ticks may lie {1e3 * SAFETY.heartbeat_stale:g} ms apart"),
    ("live-safety.md", f"names it after {supervisor.TOLD:g} s"),
    ("live-safety.md", f"The loop has {supervisor.LOOP_PATIENCE:g} s before it gets SIGTERM"),
    ("live-safety.md", f"({supervisor.PREPARATION:g} s if it has not begun)"),
    ("live-safety.md", f"the recorder {supervisor.RECORDER_PATIENCE:g} s after each tick"),
    ("live-safety.md", f"until its samples have been plausible for {plausibility.TRUST:g} s"),
    ("live-safety.md", f"a pause counts for {plausibility.PAUSE:g} s at most"),
    ("live-safety.md", f"a joint faster than {plausibility.JOINT_SPEED:g} rad/s"),
    ("live-safety.md", f"with {1e3 * plausibility.BURST:g} ms allowed for late samples"),
    ("live-safety.md", f"after {1e3 * plausibility.CONFIRM:g} ms and {plausibility.CONFIRM_SAMPLES} samples"),
    ("live-safety.md", f"changes for {plausibility.STUCK_TIME:g} s"),
    ("live-safety.md", f"each move by {plausibility.STUCK_TRAVEL:g} rad"),
    ("live-safety.md", f"its bend spans fewer than {LEAST_SPAN:g} counts"),
    ("live.md", f"It moves with at most {1e3 * poses.SPEED:g} mm/s and {poses.TURNING:g} rad/s."),
    ("live.md", f"| {100.0 * doctor.MOST_MISSED:g} % of the periods missed"),
    ("live.md", f"| {doctor.MOST_IN_A_ROW} missed in a row"),
    ("live.md", f"Each session makes this check for {doctor.QUICK_SECONDS:g} s"),
    ("recordings.md", f"faster than {POSITION.speed:g} m/s, {ORIENTATION.speed:g} rad/s (palm)"),
    ("recordings.md", f"or {JOINT.speed:g} rad/s (joint)"),
    ("recordings.md", f"more than {POSITION.force:g} m/s², {ORIENTATION.force:,g} or {JOINT.force:,g} rad/s²"),
    ("recordings.md", f"interpolated, up to {cleaning.LONGEST_RUN:g} s |"),
    ("recordings.md", f"the same numbers {cleaning.FROZEN_RUN} times and more"),
    ("gate.md", f"`malformed_share` ({SESSION_LIMITS['malformed_share']:g} % of the glove's packets)"),
    ("gate.md", f"`freed_share` ({SESSION_LIMITS['freed_share']:g} % of the ticks"),
    ("gate.md", f"`ended_early` ({SESSION_LIMITS['ended_early']:g}: it lasted"),
    ("gate.md", f"`faults` ({SESSION_LIMITS['faults']:g} in its log"),
    ("gate.md", f"a default limit on `free_off_max` of {1e3 * OUTSIDE_DEFAULTS['free_off_max']:g} mm"),
    ("live-safety.md", f"the driver {loop.DRIVER_PATIENCE:g} s;"),
    ("live-protocols.md", f"hhsim listens on port {UDP.port} (`--port`)"),
    ("live-protocols.md", f"A force beyond `--most-force`, {UDP.most_force:g} N, is shortened."),
    ("live-protocols.md", f"A bridge without a sample for {1e-9 * SILENCE_NS:g} s counts as gone"),
    ("live-protocols.md", f"after {1e-6 * SESSION_SILENCE_NS:g} ms of silence"),
)
"""Pages, and how they say what the code has."""


def test_limits_that_a_page_states_are_those_of_the_code() -> None:
    texts = {name: " ".join(Page.read(DOCS / name).text.split()) for name, _ in LIMITS}
    for name, phrase in LIMITS:
        assert phrase in texts[name], (name, phrase)


def test_defaults_of_the_options_are_those_of_the_code() -> None:
    table = {spans(row[0])[0]: row[1] for row in METHODS_PAGE.rows() if len(row) == 3 and row[0].startswith("`--")}
    spring = Stiffness()
    assert table == {
        "--linearisations": f"{USUAL['linearisations']}; `paper` {METHODS['paper'].defaults['linearisations']}",
        "--margin": f"{1e3 * USUAL['margin']:g} mm; `paper` {1e3 * METHODS['paper'].defaults['margin']:g} mm (its Δr)",
        "--stiffness": f"{spring.translation:g} N/m, {spring.rotation:g} N·m/rad, {spring.flexion:g} N·m/rad",
        "--penalty-stiffness": f"{spring.penalty:,.0f} N/m",
        "--tolerance": f"10⁻{'⁰¹²³⁴⁵⁶⁷⁸⁹'[round(-np.log10(SolverOptions().tolerance))]}",
        "--self-contact": "on" if SolverOptions().self_contact else "off",
        "--threads": f"{SolverOptions().threads}",
        "--budget": f"{1e-6 * SolverOptions().budget / SolverOptions().period:g} a microsecond of the period",
    }


def test_each_method_has_its_section_and_its_row_in_both_tables() -> None:
    assert {*METHODS} <= METHODS_PAGE.anchors()
    whole = {row[0].strip("`"): row for row in MEASURED.rows() if len(row) == 7}
    short_table = {spans(row[0])[0]: row for row in METHODS_PAGE.rows() if len(row) == 6 and spans(row[0])}
    assert set(short_table) == set(METHODS)
    for name, row in short_table.items():
        assert row[2] == whole[name][2]
        assert row[3] == whole[name][4]


def test_the_page_of_verify_counts_the_planted_faults() -> None:
    planted = sum(map(len, FAULTS.values()))
    assert f"{planted} faults planted in results of {len(FAULTS)} kinds" in Page.read(DOCS / "verify.md").text


def test_a_script_of_the_faq_is_a_script_and_its_hand_a_hand(tmp_path: Path) -> None:
    hand_text, script_text = FAQ.blocks("toml")
    script = parse_script(script_text, name="slow-pinch", where="faq")
    assert [phase.name for phase in script.phases] == ["approach", "pinch", "hold"]
    path = tmp_path / "me.toml"
    path.write_text(hand_text)
    hand = HandModel.from_toml(path)
    assert hand.hand_length == 0.178
    # What is not named scales with the hand's length.
    np.testing.assert_allclose(hand.length[2, 0] / HandModel.default().length[2, 0], 0.178 / 0.19)
    np.testing.assert_array_equal(hand.length[1], [0.045, 0.025, 0.011])


def test_every_equation_of_the_paper_has_its_functions() -> None:
    rows = [row for row in PAPER.rows() if re.match(r"(Eq\.|Fig\.|Section) ", row[0]) and spans(row[1])]
    numbered = [int(n) for row in rows if row[0].startswith("Eq.") for n in re.findall(r"\d+", row[0])]
    assert numbered == list(range(1, 15))
    named = 0
    for row in rows:
        source = ""
        for span in spans(row[1]):
            if "/" in span:
                source = (DOCS.parent / span).read_text(encoding="utf-8")
            else:
                assert re.search(rf"(?m)^(?:    )?(?:def|class) {re.escape(span)}\b", source), (row[0], span)
                named += 1
    assert named > 30
    # What the page says of k and of Δr is so.
    assert f"k = {Stiffness().contact:g} N/m (`Stiffness.contact`)" in PAPER.text
    assert f"spheres within {1e6 * TOUCH:g} µm" in PAPER.text
