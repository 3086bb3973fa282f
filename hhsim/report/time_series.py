"""Curves over time, in the manner of the paper's Figs. 12 and 14, and the histogram of tick times."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.metrics import metrics
from hhsim.metrics.run_ticks import HOLD, FreeRun, result_free_run
from hhsim.metrics.session_faults import broken_off, session_log
from hhsim.report import figure as style
from hhsim.result.reader import Result
from hhsim.result.schema import LIVE_TICK
from hhsim.system.counted import counted
from hhsim.view.plots import force_values

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORCES = ("resultant", *FINGERS, "palm")
PAIRS = ("within the margin", "touching")
FORCE_COLORS = (style.INK, *style.FINGER_COLORS, style.SKY)
PHASE_COLORS = {HOLD: "#e6eef6", "slide": "#fbefdd", "carry": "#fbefdd"}
"""Colours of the phases that the paper's figures shade; the others stay white."""
BETWEEN = 0.11
"""Space between two names of phases [inches]."""
MARK_LETTERS = 6
"""Letters of a mark's word, with the gap to its line."""
MOST_MARKS = 10
"""Most marks that the alternative text lists."""
GREY_LINE = "#8c959f"
VARIATION_TICKS = (0.0, 0.1, 1.0, 10.0, 100.0)
CAPTION = (
    "Sizes of the contact forces: of one result on each finger and the palm and of their resultant, of several the "
    "resultant alone. Dotted in the third panel: pairs that touch. Shaded: holds, and slides in another shade, of the "
    "first result. Penetration is measured after each tick; the change of the force is not defined below 0.01 N. "
    "Stiffness is what a session told its glove, of several results the largest of the five fingers: 0 is a free "
    "finger. Dashed lines through all panels: a session's faults, and its end where that was not in order. Friction is "
    "that of the contact nearest to sliding: at 100 % it slides."
)


@dataclass(frozen=True, eq=False)
class Run:
    """A result with its label in the legend."""

    label: str
    result: Result

    @property
    def is_timed(self) -> bool:
        """True if the times since the start of the motion grow."""
        return bool(np.isfinite(self.result["time"]).all() and (np.diff(self.result["time"]) > 0.0).all())

    @cached_property
    def at(self) -> FloatArray:
        """Places of the ticks on the axis, shape (T,): their times [s], or their numbers where these do not grow."""
        return self.result["time"] if self.is_timed else np.arange(self.result.ticks, dtype=np.float64)

    @cached_property
    def cpu(self) -> FloatArray:
        """CPU time of the whole tick [s], shape (T,)."""
        return 1e-9 * self.result["duration/total_cpu"]

    @cached_property
    def force(self) -> FloatArray:
        """Sizes of the forces of `FORCES` [N], shape (T, 7)."""
        # Block by block: the forces on all phalanges of a long session do not fit into memory.
        blocks = self.result.blocks(("force/phalanx", "force/total"))
        found = [force_values(block["force/phalanx"], block["force/total"]) for block in blocks]
        return np.concatenate(found) if found else np.empty((0, len(FORCES)))

    @property
    def stiffness(self) -> FloatArray | None:
        """Stiffness sent to each finger, 0 free to 1, shape (T, 5); None of a replay."""
        return None if self.result.live is None else self.result[f"{LIVE_TICK}/command_stiffness"]

    @cached_property
    def marks(self) -> list[tuple[float, str]]:
        """Times [s] of a session's faults, and of its end if that was not in order, each with its word."""
        if not self.is_timed:
            return []
        found = [(float(at), "fault") for at in session_log(self.result).faults]
        return sorted(found + [(float(at), "ended") for at in self.at[-1:] if broken_off(self.result)])

    @cached_property
    def free(self) -> FreeRun | None:
        """Free object of the result; None without one."""
        return result_free_run(self.result) if self.result.ticks else None


def series_figure(results: Mapping[str, Result]) -> style.ReportFigure:
    """Draw forces, CPU time of the tick, contacts, depth and force variation over time, phases shaded.

    Of one result the forces are drawn finger by finger; of several, each result is one colour in every panel.
    """
    runs = [Run(label, result) for label, result in results.items()]
    is_alone, surfaces = len(runs) == 1, " or ".join(dict.fromkeys(run.result.surface for run in runs))
    deepest = max((float(np.nanmax(run.result["penetration_depth"], initial=0.0)) for run in runs), default=0.0)
    unit, scale = ("mm", 1e3) if deepest >= 1e-3 else ("nm", 1e9) if 0.0 < deepest < 1e-7 else ("µm", 1e6)
    panels: list[tuple[str, float, Any, Sequence[str]]] = [
        ("force on the hand [N]", 1.75, _draw_forces, FORCES if is_alone else list(results)),
        ("CPU time of the tick", 1.3, _draw_times, ()),
        ("pairs of hand and object", 0.95, _draw_pairs, PAIRS),
        (f"penetration of the {surfaces} [{unit}]", 0.75, partial(_draw_depth, scale=scale), ()),
        ("change of the force in one tick [%]", 1.0, _draw_variation, ()),
    ]
    if any(run.stiffness is not None for run in runs):
        panels.append(("stiffness told to the fingers, 0 to 1", 0.95, _draw_stiffness, FINGERS if is_alone else ()))
    if any(run.free for run in runs):
        panels.append(("rise of the object [mm]", 0.75, _draw_rise, ()))
        panels.append(("friction of the hand, of what its contacts bear [%]", 0.75, _draw_friction, ()))

    def over_all(axes: "Sequence[Axes]") -> None:
        _draw_phases(axes, runs[0])
        _draw_axis(axes, runs)
        _draw_marks(axes, runs)

    def panel(
        title: str, height: float, draw: "Callable[[Axes, Sequence[Run]], None]", names: Sequence[str]
    ) -> style.Panel:
        return style.Panel(title, height, lambda axes: draw(axes, runs), names)

    drawn = [panel(*one) for one in panels]
    with style.chart(drawn, over_all) as figure:
        title = "Force, time and contacts over the run"
        return style.page_figure("series", title, CAPTION, _series_alt(runs, len(panels)), figure)


def _curves(axes: "Axes", runs: Sequence[Run], values: Callable[[Run], Any], width: float = 0.9) -> None:
    """Draw a curve for each run that has values."""
    for number, run in enumerate(runs):
        if (drawn := values(run)) is not None:
            color, dashes = style.run_style(number)
            axes.plot(run.at, drawn, color=color, linestyle=dashes, label=run.label, linewidth=width)


def _draw_forces(axes: "Axes", runs: Sequence[Run]) -> None:
    if len(runs) == 1:
        for k, (name, color) in enumerate(zip(FORCES, FORCE_COLORS)):
            width = 1.4 if k == 0 else 1.0
            axes.plot(runs[0].at, runs[0].force[:, k], color=color, label=name, linewidth=width)
    else:
        _curves(axes, runs, lambda run: run.force[:, 0], 1.2)
    axes.set_ylim(0.0, max(1.12 * axes.get_ylim()[1], 0.1))


def _draw_times(axes: "Axes", runs: Sequence[Run]) -> None:
    from matplotlib.ticker import FixedLocator, NullLocator

    _curves(axes, runs, lambda run: np.maximum(run.cpu, style.LEAST_TIME), 0.6)
    axes.set_yscale("log")
    every = np.concatenate([run.cpu for run in runs])
    known = every[np.isfinite(every) & (every > 0.0)]
    low, high = (float(known.min()), float(known.max())) if known.size else (1e-5, 1e-4)
    axes.set_ylim(max(0.7 * low, style.LEAST_TIME), max(1.6 * high, 2.2 * style.BUDGET))
    axes.axhline(style.BUDGET, color=style.LIMIT, linewidth=1.0)
    axes.annotate(
        "1 ms: a tick at 1 kHz", (1.0, style.BUDGET), (0.0, 2.0), xycoords=("axes fraction", "data"),
        textcoords="offset points", ha="right", va="bottom", color=style.LIMIT,
    )  # fmt: skip
    axes.yaxis.set_major_locator(FixedLocator([10.0**k for k in range(-7, 2)]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(lambda value, _: style.time_text(value).replace(".0 ", " "))


def _draw_pairs(axes: "Axes", runs: Sequence[Run]) -> None:
    for number, run in enumerate(runs):
        color, dashes = style.run_style(number)
        looks = ((style.SKY, "-"), (style.INK, "-")) if len(runs) == 1 else ((color, dashes), (color, ":"))
        for name, (hue, line), label in zip(("candidates", "touching"), looks, PAIRS if number == 0 else ("", "")):
            values = run.result[f"contacts/{name}"]
            axes.plot(run.at, values, color=hue, linestyle=line, label=label, linewidth=0.9)
    axes.set_ylim(0.0, max(1.08 * axes.get_ylim()[1], 1.0))


def _draw_depth(axes: "Axes", runs: Sequence[Run], scale: float) -> None:
    _curves(axes, runs, lambda run: scale * run.result["penetration_depth"], 0.8)
    some = any((run.result["penetration_depth"] > 0.0).any() for run in runs)
    axes.set_ylim(0.0, 1.15 * axes.get_ylim()[1] if some else 1.0)
    if not some and any(run.result.ticks for run in runs):
        style.note(axes, "none in any tick")


def _draw_variation(axes: "Axes", runs: Sequence[Run]) -> None:
    _curves(axes, runs, lambda run: run.result["force_variation_rate"], 0.7)
    axes.set_yscale("symlog", linthresh=0.1, linscale=0.6)
    axes.set_yticks(VARIATION_TICKS, [f"{value:g}" for value in VARIATION_TICKS])
    axes.minorticks_off()
    largest = max((float(np.nanmax(run.result["force_variation_rate"], initial=1.0)) for run in runs), default=1.0)
    axes.set_ylim(0.0, max(3.0, 2.0 * min(largest, 1e6)))


def _draw_stiffness(axes: "Axes", runs: Sequence[Run]) -> None:
    if len(runs) == 1 and (stiffness := runs[0].stiffness) is not None:
        for finger, (name, color) in enumerate(zip(FINGERS, style.FINGER_COLORS)):
            axes.plot(runs[0].at, stiffness[:, finger], color=color, label=name, linewidth=0.9)
    else:
        _curves(axes, runs, lambda run: None if run.stiffness is None else run.stiffness.max(axis=1, initial=0.0))
    axes.set_ylim(0.0, max(1.15 * axes.get_ylim()[1], 0.1))


def _draw_rise(axes: "Axes", runs: Sequence[Run]) -> None:
    _curves(axes, runs, lambda run: run.free and 1e3 * (run.free.center[:, 2] - run.free.center[0, 2]), 1.2)


def _draw_friction(axes: "Axes", runs: Sequence[Run]) -> None:
    _curves(axes, runs, lambda run: run.free and 100.0 * run.free.friction_share, 0.7)
    axes.axhline(100.0, color=style.LIMIT, linewidth=1.0)
    axes.set_ylim(0.0, 120.0)


def _draw_phases(axes: "Sequence[Axes]", run: Run) -> None:
    at = run.at
    if len(at) == 0:
        return
    across = max(float(at[-1] - at[0]), 1e-9)
    inches = style.inches(axes[0])
    for phase in run.result.phases:
        first, last = float(at[phase.first_tick]), float(at[min(phase.last_tick, len(at) - 1)])
        for place in axes:
            if phase.name in PHASE_COLORS:
                place.axvspan(first, last, color=PHASE_COLORS[phase.name], linewidth=0.0, zorder=0)
            elif phase.first_tick > 0:
                place.axvline(first, color=GREY_LINE, linewidth=0.6, linestyle=":", zorder=0)
        if (last - first) / across * inches > style.LETTER * len(phase.name) + 0.5 * BETWEEN:
            axes[0].annotate(
                phase.name, (0.5 * (first + last), 1.0), (0.0, -2.0), xycoords=("data", "axes fraction"),
                textcoords="offset points", ha="center", va="top", color=style.SOFT,
            )  # fmt: skip


def _draw_marks(axes: "Sequence[Axes]", runs: Sequence[Run]) -> None:
    """Draw a line through all panels at each mark, and its word at the top where it fits."""
    low, high = axes[0].get_xlim()
    word_width = style.LETTER * MARK_LETTERS * (high - low) / style.inches(axes[0])
    for number, run in enumerate(runs):
        color, named = style.LIMIT if len(runs) == 1 else style.run_style(number)[0], np.inf
        for place in axes:
            place.vlines(
                [at for at, _ in run.marks], 0.0, 1.0, color, "--", transform=place.get_xaxis_transform(),
                linewidth=0.9, clip_on=False,
            )  # fmt: skip
        # From the end on: the last word says most.
        for at, word in reversed(run.marks):
            if named - at < 2.0 * word_width:
                continue
            named, last = at, high - at < word_width
            axes[0].annotate(
                word, (at, 1.0), (-3.0 if last else 3.0, -12.0), xycoords=("data", "axes fraction"),
                textcoords="offset points", ha="right" if last else "left", va="top", color=color,
            )  # fmt: skip


def _draw_axis(axes: "Sequence[Axes]", runs: Sequence[Run]) -> None:
    ends = [(float(at[0]), float(at[-1])) for at in (run.at for run in runs) if len(at)]
    # A fault can be before the first tick, and after the last one.
    ends += [(at, at) for run in runs for at, _ in run.marks]
    low, high = (min(a for a, _ in ends), max(b for _, b in ends)) if ends else (0.0, 1.0)
    axes[0].set_xlim(low, high if high > low else low + 1.0)
    axes[-1].set_xlabel("time [s]" if all(run.is_timed for run in runs) else "tick")
    if not ends:
        style.note(axes[0], "no tick")


def _series_alt(runs: Sequence[Run], panels: int) -> str:
    sentences = [f"{panels} panels over time."]
    for run in runs:
        who = f"{run.label}: " if len(runs) > 1 else ""
        if run.result.ticks == 0:
            sentences.append(f"{who}No tick.")
            continue
        force, depth = (
            float(np.nanmax(values, initial=0.0)) for values in (run.force[:, 0], run.result["penetration_depth"])
        )
        marks = [f"{word} at {at:.3f} s" for at, word in run.marks[:MOST_MARKS]]
        told = [f"stiffness up to {run.stiffness.max():.2f}"] if run.stiffness is not None else []
        rise = [f"the object rises by {1e3 * run.free.raised:.1f} mm"] if run.free else []
        said = (f"total force up to {force:.2f} N", f"penetration up to {1e6 * depth:.3g} µm", *told, *marks, *rise)
        sentences.append(f"{who}{', '.join(said)}.")
    return " ".join(sentences)


BINS_A_DECADE = 30
HISTOGRAM = 2.0
"""Height of the histogram [inches]."""
TIMES_CAPTION = (
    "Ticks by their CPU time, those in contact, or all where none is; both axes are logarithmic, so that a single slow "
    "tick is seen. Dashed: p50 and p99, as the table has them. Red: 1 ms, the budget of a tick at 1 kHz. Compilation "
    "is no part of any tick."
)


def histogram_figure(results: Mapping[str, Result]) -> style.ReportFigure:
    """Draw CPU times of ticks on a logarithmic axis with the line of 1 ms, of results by their labels."""
    times, sentences = dict[str, FloatArray](), []
    for label, result in results.items():
        cpu, contact = 1e-9 * result["duration/total_cpu"], result["contacts/candidates"] > 0
        times[label] = cpu[contact] if contact.any() else cpu
        count, who = len(times[label]), f"{label}: " if len(results) > 1 else ""
        ticks = counted(count, "tick") + (" in contact" if contact.any() else "")
        found = metrics.tick_statistics(1e9 * times[label])
        p50, p99, most = (style.time_text(1e-6 * value) for value in (found.p50, found.p99, found.max))
        sentences.append(f"{who}{ticks}: median {p50}, p99 {p99}, longest {most}." if count else f"{who}No tick.")

    def draw(axes: "Axes") -> None:
        every = np.maximum(np.concatenate(list(times.values())), style.LEAST_TIME)
        low, high = (every.min(), every.max()) if every.size else (1e-5, 1e-4)
        # 1 ms is the edge of a bin.
        first, last = (np.log10(value / style.BUDGET) * BINS_A_DECADE for value in (low, high))
        bins = np.arange(np.floor(first) - 1.0, max(np.ceil(last), 0.3 * BINS_A_DECADE) + 2.0)
        edges = style.BUDGET * 10.0 ** (bins / BINS_A_DECADE)
        axes.set(xscale="log", yscale="log", xlabel="CPU time of a tick", xlim=(edges[0], edges[-1]))
        for number, (label, values) in enumerate(times.items()):
            color, dashes = style.run_style(number)
            counts = np.histogram(np.maximum(values, style.LEAST_TIME), edges)[0]
            axes.stairs(counts, edges, baseline=0.5, color=color, linestyle=dashes, label=label)
            for percentile in np.percentile(values, (50.0, 99.0)) if len(values) else ():
                axes.axvline(percentile, color=color, linewidth=0.9, linestyle=(0, (3, 2)))
        axes.set_ylim(bottom=0.6)
        axes.axvline(style.BUDGET, color=style.LIMIT, linewidth=1.2)
        axes.xaxis.set_major_formatter(lambda value, _: style.time_text(value).replace(".0 ", " "))
        axes.minorticks_off()
        if not every.size:
            style.note(axes, "no tick")

    panel = style.Panel("number of ticks", HISTOGRAM, draw, list(results) if len(results) > 1 else ())
    with style.chart([panel], lambda axes: None) as figure:
        alt = " ".join(("Histogram of tick times.", *sentences))
        return style.page_figure("tick-times", "How long the ticks took", TIMES_CAPTION, alt, figure)
