"""Suites that set the time of a tick against its errors: every way to solve the hand on every scene, in turns.

A run is a replay: its figures are those of the replay's table, and distances to the true mesh by the referee
(`hhsim.verify.mesh_distance`), which shares no code with the solver. The haptic input of a scene is made once. The runs
take turns, so that other load of the machine falls on all of them; of each tick in contact the median of the
repetitions counts. Errors are those of the first repetition; the others must give the same poses.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import wrap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.bench.figures import TOTALS, hand_clearance
from hhsim.bench.suite import Row, Suite
from hhsim.errors import HhsimError, InputError, check_known
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.run_ticks import PLACED
from hhsim.motion.trajectory import TickInput, Trajectory
from hhsim.render.figure import save_figure
from hhsim.replay.replay import replay_scene
from hhsim.replay.run_inputs import tick_digest
from hhsim.report import figure as style
from hhsim.result.reader import Result, load_result
from hhsim.scene.motion_catalogue import load_script, script_names
from hhsim.scene.scene import Scene, make_scene
from hhsim.scene.synthesis import synthesize
from hhsim.solver.options import SolverOptions
from hhsim.system.progress import Progress
from hhsim.system.settings_file import Count, Names
from hhsim.table.file import ALL
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree
from hhsim.verify.mesh_distance import TrueSurface

if TYPE_CHECKING:
    from matplotlib.axes import Axes


NEAR = 1e-3
"""Largest distance of the haptic hand from the mesh in a tick in contact [m]."""
LONG = 5.0
"""CPU time of all ticks above which a run is not repeated [s]."""
GAIN = 0.05
"""Share by which the error of a slower way on the frontier is smaller."""
TIMES_REMARK = (
    "times are CPU times of ticks with the haptic hand within 1 mm of the mesh, the median of the repetitions; compare "
    "them within this run, not between machines"
)


@dataclass(frozen=True, eq=False)
class Stage:
    """One motion on one object."""

    object: str
    motion: str
    hand: HandModel
    mesh: Mesh
    trajectory: Trajectory
    ticks: TickInput  # of the haptic hand, in the frame of the mesh
    surface: Any  # triangles of the mesh
    contact: BoolArray  # ticks with the haptic hand within `NEAR` of the mesh or inside, shape (T,)
    referee: TrueSurface

    def scene(self, tree: SphereTree) -> Scene:
        """Return the scene with the object's spheres."""
        return make_scene(self.mesh, tree, self.hand, self.trajectory, rate=self.ticks.rate)


class Way(NamedTuple):
    """One way to solve the hand: options of the solver, and the level of the sphere tree that a suite chose."""

    solver: SolverOptions
    level: int = 0

    @property
    def name(self) -> str:
        """Method, and the QP solver if it is another one."""
        return self.solver.method + (f" with {self.solver.qp}" if self.solver.qp != SolverOptions().qp else "")


@dataclass(frozen=True, eq=False)
class Cell:
    """One way to solve the hand on one stage."""

    stage: Stage
    way: Way
    scene: Scene
    errors: Callable[[Result], dict[str, float]]  # figures besides those of the replay's table, in the mesh's frame
    other: str  # dataset of the times besides the CPU's [ns]


@dataclass
class Run:
    """One way to solve the hand on one scene, as often as it was run."""

    object: str
    motion: str
    way: Way
    figures: dict[str, float] = field(default_factory=dict)  # of the first repetition; none where it failed
    # CPU times of the ticks in contact [s], one array of shape (n,) a repetition; and other times of the same ticks.
    cpu: list[FloatArray] = field(default_factory=list)
    other: list[FloatArray] = field(default_factory=list)
    digest: str = ""  # of its poses and forces
    repeatable: bool = True  # True if all repetitions had the same digest
    seconds: float = 0.0  # CPU time of all ticks of the first repetition
    failure: str = ""  # message of the error that ended it, or ""


def placed_at(result: Result, ticks: IntArray) -> PlacedHand:
    """Return the graphic hand of a result at some ticks."""
    return PlacedHand(*(result[name][ticks] for name in PLACED))


def median_percentile(runs: Sequence[Sequence[FloatArray]], percent: float) -> float:
    """Return a percentile of the ticks of runs, each the median of its repetitions; NaN without any."""
    times = np.concatenate([np.median(repetitions, axis=0) for repetitions in runs if repetitions] or [np.zeros(0)])
    return float(np.percentile(times, percent)) if times.size else np.nan


def mark_frontier(group: Sequence[Row], flag: str, error: str) -> None:
    """Mark the rows of a group that none beats in both time and error."""
    for i in frontier([row["tick_cpu_p50"] for row in group], [row[error] for row in group], GAIN):
        group[i][flag] = True


def frontier(time: ArrayLike, error: ArrayLike, gain: float = 0.0) -> IntArray:
    """Return the indices of the points that no other point beats, by growing time.

    A point beats another if it is no worse in both and better in one. Of equal points the first counts; a point with a
    NaN is on no frontier. The error of a slower point is less by at least the share `gain`; 0 gives the plain frontier.
    """
    first, second = np.asarray(time, np.float64).ravel(), np.asarray(error, np.float64).ravel()
    kept: list[int] = []
    for index in np.lexsort((np.arange(first.size), second, first)):
        best = second[kept[-1]] if kept else np.nan
        less = best - gain * abs(best) if np.isfinite(best) else best
        if not (np.isnan(first[index]) or np.isnan(second[index])) and (not kept or second[index] < less):
            kept.append(int(index))
    return np.array(kept, np.int64)


@dataclass(frozen=True, kw_only=True)
class TradeOff(Suite):
    """Scenes and ways to solve the hand, each with each."""

    objects: Names
    motions: Names
    methods: Names | None
    repetitions: Count
    rate: float  # [Hz]
    seed: int
    hands: Count  # limit of the hands of a run whose depth is measured, 6 to 18 ms each
    draws_picture = True

    def check(self) -> None:
        """Raise InputError for an object or a motion that the catalogue lacks, or a motion that touches nothing."""
        check_known("object", self.objects, object_names())
        check_known("trajectory", self.motions, script_names())
        for motion in self.motions:
            if not load_script(motion).contact:
                raise InputError(f"the motion '{motion}' touches nothing: there is no error to measure")

    def stages(self, hand: HandModel, tree: Callable[[Mesh], SphereTree], progress: Progress) -> Iterator[Stage]:
        """Yield every motion on every object, made on the object's tree; TrajectoryError for one that cannot be."""
        count = len(self.objects) * len(self.motions)
        for i, name in enumerate(self.objects):
            mesh = load_object(name).mesh
            spheres, referee = tree(mesh), TrueSurface(mesh, open_too=True)
            surface = contact_surface("mesh", mesh, spheres).arrays
            for j, motion in enumerate(self.motions):
                progress("scenes", i * len(self.motions) + j, count)
                trajectory = synthesize(load_script(motion), hand, spheres, self.seed)
                scene = make_scene(mesh, spheres, hand, trajectory, rate=self.rate)
                ticks = scene.hands[0].ticks.seen_from_object()
                placed = forward_kinematics(hand, *HandConfiguration.of(ticks))
                contact = hand_clearance(hand, surface, placed, NEAR) < NEAR
                yield Stage(name, motion, hand, mesh, trajectory, ticks, surface, contact, referee)

    def run(self, cell: Cell, before: Run | None) -> Run:
        """Replay a way on its scene once more, unless it failed or takes long; an HhsimError is kept."""
        run = before or Run(cell.stage.object, cell.stage.motion, cell.way)
        if run.failure or run.seconds > LONG:
            return run
        with TemporaryDirectory() as folder:
            path = Path(folder) / "run.h5"
            try:
                summary = replay_scene(cell.scene, cell.way.solver, path)
                result = load_result(path)
                finite = np.isfinite(result["graphic/joints"]).all(axis=(1, 2, 3))
                if not finite.all():
                    raise HhsimError(f"the graphic hand is not finite after tick {int(finite.argmin())}")
                digest, cpu = tick_digest(result), 1e-9 * result["duration/total_cpu"]
                if not run.figures:
                    run.figures = {**summary.attributes(), **cell.errors(result.seen_from_object)}
                    run.digest, run.seconds = digest, float(cpu.sum())
            except HhsimError as error:
                run.failure = str(error)
                return run
            run.repeatable = run.repeatable and digest == run.digest
            run.cpu.append(cpu[cell.stage.contact])
            run.other.append(1e-9 * result[cell.other][cell.stage.contact])
        return run

    def of_way(self, runs: Sequence[Run]) -> Row:
        """Return what a row has of runs of one way besides names, times, figures and failures."""
        raise NotImplementedError

    def mark(self, group: Sequence[Row]) -> None:
        """Mark the best of the rows that compete."""
        raise NotImplementedError

    def rows(self, figures: Sequence[Run]) -> list[Row]:
        """Return a row a run, then one for each way and object, then one for each way."""
        groups: dict[tuple[str, Way], list[Run]] = defaultdict(list)
        for run in figures:
            groups[run.object, run.way].append(run)
        for run in figures:
            groups[ALL, run.way].append(run)
        totals = {name: TOTALS[one.total] for name, one in self.plan().columns.items() if one.total}

        def row(name: str, motion: str, group: Sequence[Run]) -> Row:
            times, known = [run.cpu for run in group], [run.figures for run in group if run.figures]
            values = {key: float(total([of.get(key, np.nan) for of in known])) for key, total in totals.items()}
            return {
                "object": name,
                "motion": motion,
                "contact_ticks": sum(cpu[0].size for cpu in times if cpu),
                "tick_cpu_p50": median_percentile(times, 50.0),
                "tick_cpu_p99": median_percentile(times, 99.0),
                **values,
                **self.of_way(group),
                "failed_runs": sum(bool(run.failure) for run in group),
            }

        rows = [row(run.object, run.motion, [run]) for run in figures]
        rows += [row(name, ALL, group) for (name, _), group in groups.items()]
        competing: dict[tuple[str, str], list[Row]] = defaultdict(list)
        for one in rows:
            if not one["failed_runs"]:
                competing[one["object"], one["motion"]].append(one)
        for together in competing.values():
            self.mark(together)
        return rows

    def title(self) -> str:
        """Return the motions."""
        return ", ".join(self.motions)

    def notes(self, figures: Sequence[Run]) -> list[str]:
        """Return remarks on the times, and on the runs that failed."""
        failed = [run for run in figures if run.failure]
        where = [f"{run.way.name}, {run.object}, {run.motion}: {run.failure}" for run in failed[:1]]
        told = [f"{len(failed)} of {len(figures)} runs could not be done; the first: {first}" for first in where]
        return [TIMES_REMARK, *told]

    def named(self, cell: Cell) -> str:
        """Return way and scene."""
        return f"{cell.way.name}, {cell.stage.object}, {cell.stage.motion}"

    def draw(
        self, path: Path, rows: Sequence[Row], figures: Sequence[Run], progress: Progress, note: str
    ) -> list[Path]:
        """Draw time against error."""
        draw_trade_off(path, rows, note)
        return [path]


MOST_PANELS, ACROSS = 4, 2
"""Panels of such a suite, and those beside one another."""
PANEL, WIDE_PANEL = (3.4, 2.4), (6.5, 3.2)
"""Width and height of a panel with its labels, without and with other engines [inches]."""
PAPER_RANGE = (310e-6, 480e-6)
"""Mean times of a tick that the paper states, for the five simple objects of its Fig. 11, on its own machine [s]."""
ROUNDING = 1e-6
"""Smaller errors are drawn as 0 [mm]."""
LEAST = 1e-2
"""A tenth of the lowest decade that is shown [mm]."""
GREY = "#6e7781"
OTHERS = ("x", "^", "v", "<", ">", "p", "*", "d", "s", "h", "8", "H")
"""Marks of other engines, all in grey."""
OWN_QP = "active-set"
LEVEL_MARKS = {1: "v", 2: "D", 3: "s", 4: "o", 5: "*"}
"""Marks by the level of the sphere tree."""
CAPTION = (
    "Mark: median CPU time of a tick in contact; the line from it ends at p99. Off the true mesh: the larger of the "
    "deepest penetration and the farthest contact point, over all motions. A hollow mark is one linearisation; steps "
    "join those that none beats. Grey band: mean times that the paper states. Red: 1 ms."
)
CAPTION_OF_OTHERS = " Grey marks: other engines, whose ratios carry over to another machine, and not their times."


class Mark(NamedTuple):
    """One mark of a panel; NaN where time or error is undefined."""

    time: float  # median CPU time of a tick [s]
    p99: float  # 99th percentile [s]
    error: float  # [mm]
    color: str
    shape: str
    is_filled: bool
    is_best: bool  # True if a line joins it to the others that none beats


def draw_trade_off(path: Path, rows: Sequence[Row], note: str = "") -> None:
    """Write the picture of a table, with a note on the run in its legend; errors as `save_figure`."""
    from matplotlib.lines import Line2D

    panels, legend = _panels(rows)
    if note:
        legend[note] = style.LIMIT, ""
    others = any(not row.get("ours", True) for row in rows)
    (width, height), down = WIDE_PANEL if others else PANEL, -(-len(panels) // ACROSS)
    columns = max(1, int(ACROSS * width / (style.SIGN + style.LETTER * max(map(len, legend), default=1))))
    # The panels stand beside one another, below their legend.
    whole = down * height + 0.2 * (len(legend) // columns + 1)
    with style.new_figure(ACROSS * width, whole, "constrained") as figure:
        grid = figure.subplots(down, ACROSS, squeeze=False).ravel()
        for axes in grid[len(panels) :]:
            axes.set_axis_off()
        for axes, (title, marks) in zip(grid, panels.items()):
            axes.set_title(title)
            _draw_panel(axes, marks)
        signs = [Line2D([], [], color=color, marker=mark, linewidth=1.2) for color, mark in legend.values()]
        figure.legend(signs, list(legend), loc="outside upper left", ncols=columns, **style.LEGEND)
        caption = wrap(CAPTION + CAPTION_OF_OTHERS * others, int(figure.get_figwidth() / style.LETTER))
        figure.supxlabel("\n".join(caption), x=0.0, ha="left", color=style.SOFT, fontsize=style.TEXT)
        save_figure(figure, path)


def _panels(rows: Sequence[Row]) -> tuple[dict[str, list[Mark]], dict[str, tuple[str, str]]]:
    """Return panels by their titles, for each object and of `speed-error` one against the optimum, and the legend.

    The legend has the colour and the mark of each label.
    """
    summed = [row for row in rows if row["motion"] == ALL and row.get("qp", OWN_QP) == OWN_QP]
    names = list(dict.fromkeys(row["object"] for row in summed if row["object"] != ALL))
    ours = [row for row in summed if row.get("ours", True)]
    colors = {name: style.run_style(i)[0] for i, name in enumerate(dict.fromkeys(row["method"] for row in ours))}
    foreign = dict.fromkeys(row["method"] for row in summed if row["method"] not in colors)
    engines = {name: (GREY, OTHERS[i % len(OTHERS)]) for i, name in enumerate(foreign)}

    def panel(name: str, error: str, frontier: str) -> list[Mark]:
        marks = []
        for row in (row for row in summed if row["object"] == name):
            time, p99, off = (_number(row.get(key)) for key in ("tick_cpu_p50", "tick_cpu_p99", error))
            look = engines.get(row["method"]) or (colors[row["method"]], _touched(row)[1])
            marks.append(Mark(time, p99, 1e3 * off, *look, row.get("linearisations") != 1, bool(row.get(frontier))))
        return marks

    of_pose = any("off_optimum_mean" in row for row in summed)
    frontier = "mesh_frontier" if of_pose else "frontier"
    drawn = names[: MOST_PANELS - of_pose]
    panels = {f"{name}: off the true mesh [mm]": panel(name, "mesh_error", frontier) for name in drawn}
    if of_pose:
        of_all = names[0] if len(names) == 1 else "all objects"
        panels[f"{of_all}: off the best pose [mm]"] = panel(ALL, "off_optimum_mean", "tracking_frontier")
    legend = {method: (color, "o") for method, color in colors.items()}
    return panels, legend | {label: (style.INK, shape) for label, shape in sorted(map(_touched, ours))} | engines


def _touched(row: Row) -> tuple[str, str]:
    """Return what a row's hand touches, in words, and its mark."""
    if row["surface"] == "mesh":
        return "the mesh itself", "P"
    level = row.get("level")
    return ("spheres", "o") if level is None else (f"spheres of level {level:.0f}", LEVEL_MARKS.get(level, "o"))


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else np.nan


def _draw_panel(axes: "Axes", marks: Sequence[Mark]) -> None:
    errors = [0.0 if abs(mark.error) < ROUNDING else mark.error for mark in marks if np.isfinite(mark.error)]
    some = [error for error in errors if error > 0.0]
    low = 10.0 ** np.floor(np.log10(min([*some, LEAST * 10.0])))
    high = 10.0 ** np.ceil(np.log10(max([*some, 10.0 * low])) + 0.1)
    # A logarithm has no zero: 0 stands below the lowest decade, where an error is nothing.
    decades = float(np.log10(high / low))
    zero, has_zero = low * 10.0 ** (-0.12 * decades), len(some) < max(1, len(errors))
    axes.set(xscale="log", yscale="log", ylim=(zero * 10.0 ** (-0.1 * decades) if has_zero else low, high))
    axes.grid(axis="y")
    axes.axhline(low, color=style.SOFT, linewidth=0.5, linestyle=":")
    axes.axvspan(*PAPER_RANGE, color=style.SOFT, alpha=0.1, linewidth=0)
    axes.axvline(style.BUDGET, color=style.LIMIT, linewidth=1.2)
    known = [(mark, max(mark.error, zero)) for mark in marks if np.isfinite(mark.time) and np.isfinite(mark.error)]
    for mark, height in known:
        face = mark.color if mark.is_filled else "white"
        look: Any = {"color": mark.color, "markerfacecolor": face, "markersize": 6.0, "zorder": 4, "clip_on": False}
        axes.plot(mark.time, height, mark.shape, **look)
        axes.plot([mark.time, mark.p99], [height, height], color=mark.color, linewidth=1.2)
    times = [time for mark, _ in known for time in (mark.time, mark.p99) if time > 0.0]
    axes.set_xlim(0.5 * min([*times, 1e-5]), 2.0 * max([*times, style.BUDGET]))
    if best := sorted((mark.time, height) for mark, height in known if mark.is_best):
        # Steps, down to the fastest and on to the right of the best.
        steps = [best[0][0], *(time for time, _ in best), 1e9], [1e9, *(off for _, off in best), best[-1][1]]
        axes.plot(*steps, color=style.SOFT, linewidth=0.9, drawstyle="steps-post", zorder=2)
    if not errors:
        style.note(axes, "not measured")
    powers = [10.0**k for k in range(round(np.log10(low)), round(np.log10(high)) + 1)][:: 1 + round(decades) // 7]
    named = {**({zero: "0"} if has_zero else {}), **{power: f"{power:g}" for power in powers}}
    axes.set_yticks(list(named), list(named.values()))
    axes.xaxis.set_major_formatter(lambda value, _: style.time_text(value).replace(".0 ", " "))
    axes.minorticks_off()
    axes.set_xlabel("CPU time of a tick in contact")
