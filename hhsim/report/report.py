"""`hhsim report`: one HTML page of results, which needs no server and no script; the same files give the same bytes.

Pictures of the hand have skin for the graphic hand, blue glass for the haptic one, and forces in red.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hhsim import __version__
from hhsim.arrays import FloatArray
from hhsim.errors import InputError, OutputError
from hhsim.metrics.session_faults import how_it_ended
from hhsim.render.hand_picture import label, transparent
from hhsim.render.rasterizer import Camera, blend, frame, shade
from hhsim.render.triangle_soup import STONE, Surface, look_from, mesh_surface, near_hands
from hhsim.render.viewpoint import View
from hhsim.replay.compare import Comparison, compare
from hhsim.report.figure import INK, ReportFigure, new_figure, page_figure
from hhsim.report.sections import ReportRun, of_one_run, report_runs, result_tables
from hhsim.report.time_series import histogram_figure, series_figure
from hhsim.result.reader import Result, load_result
from hhsim.result.wording import motion_name, object_name
from hhsim.system.atomic_write import write_together
from hhsim.system.counted import counted
from hhsim.system.output_path import check_output_path, holds
from hhsim.system.progress import Progress, silent
from hhsim.table.html import render
from hhsim.view.scene_log import Moment, clearest_view, moment, overview_tick
from hhsim.view.viewer import shown_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes


PICTURE = (3.6, 3.2)
"""Width and height of the picture of one tick [inches]."""
SMALL_TEXT = 12.5
"""Size of its text [pt]: 12 pixels where the picture is shown 16 rem wide beside others."""
RENDER_DPI = 170
"""Resolution of the rendered part; text is finer."""
MARGIN = 0.06
"""Share of the picture that is left free on each side for the numbers at the arrows."""
DOT = "#212126"
BAR = 0.02
"""Length of the bar that shows the scale [m]."""
HANDS = "Skin: graphic hand. Blue: haptic hand. Dots: contacts. Red: forces; the object is see-through."
CUT = "The object is larger than the picture, and cut at its edge."


def overview_picture(result: Result, view: View | None = None) -> ReportFigure:
    """Draw the hand at `overview_tick`; InputError without a tick, or as `hand_picture`."""
    tick = overview_tick(result)
    time, phase = float(result.at(tick, ["time"])["time"]), result.phase_at(tick) or "no phase"
    return replace(hand_picture(result, tick, view), name="hand", title=f"Tick {tick:,}, at {time:.3f} s, {phase}")


def overview_view(result: Result) -> View:
    """Return the viewer's direction that shows most of `overview_tick`; errors as `overview_picture`."""
    return _seen(result, overview_tick(result), None)[2]


def draw(result: Result | str | Path, tick: int | None = None, view: tuple[float, float] | None = None) -> ReportFigure:
    """Draw the hand on the object at one tick, with contact points and forces; a notebook shows the picture by itself.

    The result is one of a replay or a session, or its file; ticks count from 0, and None is `overview_tick`. View and
    errors are as of `hand_picture`.
    """
    # The camera moves along with an object that moves.
    seen = (result if isinstance(result, Result) else load_result(result)).seen_from_object
    return hand_picture(seen, overview_tick(seen) if tick is None else tick, view)


def hand_picture(result: Result, tick: int, view: tuple[float, float] | None = None) -> ReportFigure:
    """Draw the hand at one tick, with contact points and forces.

    Args:
        tick: Number of the tick, from 0.
        view: Azimuth from x to y and elevation [degrees] of the viewer; None for the one that shows most.

    Raises:
        InputError: No such tick, or the result's hand cannot be told (`hhsim.replay.stored_scene.stored_hand`).
    """
    shown, body, towards, cut = _seen(result, tick, view)
    touching = dict.fromkeys(force.name.partition("/")[0] for force in shown.forces)
    name = str(result.scene.get("object_name") or result.scene.get("object") or "the object")
    total = float(np.linalg.norm(result.at(tick, ("force/total",))["force/total"]))
    felt = f"forces on {', '.join(touching)}, resultant {total:.2f} N" if touching else "no force"
    tips = np.array([force.contact for force in shown.forces]).reshape(-1, 3) + shown.arrows
    points = np.concatenate([*(surface.points for surface in (*shown.hands, body)), tips])
    shape = (round(PICTURE[1] * RENDER_DPI), round(PICTURE[0] * RENDER_DPI))
    camera = frame(points, look_from(towards.towards), shape, MARGIN)
    with new_figure(*PICTURE) as figure:
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        layers, forces = transparent(*shown.hands, shade(body, camera), shown.forces, camera)
        _show(axes, blend(layers), replace(shown, forces=forces), camera)
        alt = f"The hand at {name}, tick {tick:,}: {felt}."
        return page_figure(f"tick-{tick}", f"Tick {tick:,}", f"{HANDS} {CUT}" if cut else HANDS, alt, figure)


def _seen(result: Result, tick: int, view: tuple[float, float] | None) -> tuple[Moment, Surface, View, bool]:
    """Return hands, forces and contacts of a tick, the object near them, the view, and whether the object is cut."""
    scene = shown_scene(result)
    shown = moment(result, scene, tick)
    mesh = scene.placed(result.meshes_moved(tick))
    near = near_hands(mesh, np.concatenate([hand.points for hand in shown.hands]))
    body = mesh_surface(near, STONE)
    towards = clearest_view(shown, body) if view is None else View(*view)
    return shown, body, towards, near is not mesh


def _show(axes: "Axes", picture: FloatArray, shown: Moment, camera: Camera) -> None:
    """Show a picture with the bar of its scale, contacts, and the sizes of forces."""
    axes.imshow(picture, interpolation="antialiased", aspect="auto")
    axes.set_axis_off()
    seen = (shown.contacts.point - camera.center) @ camera.rotation.T * (camera.shape[0] / camera.height)
    x, y = 0.5 * camera.shape[1] + seen[:, 0], 0.5 * camera.shape[0] - seen[:, 1]
    axes.scatter(x, y, s=9.0, facecolor=DOT, edgecolor="white", linewidth=0.5, zorder=3)
    label(axes, shown.forces, camera, size=SMALL_TEXT, pixel=100.0 / RENDER_DPI)
    rows, columns = camera.shape
    long, left, down = BAR * rows / camera.height, 0.04 * columns, 0.95 * rows
    axes.plot([left, left + long], [down, down], color=INK, linewidth=1.6, solid_capstyle="butt")
    text = f"{100.0 * BAR:g} cm"
    axes.text(left + 0.5 * long, down - 0.01 * rows, text, ha="center", va="bottom", fontsize=SMALL_TEXT)


GENERATOR = "hhsim report"
"""Program that the page names."""
GENERATED = f'content="{GENERATOR} '.encode()
"""Bytes of every page; a file without them is not replaced."""
PAGE = "report.html"
CHARTS = {"time": series_figure, "ticks": histogram_figure}
"""Figures of all results together."""
CUT_OBJECT = "An object that is much larger than the hand is cut at a clean edge near it."


@dataclass(frozen=True)
class Report:
    """A report that is not written yet: PNGs by file name, and comparisons with the first result.

    A hand of the first one's run has no comparison.
    """

    title: str
    html: str
    pictures: dict[str, bytes]
    runs: tuple[ReportRun, ...]
    comparisons: tuple[Comparison | None, ...]

    def verdict_lines(self) -> list[str]:
        """Return the verdicts, a line each."""
        lines = [f"{run.label}: {run.ended}" for run in self.runs if run.ended]
        lines += [f"{run.label}: {run.verdict.word}. {' '.join(run.verdict.sentences)}" for run in self.runs]
        compared = zip(self.runs[1:], self.comparisons)
        beside = self.runs[0].label
        return lines + [f"{run.label} beside {beside}: {found.sentence()}" for run, found in compared if found]

    def to_json(self) -> dict[str, Any]:
        """Return the report as plain values for JSON."""
        return {
            "title": self.title,
            "results": [
                {
                    "result": str(run.result.path),
                    "label": run.label,
                    "verdict": run.verdict.word,
                    "missed": list(run.verdict.missed),
                    "figures": {row.name: row.value for row in run.rows},
                }
                for run in self.runs
            ],
            "comparisons": [
                {
                    "result": str(run.result.path),
                    "comparable": found.comparable,
                    **{name: list(getattr(found, name)) for name in ("scene", "how", "around")},
                }
                for run, found in zip(self.runs[1:], self.comparisons)
                if found
            ],
        }


class ReportFiles(NamedTuple):
    """Paths of a written report."""

    page: Path
    pictures: tuple[Path, ...]


def make_report(paths: Sequence[Path], *, progress: Progress = silent) -> Report:
    """Make the page of results, in the order of the files; InputError for another file."""
    results = [hand for path in paths for hand in load_result(path).hands.values()]
    steps = itertools.count()

    def report_step(what: str) -> None:
        progress(what, next(steps), 2 + len(CHARTS))

    report_step("reading")
    runs = report_runs(results)
    comparisons = [None if of_one_run(results[0], other) else compare(results[0], other) for other in results[1:]]
    report_step("the hand")
    hands, figures = _hands(runs), {}
    for name, make in CHARTS.items():
        report_step(f"chart of {name}")
        figures[name] = make({run.label: run.result for run in runs})
    shown = (*hands, *figures.values())
    pictures = {figure.name: figure.png for figure in shown if isinstance(figure, ReportFigure)}
    title, subtitle = title_of(runs), subtitle_of(runs, one=not any(comparisons))
    html = render(
        "report/report.html", title=title, subtitle=subtitle, generator=GENERATOR, version=__version__,
        runs=runs, several=len(runs) > 1, hands=hands, hands_note=f"{HANDS} {CUT_OBJECT}", figures=figures,
        **result_tables(runs, comparisons),
    )  # fmt: skip
    return Report(title, html, pictures, tuple(runs), tuple(comparisons))


def check_report_path(output_path: Path) -> Path:
    """Return the path of the page NAME.html, or in a folder, which is made where it is missing.

    Raises OutputError as `hhsim.system.output_path.check_output_path`, or for a file that is no report.
    """
    is_page = output_path.suffix.lower() in (".html", ".htm")
    page = output_path if is_page else output_path / PAGE
    if not is_page and output_path.exists() and not output_path.is_dir():
        raise OutputError(f"{output_path} is a file: name a folder, or a page such as {output_path}.html")
    made = page if is_page or output_path.is_dir() else output_path
    check_output_path(made, "page of hhsim report", holds(GENERATED))
    return page


def write_report(report: Report, output_path: Path) -> ReportFiles:
    """Write the page and its pictures, NAME-….png beside NAME.html, all or none of them, the page last.

    Raises OutputError as `check_report_path`; for a full disk, or a picture's name that is taken where no report is.
    """
    page = check_report_path(output_path)
    stem = "" if page.name == PAGE else f"{page.stem}-"
    files = {page.with_name(f"{stem}{name}.png"): png for name, png in report.pictures.items()}
    taken = [path for path in files if path.exists()]
    if taken and not page.exists():
        raise OutputError(f"{taken[0]} exists, and no report that it belongs to: name another place with --out")
    folder = page.parent
    try:
        missing = not folder.exists()
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"cannot make the folder {folder}: {error.strerror or error}; name another with --out"
        ) from error
    try:
        write_together({**files, page: report.html.encode()})
    except OutputError:
        if missing:
            folder.rmdir()
        raise
    return ReportFiles(page, tuple(files))


def _hands(runs: Sequence[ReportRun]) -> list[ReportFigure | str]:
    """Return the hand of each result, all seen from one side.

    Where a picture cannot be made, its place has a sentence.
    """
    several, view = len(runs) > 1, None
    found: list[ReportFigure | str] = []
    for run in runs:
        try:
            view = view or overview_view(run.result)
            made = overview_picture(run.result, view)
        except InputError as error:
            found.append(f"{f'{run.label}: ' if several else ''}No picture of the hand: {error}")
        else:
            title = f"{run.label}, {made.title[0].lower()}{made.title[1:]}"
            named = replace(made, name=f"{run.prefix}{made.name}", title=title, caption="")
            found.append(named if several else made)
    return found


MOST_NAMED = 4


def title_of(runs: Sequence[ReportRun]) -> str:
    """Return what a report is of, in a line."""
    if all(of_one_run(runs[0].result, run.result) for run in runs[1:]):
        whole = replace(runs[0].result, hands={}) if len(runs) > 1 else runs[0].result
        return replace(runs[0], result=whole).name
    scenes = list(dict.fromkeys(f"{object_name(run.result)}, {motion_name(run.result)}" for run in runs))
    # Of several scenes the labels repeat object and motion: they are told below, and the scenes here.
    named = [run.label for run in runs] if len(scenes) == 1 else scenes
    shown = "; ".join([*named[:MOST_NAMED], *(["…"] if len(named) > MOST_NAMED else [])])
    return f"{scenes[0]}: {shown}" if len(scenes) == 1 else f"{len(runs)} results: {shown}"


def subtitle_of(runs: Sequence[ReportRun], *, one: bool) -> str:
    """Return what the results are, or the one run, in a line below the title."""
    if not one:
        return f"{len(runs)} results, each beside {runs[0].letter}"
    result = runs[0].result
    kind = "a recorded session" if result.live is not None else "a replay"
    ended = how_it_ended(result)
    text = f"{result.path.name}, {kind} of {counted(result.ticks, 'tick')}, written {result.created_utc}"
    return f"{text}, ended: {ended}" if ended else text
