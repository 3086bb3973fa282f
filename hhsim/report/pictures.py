"""Pictures of the hand: skin for the graphic hand, blue glass for the haptic one, forces in red."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.render.hand_picture import label, transparent
from hhsim.render.rasterizer import Camera, blend, frame, shade
from hhsim.render.triangle_soup import STONE, Surface, look_from, mesh_surface, near_hands
from hhsim.render.viewpoint import View
from hhsim.report.figure import INK, ReportFigure, new_figure, page_figure
from hhsim.result.reader import Result, load_result
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
