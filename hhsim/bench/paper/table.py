"""Rows of the paper's evaluation: the paper's figures, each method's, and our own bars."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hhsim.bench.figures import mean, metric_column
from hhsim.bench.paper.run import NOISES, STEPS, UNTOLD, PaperRuns, SceneRun, percentile
from hhsim.bench.paper.scene import CASES, SLIDING, held_ticks
from hhsim.kernels.tick.step import DURATION_DETECT, DURATION_FINGERS, DURATION_FORCE, DURATION_PALM
from hhsim.mesh.catalogue import object_names
from hhsim.metrics.run.contact import JUMP
from hhsim.metrics.run.force import FELT
from hhsim.metrics.run.registry import run_figure
from hhsim.solver.known_methods import find_method
from hhsim.system.counted import counted
from hhsim.table.table import Column

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


@dataclass(frozen=True)
class PaperRow:
    """One figure of the paper, and one method's, see `ROW_COLUMNS`; `name` is the column `row`."""

    name: str
    figure: str
    label: str
    method: str
    unit: str
    paper: float
    paper_text: str
    ours: float
    bar: float = math.nan
    note: str = ""

    @property
    def ratio(self) -> float:
        """Paper's figure over ours; NaN if it prints none, infinite if ours is 0."""
        return self.paper / self.ours if self.ours > 0.0 else math.inf if self.paper > 0.0 else math.nan

    @property
    def passed(self) -> bool:
        """True if the bar is kept or there is none; NaN keeps no bar."""
        return bool(math.isnan(self.bar) or self.ours <= self.bar)


ROW_COLUMNS = (
    Column("row", "name of the figure", of="name"),
    Column("figure", "of the paper, or its section"),
    Column("label", "what it is"),
    Column("method", "method of the solver"),
    Column("unit", "of the columns paper, ours and bar: s, m or %"),
    Column("paper", "what the paper prints, NaN where it prints no number"),
    Column("paper_text", "as it is printed"),
    Column("ours", "measured here"),
    Column("ratio", "the paper's over ours: how many times below the paper's"),
    Column("bar", "ours must not be above it; NaN where there is none"),
    Column("passed", "whether the bar, if there is one, is kept"),
    Column("note", "where the figure comes from"),
)


def paper_rows(runs: PaperRuns, methods: Sequence[str], is_whole: bool) -> list[PaperRow]:
    """Return the table, row by row, each for all methods, without rows whose scenes were left out.

    Rows that sum up all holds (`OF_ALL`) have bars in the whole evaluation on the paper's tree levels only.
    """
    by_method = [
        [row for rows in (_simple_objects, _complex_objects, _all_scenes) for row in rows(runs, method)]
        for method in methods
    ]
    found = [row for same in zip(*by_method, strict=True) for row in same]
    return found if is_whole else [replace(row, bar=math.nan) if row.name.startswith(OF_ALL) else row for row in found]


def _simple_objects(runs: PaperRuns, method: str) -> Iterator[PaperRow]:
    for name, paper in SIMPLE_MEAN.items():
        if played := runs.of(method, "11", object_name=name):
            ours = _pooled_mean(played)
            yield PaperRow(
                f"mean_{name}", "11", f"mean tick, {name}", method, "s", paper, f"{1e3 * paper:.2f} ms", ours,
                paper / FASTER, "touch, pinch, grasp with the palm; ticks in contact",
            )  # fmt: skip
    for run in runs.of(method, "12"):
        name = run.scenario.object_name
        yield PaperRow(
            f"sequence_max_{name}", "12", f"longest tick, {name}", method, "s", 1e-3, "< 1 ms",
            float(run.tick_cpu.max()), 1e-3, "none, one, two, five, two, one, none; all ticks",
        )  # fmt: skip
    if played := runs.of(method, SLIDING):
        yield PaperRow(
            "sliding_depth", "V-A", "depth while sliding", method, "m", math.nan,
            "none to be seen", _deepest(played), DEPTH, counted(len(played), "object"),
        )  # fmt: skip


def _complex_objects(runs: PaperRuns, method: str) -> Iterator[PaperRow]:
    for name in object_names():
        if played := runs.of(method, "13", object_name=name):
            worst = max(played, key=lambda run: percentile(run, 99.0))
            yield PaperRow(
                f"complex_p99_{name}", "13", f"p99 tick, {name}", method, "s", math.nan, "no time",
                percentile(worst, 99.0), COMPLEX_P99,
                f"worst of {counted(len(played), 'scene')}: {worst.scenario.motion}",
            )  # fmt: skip
    for run in runs.of(method, "14"):
        name, motion = run.scenario.object_name, run.scenario.motion
        yield PaperRow(
            f"interaction_p50_{name}", "14", f"median tick, {name} {motion}", method, "s", 1e-3, "most < 1 ms",
            percentile(run, 50.0), math.nan, "squeeze, hold, slide; ticks in contact",
        )  # fmt: skip
        yield PaperRow(
            f"interaction_p99_{name}", "14", f"p99 tick, {name} {motion}", method, "s", math.nan, "no p99",
            percentile(run, 99.0), COMPLEX_P99, "ticks in contact",
        )  # fmt: skip
        yield PaperRow(
            f"interaction_max_{name}", "14", f"longest tick, {name} {motion}", method, "s", 1.5e-3, "all < 1.5 ms",
            float(run.tick_cpu.max()), 1.5e-3, "all ticks",
        )  # fmt: skip
    for case in CASES:
        if played := runs.of(method, "15", case=case):
            contacts = [run.contacts for run in played]
            instances = sum(len(run.stage.motions) for run in played)
            worst = max(played, key=lambda run: percentile(run, 99.0))
            yield PaperRow(
                f"case_p99_{case}", "15", f"p99 tick, {CASES[case]}", method, "s", math.nan,
                "means only", percentile(worst, 99.0), COMPLEX_P99,
                f"worst object: {worst.scenario.object_name}; {instances} instances, {min(contacts):.0f} to "
                f"{max(contacts):.0f} pairs; mean of all {1e6 * _pooled_mean(played):.1f} µs",
            )  # fmt: skip
    for found in runs.at_contacts:
        if found.run.options.method == method:
            held = held_ticks(found.run.stage)
            label = f"mean tick, {found.wanted:.0f} pairs, {CASES[found.case]}"
            yield PaperRow(
                f"contacts_{found.wanted:.0f}", "15", label, method, "s", math.nan, NAMED_CONTACTS[found.wanted],
                float(found.run.tick_cpu[held].mean()), 1e-3,
                f"{found.run.scenario.object_name}, {found.run.candidates[held].mean():.0f} pairs in the hold, at a "
                f"margin of {1e3 * found.margin:.2f} mm; the paper counts phalanges grown by 0.5 mm",
            )  # fmt: skip


def _all_scenes(runs: PaperRuns, method: str) -> Iterator[PaperRow]:
    whole = runs.of(method, "11", "12", SLIDING, "13", "14", "15")
    if whole:
        worst = max(whole, key=lambda run: float(run.depth.max()))
        ticks = sum(len(run.depth) for run in whole)
        motions = counted(sum(len(r.stage.motions) for r in whole), "motion")
        yield PaperRow(
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
            yield PaperRow(
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
        for number, (paper, spread) in enumerate(VARIATION):
            values = sizes if number == 0 else parts[:, number - 1]
            known = values[np.isfinite(values[:, 0])]
            count = len(known)
            middle = np.median(known, axis=0).tolist() if count else [math.nan, math.nan]
            part = "size" if number == 0 else "xyz"[number - 1]
            above = f", {int((values[:, 0] > paper).sum())} above {paper:.2f} %" if is_still else ""
            defined = np.where(np.isfinite(values[:, 0]), values[:, 0], -1.0)
            largest = f"largest {defined.max():.2f} % ({played[int(defined.argmax())].scenario.name})"
            yield PaperRow(
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
        yield PaperRow(
            "touches", "11 to 15", "named touches missing", method, "1", 0.0, "as shown", float(len(failed)),
            0.0 if method == "coupled" else math.nan, f"of {demanded}{where}",
        )  # fmt: skip


def _pooled_mean(runs: Sequence[SceneRun]) -> float:
    """Mean CPU time of all ticks in contact [s]."""
    return mean(np.concatenate([run.tick_cpu[run.contact] for run in runs]))


def _deepest(runs: Sequence[SceneRun]) -> float:
    return max(float(run.depth.max(initial=0.0)) for run in runs)


def _step(name: str) -> Callable[[SceneRun], float]:
    return lambda run: run.steps[name]


SCENE_COLUMNS = (
    Column("figure", "of the paper", of="scenario.figure"),
    Column("object", "object of the catalogue", of="scenario.object_name"),
    Column("motion", "motion of the catalogue", of="scenario.motion"),
    Column(
        "case", "of Fig. 15: SF single finger, TF two fingers, FF five fingers, WH whole hand", of="scenario.case"
    ),
    Column("method", "method of the solver", of="options.method"),
    Column("spheres", "leaves of the object's tree", of="stage.tree.leaf_count"),
    Column("instances", "motions, each with the hand a little elsewhere", of=lambda run: len(run.stage.motions)),
    Column("ticks", "in all", of=lambda run: len(run.depth)),
    Column(
        "ticks_in_contact", "with candidate pairs, while fingers close, hold or slide; the times are theirs",
        of=lambda run: int(run.contact.sum()),
    ),
    Column(
        "contacts_mean", "candidate pairs of these ticks, mean", of=lambda run: run.contacts,
    ),
    metric_column("candidates_max", "contacts_max", lambda run: int(run_figure("candidates_max", run.ticks))),
    metric_column("touching_max", of=lambda run: int(run_figure("touching_max", run.ticks))),
    Column("cpu_mean", "tick, thread time, mean", "µs", lambda run: mean(run.tick_cpu[run.contact])),
    Column("cpu_p50", "tick, thread time, median", "µs", lambda run: percentile(run, 50.0)),
    Column("cpu_p99", "tick, thread time, p99", "µs", lambda run: percentile(run, 99.0)),
    Column("cpu_max", "longest of all ticks, thread time", "µs", lambda run: float(run.tick_cpu.max())),
    Column("wall_mean", "tick, wall time, mean", "µs", lambda run: mean(run.tick_wall[run.contact])),
    Column(
        "detection", "contact detection, wall time, mean of ticks that were not interrupted", "µs",
        lambda run: mean_of_parts(run, DURATION_DETECT),
    ),
    Column(
        "response", "collision response: palm, fingers and forces, wall time, mean of the same ticks", "µs",
        lambda run: mean_of_parts(run, DURATION_PALM, DURATION_FINGERS, DURATION_FORCE),
    ),
    metric_column("penetration_max", "depth_max", lambda run: run_figure("penetration_max", run.ticks)),
    Column(
        "index_variation", "index force in the hold, glove's sensors, mean", "%",
        lambda run: _index_variation(run, "glove"),
    ),
    Column(
        "index_variation_trembling", "index force in the hold, glove's sensors and trembling palm, mean", "%",
        lambda run: _index_variation(run, "trembling"),
    ),
    *(metric_column(name, of=_step(name)) for name in STEPS),
    Column("touches", "demanded touches", of=lambda run: len(run.touches)),
    Column("touches_missed", "demanded touches that did not happen", of=lambda run: len(run.missed)),
    metric_column("stuck_ticks", of=lambda run: int(run_figure("stuck_ticks", run.ticks))),
    metric_column("lag_ticks", of=lambda run: int(run_figure("lag_ticks", run.ticks))),
)  # fmt: skip


def mean_of_parts(run: SceneRun, *parts: int) -> float:
    """Return the wall time of some parts of a tick in contact [s], mean of the ticks that were not interrupted."""
    times = run.tick_parts[run.undisturbed]
    return float(times.mean(axis=0)[[*parts]].sum()) if len(times) else math.nan


def _index_variation(run: SceneRun, noise: str) -> float:
    return float(run.variation[noise].size[0]) if run.variation else math.nan
