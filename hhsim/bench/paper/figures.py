"""Pictures of `hhsim bench paper` in the manner of the paper's Figs. 11 to 15."""

import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hhsim.bench.paper.run import CASES, INDEX, PaperRuns, SceneRun
from hhsim.hand.fingers import FINGERS
from hhsim.kernels.hand.kinematics import PHALANX_COUNT
from hhsim.kernels.tick.step import DURATION_DETECT
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.brute_force_distance import round_cone_contact
from hhsim.render.figure import new_figure, save_figure, tidy
from hhsim.render.hand_picture import arrow_layers, arrow_surfaces, behind, label, with_hidden
from hhsim.render.rasterizer import blend, frame, shade
from hhsim.render.triangle_soup import PIECES, STONE, hand_surface, joined, look_from, mesh_surface, painted
from hhsim.render.viewpoint import GHOST, PieceForce, View, viewpoint
from hhsim.scene.contact_goals import TOUCHING
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
CURVES_TOP = 5.8
"""Height of the upper edge of the curves [inches]."""
TILE = 150
"""Rows and columns of a small picture [pixels]."""
PALETTE = 256
"""Colours of a PNG: a quarter of the bytes of true colour."""
PAIRS = {"11": 3, "13": 4}
"""Scenes in a row of a figure of pictures."""
STATED = {"12": "below 1,000 µs", "14": "all below 1,500 µs, most below 1,000 µs"}
"""Time of a tick that the paper states for the scenes of a figure."""
ARROWS = {"12": "normal forces at the fingertips", "14": "contact forces on the phalanges of the index finger"}
"""Forces that the red arrows of a figure show."""


def draw_all(folder: Path, runs: PaperRuns, progress: Progress = silent, note: str = "") -> list[Path]:
    """Draw every figure that the runs have scenes for: fig11 to fig15, each of `KINDS`, with a note on the runs.

    Errors as `save_figure`.
    """
    jobs: list[tuple[str, Callable[[], Figure]]] = []
    # The hands that are shown are the baseline's beside the default method's, or else the last one's.
    methods = list(dict.fromkeys(run.options.method for run in runs))
    compared = [method for method in ("paper", "coupled") if method in methods] or methods[-1:]
    for figure, columns in PAIRS.items():
        scenes = list(zip(*(runs.of(method, figure) for method in compared), strict=True))
        if scenes:
            jobs.append((f"fig{figure}", partial(_gallery, scenes=scenes, columns=columns)))
    for figure in ("12", "14"):
        for name in object_names():
            same = [run for method in methods for run in runs.of(method, figure, object_name=name)]
            if same:
                jobs.append((f"fig{figure}-{name}", partial(_forces_over_time, number=figure, runs=same)))
    if any(run.scenario.figure == "15" for run in runs):
        jobs.append(("fig15", partial(_cases, runs=runs, methods=methods)))
    written = []
    for number, (name, job) in enumerate(jobs):
        progress("pictures", number, len(jobs))
        drawn = job()
        drawn.text(0.998, 0.998, note, fontsize=9, ha="right", va="top", color=BUDGET_COLOR)
        for kind in KINDS:
            save_figure(drawn, folder / f"{name}{kind}", colors=PALETTE)
            written.append(folder / f"{name}{kind}")
    return written


def _gallery(scenes: Sequence[Sequence[SceneRun]], columns: int) -> "Figure":
    methods = len(scenes[0])
    across, up = methods * columns * TILE, -(-len(scenes) // columns) * (TILE + 22) + 30
    figure = new_figure(across / 100, up / 100)
    for number, same in enumerate(scenes):
        mesh = load_object(same[0].scenario.object_name).mesh
        view = best_view(same[-1], mesh)
        for k, run in enumerate(same):
            left, bottom = (methods * (number % columns) + k) * TILE, up - (number // columns + 1) * (TILE + 22)
            axes = figure.add_axes((left / across, bottom / up, TILE / across, TILE / up))
            draw_scene(axes, run, mesh, view, TILE)
            if k == 0:
                axes.set_title(run.scenario.name, x=0.5 * methods, fontsize=10, color="0.25", pad=3)
    said = f"skin: graphic hand of {', then of '.join(run.options.method for run in scenes[0])}; blue: haptic hand"
    figure.text(1.0 - 10 / across, 6 / up, said, ha="right", color="0.4")
    return figure


def _forces_over_time(number: str, runs: Sequence[SceneRun]) -> "Figure":
    """Draw forces and the time of a tick, with the hand in each hold.

    Fig. 12: normal forces of the five fingers; Fig. 14: the index finger's contact force with its components.
    """
    figure, forces, times = _curves_figure(number, runs)
    for axes, run in zip(forces, runs):
        assert run.curves is not None
        if number == "12":
            for f, finger in enumerate(FINGERS):
                axes.plot(run.curves.fingertip[:, f], color=FINGER_COLORS[f], linewidth=1.4, label=finger)
        else:
            size = np.linalg.norm(run.curves.index_finger, axis=1)
            for part, values in zip(PART_COLORS, (size, *run.curves.index_finger.T)):
                width = 2.0 if part == "total" else 1.2
                axes.plot(values, color=PART_COLORS[part], linewidth=width, label=part)
    force = "normal force at the fingertip" if number == "12" else "contact force on the index finger"
    forces[0].set_ylabel(f"{force} [N]")
    # Legend and the paper's words stand once, over all columns: a column is narrower the more methods there are.
    figure.legend(
        *forces[0].get_legend_handles_labels(), loc="lower left", ncols=5, fontsize=9, frameon=False, columnspacing=1.0,
        handlelength=1.2, borderaxespad=0.0, bbox_to_anchor=(0.06, (CURVES_TOP + 0.42) / figure.get_figheight()),
    )  # fmt: skip
    longest = [1e6 * run.tick_cpu.max() for run in runs]
    for axes, run, most in zip(times, runs, longest):
        axes.plot(1e6 * run.tick_cpu, color="0.25", linewidth=0.6)
        text = f"longest {most:.0f} µs"
        axes.text(0.99, 0.97, text, transform=axes.transAxes, ha="right", va="top", fontsize=9, color=BUDGET_COLOR)
    times[0].set_title(f"the paper: {STATED[number]}", fontsize=9, loc="left", pad=4, color=BUDGET_COLOR)
    times[0].set_ylim(0.0, 1.08 * float(max(longest)))
    times[0].set_ylabel("time of a tick, CPU [µs]")
    return figure


def _curves_figure(number: str, runs: Sequence[SceneRun]) -> "tuple[Figure, Sequence[Axes], Sequence[Axes]]":
    """Draw the holds of the first and the last method on top, a row each.

    Returns the figure with a column a method: axes of forces above, of times below.
    """
    shown, size, moments = list(dict.fromkeys((runs[0], runs[-1]))), 3 * TILE // 2, len(runs[-1].shown)
    row = size / 100 + 0.2
    height = CURVES_TOP + 1.25 + row * len(shown)
    figure = new_figure(max(14.0, 3.4 * len(runs)), height)
    mesh = load_object(runs[-1].scenario.object_name).mesh
    view = best_view(runs[-1], mesh, moments // 2, _forces(number, runs[-1], moments // 2))
    for down, run in enumerate(shown, 1):
        low, share = 1.0 - (0.55 + down * row) / height, 0.92 / moments
        figure.text(0.012, low + 0.5 * row / height, run.options.method, fontsize=12, rotation=90, va="center")
        for k, moment in enumerate(run.shown):
            place = figure.add_axes((0.06 + k * share, low, share, size / 100 / height))
            draw_scene(place, run, mesh, view, size, k, _forces(number, run, k))
            place.set_title(moment.name, fontsize=10, color="0.3", pad=1)
    said = f"skin: graphic hand; blue: haptic hand; red: {ARROWS[number]}"
    figure.text(0.06, 1.0 - 0.32 / height, runs[-1].scenario.name, fontsize=14)
    figure.text(0.99, 1.0 - 0.32 / height, said, fontsize=10, color="0.4", ha="right")
    inside = {"left": 0.06, "right": 0.98, "bottom": 0.55 / height, "top": CURVES_TOP / height}
    # One scale for all methods: a force that jumps in one is seen to be smooth in another.
    forces, times = figure.add_gridspec(2, len(runs), hspace=0.16, wspace=0.12, **inside).subplots(
        sharey="row", squeeze=False
    )
    for top, bottom, run in zip(forces, times, runs):
        tidy(top)
        tidy(bottom)
        top.set_title(run.options.method, fontsize=12, loc="left", pad=14)
        top.tick_params(labelbottom=False)
        bottom.set_xlabel("tick")
        holds = 0
        for phase in run.stage.motions[0].phases:
            holds += phase.name == "hold"
            count = str(holds) if phase.name == "hold" else ""
            middle = 0.5 * (phase.first_tick + phase.last_tick)
            for axes in (top, bottom):
                if phase.name in ("hold", "slide"):
                    axes.axvspan(phase.first_tick, phase.last_tick, color="0.92" if count else "#dbe9fa", zorder=0)
                axes.set_xlim(0, len(run.depth))
            name = f"hold {count}" if count else "slide" if phase.name == "slide" else ""
            if name:
                top.text(middle, 1.01, name, transform=top.get_xaxis_transform(), fontsize=8, ha="center", color="0.4")
    return figure, forces, times


def _cases(runs: PaperRuns, methods: Sequence[str]) -> "Figure":
    """Draw Fig. 15: detection, response and total by case, with the number of candidate pairs, object by object."""
    played = [name for name in object_names() if runs.of(methods[0], "15", object_name=name)]
    figure = new_figure(2.9 * len(played) + 0.6, 2.7 * len(methods) + 0.7)
    panels = figure.subplots(len(methods), len(played), squeeze=False, sharex=True, sharey=True)
    for row, method in zip(panels, methods):
        for axes, name in zip(row, played):
            tidy(axes)
            same = {run.scenario.case: run for run in runs.of(method, "15", object_name=name)}
            cases = [case for case in CASES if case in same]
            values: dict[str, list[float]] = {part: [] for part in TIME_COLORS}
            for case in cases:
                run = same[case]
                parts = run.tick_parts[run.undisturbed].mean(axis=0)
                values["detection"].append(1e6 * parts[DURATION_DETECT])
                values["response"].append(1e6 * (parts.sum() - parts[DURATION_DETECT]))
                values["total"].append(1e6 * run.tick_cpu[run.contact].mean())
            for part, color in TIME_COLORS.items():
                axes.plot(cases, values[part], color=color, marker="o", markersize=4, linewidth=1.6, label=part)
            for case, total in zip(cases, values["total"]):
                pairs = f"{same[case].contacts:.0f}"
                axes.annotate(pairs, (case, total), (0, 6), textcoords="offset points", ha="center", fontsize=9)
    for axes, name in zip(panels[0], played):
        axes.set_title(name, fontsize=12)
    for row, method in zip(panels, methods):
        row[0].set_ylabel(f"{method}\nmean tick [µs]")
    panels[0, 0].set_ylim(0.0, 1.15 * panels[0, 0].get_ylim()[1])
    panels[0, 0].legend(loc="upper left", fontsize=8, frameon=False)
    count = len(runs.of(methods[0], "15")[0].stage.motions)
    named = ", ".join(f"{case}: {CASES[case]}" for case in CASES)
    said = (
        f"{named}. One thread, mean of {count} instances; the numbers are candidate pairs in the same ticks, within "
        "Δr = 0.5 mm for paper, as in the paper, and 1 mm for the others. The paper: almost 1,000 µs for 131 contacts "
        "(TF, bunny, threads)"
    )
    width, height = (float(size) for size in figure.get_size_inches())
    lines = textwrap.wrap(said, int((width - 0.2) / LETTER))
    bottom = (0.4 + LINE * len(lines)) / height
    figure.subplots_adjust(left=0.75 / width, right=0.99, top=1.0 - 0.35 / height, bottom=bottom, wspace=0.06)
    figure.text(1.0 - 0.1 / width, 0.05 / height, "\n".join(lines), ha="right", fontsize=9, color=BUDGET_COLOR)
    return figure


GLASS = 0.4
CONTACT = 0.008
"""Depth below the skin that a visible contact has at most [m]: those of fingers that are seen from the side."""
ELEVATIONS = (-30.0, -10.0, 10.0, 35.0, 60.0)
"""Elevations of the views that are tried [degrees]."""


def _forces(number: str, run: SceneRun, moment: int) -> list[PieceForce]:
    """Return the forces that a figure's arrows show, at the fingertips or in the middles of phalanges."""
    shown = run.shown[moment]
    joints = run.stage.hand.joints(*shown.graphic)
    middles = 0.5 * (joints[INDEX, :-1] + joints[INDEX, 1:])
    index = PIECES[INDEX * PHALANX_COUNT :]
    tips, phalanges = zip(FINGERS, joints[:, -1], shown.fingertip), zip(index, middles, shown.index_finger)
    return [PieceForce(*one) for one in (tips if number == "12" else phalanges) if one[2].any()]


def draw_scene(
    axes: "Axes", run: SceneRun, mesh: Mesh, view: View, size: int, moment: int = 0, forces: Sequence[PieceForce] = ()
) -> None:
    """Draw the hands, the object's mesh, its own frame, and forces at a moment of a run, in `size` rows and columns."""
    shown = run.shown[moment]
    graphic, haptic = (hand_surface(run.stage.hand, pose) for pose in (shown.graphic, shown.haptic))
    body = mesh_surface(mesh, STONE)
    camera = frame(joined([graphic, body, *arrow_surfaces(forces)]).points, look_from(view.towards), (size, size))
    hand, ghost = shade(graphic, camera), shade(painted(haptic, GHOST), camera)
    layers = [(hand, 1.0), (shade(body, camera), 1.0), (behind(ghost, hand), GLASS)]
    forces = with_hidden(forces, hand, camera)
    axes.imshow(blend([*layers, *arrow_layers(forces, camera)]), interpolation="none")
    axes.set_axis_off()
    label(axes, forces, camera, 8.0)


def best_view(run: SceneRun, mesh: Mesh, moment: int = 0, forces: Sequence[PieceForce] = ()) -> View:
    """Return the view that shows most of the contacts, then of hand and object, with forces not seen end on."""
    pose, hand, tree = run.shown[moment].graphic, run.stage.hand, run.stage.tree
    contacts = [np.empty((0, 3))]
    for joints, radii in zip(hand.joints(*pose), hand.radius):
        for k in range(PHALANX_COUNT):
            cone = joints[k], joints[k + 1], *radii[k : k + 2].tolist()
            distance, points = round_cone_contact(tree.leaf_center, tree.leaf_radius, *cone)
            if distance.min() < TOUCHING:
                contacts.append(points[[distance.argmin()]])
    surfaces = hand_surface(hand, pose), mesh_surface(mesh, STONE)
    pushes = np.array([force.force for force in forces]).reshape(-1, 3)
    return viewpoint(*surfaces, np.concatenate(contacts), pushes, below=CONTACT, elevations=ELEVATIONS)
