"""Picture of a replay in its hold: `python -m hhsim.render.replay_figure RESULT docs/grasp.png [AZIMUTH,ELEVATION]`.

Left is what a user sees: the graphic hand on the object. Right is why: the haptic hand goes into the object, and the
difference becomes forces on the phalanges.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, OutputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import FORCE_FLOOR
from hhsim.metrics.run_ticks import HOLD
from hhsim.render.figure import halo, new_figure, save_figure
from hhsim.render.rasterizer import Camera, Layer, blend, frame, look_from, shade
from hhsim.render.triangle_soup import Surface, arrow_surface, hand_surface, joined, mesh_surface, painted
from hhsim.render.viewpoint import View
from hhsim.replay.stored_scene import stored_hand
from hhsim.result.reader import Result, load_result
from hhsim.system.output_path import check_output_path

if TYPE_CHECKING:
    from matplotlib.axes import Axes

VIEW = View(125.0, 12.0)
PANEL = (580, 620)
"""Rows and columns of a panel [pixels]."""

STONE = np.array([0.80, 0.80, 0.78])
GHOST = np.array([0.25, 0.52, 0.95])
RED = np.array([0.85, 0.10, 0.08])

ARROW_RADIUS = 1.3e-3
"""Radius of an arrow's shaft [m]."""
ARROW_LENGTH = 0.02
"""Length of the arrow of 1 N [m]; it grows with the square root of the force, so that small ones can be seen."""

LONGEST_ARROW = 10.0
"""Longest arrow that is drawn [m]: a damaged file may hold forces that no picture has space for."""

BODY_OPACITY = 0.5
IN_FRONT = 10.0
"""Distance by which forces are drawn in front of everything else [m]."""
LETTER = 0.92
"""Width of a letter or digit with its share of the white rim [pixels at 100 to the inch, by the size in pt]."""


@dataclass(frozen=True)
class PhalanxForce:
    """Contact force on one phalanx [N], and the phalanx's point nearest to the object [m], shapes (3,), world."""

    name: str
    contact: FloatArray
    force: FloatArray


def draw_replay(result: Result, path: Path, view: View = VIEW) -> None:
    """Draw the last tick of the first hold, or of the replay where nothing is held.

    Raises:
        InputError, OutputError: No tick, or a hand file that has changed; as `save_figure`.
    """
    check_output_path(path)
    # The camera moves along with an object that moves.
    result = result.seen_from_object
    tick = shown_tick(result)
    hand = stored_hand(result)
    graphic, haptic = (
        hand_surface(hand, *(result[f"{whose}/{name}"][tick] for name in HandConfiguration._fields))
        for whose in ("graphic", "haptic")
    )
    haptic = painted(haptic, GHOST)
    mesh = Mesh(result.static["object/vertices"], result.static["object/faces"], "object", str(result.path))
    body = mesh_surface(mesh, STONE)
    forces = phalanx_forces(result, tick)
    camera = frame(joined([graphic, haptic, body]).points, look_from(view.towards), PANEL)

    rows, columns = PANEL
    figure = new_figure(2 * columns / 100, (rows + 60) / 100)
    pictures = {
        "What the user sees: the graphic hand stays outside": blend([(shade(joined([graphic, body]), camera), 1.0)]),
        "The user's own hand (blue) goes in: that makes the forces": seen_through(
            graphic, haptic, body, forces, camera
        ),
    }
    for column, (title, picture) in enumerate(pictures.items()):
        axes = figure.add_axes((0.5 * column, 0.0, 0.5, rows / (rows + 60)))
        axes.imshow(picture, interpolation="none")
        axes.set_axis_off()
        axes.set_title(title, fontsize=15, color="0.2", pad=12)
        if column == 1:
            label(axes, forces, camera)
    save_figure(figure, path)


def shown_tick(result: Result) -> int:
    """Return the last tick of the first hold; without a hold, the last tick; InputError without a tick."""
    if result.ticks == 0:
        raise InputError(f"{result.path} holds no tick")
    held = any(phase.name == HOLD for phase in result.phases)
    return (result.phase(HOLD).stop if held else result.ticks) - 1


def phalanx_forces(result: Result, tick: int) -> list[PhalanxForce]:
    """Return the forces of a tick that can be felt, each at the phalanx's point nearest to an object sphere."""
    static = result.static
    level = static["object/tree/level"]
    leaves = level == level.max()
    center, radius = static["object/tree/center"][leaves], static["object/tree/radius"][leaves]
    found = []
    for f, finger in enumerate(FINGERS):
        for k, phalanx in enumerate(("proximal", "middle", "distal")):
            force = result["force/phalanx"][tick, f, k]
            size = float(np.linalg.norm(force))
            if size < FORCE_FLOOR:
                continue
            a, b = result["graphic/joints"][tick, f, k : k + 2]
            thick, thin = static["hand/phalanx_radius"][f, k : k + 2]
            # To a drawing's accuracy the cone is narrow: the foot of the perpendicular stands for the nearest point.
            along = np.clip((center - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            thickness = thick + along * (thin - thick)
            axis = a + along[:, None] * (b - a)
            nearest = int(np.argmin(np.linalg.norm(center - axis, axis=1) - radius - thickness))
            contact = axis[nearest] - thickness[nearest] * force / size
            found.append(PhalanxForce(f"{finger}, {phalanx}", contact, force))
    return found


def arrow(force: PhalanxForce) -> FloatArray:
    """Return the arrow of a force [m], shape (3,)."""
    return np.asarray(ARROW_LENGTH * force.force / np.sqrt(np.linalg.norm(force.force)))


def arrow_surfaces(forces: Sequence[PhalanxForce]) -> list[Surface]:
    """Return the arrows of forces, but for those that no picture has space for."""
    shown = [force for force in forces if 0.0 < float(np.linalg.norm(arrow(force))) < LONGEST_ARROW]
    return [arrow_surface(force.contact, arrow(force), ARROW_RADIUS, RED) for force in shown]


def transparent(
    graphic: Surface, haptic: Surface, body: Layer, arrows: Sequence[Surface], camera: Camera
) -> list[tuple[Layer, FloatArray | float]]:
    """Return the layers of a transparent object, the haptic hand in and around it, and the forces over everything."""
    hand = shade(graphic, camera)
    ghost = behind(shade(haptic, camera), hand)
    # Glass is clearest where one looks straight at it.
    glass = np.asarray(0.3 + 0.6 * (1.0 - np.abs(ghost.facing)) ** 2)
    layers: list[tuple[Layer, FloatArray | float]] = [(hand, 1.0), (body, BODY_OPACITY), (ghost, glass)]
    if arrows:
        layer = shade(joined(arrows), camera)
        layers.append((replace(layer, depth=layer.depth + IN_FRONT), 1.0))
    return layers


def seen_through(
    graphic: Surface, haptic: Surface, body: Surface, forces: list[PhalanxForce], camera: Camera
) -> FloatArray:
    """Render the picture of `transparent`."""
    return blend(transparent(graphic, haptic, shade(body, camera), arrow_surfaces(forces), camera))


def behind(ghost: Layer, hand: Layer) -> Layer:
    """Return the haptic hand behind the graphic one: where both are, the skin stays clean."""
    return replace(ghost, depth=np.where(hand.seen(), np.minimum(ghost.depth, hand.depth - 1e-6), ghost.depth))


def label(axes: "Axes", forces: Sequence[PhalanxForce], camera: Camera, size: float = 11.0, pixel: float = 1.0) -> None:
    """Write the size of each force at its arrow's head in letters of `size` [pt], or lower where another one stands.

    `pixel` is the size of the picture's pixels, relative to 100 to the inch.
    """
    rows, columns = camera.shape
    scale = rows / camera.height
    apart = np.array([max(40.0, 4.3 * size), max(15.0, 1.4 * size)]) / pixel
    placed: list[FloatArray] = []
    for force in forces:
        along = camera.rotation @ arrow(force)
        tip = camera.rotation @ (force.contact - camera.center) + along
        away = along[:2] / max(float(np.linalg.norm(along[:2])), 1e-9)
        head = np.array([0.5 * columns + scale * tip[0], 0.5 * rows - scale * tip[1]])
        first = head + np.array([20.0 * away[0], -12.0 * away[1]]) / pixel
        text = f"{np.linalg.norm(force.force):.1f} N"
        edge = np.array([max(22.0, 0.5 * LETTER * size * len(text)), 9.0]) / pixel
        first = np.clip(first, edge, np.array([columns, rows]) - edge)
        place = first.copy()
        while any((np.abs(place - other) < apart).all() for other in placed):
            place[1] += 3.0 / pixel
        placed.append(place)
        color = tuple(0.8 * RED)
        # A number that had to go further is tied to its arrow.
        far = bool(place[1] - first[1] > 12.0 / pixel)
        axes.annotate(
            text, tuple(head) if far else tuple(place), tuple(place), ha="center", va="center", fontsize=size,
            color=color, **halo(3),
            arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.7, "shrinkB": 0.0} if far else None,
        )  # fmt: skip


def draw_from_arguments(
    arguments: list[str], draw: Callable[[Result, Path, View], None], module: str, view: View
) -> None:
    """Draw a result by a command's RESULT PICTURE [AZIMUTH,ELEVATION]; SystemExit says in a line what is wrong."""
    if len(arguments) not in (2, 3):
        raise SystemExit(f"usage: python -m {module} RESULT PICTURE [AZIMUTH,ELEVATION]")
    try:
        azimuth, elevation = map(float, arguments[2].split(",")) if len(arguments) == 3 else view
    except ValueError:
        raise SystemExit(f"'{arguments[2]}': expected AZIMUTH,ELEVATION in degrees, such as 125,12") from None
    try:
        draw(load_result(Path(arguments[0])), Path(arguments[1]), View(azimuth, elevation))
    except (InputError, OutputError) as error:
        raise SystemExit(str(error)) from error


if __name__ == "__main__":
    draw_from_arguments(sys.argv[1:], draw_replay, "hhsim.render.replay_figure", VIEW)
