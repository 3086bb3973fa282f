"""Pictures of `hhsim bench paper` in the manner of the paper's Figs. 11 to 15."""

import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.paper.bench import PaperRuns
from hhsim.bench.paper.run import SceneRun
from hhsim.bench.paper.scene import CASES, held_ticks
from hhsim.errors import OutputError
from hhsim.hand.fingers import FINGERS
from hhsim.kernels.tick.step import DURATION_DETECT
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.mesh.mesh import Mesh
from hhsim.render.figure import new_figure, save_figure, tidy
from hhsim.render.hand_picture import GHOST, View, behind, viewpoint
from hhsim.render.rasterizer import blend, frame, look_from, shade
from hhsim.render.triangle_soup import STONE, hand_surface, joined, mesh_surface, painted
from hhsim.system.output_path import check_picture
from hhsim.system.progress import Progress, silent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


FINGER_COLORS = ("#b3261e", "#1b6ca8", "#2e7d32", "#c8641a", "#7a3b8f")
PART_COLORS = {"total": "0.15", "x": "#b3261e", "y": "#2e7d32", "z": "#1b6ca8"}
TIME_COLORS = {"detection": "#2e7d32", "response": "#c8641a", "total": "0.15"}
BUDGET_COLOR = "#b00020"
KINDS = (".png", ".pdf", ".svg")
LETTER, LINE = 0.075, 0.16
"""Width of a letter and height of a line of the text below a figure [inches]."""
TILE = 230
"""Rows and columns of a small picture [pixels]."""


def check_folder(folder: Path) -> None:
    """Make the folder, before the work; raise OutputError if it cannot be made or written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make the folder {folder}: {error.strerror or error}") from error
    check_picture(folder / "fig11.png")


def draw_all(folder: Path, runs: PaperRuns, progress: Progress = silent) -> list[Path]:
    """Draw every figure that the runs have scenes for: fig11 to fig15, each of `KINDS`; errors as `save_figure`."""
    jobs: list[tuple[str, Callable[[], Figure]]] = []
    # The hand that is shown is the default method's, or else the last one's.
    methods = list(dict.fromkeys(run.options.method for run in runs.scenes))
    shown = "coupled" if "coupled" in methods else methods[-1]
    for figure, columns in (("11", 3), ("13", 6)):
        scenes = runs.of(shown, figure)
        if scenes:
            jobs.append((f"fig{figure}", partial(_gallery, scenes=scenes, columns=columns)))
    for figure in ("12", "14"):
        for name in object_names():
            same = [run for method in methods for run in runs.of(method, figure, object_name=name)]
            if same:
                jobs.append((f"fig{figure}-{name}", partial(_forces_over_time, number=figure, runs=same)))
    if any(run.scenario.figure == "15" for run in runs.scenes):
        jobs.append(("fig15", partial(_cases, runs=runs, methods=methods)))
    written = []
    for number, (name, job) in enumerate(jobs):
        progress("pictures", number, len(jobs))
        drawn = job()
        for kind in KINDS:
            save_figure(drawn, folder / f"{name}{kind}")
            written.append(folder / f"{name}{kind}")
    return written


def _gallery(scenes: Sequence[SceneRun], columns: int) -> "Figure":
    rows = -(-len(scenes) // columns)
    figure = new_figure(columns * TILE / 100, rows * (TILE + 22) / 100 + 0.3)
    axes = figure.subplots(rows, columns, squeeze=False)
    for place in axes.ravel():
        place.set_axis_off()
    for place, run in zip(axes.ravel(), scenes):
        mesh = load_object(run.scenario.object_name).mesh
        place.imshow(scene_picture(run, mesh, shape=(TILE, TILE)), interpolation="none")
        place.set_title(run.scenario.name, fontsize=10, color="0.25", pad=2)
    figure.subplots_adjust(left=0.0, right=1.0, bottom=0.03, top=1.0 - 0.25 / (rows * 2.5), wspace=0.02, hspace=0.08)
    figure.text(
        0.99, 0.008, f"skin: graphic hand, {scenes[0].options.method}; blue: haptic hand", ha="right", color="0.4"
    )
    return figure


def _forces_over_time(number: str, runs: Sequence[SceneRun]) -> "Figure":
    """Draw forces and the time of a tick, with the hand in each hold.

    Fig. 12: normal forces of the five fingers; Fig. 14: the index finger's contact force with its components.
    """
    figure, forces, times = _curves_figure(runs)
    for axes, run in zip(forces, runs):
        assert run.curves is not None
        if number == "12":
            for f, finger in enumerate(FINGERS):
                axes.plot(run.curves.fingertip[:, f], color=FINGER_COLORS[f], linewidth=1.4, label=finger)
        else:
            size = np.linalg.norm(run.curves.index_finger, axis=1)
            for label, values in zip(PART_COLORS, (size, *run.curves.index_finger.T)):
                width = 2.0 if label == "total" else 1.2
                axes.plot(values, color=PART_COLORS[label], linewidth=width, label=label)
    force = "normal force at the fingertip" if number == "12" else "contact force on the index finger"
    forces[0].set_ylabel(f"{force} [N]")
    handles, labels = forces[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="center left", bbox_to_anchor=(0.13, 0.733), ncols=5, fontsize=8, frameon=False,
        columnspacing=1.0, handlelength=1.4,
    )  # fmt: skip
    longest = [1e6 * run.tick_cpu.max() for run in runs]
    for axes, run, most in zip(times, runs, longest):
        axes.plot(1e6 * run.tick_cpu, color="0.25", linewidth=0.6)
        axes.set_ylim(0.0, 1.08 * float(max(longest)))
        text = f"longest {most:.0f} µs; the paper: below 1,000 to 1,500 µs"
        axes.text(0.99, 0.97, text, transform=axes.transAxes, ha="right", va="top", fontsize=9, color=BUDGET_COLOR)
    times[0].set_ylabel("time of a tick, CPU [µs]")
    return figure


def _curves_figure(runs: Sequence[SceneRun]) -> "tuple[Figure, Sequence[Axes], Sequence[Axes]]":
    """Draw the holds on top; return the figure with a column a method: axes of forces above, of times below."""
    figure = new_figure(14.0, 8.6)
    moments = runs[-1].shown
    mesh = load_object(runs[-1].scenario.object_name).mesh
    view = best_view(runs[-1], mesh, len(moments) // 2)
    width = 0.92 / len(moments)
    for k, moment in enumerate(moments):
        place = figure.add_axes((0.06 + k * width, 0.745, width, 0.205))
        place.imshow(scene_picture(runs[-1], mesh, k, (TILE, TILE), view), interpolation="none")
        place.set_axis_off()
        place.set_title(moment.name, fontsize=10, color="0.3", pad=1)
    figure.text(0.06, 0.972, f"{runs[-1].scenario.name}, {runs[-1].options.method}", fontsize=14)
    figure.text(0.99, 0.972, "skin: graphic hand; blue: haptic hand", fontsize=10, color="0.4", ha="right")
    grid = figure.add_gridspec(2, len(runs), left=0.06, right=0.98, bottom=0.065, top=0.7, hspace=0.12, wspace=0.12)
    forces = [figure.add_subplot(grid[0, k]) for k in range(len(runs))]
    times = [figure.add_subplot(grid[1, k]) for k in range(len(runs))]
    for top, bottom, run in zip(forces, times, runs):
        tidy(top)
        tidy(bottom)
        top.set_title(run.options.method, fontsize=12, loc="left", pad=14)
        top.tick_params(labelbottom=False)
        bottom.set_xlabel("tick")
        number = 0
        for phase in run.stage.motions[0].phases:
            number += phase.name == "hold"
            label = str(number) if phase.name == "hold" else ""
            middle = 0.5 * (phase.first_tick + phase.last_tick)
            for axes in (top, bottom):
                if phase.name in ("hold", "slide"):
                    axes.axvspan(phase.first_tick, phase.last_tick, color="0.94" if label else "#eef4fa", zorder=0)
                axes.set_xlim(0, len(run.depth))
            name = f"hold {label}" if label else "slide" if phase.name == "slide" else ""
            if name:
                top.text(middle, 1.01, name, transform=top.get_xaxis_transform(), fontsize=8, ha="center", color="0.4")
    return figure, forces, times


def _cases(runs: PaperRuns, methods: Sequence[str]) -> "Figure":
    """Draw Fig. 15: detection, response and total by case, with the number of contacts, object by object."""
    played = [name for name in object_names() if runs.of(methods[0], "15", object_name=name)]
    figure = new_figure(2.9 * len(played) + 0.6, 2.7 * len(methods) + 0.7)
    panels = figure.subplots(len(methods), len(played), squeeze=False, sharex=True, sharey=True)
    for row, method in zip(panels, methods):
        for axes, name in zip(row, played):
            tidy(axes)
            same = {run.scenario.case: run for run in runs.of(method, "15", object_name=name)}
            cases = [case for case in CASES if case in same]
            values: dict[str, list[float]] = {label: [] for label in TIME_COLORS}
            for case in cases:
                run = same[case]
                parts = run.tick_parts[run.undisturbed].mean(axis=0)
                values["detection"].append(1e6 * parts[DURATION_DETECT])
                values["response"].append(1e6 * (parts.sum() - parts[DURATION_DETECT]))
                values["total"].append(1e6 * run.tick_cpu[run.contact].mean())
            for label, color in TIME_COLORS.items():
                axes.plot(cases, values[label], color=color, marker="o", markersize=4, linewidth=1.6, label=label)
            for case, total in zip(cases, values["total"]):
                contacts = same[case].candidates[held_ticks(same[case].stage)].mean()
                axes.annotate(
                    f"{contacts:.0f}", (case, total), (0, 6), textcoords="offset points", ha="center", fontsize=9
                )
    for axes, name in zip(panels[0], played):
        axes.set_title(name, fontsize=12)
    for row, method in zip(panels, methods):
        row[0].set_ylabel(f"{method}\nmean tick [µs]")
    panels[0, 0].set_ylim(0.0, 1.15 * panels[0, 0].get_ylim()[1])
    panels[0, 0].legend(loc="upper left", fontsize=8, frameon=False)
    count = len(runs.of(methods[0], "15")[0].stage.motions)
    named = ", ".join(f"{case}: {CASES[case]}" for case in CASES)
    said = (
        f"{named}. One thread, mean of {count} instances; the numbers are contacts in the hold. "
        "The paper: ≈ 1,000 µs for 131 contacts (TF, bunny) and for ≈ 250 (WH)"
    )
    width, height = (float(size) for size in figure.get_size_inches())
    lines = textwrap.wrap(said, int((width - 0.2) / LETTER))
    bottom = (0.4 + LINE * len(lines)) / height
    figure.subplots_adjust(left=0.75 / width, right=0.99, top=1.0 - 0.35 / height, bottom=bottom, wspace=0.06)
    figure.text(1.0 - 0.1 / width, 0.05 / height, "\n".join(lines), ha="right", fontsize=9, color=BUDGET_COLOR)
    return figure


GLASS = 0.4
TIP = 0.012
"""Depth below the skin that the middle of a visible fingertip has at most [m]."""


def scene_picture(
    run: SceneRun, mesh: Mesh, moment: int = 0, shape: tuple[int, int] = (300, 300), view: View | None = None
) -> FloatArray:
    """Render the hand and the object's mesh, its own frame, at a moment of a run of one motion.

    The picture has shape (rows, columns, 3), 0 to 1, of rows and columns [pixels]; it is seen from `view`, by default
    `best_view`.
    """
    shown = run.shown[moment]
    graphic, haptic = (hand_surface(run.stage.hand, pose) for pose in (shown.graphic, shown.haptic))
    body = mesh_surface(mesh, STONE)
    rotation = look_from((view or best_view(run, mesh, moment)).towards)
    camera = frame(joined([graphic, body]).points, rotation, shape)
    hand, ghost = shade(graphic, camera), shade(painted(haptic, GHOST), camera)
    return blend([(hand, 1.0), (shade(body, camera), 1.0), (behind(ghost, hand), GLASS)])


def best_view(run: SceneRun, mesh: Mesh, moment: int = 0) -> View:
    """Return the view that shows most of the fingertips that are to touch, then of hand and object."""
    pose, hand = run.shown[moment].graphic, run.stage.hand
    named = {touch.part for touches in run.stage.script.hold_touches for touch in touches}
    tips = hand.joints(*pose)[[finger in named for finger in FINGERS], 3]
    return viewpoint(hand_surface(hand, pose), mesh_surface(mesh, STONE), tips, np.empty((0, 3)), below=TIP)
