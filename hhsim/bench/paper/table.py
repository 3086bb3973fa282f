"""Rows of the paper's evaluation: the paper's figures, each method's, and our own bars."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from hhsim.bench.figures import mean
from hhsim.bench.paper.run import NOISES, UNTOLD, PaperRuns, SceneRun, percentile
from hhsim.bench.paper.scene import CASES, SLIDING, held_ticks
from hhsim.bench.suite import Row
from hhsim.kernels.tick.step import DURATION_DETECT, DURATION_FINGERS, DURATION_FORCE, DURATION_PALM
from hhsim.mesh.catalogue import object_names
from hhsim.metrics.run.contact import JUMP
from hhsim.metrics.run.force import FELT
from hhsim.solver.method import find_method
from hhsim.system.counted import counted
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
COMPLEX_P99 = 150e-6
"""Our bar for the p99 of a tick in contact with a complex object [s]."""
DEPTH = 1e-6
"""Our bar for the depth [m]."""
OF_ALL = ("variation", "touches")
"""Beginnings of the names of rows that sum up the holds of all scenes."""
NAMED_CONTACTS = {131.0: "almost 1 ms, threads", 250.0: "> 1 kHz; V-D: > 1 ms"}
"""What the paper says of a tick with so many contacts, on its machine and with its Δr; of the second it says both."""
VARIATION = ((0.18, 0.32), (0.18, 0.32), (0.16, 0.29), (0.18, 0.32))
"""Variation of the index finger's force that the paper prints [%], mean and spread: its size, then x, y, z."""
MOST_NAMED = 5
"""Limit of the missed touches that are named."""


def paper_row(
    row: str, figure: str, label: str, method: str, unit: str, paper: float, text: str, ours: float,
    bar: float = math.nan, note: str = "",
) -> Row:  # fmt: skip
    """Return one figure of the paper, and one method's, by the figures of the suite's plan."""
    ratio = paper / ours if ours > 0.0 else math.inf if paper > 0.0 else math.nan
    words = {"row": row, "figure": figure, "label": label, "method": method, "unit": unit}
    figures = {"paper": paper, "paper_text": text, "ours": ours, "bar": bar, "note": note, "ratio": ratio}
    return {**words, **figures, "passed": bool(math.isnan(bar) or ours <= bar)}


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
    for name, paper in SIMPLE_MEAN.items():
        if played := runs.of(method, "11", object_name=name):
            ours = _pooled_mean(played)
            yield paper_row(
                f"mean_{name}", "11", f"mean tick, {name}", method, "s", paper, f"{1e3 * paper:.2f} ms", ours,
                paper / FASTER, "touch, pinch, grasp with the palm; ticks in contact",
            )  # fmt: skip
    for run in runs.of(method, "12"):
        name = run.scenario.object_name
        yield paper_row(
            f"sequence_max_{name}", "12", f"longest tick, {name}", method, "s", 1e-3, "< 1 ms",
            float(run.tick_cpu.max()), 1e-3, "none, one, two, five, two, one, none; all ticks",
        )  # fmt: skip
    if played := runs.of(method, SLIDING):
        yield paper_row(
            "sliding_depth", "V-A", "depth while sliding", method, "m", math.nan,
            "none to be seen", _deepest(played), DEPTH, counted(len(played), "object"),
        )  # fmt: skip


def _complex_objects(runs: PaperRuns, method: str) -> Iterator[Row]:
    for name in object_names():
        if played := runs.of(method, "13", object_name=name):
            worst = max(played, key=lambda run: percentile(run, 99.0))
            yield paper_row(
                f"complex_p99_{name}", "13", f"p99 tick, {name}", method, "s", math.nan, "no time",
                percentile(worst, 99.0), COMPLEX_P99,
                f"worst of {counted(len(played), 'scene')}: {worst.scenario.motion}",
            )  # fmt: skip
    for run in runs.of(method, "14"):
        name, motion = run.scenario.object_name, run.scenario.motion
        yield paper_row(
            f"interaction_p50_{name}", "14", f"median tick, {name} {motion}", method, "s", 1e-3, "most < 1 ms",
            percentile(run, 50.0), math.nan, "squeeze, hold, slide; ticks in contact",
        )  # fmt: skip
        yield paper_row(
            f"interaction_p99_{name}", "14", f"p99 tick, {name} {motion}", method, "s", math.nan, "no p99",
            percentile(run, 99.0), COMPLEX_P99, "ticks in contact",
        )  # fmt: skip
        yield paper_row(
            f"interaction_max_{name}", "14", f"longest tick, {name} {motion}", method, "s", 1.5e-3, "all < 1.5 ms",
            float(run.tick_cpu.max()), 1.5e-3, "all ticks",
        )  # fmt: skip
    for case in CASES:
        if played := runs.of(method, "15", case=case):
            contacts = [run.contacts for run in played]
            instances = sum(len(run.stage.motions) for run in played)
            worst = max(played, key=lambda run: percentile(run, 99.0))
            yield paper_row(
                f"case_p99_{case}", "15", f"p99 tick, {CASES[case]}", method, "s", math.nan,
                "means only", percentile(worst, 99.0), COMPLEX_P99,
                f"worst object: {worst.scenario.object_name}; {instances} instances, {min(contacts):.0f} to "
                f"{max(contacts):.0f} pairs; mean of all {1e6 * _pooled_mean(played):.1f} µs",
            )  # fmt: skip
    for run in runs.at_contacts:
        if run.options.method == method:
            held = held_ticks(run.stage)
            label = f"mean tick, {run.wanted:.0f} pairs, {CASES[run.case]}"
            yield paper_row(
                f"contacts_{run.wanted:.0f}", "15", label, method, "s", math.nan, NAMED_CONTACTS[run.wanted],
                float(run.tick_cpu[held].mean()), 1e-3,
                f"{run.scenario.object_name}, {run.candidates[held].mean():.0f} pairs in the hold, at a "
                f"margin of {1e3 * run.options.margin:.2f} mm; the paper counts phalanges grown by 0.5 mm",
            )  # fmt: skip


def _all_scenes(runs: PaperRuns, method: str) -> Iterator[Row]:
    whole = runs.of(method, "11", "12", SLIDING, "13", "14", "15")
    if whole:
        worst = max(whole, key=lambda run: float(run.depth.max()))
        ticks = sum(len(run.depth) for run in whole)
        motions = counted(sum(len(r.stage.motions) for r in whole), "motion")
        yield paper_row(
            "depth", "V-D", "depth in the spheres, largest", method, "m", 1e-4, "≈ 0.1 mm",
            _deepest(whole), DEPTH, f"{ticks:,} ticks of {motions}; deepest: {worst.scenario.name}",
        )  # fmt: skip
        bounded = find_method(method).nearest_to_user
        for name, label, unit, bar in (
            ("posture_jump_max", "largest jump of a shown joint", "m", math.nan),
            (UNTOLD, "the same, where no snap is told", "m", JUMP if bounded else math.nan),
            ("force_contact_step_share", "largest force step, of the mean", "%", FELT if bounded else math.nan),
        ):
            farthest = np.nan_to_num([run.steps[name] for run in whole], nan=-1.0)
            found = whole[int(farthest.argmax())]
            yield paper_row(
                name, "V, 2", label, method, unit, math.nan, "no big jump", found.steps[name], bar,
                f"from tick to tick in contact: {found.scenario.name}, {found.steps['force_contact_step']:.3f} N",
            )  # fmt: skip
    # The paper's haptic hand "holding the object with no movement" is no measure of a trembling palm.
    names = {"glove": "still palm", "trembling": "trembling palm"}
    played = [run for run in runs.of(method, "11", "13", "14") if run.variation]
    for noise in NOISES if played else ():
        sizes = np.array([run.variation[noise].size for run in played])
        parts = np.array([run.variation[noise].component for run in played])
        is_still = noise == "glove"
        for row, (paper, spread) in enumerate(VARIATION):
            values = sizes if row == 0 else parts[:, row - 1]
            known = values[np.isfinite(values[:, 0])]
            count = len(known)
            middle = np.median(known, axis=0).tolist() if count else [math.nan, math.nan]
            part = "size" if row == 0 else "xyz"[row - 1]
            above = f", {int((values[:, 0] > paper).sum())} above {paper:.2f} %" if is_still else ""
            defined = np.where(np.isfinite(values[:, 0]), values[:, 0], -1.0)
            largest = f"largest {defined.max():.2f} % ({played[int(defined.argmax())].scenario.name})"
            yield paper_row(
                f"variation_{noise}_{part}", "V-D", f"index force, {part}, {names[noise]}", method, "%",
                paper if is_still else math.nan, f"{paper:.2f} ± {spread:.2f} %" if is_still else "hand stands still",
                middle[0], paper if is_still else math.nan,
                "not measured: the force is large enough in no hold" if not count else
                f"change a tick, glove's sensors; ± {middle[1]:.2f} %; median of {counted(count, 'hold')}{above}; "
                f"{largest}",
            )  # fmt: skip
    if whole:
        demanded = sum(len(run.touches) for run in whole)
        failed = [(run, touch) for run in whole for touch, _ in run.missed]
        named = [f"{run.scenario.name} {touch}" for run, touch in failed[:MOST_NAMED]]
        more = [f"{len(failed) - MOST_NAMED:,} more"] if len(failed) > MOST_NAMED else []
        where = f"; not: {', '.join([*named, *more])}" if failed else ""
        yield paper_row(
            "touches", "11 to 15", "named touches missing", method, "1", 0.0, "as shown", float(len(failed)),
            0.0 if method == "coupled" else math.nan, f"of {demanded}{where}",
        )  # fmt: skip


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
    return Table(columns, [run for run in runs if run.scenario.case], title)
