"""Histogram of tick times."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.metrics import metrics
from hhsim.report import figure as style
from hhsim.result.reader import Result
from hhsim.system.counted import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BINS_A_DECADE = 30
PANEL = 1.5
"""Height of each panel [inches]."""
NAMES, CONTACT_NAMES = ("CPU", "wall"), ("CPU, all", "CPU, contact", "wall, contact")
HALO = {"boxstyle": "square,pad=0.05", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}
"""Box behind text that crosses lines."""
TIMES = tuple(factor * 10.0**power for power in range(-7, 2) for factor in (1.0, 2.0, 5.0))


@dataclass(frozen=True)
class TickTimes:
    """Times of a result's ticks [s]: CPU time of all; CPU and wall time of those in contact, or of all without any.

    `contact` is true if they are those in contact.
    """

    label: str
    all_cpu: FloatArray
    cpu: FloatArray
    wall: FloatArray
    contact: bool


def histogram_figure(results: Mapping[str, Result]) -> style.ReportFigure:
    """Draw CPU and wall times of ticks on a logarithmic axis with the line of 1 ms, of results by their labels."""
    runs = [_times(label, result) for label, result in results.items()]
    edges = _edges(runs)

    def panel(number: int, run: TickTimes) -> style.Panel:
        title = f"{run.label}: number of ticks" if len(runs) > 1 else "number of ticks"
        draw = partial(_draw_panel, run=run, edges=edges, color=style.run_style(number)[0])
        return style.Panel(title, PANEL, draw, CONTACT_NAMES if run.contact else NAMES)

    def over_all(axes: "Sequence[Axes]", narrow: bool) -> None:
        _scale(axes[0], edges, narrow)
        axes[-1].set_xlabel("time of a tick")

    drawing = style.chart([panel(number, run) for number, run in enumerate(runs)], over_all)
    return style.drawn_figure("tick-times", "How long the ticks took", _caption(runs), _alt(runs), drawing)


def _times(label: str, result: Result) -> TickTimes:
    cpu, wall = (1e-9 * result[f"duration/{name}"] for name in ("total_cpu", "total"))
    contact = result["contacts/candidates"] > 0
    if not contact.any():
        return TickTimes(label, cpu, cpu, wall, False)
    return TickTimes(label, cpu, cpu[contact], wall[contact], True)


def _edges(runs: Sequence[TickTimes]) -> FloatArray:
    """Return the edges of the bins [s]; 1 ms is one of them."""
    every = np.concatenate([np.concatenate([run.all_cpu, run.wall]) for run in runs] or [np.empty(0)])
    low, high = (every.min(), every.max()) if every.size else (1e-5, 1e-4)
    first, last = (np.log10(max(value, style.LEAST_TIME) / style.BUDGET) * BINS_A_DECADE for value in (low, high))
    bins = np.arange(np.floor(first) - 1.0, max(np.ceil(last), 0.3 * BINS_A_DECADE) + 2.0)
    return np.asarray(style.BUDGET * 10.0 ** (bins / BINS_A_DECADE))


def _draw_panel(axes: "Axes", run: TickTimes, edges: FloatArray, color: str) -> None:
    def stairs(times: FloatArray, **look: Any) -> None:
        counts = np.histogram(np.maximum(times, style.LEAST_TIME), edges)[0]
        axes.stairs(counts, edges, baseline=0.0, label="ticks", **look)

    if run.contact:
        stairs(run.all_cpu, fill=True, color="#d8dee4")
    stairs(run.cpu, fill=True, color=color, alpha=0.75)
    stairs(run.wall, color=style.INK, linewidth=0.9)
    most = max(1, run.all_cpu.size)
    # The space above the bars is for two lines of text.
    axes.set_ylim(0.6, 10.0 ** (1.3 * np.log10(most) + 0.6))
    axes.set_yscale("log")
    powers = [10**k for k in range(int(np.log10(most)) + 1)]
    axes.set_yticks(powers, [f"{power:,}" for power in powers])
    axes.minorticks_off()
    axes.axvline(style.BUDGET, color=style.LIMIT, linewidth=1.2)
    axes.axvspan(style.BUDGET, edges[-1], color=style.LIMIT, alpha=0.05, linewidth=0.0)
    axes.annotate(
        "1 ms", (style.BUDGET, 1.0), (3.0, -2.0), xycoords=("data", "axes fraction"), textcoords="offset points",
        color=style.LIMIT, va="top",
    )  # fmt: skip
    statistics = metrics.tick_statistics(1e9 * run.cpu)
    if statistics.count == 0:
        style.note(axes, "no tick")
        return
    for line, (name, value) in enumerate((("p50", statistics.p50), ("p99", statistics.p99))):
        axes.axvline(1e-6 * value, color=style.INK, linewidth=0.9, linestyle=(0, (3, 2)))
        # Each has its own line, however near they are to each other.
        axes.annotate(
            f"{name} {style.time_text(1e-6 * value)}", (1e-6 * value, 1.0), (3.0, -2.0 - 72 * style.LEGEND_LINE * line),
            xycoords=("data", "axes fraction"), textcoords="offset points", va="top", bbox=HALO,
        )  # fmt: skip


def _scale(axes: "Axes", edges: FloatArray, narrow: bool) -> None:
    axes.set_xscale("log")
    axes.set_xlim(edges[0], edges[-1])
    decades = np.log10(edges[-1] / edges[0])
    named = [time for time in TIMES if edges[0] <= time <= edges[-1]]
    if decades > (1.4 if narrow else 3.2):
        named = [time for time in named if np.isclose((np.log10(time) + 0.5) % 1.0, 0.5)]
    axes.set_xticks(named, [style.time_text(time).replace(".0 ", " ") for time in named])
    axes.minorticks_off()


def _caption(runs: Sequence[TickTimes]) -> str:
    shown = "ticks in contact, those with candidate pairs" if any(run.contact for run in runs) else "all ticks"
    return (
        f"Ticks by how long they took, {shown}: CPU time filled, wall time as a line; both axes are logarithmic, so "
        "that a single slow tick is seen. Dashed: p50 and p99 of the CPU time, as the table has them. Red: 1 ms, "
        "the budget of a tick at 1 kHz. Compilation is no part of any tick."
    )


def _alt(runs: Sequence[TickTimes]) -> str:
    sentences = [f"Histogram{'s' if len(runs) > 1 else ''} of tick times."]
    for run in runs:
        cpu, wall = (metrics.tick_statistics(1e9 * values) for values in (run.cpu, run.wall))
        who = f"{run.label}: " if len(runs) > 1 else ""
        if cpu.count == 0:
            sentences.append(f"{who}No tick.")
            continue
        p50, p99, most = (style.time_text(1e-6 * value) for value in (cpu.p50, cpu.p99, cpu.max))
        sentences.append(
            f"{who}CPU time of {counted(cpu.count, 'tick')}{' in contact' if run.contact else ''}: median {p50}, "
            f"p99 {p99}, longest {most}; {100.0 * wall.over_budget:.2f} % took more than 1 ms of wall time."
        )
    return " ".join(sentences)
