"""Pictures of the hand: skin for the graphic hand, blue glass for the haptic one, forces in red."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import AnyArray, FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.kernels.contact.surface import ContactPoints
from hhsim.metrics.contact_points import find_contact_points
from hhsim.metrics.metrics import FORCE_FLOOR
from hhsim.metrics.run_ticks import HOLD
from hhsim.render.hand_meshes import PIECES
from hhsim.render.rasterizer import Camera, blend, frame, look_from, shade
from hhsim.render.replay_figure import GHOST, STONE, PhalanxForce, arrow, label, seen_through, shown_tick
from hhsim.render.triangle_soup import Surface, hand_surface, joined, mesh_surface, near_hands, painted
from hhsim.render.viewpoint import View, viewpoint
from hhsim.report.figure import DPI, INK, TEXT, Drawing, ReportFigure, drawn_figure, new_figure, png_bytes
from hhsim.result.reader import Result, load_result
from hhsim.view.plots import ShownTicks, palm_force, shown_ticks
from hhsim.view.scene_log import force_places
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
HANDS = "Skin: graphic hand. Blue: haptic hand. Dots: contacts. Red: forces; the object is see-through."
CUT = "The object is larger than the picture, and cut at its edge."


@dataclass(frozen=True)
class Moment:
    """One tick as it is drawn: surfaces, forces that can be felt, contacts, view, and alternative text."""

    graphic: Surface
    haptic: Surface
    body: Surface
    forces: list[PhalanxForce]
    contacts: ContactPoints
    view: View
    sentence: str
    cut: bool = False


def overview_picture(result: Result) -> ReportFigure:
    """Draw the hand on the object at `overview_tick`.

    Raises:
        InputError: The result holds no tick, or its hand cannot be told (`hhsim.replay.stored_scene.stored_hand`).
    """
    tick = overview_tick(result)
    moment = _moment(result, tick, None)
    camera = _camera(moment, OVERVIEW)
    panels = {
        "what the user sees": blend([(shade(joined([moment.graphic, moment.body]), camera), 1.0)]),
        "why: the user's own hand (blue), forces": _see_through(moment, camera),
    }

    def draw(figure: "Figure", narrow: bool) -> None:
        width, height = (float(side) for side in figure.get_size_inches())
        size = 1.0 if narrow else 0.5
        panel = size * width * OVERVIEW[1] / OVERVIEW[0]
        for number, (title, picture) in enumerate(panels.items()):
            across, down = (0, number) if narrow else (number, 0)
            bottom = height - (down + 1) * (HEADING + panel)
            axes = figure.add_axes((across * size, bottom / height, size, panel / height))
            _show(axes, picture, moment, camera, why=number == 1)
            axes.set_title(title, fontweight="bold", loc="left", x=0.02, pad=4)

    time = float(result.at(tick, ["time"])["time"])
    caption = (
        f"Tick {tick:,}, at {time:.3f} s: {result.phase_at(tick) or 'no phase'}. First the graphic hand, which stays "
        "outside. Then the haptic hand, where the user's is, in blue; the object is see-through, dots are contacts, "
        "and the red arrows are the contact forces, longer by the square root of their size."
    ) + (f" {CUT}" if moment.cut else "")

    def height(width: float, narrow: bool) -> float:
        panel = (width if narrow else 0.5 * width) * OVERVIEW[1] / OVERVIEW[0]
        return (2 if narrow else 1) * (HEADING + panel)

    return drawn_figure("hand", "The hand on the object", caption, moment.sentence, Drawing(draw, height))


def overview_tick(result: Result) -> int:
    """Return the last tick of the first hold; else that of largest force, or the last; InputError without a tick."""
    if result.ticks and not any(phase.name == HOLD for phase in result.phases):
        size = np.nan_to_num(np.linalg.norm(result["force/total"], axis=1))
        if size.max() >= FORCE_FLOOR:
            return int(np.argmax(size))
    return shown_tick(result)


def held_picture(result: Result, view: View | None = None) -> ReportFigure:
    """Draw the second half of the overview alone, from `view` or that of the overview; errors as `overview_picture`."""
    tick = overview_tick(result)
    figure = hand_picture(result, tick, view)
    return replace(figure, name="hand", title=f"Tick {tick:,}, {result.phase_at(tick) or 'no phase'}")


def overview_view(result: Result) -> View:
    """Return the viewer's direction of the overview; errors as `overview_picture`."""
    return _moment(result, overview_tick(result), None).view


def draw(result: Result | str | Path, tick: int | None = None, view: tuple[float, float] | None = None) -> ReportFigure:
    """Draw the hand on the object at one tick, with contact points and forces; a notebook shows the picture by itself.

    Args:
        result: Result of a replay or a session, or its file.
        tick: Number of the tick, from 0; None for `overview_tick`.
        view: As of `hand_picture`, which also says the errors.
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
    moment = _moment(result, tick, None if view is None else View(*view), usual)
    with new_figure(*PICTURE) as figure:
        camera = _camera(moment, PICTURE)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        _show(axes, _see_through(moment, camera), moment, camera, why=True, size=SMALL_TEXT)
        png = png_bytes(figure)
    caption = f"{HANDS} {CUT}" if moment.cut else HANDS
    size = round(PICTURE[0] * DPI), round(PICTURE[1] * DPI)
    return ReportFigure(f"tick-{tick}", f"Tick {tick:,}", caption, moment.sentence, png, *size)


def _moment(result: Result, tick: int, view: View | None, usual: View | None = None) -> Moment:
    result.at(tick, ())
    scene = shown_scene(result)

    def column(name: str) -> AnyArray:
        return np.ascontiguousarray(result.at(tick, (name,))[name][None])

    ticks = shown_ticks(column, [tick], [0], [0])
    graphic, haptic = (
        hand_surface(scene.hand, *(values[0] for values in pose)) for pose in (ticks.graphic, ticks.haptic)
    )
    whole = mesh_surface(scene.mesh, STONE)
    body = near_hands(whole, np.concatenate([graphic.points, haptic.points]))
    contacts = find_contact_points(
        scene.surface_arrays,
        scene.shape,
        PlacedHand(ticks.joints, ticks.graphic.position, ticks.graphic.orientation),
        scene.touch,
        fingers=scene.fingers,
    )
    force = np.concatenate([ticks.phalanx.reshape(1, 15, 3), palm_force(ticks.phalanx, ticks.total)[:, None]], axis=1)
    places = force_places(ticks, contacts, force, scene.hand.radius)[0]
    felt = np.flatnonzero(np.linalg.norm(force[0], axis=1) >= FORCE_FLOOR)
    forces = [PhalanxForce(PIECES[k], places[k], force[0, k]) for k in felt]
    if view is None:
        vectors = np.array([arrow(one) for one in forces]).reshape(-1, 3)
        view = viewpoint(graphic, body, contacts.point, vectors, usual)
    sentence = _alt_text(result, tick, ticks, forces)
    if body is not whole:
        sentence += f" {CUT}"
    return Moment(graphic, painted(haptic, GHOST), body, forces, contacts, view, sentence, cut=body is not whole)


def _camera(moment: Moment, size: tuple[float, float]) -> Camera:
    """Return the camera of a picture of this width and height [inches]."""
    body = moment.body.points[np.unique(moment.body.faces)]
    tips = np.array([force.contact + arrow(force) for force in moment.forces]).reshape(-1, 3)
    points = np.concatenate([moment.graphic.points, moment.haptic.points, body, tips])
    shape = (round(size[1] * RENDER_DPI), round(size[0] * RENDER_DPI))
    return frame(points, look_from(moment.view.towards), shape, MARGIN)


def _see_through(moment: Moment, camera: Camera) -> FloatArray:
    return seen_through(moment.graphic, moment.haptic, moment.body, moment.forces, camera)


def _show(axes: "Axes", picture: FloatArray, moment: Moment, camera: Camera, why: bool, size: float = TEXT) -> None:
    """Show a picture with the bar of its scale, and with contacts and the sizes of forces where `why` is set."""
    axes.imshow(picture, interpolation="antialiased", aspect="auto")
    axes.set_axis_off()
    if why:
        seen = (moment.contacts.point - camera.center) @ camera.rotation.T * (camera.shape[0] / camera.height)
        x, y = 0.5 * camera.shape[1] + seen[:, 0], 0.5 * camera.shape[0] - seen[:, 1]
        axes.scatter(x, y, s=9.0, facecolor=DOT, edgecolor="white", linewidth=0.5, zorder=3)
        label(axes, moment.forces, camera, size=size, pixel=100.0 / RENDER_DPI)
    rows, columns = camera.shape
    long, left, down = BAR * rows / camera.height, 0.04 * columns, 0.95 * rows
    axes.plot([left, left + long], [down, down], color=INK, linewidth=1.6, solid_capstyle="butt")
    axes.text(left + 0.5 * long, down - 0.01 * rows, f"{100.0 * BAR:g} cm", ha="center", va="bottom", fontsize=size)


def _alt_text(result: Result, tick: int, ticks: ShownTicks, forces: list[PhalanxForce]) -> str:
    touching = [finger for f, finger in enumerate(FINGERS) if any(one.name.startswith(finger) for one in forces)]
    if any(one.name == PIECES[15] for one in forces):
        touching.append("palm")
    name = str(result.scene.get("object_name") or result.scene.get("object") or "the object")
    total = float(np.linalg.norm(ticks.total[0]))
    felt = f"forces on {', '.join(touching)}, resultant {total:.2f} N" if forces else "no force"
    return f"The hand at {name}, tick {tick:,}: {felt}."
