"""Pictures of the hand: skin for the graphic hand, blue glass for the haptic one, forces in red.

Ticks that a reader wants to see are the slowest, the deepest, those of the largest step of the force and largest lag.
"""

import shlex
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.metrics.run_ticks import HOLD
from hhsim.render.figure import png_bytes
from hhsim.render.hand_picture import label, seen_through
from hhsim.render.rasterizer import Camera, blend, frame, shade
from hhsim.render.triangle_soup import STONE, Surface, joined, look_from, mesh_surface, near_hands
from hhsim.render.viewpoint import View
from hhsim.report.figure import DPI, INK, TEXT, Album, Drawing, PageFigure, ReportFigure, drawn_figure, new_figure
from hhsim.report.run import ReportRun
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import LIVE_TICK
from hhsim.table.table import Table, number, shown, words
from hhsim.view.scene_log import Moment, clearest_view, moment, overview_tick, status_words
from hhsim.view.viewer import shown_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURE = (3.6, 3.2)
"""Width and height of the picture of one tick [inches]."""
SMALL_TEXT = 12.5
"""Size of its text [pt]: 12 pixels where the picture is shown 16 rem wide beside others."""
OVERVIEW, HEADING = (3.5, 3.2), 0.24
"""Width and height of each half of the overview, and height of its title [inches]."""
RENDER_DPI = 170
"""Resolution of the rendered part; text is finer."""
MARGIN = 0.06
"""Share of the picture that is left free on each side for the numbers at the arrows."""
DOT = "#212126"
BAR = 0.02
"""Length of the bar that shows the scale [m]."""
HANDS = (
    "Skin: graphic hand. Blue: haptic hand. Dots: contacts. Red: forces, hollow behind the hand; the object is "
    "see-through."
)
CUT = "The object is larger than the picture, and cut at its edge."


@dataclass(frozen=True)
class Shot:
    """One tick as it is drawn: hands, forces and contacts, the object near them, view, and alternative text.

    `cut` is true if the object is larger.
    """

    moment: Moment
    body: Surface
    cut: bool
    view: View
    sentence: str


def overview_picture(result: Result) -> ReportFigure:
    """Draw the hand on the object at `overview_tick`; InputError without a tick, or as `stored_hand`."""
    tick = overview_tick(result)
    shot = _shot(result, tick, None)
    camera = _camera(shot, OVERVIEW)
    panels = {
        "what the user sees": (blend([(shade(joined([shot.moment.graphic, shot.body]), camera), 1.0)]), None),
        "why: the user's own hand (blue), forces": _see_through(shot, camera),
    }

    def draw(figure: "Figure", narrow: bool) -> None:
        width, height = (float(side) for side in figure.get_size_inches())
        size = 1.0 if narrow else 0.5
        panel = size * width * OVERVIEW[1] / OVERVIEW[0]
        for place, (title, (picture, at)) in enumerate(panels.items()):
            across, down = (0, place) if narrow else (place, 0)
            bottom = height - (down + 1) * (HEADING + panel)
            axes = figure.add_axes((across * size, bottom / height, size, panel / height))
            _show(axes, picture, at, camera)
            axes.set_title(title, fontweight="bold", loc="left", x=0.02, pad=4)

    time = float(result.at(tick, ["time"])["time"])
    caption = (
        f"Tick {tick:,}, at {time:.3f} s: {result.phase_at(tick) or 'no phase'}. First the graphic hand, which stays "
        "outside. Then the haptic hand, where the user's is, in blue; the object is see-through, dots are contacts, "
        "and the red arrows are the contact forces, longer by the square root of their size. A hollow one is "
        "behind another part of the hand, and has its finger's name."
    ) + (f" {CUT}" if shot.cut else "")

    def height(width: float, narrow: bool) -> float:
        panel = (width if narrow else 0.5 * width) * OVERVIEW[1] / OVERVIEW[0]
        return (2 if narrow else 1) * (HEADING + panel)

    return drawn_figure("hand", "The hand on the object", caption, shot.sentence, Drawing(draw, height))


def held_picture(result: Result, view: View | None = None) -> ReportFigure:
    """Draw the second half of the overview alone, from `view` or that of the overview; errors as `overview_picture`."""
    tick = overview_tick(result)
    figure = hand_picture(result, tick, view)
    return replace(figure, name="hand", title=f"Tick {tick:,}, {result.phase_at(tick) or 'no phase'}")


def overview_view(result: Result) -> View:
    """Return the viewer's direction of the overview; errors as `overview_picture`."""
    return _shot(result, overview_tick(result), None).view


def draw(result: Result | str | Path, tick: int | None = None, view: tuple[float, float] | None = None) -> ReportFigure:
    """Draw the hand on the object at one tick, with contact points and forces; a notebook shows the picture by itself.

    The result is one of a replay or a session, or its file; ticks count from 0, and None is `overview_tick`. View and
    errors are as of `hand_picture`.
    """
    # The camera moves along with an object that moves.
    seen = (result if isinstance(result, Result) else load_result(result)).seen_from_object
    return hand_picture(seen, overview_tick(seen) if tick is None else tick, view)


def hand_picture(
    result: Result, tick: int, view: tuple[float, float] | None = None, usual: View | None = None
) -> ReportFigure:
    """Draw the hand at one tick, with contact points and forces.

    Args:
        tick: Number of the tick, from 0.
        view: Azimuth from x to y and elevation [degrees] of the viewer; None for that of the overview, or a clearer
            one where much is hidden there.
        usual: View of the overview, where it is known.

    Raises:
        InputError: No such tick, or the result's hand cannot be told (`hhsim.replay.stored_scene.stored_hand`).
    """
    if view is None and usual is None:
        usual = overview_view(result)
    shot = _shot(result, tick, None if view is None else View(*view), usual)
    with new_figure(*PICTURE) as figure:
        camera = _camera(shot, PICTURE)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        _show(axes, *_see_through(shot, camera), camera, size=SMALL_TEXT)
        png = png_bytes(figure)
    caption = f"{HANDS} {CUT}" if shot.cut else HANDS
    size = round(PICTURE[0] * DPI), round(PICTURE[1] * DPI)
    return ReportFigure(f"tick-{tick}", f"Tick {tick:,}", caption, shot.sentence, png, *size)


def _shot(result: Result, tick: int, view: View | None, usual: View | None = None) -> Shot:
    scene = shown_scene(result)
    shown = moment(result, scene, tick)
    mesh = scene.placed(result.meshes_moved(tick))
    near = near_hands(mesh, np.concatenate([hand.points for hand in shown.hands]))
    body, cut = mesh_surface(near, STONE), near is not mesh
    if view is None:
        view = clearest_view(result, scene, tick, shown, body, usual)
    touching = dict.fromkeys(force.name.partition("/")[0] for force in shown.forces)
    name = str(result.scene.get("object_name") or result.scene.get("object") or "the object")
    total = float(np.linalg.norm(result.at(tick, ("force/total",))["force/total"]))
    felt = f"forces on {', '.join(touching)}, resultant {total:.2f} N" if touching else "no force"
    sentence = f"The hand at {name}, tick {tick:,}: {felt}."
    return Shot(shown, body, cut, view, f"{sentence} {CUT}" if cut else sentence)


def _camera(shot: Shot, size: tuple[float, float]) -> Camera:
    """Return the camera of a picture of this width and height [inches]."""
    tips = np.array([force.contact for force in shot.moment.forces]).reshape(-1, 3) + shot.moment.arrows
    points = np.concatenate([*(surface.points for surface in (*shot.moment.hands, shot.body)), tips])
    shape = (round(size[1] * RENDER_DPI), round(size[0] * RENDER_DPI))
    return frame(points, look_from(shot.view.towards), shape, MARGIN)


def _see_through(shot: Shot, camera: Camera) -> tuple[FloatArray, Moment]:
    picture, marked = seen_through(*shot.moment.hands, shot.body, shot.moment.forces, camera)
    return picture, replace(shot.moment, forces=marked)


def _show(axes: "Axes", picture: FloatArray, shown: Moment | None, camera: Camera, size: float = TEXT) -> None:
    """Show a picture with the bar of its scale, and with contacts and the sizes of forces if a moment is given."""
    axes.imshow(picture, interpolation="antialiased", aspect="auto")
    axes.set_axis_off()
    if shown is not None:
        seen = (shown.contacts.point - camera.center) @ camera.rotation.T * (camera.shape[0] / camera.height)
        x, y = 0.5 * camera.shape[1] + seen[:, 0], 0.5 * camera.shape[0] - seen[:, 1]
        axes.scatter(x, y, s=9.0, facecolor=DOT, edgecolor="white", linewidth=0.5, zorder=3)
        label(axes, shown.forces, camera, size=size, pixel=100.0 / RENDER_DPI)
    rows, columns = camera.shape
    long, left, down = BAR * rows / camera.height, 0.04 * columns, 0.95 * rows
    axes.plot([left, left + long], [down, down], color=INK, linewidth=1.6, solid_capstyle="butt")
    axes.text(left + 0.5 * long, down - 0.01 * rows, f"{100.0 * BAR:g} cm", ha="center", va="bottom", fontsize=size)


@dataclass(frozen=True)
class WorstTick:
    """A tick, the first of several equal ones, why it was chosen, and a sentence on what happened."""

    kind: str  # of `KINDS`
    tick: int
    sentence: str


KINDS = {"slowest": "slowest", "deepest": "deepest", "force-step": "largest step of the force", "lag": "largest lag"}
"""Headings by kind."""


def worst_ticks(result: Result) -> list[WorstTick]:
    """Return at most one tick of each kind, none of what did not happen."""
    if result.ticks == 0:
        return []
    cpu = 1e-9 * result["duration/total_cpu"]
    # Of the ticks that the table's median is of.
    contact = result["contacts/candidates"] > 0
    median = float(np.median(cpu[contact])) if contact.any() else 0.0
    kinds: dict[str, tuple[FloatArray, Callable[[float], str]]] = {
        "slowest": (
            cpu,
            lambda value: (
                f"The slowest tick took {1e6 * value:,.1f} µs of CPU time"
                + (f", {value / median:.1f} times the median of ticks in contact" if median > 0.0 else "")
            ),
        ),
        "deepest": (result["penetration_depth"], lambda value: f"The deepest penetration is {1e6 * value:,.3f} µm"),
        "force-step": (
            _force_steps(result),
            lambda value: f"The total force changed most in one tick of motion, by {value:.3f} N",
        ),
        "lag": (result["lag"], lambda value: f"The hand lagged most, {1e3 * value:.2f} mm behind what was asked"),
    }
    found = []
    for kind, (sizes, sentence) in kinds.items():
        known = np.where(np.isfinite(sizes), sizes, 0.0)
        tick = int(np.argmax(known))
        if known[tick] > 0.0:
            phase = result.phase_at(tick)
            where = f"tick {tick:,} at {result['time'][tick]:.3f} s{phase and ', '}{phase}"
            found.append(WorstTick(kind, tick, f"{sentence(float(known[tick]))}: {where}."))
    return found


def _force_steps(result: Result) -> FloatArray:
    """Return the one-tick change of the total force [N], shape (T,), as `hhsim.metrics.metrics.force_step` does.

    It is 0 in holds and wherever the tick before is not in the file.
    """
    steps = np.zeros(result.ticks)
    steps[1:] = np.linalg.norm(np.diff(result["force/total"], axis=0), axis=1)
    for phase in result.phases:
        if phase.name == HOLD:
            steps[phase.first_tick : phase.last_tick + 1] = 0.0
    if result.live is not None:
        steps[1:][np.diff(result[f"{LIVE_TICK}/record"]) != 1] = 0.0
    return steps


FACTS = {
    "duration/total_cpu": ("CPU time", "µs", 1e-3, 1),
    "duration/total": ("wall time", "µs", 1e-3, 1),
    "duration/detect": ("of it detection", "µs", 1e-3, 1),
    "duration/palm": ("of it palm or whole hand", "µs", 1e-3, 1),
    "duration/fingers": ("of it fingers", "µs", 1e-3, 1),
    "duration/force": ("of it forces", "µs", 1e-3, 1),
    "contacts/candidates": ("candidate pairs", "", 1.0, 0),
    "contacts/touching": ("touching pairs", "", 1.0, 0),
    "penetration_depth": ("penetration", "µm", 1e6, 3),
    "force_variation_rate": ("force change", "%", 1.0, 3),
    "lag": ("lag", "mm", 1e3, 3),
    "work/linearisations": ("linearisations", "", 1.0, 0),
    "work/qp_iterations": ("QP iterations", "", 1.0, 0),
    "work/pair_tests": ("exact distances", "", 1.0, 0),
}
"""Datasets of a tick: label, unit, scale to that unit, and digits."""


def worst_cards(run: ReportRun, album: Album) -> list[dict[str, Any]]:
    """Return a card for each worst tick of a result, by the names of the template."""
    found: dict[int, list[WorstTick]] = {}
    for worst in worst_ticks(run.result):
        found.setdefault(worst.tick, []).append(worst)
    usual = None
    # Each card says why it has no picture.
    with suppress(InputError):
        usual = overview_view(run.result) if found else None
    cards = []
    for tick, worsts in found.items():
        picture: PageFigure | str
        try:
            picture = album.shown(hand_picture(run.result, tick, usual=usual), run.prefix)
        except InputError as error:
            picture = f"No picture: {error}"
        columns = words("figure", 0), number("hhsim", 1), words("unit", 2)
        cards.append(
            {
                "title": f"Tick {tick:,}: {', '.join(KINDS[worst.kind] for worst in worsts)}",
                "sentences": [worst.sentence for worst in worsts],
                "picture": picture,
                "facts": Table(columns, _tick_facts(run.result, tick), f"Tick {tick:,} in figures"),
                "command": f"hhsim view {shlex.quote(run.result.path.name)}",
                "tick": f"{tick:,}",
            }
        )
    return cards


def _tick_facts(result: Result, tick: int) -> list[tuple[str, str, str]]:
    """Return label, figure and unit of what a file says of a tick."""
    values = result.at(tick, [*FACTS, "time", "status", "force/total"])
    rows = [
        ("time", f"{float(values['time']):,.3f}", "s"),
        ("phase", result.phase_at(tick) or "—", ""),
        ("how it ended", status_words(int(values["status"])), ""),
    ]
    for name, (fact, unit, scale, digits) in FACTS.items():
        rows.append((fact, shown(scale * float(values[name]), digits), unit))
        if name == "penetration_depth":
            rows.append(("force", shown(float(np.linalg.norm(values["force/total"])), 3), "N"))
    return rows
