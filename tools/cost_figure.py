"""What a tick costs against the contacts it has: `python -m tools.cost_figure docs/cost.png`.

Five motions are replayed on the bunny at two levels of its sphere tree, with both methods and with three margins: a
wider margin lets more pairs into the same program, up to more than a thousand. The replays take turns, and of each tick
the median over the rounds counts, so that what else the machine does falls out.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, OutputError
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.state import WORK_CANDIDATES
from hhsim.mesh.catalogue import load_object
from hhsim.render.figure import save_figure
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import Scene, make_scene
from hhsim.solver.hand_solver import HandSolver, warm_up
from hhsim.solver.options import SolverOptions
from hhsim.system.output_path import check_picture
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions

if TYPE_CHECKING:
    from matplotlib.axes import Axes


BIN_EDGES = np.array([1, 10, 20, 40, 80, 160, 320, 640, 1000, 1400])
"""Bins of candidate pairs: each holds its lower edge and not its upper one."""
BIN_TICKS = 50
"""A bin with fewer ticks has no 99th percentile worth the name and is left out."""

BUDGET = 1e-3
"""Of a tick at 1 kHz [s]."""
COLORS = {"coupled": "#1b6ca8", "progressive": "#c8641a"}
PAPER_COLOR = "0.35"


@dataclass(frozen=True)
class PaperPoint:
    """A cost that the paper states, for its own machine: an Intel Core i7-8700.

    Attributes:
        pairs: Candidate pairs; None where the paper states a cost without a count.
        low, high: Mean time of a tick [s], as the paper states it.
        label: What was measured.
        align: Where the label ends or begins at the point.
    """

    pairs: int | None
    low: float
    high: float
    label: str
    align: Literal["left", "right"] = "left"


PAPER = (
    PaperPoint(131, 1e-3, 1e-3, "the paper: two\nfingers, threads", "right"),
    PaperPoint(250, 1e-3, 1e-3, "the paper:\nwhole hand"),
    PaperPoint(None, 310e-6, 480e-6, "the paper: simple objects, pairs not stated"),
)


@dataclass(frozen=True)
class CostOptions:
    """What is replayed, and how often.

    Attributes:
        object_name: Of the catalogue.
        levels: Of its sphere tree.
        trajectories: Of the catalogue.
        methods: Of the solver.
        margins: [m].
        rounds: Replays of each.
    """

    object_name: str = "bunny"
    levels: tuple[int, ...] = (3, 4)
    trajectories: tuple[str, ...] = ("touch", "pinch", "grasp", "whole-hand", "slide")
    methods: tuple[str, ...] = ("coupled", "progressive")
    margins: tuple[float, ...] = (1e-3, 2e-3, 3e-3)
    rounds: int = 5


@dataclass(frozen=True)
class TickCosts:
    """All ticks of one method: candidate pairs, shape (n,); CPU time [s], the median of the rounds, shape (n,)."""

    pairs: IntArray
    cost: FloatArray


@dataclass(frozen=True)
class CostBin:
    """The ticks with `first` to `last` candidate pairs; costs in s."""

    first: int
    last: int
    ticks: int
    pairs: float
    p10: float
    median: float
    p90: float
    p99: float


@dataclass
class _Replay:
    scene: Scene
    solver: SolverOptions
    pairs: IntArray | None = None
    rounds: list[FloatArray] = field(default_factory=list)


def measure(options: CostOptions, progress: Callable[[str], None] | None = None) -> dict[str, TickCosts]:
    """Replay everything in turns and return the ticks that had candidate pairs, by method."""
    hand = HandModel.default()
    mesh = load_object(options.object_name).mesh
    replays = []
    for level in options.levels:
        tree = cached_sphere_tree(mesh, TreeOptions(level=level))
        for name in options.trajectories:
            scene = make_scene(mesh, tree, hand, load_script(name))
            for margin in options.margins:
                replays += [_Replay(scene, SolverOptions(method=method, margin=margin)) for method in options.methods]
    for method in options.methods:
        warm_up(hand, SolverOptions(method=method))
    for number in range(options.rounds):
        if progress is not None:
            progress(f"round {number + 1} of {options.rounds}: {len(replays)} replays")
        for replay in replays:
            _run(replay)
    costs = {}
    for method in options.methods:
        mine = [replay for replay in replays if replay.solver.method == method]
        pairs = np.concatenate([replay.pairs for replay in mine if replay.pairs is not None])
        cost = np.concatenate([np.median(replay.rounds, axis=0) for replay in mine])
        costs[method] = TickCosts(pairs[pairs > 0], cost[pairs > 0])
    return costs


def _run(replay: _Replay) -> None:
    ticks = replay.scene.hands[0].ticks.seen_from_object()
    solver = HandSolver(replay.scene.hands[0].model, replay.scene.solids[0].placed_tree.arrays(), replay.solver)
    record = solver.run(ticks.position, ticks.orientation, ticks.flexion, ticks.abduction)
    replay.pairs = record.work[:, WORK_CANDIDATES]
    replay.rounds.append(np.multiply(1e-9, record.duration_cpu, dtype=np.float64))


def binned(costs: TickCosts, edges: ArrayLike = BIN_EDGES, least: int = BIN_TICKS) -> list[CostBin]:
    """Statistics of each bin that holds at least `least` ticks."""
    bounds = np.asarray(edges)
    bins = []
    for low, high in pairwise(bounds):
        inside = (costs.pairs >= low) & (costs.pairs < high)
        if inside.sum() < max(least, 1):
            continue
        p10, median, p90, p99 = np.percentile(costs.cost[inside], (10, 50, 90, 99))
        pairs = float(np.mean(costs.pairs[inside]))
        bins.append(CostBin(int(low), int(high) - 1, int(inside.sum()), pairs, p10, median, p90, p99))
    return bins


def table(bins: dict[str, list[CostBin]]) -> str:
    """The bins as text."""
    lines = [f"{'method':12}{'pairs':>12}{'ticks':>9}{'p10':>8}{'p50':>8}{'p90':>8}{'p99':>8}   µs, thread CPU time"]
    for method, rows in bins.items():
        for row in rows:
            figures = "".join(f"{1e6 * value:8.1f}" for value in (row.p10, row.median, row.p90, row.p99))
            lines.append(f"{method:12}{f'{row.first} to {row.last}':>12}{row.ticks:>9,}{figures}")
    return "\n".join(lines)


def draw_costs(path: Path, bins: dict[str, list[CostBin]]) -> None:
    """Draw the cost of a tick and the cost of a pair, against the pairs.

    Raises:
        OutputError: The picture cannot be written.
        InputError: matplotlib has no such picture format.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    check_picture(path)
    figure = Figure(figsize=(14.0, 6.0), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    left, right = figure.add_axes((0.065, 0.125, 0.52, 0.77)), figure.add_axes((0.665, 0.125, 0.32, 0.77))
    for method, rows in bins.items():
        pairs = np.array([row.pairs for row in rows])
        for axes, per_pair in ((left, False), (right, True)):
            share = 1e6 / pairs if per_pair else np.full(len(pairs), 1e6)
            low, middle, high, rare = (
                share * [getattr(row, name) for row in rows] for name in ("p10", "median", "p90", "p99")
            )
            axes.fill_between(pairs, low, high, color=COLORS[method], alpha=0.22, linewidth=0)
            axes.plot(pairs, middle, color=COLORS[method], marker="o", markersize=5, linewidth=2.2, label=method)
            if not per_pair:
                axes.plot(pairs, rare, color=COLORS[method], linestyle="--", linewidth=1.3, label=f"{method}, p99")
    _draw_paper(left, right)
    for axes in (left, right):
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlim(4, 1600)
        axes.set_xticks([5, 10, 20, 50, 100, 200, 500, 1000], ["5", "10", "20", "50", "100", "200", "500", "1,000"])
        axes.minorticks_off()
        axes.set_xlabel("candidate pairs of the tick", fontsize=13)
        axes.grid(color="0.9", linewidth=0.8)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=12)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    left.set_ylim(2, 3000)
    left.set_yticks([5, 10, 20, 50, 100, 200, 500, 1000], ["5", "10", "20", "50", "100", "200", "500", "1,000"])
    left.set_title("CPU time of a tick [µs]", fontsize=15, loc="left")
    right.set_yticks([0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5], ["0.02", "0.05", "0.1", "0.2", "0.5", "1", "2", "5"])
    right.set_title("CPU time of a tick per pair [µs]", fontsize=15, loc="left")
    left.legend(loc="lower right", fontsize=12, frameon=False, ncols=len(bins))
    figure.text(
        0.985,
        0.012,
        "line: median; band: p10 to p90; diamonds: means of the paper, on its own Intel Core i7-8700",
        ha="right",
        fontsize=11,
        color="0.35",
    )
    save_figure(figure, path)


def _draw_paper(left: "Axes", right: "Axes") -> None:
    left.axhline(1e6 * BUDGET, color="#b00020", linewidth=1.6)
    left.text(4.3, 1e6 * BUDGET * 1.12, "1 ms: the budget at 1 kHz", color="#b00020", fontsize=12)
    for point in PAPER:
        if point.pairs is None:
            left.axhspan(1e6 * point.low, 1e6 * point.high, color=PAPER_COLOR, alpha=0.13, linewidth=0)
            middle = 1e6 * float(np.sqrt(point.low * point.high))
            left.text(4.3, middle, point.label, color=PAPER_COLOR, fontsize=12, va="center")
            continue
        for axes, share in ((left, 1.0), (right, point.pairs)):
            axes.plot(point.pairs, 1e6 * point.low / share, "D", color=PAPER_COLOR, markersize=9, zorder=5)
        left.annotate(
            point.label,
            (point.pairs, 1e6 * point.low),
            (-8, 9) if point.align == "left" else (8, 9),
            textcoords="offset points",
            ha=point.align,
            va="bottom",
            fontsize=12,
            color=PAPER_COLOR,
        )


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    if len(arguments) != 1:
        raise SystemExit("usage: python -m tools.cost_figure PICTURE, for example docs/cost.png")
    path = Path(arguments[0])
    try:
        check_picture(path)
        costs = measure(CostOptions(), progress=lambda text: print(text, file=sys.stderr))
        bins = {method: binned(ticks) for method, ticks in costs.items()}
        draw_costs(path, bins)
    except (InputError, OutputError) as error:
        raise SystemExit(str(error)) from error
    print(table(bins))


if __name__ == "__main__":
    main(sys.argv[1:])
