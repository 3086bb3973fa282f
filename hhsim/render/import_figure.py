"""Picture of an import: input in grey, output in colour, and the samples that bear a flag."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.motion.sample_flags import SampleFlag, marked
from hhsim.recordings.cleaning import CleanedRecording
from hhsim.recordings.recording import turn
from hhsim.render.figure import new_figure, save_figure
from hhsim.system.output_path import check_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00")
"""Okabe and Ito's colours for the colour-blind."""
BANDS: tuple[tuple[str, SampleFlag, str], ...] = (
    ("interpolated", SampleFlag.PALM_FILLED | SampleFlag.FINGERS_FILLED, "#56B4E9"),
    ("outlier replaced", SampleFlag.PALM_OUTLIER | SampleFlag.FINGERS_OUTLIER, "#D55E00"),
    ("at a joint limit", SampleFlag.LIMITED, "#E69F00"),
    ("suspect, jump or frozen", SampleFlag.SUSPECT | SampleFlag.JUMP | SampleFlag.FROZEN, "#CC79A7"),
    ("stamps: gap, cut, sorted", SampleFlag.GAP_BEFORE | SampleFlag.CUT_BEFORE | SampleFlag.REORDERED, "#000000"),
    ("device unsure, estimated", SampleFlag.INVALID | SampleFlag.ESTIMATED, "#999999"),
    ("quaternion turned or scaled", SampleFlag.FLIPPED | SampleFlag.RENORMALISED, "#009E73"),
)


def draw_import(cleaned: CleanedRecording, path: Path) -> None:
    """Draw a recording in our units, and the trajectory that was made of it; errors as `save_figure`."""
    check_picture(path)
    figure = new_figure(13, 15, layout="constrained")
    rows = figure.subplots(9, 1, sharex=True, height_ratios=[2, 2, 2, 2, 2, 2, 2, 2, 1.5])
    given, motion = cleaned.given, cleaned.trajectory
    clocks = given.time, motion.time
    _panel(rows[0], clocks, 1e3 * given.position, 1e3 * motion.position, ("x", "y", "z"), "palm [mm]")
    _panel(rows[1], clocks, _angle(given.orientation), _angle(motion.orientation), ("x", "y", "z"), "turn [°]")
    for f, finger in enumerate(FINGERS):
        came, went = np.degrees(given.flexion[:, f]), np.degrees(motion.flexion[:, f])
        _panel(rows[2 + f], clocks, came, went, ("first", "second", "third"), f"{finger}\nflexion [°]")
    came, went = np.degrees(given.abduction), np.degrees(motion.abduction)
    _panel(rows[7], clocks, came, went, FINGERS, "abduction [°]")
    # A row of marks for each group of flags.
    flags = motion.flags if motion.flags is not None else np.zeros(motion.sample_count, dtype=np.uint32)
    for row, (_, flag, colour) in enumerate(BANDS):
        at = motion.time[marked(flags, flag)]
        rows[8].plot(at, np.full(at.shape, -row), "|", color=colour, markersize=8)
    names = [f"{name}: {int(marked(flags, flag).sum())}" for name, flag, _ in BANDS]
    rows[8].set_yticks([-row for row in range(len(BANDS))], names, fontsize=8)
    rows[8].set_ylim(-len(BANDS) + 0.4, 0.6)
    rows[8].grid(axis="x", color="0.92")
    rows[0].set_title(f"{motion.name}: grey what came in, coloured what went out", fontsize=13, loc="left")
    rows[8].set_xlabel("time [s]")
    save_figure(figure, path)


def _angle(orientation: FloatArray) -> FloatArray:
    """Return rotation vectors [degrees] from the first whole quaternion on, shape (T, 3)."""
    whole = np.isfinite(orientation).all(axis=1) & (np.linalg.norm(np.nan_to_num(orientation), axis=1) > 0.0)
    first = orientation[np.argmax(whole)]
    return np.asarray(np.degrees(turn(np.broadcast_to(first, orientation.shape), orientation)))


def _panel(
    axes: "Axes", clocks: Sequence[FloatArray], came: FloatArray, went: FloatArray, names: Sequence[str], label: str
) -> None:
    """Draw curves of input and output, each by its own clock."""
    time_in, time_out = clocks
    for column in range(went.shape[1]):
        axes.plot(time_in, came[:, column], color="0.65", linewidth=2.5, marker=".", markersize=4)
    for column, name in enumerate(names):
        axes.plot(time_out, went[:, column], color=COLOURS[column], linewidth=1.0, label=name)
    low, high = float(np.min(went)), float(np.max(went))
    margin = 0.35 * max(high - low, 1.0)
    # Outliers leave the panel rather than flatten it.
    shown = came[np.isfinite(came)]
    inside = shown[(shown > low - 3 * margin) & (shown < high + 3 * margin)]
    axes.set_ylim(min(low, inside.min(initial=low)) - 0.2 * margin, max(high, inside.max(initial=high)) + 0.2 * margin)
    axes.set_xlim(time_out[0], time_out[-1])
    axes.set_ylabel(label)
    axes.grid(color="0.92")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
