"""Rows of the paper's evaluation: the paper's figures, each method's, and our own bars."""

import math
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from msgspec import structs

from hhsim.bench.figures import mean
from hhsim.bench.paper.run import CASES, NOISES, SLIDING, UNTOLD, PaperRuns, SceneRun, held_ticks, percentile
from hhsim.bench.suite import Row
from hhsim.kernels.tick.step import DURATION_DETECT, DURATION_FINGERS, DURATION_FORCE, DURATION_PALM
from hhsim.mesh.catalogue import object_names
from hhsim.metrics.run.contact import JUMP
from hhsim.metrics.run.force import FELT
from hhsim.solver.method import find_method
from hhsim.system.counted import counted
from hhsim.system.settings_file import Settings, read_settings
from hhsim.table.table import Table, number, words

SIMPLE_MEAN = {
    "sphere": 0.41e-3,
    "cylinder": 0.31e-3,
    "triangular-prism": 0.31e-3,
    "cube": 0.32e-3,
    "hexagonal-prism": 0.48e-3,
}
"""Mean tick that the paper prints for the scenes of Fig. 11 [s]."""
FASTER = 10.0
"""Ratio of the paper's means to our bars."""
OF_ALL = ("variation", "touches")
"""Beginnings of the names of rows that sum up the holds of all scenes."""
VARIATION = (("size", 0.18, 0.32), ("x", 0.18, 0.32), ("y", 0.16, 0.29), ("z", 0.18, 0.32))
"""Variation of the index finger's force that the paper prints [%], mean and spread: of its size and components."""
MOST_NAMED = 5
"""Limit of the missed touches that are named."""


class Printed(Settings, frozen=True):
    """Figure of a row as the paper prints it, and our own bar."""

    figure: str  # of the paper, or its section
    label: str
    unit: str
    text: str
    paper: float = math.nan
    bar: float = math.nan


@cache
def printed() -> dict[str, Printed]:
    """Return the rows of printed.toml by their names."""
    return read_settings(Path(__file__).with_name("printed.toml"), dict[str, Printed], "table of printed figures")


def paper_row(
    key: str, method: str, ours: float, note: str = "", of: str = "", row: str = "", **stated: float | str
) -> Row:
    """Return a figure of the paper, and a method's, by the figures of the suite's plan.

    `of` stands in the label, `row` is the row's name where it is not the key, `stated` are other fields of `Printed`.
    """
    one = structs.replace(printed()[key], **stated)
    ratio = one.paper / ours if ours > 0.0 else math.inf if one.paper > 0.0 else math.nan
    words = {"row": row or key, "figure": one.figure, "label": one.label.format(of), "method": method, "unit": one.unit}
    figures = {"paper": one.paper, "paper_text": one.text, "ours": ours, "bar": one.bar, "note": note, "ratio": ratio}
    return {**words, **figures, "passed": bool(math.isnan(one.bar) or ours <= one.bar)}


def paper_rows(runs: PaperRuns, methods: Sequence[str], is_whole: bool) -> list[Row]:
    """Return the table, row by row, each for all methods, without rows whose scenes were left out.

    Rows that sum up all holds (`OF_ALL`) have bars in the whole evaluation on the paper's tree levels only.
    """
    by_method = [
        [row for rows in (_simple_objects, _complex_objects, _all_scenes) for row in rows(runs, method)]
        for method in methods
    ]
    found = [row for same in zip(*by_method, strict=True) for row in same]
    unjudged = {"bar": math.nan, "passed": True}
    return [row if is_whole or not row["row"].startswith(OF_ALL) else {**row, **unjudged} for row in found]


def _simple_objects(runs: PaperRuns, method: str) -> Iterator[Row]:
    note = "touch, pinch, grasp with the palm; ticks in contact"
    for name, paper in SIMPLE_MEAN.items():
        if played := runs.of(method, "11", object_name=name):
            row, bar, text = f"mean_{name}", paper / FASTER, f"{1e3 * paper:.2f} ms"
            ours = _pooled_mean(played)
            yield paper_row("mean", method, ours, note, name, row, paper=paper, bar=bar, text=text)
    note = "none, one, two, five, two, one, none; all ticks"
    for run in runs.of(method, "12"):
        name = run.scenario.object_name
        yield paper_row("sequence_max", method, float(run.tick_cpu.max()), note, name, f"sequence_max_{name}")
    if played := runs.of(method, SLIDING):
        yield paper_row("sliding_depth", method, _deepest(played), counted(len(played), "object"))


def _complex_objects(runs: PaperRuns, method: str) -> Iterator[Row]:
    for name in object_names():
        if played := runs.of(method, "13", object_name=name):
            worst = max(played, key=lambda run: percentile(run, 99.0))
            note = f"worst of {counted(len(played), 'scene')}: {worst.scenario.motion}"
            yield paper_row("complex_p99", method, percentile(worst, 99.0), note, name, f"complex_p99_{name}")
    for run in runs.of(method, "14"):
        for key, ours, note in (
            ("interaction_p50", percentile(run, 50.0), "squeeze, hold, slide; ticks in contact"),
            ("interaction_p99", percentile(run, 99.0), "ticks in contact"),
            ("interaction_max", float(run.tick_cpu.max()), "all ticks"),
        ):
            yield paper_row(key, method, ours, note, run.scenario.name, f"{key}_{run.scenario.object_name}")
    for case in CASES:
        if played := runs.of(method, "15", case=case):
            contacts = [run.contacts for run in played]
            instances = sum(len(run.stage.motions) for run in played)
            worst = max(played, key=lambda run: percentile(run, 99.0))
            note = (
                f"worst object: {worst.scenario.object_name}; {instances} instances, {min(contacts):.0f} to "
                f"{max(contacts):.0f} pairs; mean of all {1e6 * _pooled_mean(played):.1f} µs"
            )
            yield paper_row("case_p99", method, percentile(worst, 99.0), note, CASES[case], f"case_p99_{case}")
    for run in (run for run in runs if run.case and run.options.method == method):
        held = held_ticks(run.stage)
        note = (
            f"{run.scenario.object_name}, {run.candidates[held].mean():.0f} pairs in the hold, at a "
            f"margin of {1e3 * run.options.margin:.2f} mm; the paper counts phalanges grown by 0.5 mm"
        )
        yield paper_row(f"contacts_{run.wanted:.0f}", method, float(run.tick_cpu[held].mean()), note, CASES[run.case])


def _all_scenes(runs: PaperRuns, method: str) -> Iterator[Row]:
    whole = runs.of(method, "11", "12", SLIDING, "13", "14", "15")
    if whole:
        worst = max(whole, key=lambda run: float(run.depth.max()))
        ticks = sum(len(run.depth) for run in whole)
        motions = counted(sum(len(r.stage.motions) for r in whole), "motion")
        note = f"{ticks:,} ticks of {motions}; deepest: {worst.scenario.name}"
        yield paper_row("depth", method, _deepest(whole), note)
        bars = {UNTOLD: JUMP, "force_contact_step_share": FELT} if find_method(method).nearest_to_user else {}
        for key in ("posture_jump_max", UNTOLD, "force_contact_step_share"):
            farthest = np.nan_to_num([run.steps[key] for run in whole], nan=-1.0)
            found = whole[int(farthest.argmax())]
            step = f"{found.steps['force_contact_step']:.3f} N"
            note = f"from tick to tick in contact: {found.scenario.name}, {step}"
            yield paper_row(key, method, found.steps[key], note, bar=bars.get(key, math.nan))
    # The paper's haptic hand "holding the object with no movement" is no measure of a trembling palm.
    names = {"glove": "still palm", "trembling": "trembling palm"}
    played = [run for run in runs.of(method, "11", "13", "14") if run.variation]
    for noise in NOISES if played else ():
        for place, (part, paper, spread) in enumerate(VARIATION):
            values = np.array([run.variation[noise][place] for run in played])
            known = values[np.isfinite(values[:, 0])]
            count = len(known)
            middle = np.median(known, axis=0).tolist() if count else [math.nan, math.nan]
            above, stated = "", dict[str, float | str]()
            if noise == "glove":
                above = f", {int((values[:, 0] > paper).sum())} above {paper:.2f} %"
                stated = {"paper": paper, "bar": paper, "text": f"{paper:.2f} ± {spread:.2f} %"}
            defined = np.where(np.isfinite(values[:, 0]), values[:, 0], -1.0)
            largest = f"largest {defined.max():.2f} % ({played[int(defined.argmax())].scenario.name})"
            note = "not measured: the force is large enough in no hold"
            if count:
                spreads = f"± {middle[1]:.2f} %; median of {counted(count, 'hold')}{above}"
                note = f"change a tick, glove's sensors; {spreads}; {largest}"
            of, row = f"{part}, {names[noise]}", f"variation_{noise}_{part}"
            yield paper_row("variation", method, middle[0], note, of, row, **stated)
    if whole:
        demanded = sum(len(run.touches) for run in whole)
        failed = [(run, touch) for run in whole for touch, _ in run.missed]
        named = [f"{run.scenario.name} {touch}" for run, touch in failed[:MOST_NAMED]]
        more = [f"{len(failed) - MOST_NAMED:,} more"] if len(failed) > MOST_NAMED else []
        note = f"of {demanded}" + (f"; not: {', '.join([*named, *more])}" if failed else "")
        bar = 0.0 if method == "coupled" else math.nan
        yield paper_row("touches", method, float(len(failed)), note, bar=bar)


def _pooled_mean(runs: Sequence[SceneRun]) -> float:
    """Mean CPU time of all ticks in contact [s]."""
    return mean(np.concatenate([run.tick_cpu[run.contact] for run in runs]))


def _deepest(runs: Sequence[SceneRun]) -> float:
    return max(float(run.depth.max(initial=0.0)) for run in runs)


def case_table(runs: Sequence[SceneRun]) -> Table:
    """Return the ticks of the cases of Fig. 15, object by object."""

    def parts(run: SceneRun, *numbers: int) -> float:
        times = run.tick_parts[run.undisturbed]
        return float(times.mean(axis=0)[[*numbers]].sum()) if len(times) else math.nan

    columns = (
        words("object", "scenario.object_name"),
        words("case", "scenario.case"),
        words("method", "options.method"),
        number("instances", lambda run: len(run.stage.motions)),
        number("pairs", "contacts"),
        number("detection", lambda run: parts(run, DURATION_DETECT), "µs"),
        number("response", lambda run: parts(run, DURATION_PALM, DURATION_FINGERS, DURATION_FORCE), "µs"),
        number("total, CPU", lambda run: mean(run.tick_cpu[run.contact]), "µs"),
        number("p99", lambda run: percentile(run, 99.0), "µs"),
    )
    title = (
        "Fig. 15: a tick in contact, mean; its parts by the clock on the wall, where nothing interrupted it. SF: "
        "single finger, TF: two fingers, FF: five fingers, WH: whole hand"
    )
    return Table(columns, [run for run in runs if run.scenario.case and not run.case], title)
