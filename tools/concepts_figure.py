"""The picture of docs/concepts.md: `python -m tools.concepts_figure RESULT docs/concepts.png`.

From one tick of a replay: the haptic hand inside the object; what collides, round cones and spheres; the graphic hand
and its forces; the levels of the sphere tree; and a section through the finger that presses most, at full size. All of
it is drawn from the file. Made with

    hhsim replay bunny touch --level 3 --out touch.h5
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, OutputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import FORCE_FLOOR
from hhsim.render.figure import save_figure
from hhsim.render.hand_picture import GHOST, RED, View, label, seen_through
from hhsim.render.rasterizer import Camera, Layer, blend, frame, lit, look_from, see_spheres, shade
from hhsim.render.triangle_soup import SKIN, SPHERE, STONE, hand_surface, joined, mesh_surface, painted
from hhsim.replay.stored_scene import stored_hand
from hhsim.result.reader import Result, load_result
from hhsim.system.output_path import check_picture
from hhsim.view.moment import moment, overview_tick
from hhsim.view.viewer import shown_scene
from tools.cross_section import Plane, Pose, cut_mesh, cut_spheres, finger_plane, round_cone_outline
from tools.hand_figure import hybrid_surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes


VIEW = View(288.0, 16.0)
"""Azimuth from x to y, and elevation [degrees], of the viewer."""
PANEL = (430, 460)
"""Rows and columns of a panel of the upper row [pixels]."""
LEVEL_PANEL = (215, 230)
"""Of a level of the tree."""
LEVELS = (1, 2, 3)
SECTION = (0.062, 0.0316)
"""Width and height of the section [m]."""
FROM_LEFT, FROM_BELOW = 0.66, 0.42
"""Where in it the contact is, as a share of both."""
LABELS = 0.38
"""Share of its width that is kept for the texts."""
ARROW = 0.007
"""Of the section's arrow of 1 N [m], longer by the square root of the force."""
INK, FAINT = "0.15", "0.45"
TITLE: dict[str, Any] = {"fontsize": 14, "color": INK, "pad": 8}
TEXT: dict[str, Any] = {"fontsize": 12.5, "color": INK}


@dataclass(frozen=True)
class Shown:
    """One tick of a result, ready to be drawn.

    Attributes:
        result: The run.
        tick: Which.
        finger: That presses most with its last phalanx, within its own plane, 0 to 4.
        plane: In which it flexes.
    """

    result: Result
    tick: int
    finger: int
    plane: Plane

    def pose(self, whose: str) -> Pose:
        """Configuration of the `graphic` or the `haptic` hand, as `HandModel.joints` takes it."""
        return _pose(self.result, self.tick, whose)

    def leaves(self) -> tuple[FloatArray, FloatArray]:
        """Centres [m] and radii [m] of the object's leaf spheres."""
        return self.spheres(int(self.result.body.static["tree/level"].max()))

    def spheres(self, level: int) -> tuple[FloatArray, FloatArray]:
        """Centres [m] and radii [m] of the spheres of a level."""
        static = self.result.body.static
        chosen = static["tree/level"] == level
        return static["tree/center"][chosen], static["tree/radius"][chosen]


def draw_concepts(result: Result, path: Path, view: View = VIEW) -> None:
    """Draw the last tick of the hold.

    Args:
        result: A replay in which a fingertip presses.
        path: Picture file; matplotlib chooses the format by its ending.
        view: Azimuth and elevation of the viewer [degrees].

    Raises:
        InputError: No finger presses with its last phalanx in that tick, or the result holds none; matplotlib has no
            such picture format.
        OutputError: The picture cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    check_picture(path)
    shown = show(result)
    figure = Figure(figsize=(14.0, 8.9), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    _draw_hands([figure.add_axes((0.005 + 0.332 * column, 0.475, 0.327, 0.483)) for column in range(3)], shown, view)
    _draw_levels([figure.add_axes((0.005 + 0.137 * column, 0.075, 0.134, 0.20)) for column in range(3)], shown, view)
    figure.text(0.21, 0.405, "4  The sphere tree", ha="center", **{k: v for k, v in TITLE.items() if k != "pad"})
    figure.text(
        *(0.21, 0.352),
        "Every sphere encloses the ones below it.\nA hand far from one is far from all of those.",
        ha="center",
        va="center",
        **TEXT,
    )
    draw_section(figure.add_axes((0.437, 0.012, 0.556, 0.385)), shown)
    save_figure(figure, path)


def show(result: Result) -> Shown:
    """What is drawn of a result: the tick, the finger, the plane.

    Raises:
        InputError: No finger presses with its last phalanx.
    """
    tick = overview_tick(result)
    hand, pose = stored_hand(result), _pose(result, tick, "graphic")
    best: Shown | None = None
    most = -np.inf
    for finger, force in enumerate(result["force/phalanx"][tick, :, 2]):
        size = float(np.linalg.norm(force))
        if size < FORCE_FLOOR:
            continue
        plane = finger_plane(hand, pose, finger, force)
        # In its plane a finger shows what it touches; one that leans sideways touches above or below the section.
        sideways = abs(float(plane.axes[2] @ force))
        upright = float(np.sqrt(size**2 - sideways**2))
        if upright - sideways > most:
            best, most = Shown(result, tick, finger, plane), upright - sideways
    if best is None:
        raise InputError(f"{result.path}: no finger presses with its last phalanx at tick {tick}")
    return best


def _pose(result: Result, tick: int, whose: str) -> Pose:
    position, orientation, flexion, abduction = (
        np.asarray(result[f"{whose}/{name}"][tick]) for name in HandConfiguration._fields
    )
    return position, orientation, flexion, abduction


def _draw_hands(panels: "list[Axes]", shown: Shown, view: View) -> None:
    result, hand = shown.result, stored_hand(shown.result)
    mesh = Mesh(result.body.vertices, result.body.faces, "object", str(result.path))
    body = mesh_surface(mesh, STONE)
    graphic = hand_surface(hand, shown.pose("graphic"))
    haptic = painted(hand_surface(hand, shown.pose("haptic")), GHOST)
    center, radius = shown.leaves()
    camera = frame(joined([graphic, haptic, body]).points, look_from(view.towards), PANEL)
    forces = moment(result, shown_scene(result), shown.tick).forces
    hybrid = shade(hybrid_surface(hand, shown.pose("graphic")), camera)
    pictures = (
        (
            "1  The haptic hand: where the user's hand is",
            blend([(shade(haptic, camera), 1.0), (shade(body, camera), 0.5)]),
        ),
        ("2  What collides: round cones and spheres", blend([(hybrid, 1.0), (spheres(center, radius, camera), 1.0)])),
        ("3  The graphic hand stays out, and is pushed", seen_through(graphic, haptic, body, forces, camera)),
    )
    for axes, (title, picture) in zip(panels, pictures, strict=True):
        axes.imshow(picture, interpolation="none")
        axes.set_axis_off()
        axes.set_title(title, **TITLE)
    label(panels[2], forces, camera)


def _draw_levels(panels: "list[Axes]", shown: Shown, view: View) -> None:
    rotation = look_from(view.towards)
    for axes, level in zip(panels, LEVELS, strict=True):
        axes.set_axis_off()
        center, radius = shown.spheres(level)
        if len(radius) == 0:
            continue
        reach = np.concatenate([center + side * radius[:, None] * rotation[k] for k in (0, 1) for side in (-1.0, 1.0)])
        axes.imshow(blend([(spheres(center, radius, frame(reach, rotation, LEVEL_PANEL)), 1.0)]), interpolation="none")
        axes.set_title(f"level {level}: {len(radius):,} spheres", y=-0.2, **{**TEXT, "pad": 0})


def spheres(center: FloatArray, radius: FloatArray, camera: Camera) -> Layer:
    """Spheres [m] as the camera sees them, all of one colour."""
    depth, normals, _ = see_spheres(center, radius, camera)
    return lit(depth, normals, np.tile(SPHERE, (len(normals), 1)), camera)


def draw_section(axes: "Axes", shown: Shown) -> None:
    """Draw a finger and the object, cut by the plane in which the finger flexes; the axes are in mm."""
    from matplotlib.patches import Circle, Polygon
    from matplotlib.patheffects import withStroke

    result, plane, finger, static = shown.result, shown.plane, shown.finger, shown.result.static
    forces = moment(result, shown_scene(result), shown.tick).forces
    contact = next(force for force in forces if force.name == f"{FINGERS[finger]}/distal")
    point = plane.flat(contact.contact)
    hand = stored_hand(result)
    ends = {whose: plane.flat(hand.joints(*shown.pose(whose))[finger]) for whose in ("haptic", "graphic")}
    thickness = static["hand/phalanx_radius"][finger]
    _draw_finger(axes, ends["haptic"], thickness, 0.45 * GHOST + 0.55)
    center, radius, _ = cut_spheres(plane, *shown.leaves())
    for middle, size in zip(center, radius, strict=True):
        edge = (*(0.7 * SPHERE), 0.9)
        axes.add_patch(Circle(1e3 * middle, 1e3 * size, facecolor=(*SPHERE, 0.35), edgecolor=edge, lw=0.8))
    curves = cut_mesh(plane, shown.result.body.vertices, shown.result.body.faces)
    for curve in curves:
        axes.add_patch(Polygon(1e3 * curve, closed=True, fill=False, edgecolor=INK, lw=2.2))
    _draw_finger(axes, ends["graphic"], thickness, SKIN)
    spring = coil(ends["haptic"][3], ends["graphic"][3])
    axes.plot(*(1e3 * spring.T), color="0.1", lw=1.4, solid_capstyle="round")
    axes.plot(*(1e3 * spring[[0, -1]].T), "o", color="0.1", ms=4.5)
    push = plane.axes[:2] @ contact.force
    push *= ARROW / np.sqrt(np.linalg.norm(contact.force))
    head = {"arrowstyle": "-|>,head_width=0.35,head_length=0.7", "color": tuple(RED), "lw": 3.0}
    axes.annotate("", tuple(1e3 * (point + push)), tuple(1e3 * point), arrowprops={**head, "shrinkA": 0, "shrinkB": 0})
    axes.plot(*(1e3 * point), "o", color="0.1", ms=6, zorder=5)

    width, height = SECTION
    left, bottom = point[0] - FROM_LEFT * width, point[1] - FROM_BELOW * height
    axes.set_xlim(1e3 * left, 1e3 * (left + width))
    axes.set_ylim(1e3 * bottom, 1e3 * (bottom + height))
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color("0.8")
    inside = (center[:, 0] - radius > left + LABELS * width) & (np.abs(center[:, 1] - point[1]) < 0.4 * height)
    outer = np.flatnonzero(inside)[np.argmin(center[inside, 0] - radius[inside])]
    rim = np.concatenate(curves)
    skin = rim[np.argmin(np.linalg.norm(rim - center[outer] + [0.0, 2.0 * radius[outer]], axis=1))]
    slant = np.array([-0.87, -0.5])
    _draw_labels(
        axes,
        [
            ("graphic finger: shown, touches", ends["graphic"][3] + thickness[3] * np.array([-1.0, 0.1])),
            ("coupling: springs of stiffness G", spring[len(spring) // 2]),
            ("contact, and force on the finger", point),
            ("leaf sphere of the object", center[outer] - [0.9 * radius[outer], 0.0]),
            ("the object's true surface", skin),
            ("haptic finger: the user's, inside", ends["haptic"][3] + 0.97 * thickness[3] * slant),
        ],
    )
    halo = [withStroke(linewidth=3, foreground="white")]
    bar = np.array([left + 0.965 * width - 0.005, left + 0.965 * width])
    axes.plot(1e3 * bar, [1e3 * (bottom + 0.06 * height)] * 2, color=INK, lw=2.5, path_effects=halo)
    axes.text(1e3 * bar.mean(), 1e3 * (bottom + 0.085 * height), "5 mm", ha="center", path_effects=halo, **TEXT)
    called = FINGERS[finger] + ("" if FINGERS[finger] == "thumb" else " finger")
    axes.set_title(f"5  A section through the {called}, where it touches", **TITLE)


def _draw_finger(axes: "Axes", ends: FloatArray, thickness: FloatArray, color: FloatArray) -> None:
    from matplotlib.patches import Polygon

    outlines = [1e3 * round_cone_outline(*ends[k : k + 2], *thickness[k : k + 2]) for k in range(3)]
    # All edges first: the fills then leave the outline of the whole finger alone.
    for outline in outlines:
        axes.add_patch(Polygon(outline, closed=True, fill=False, edgecolor=tuple(0.55 * color), lw=2.4))
    for outline in outlines:
        axes.add_patch(Polygon(outline, closed=True, facecolor=tuple(color), edgecolor="none"))


def _draw_labels(axes: "Axes", labels: list[tuple[str, FloatArray]]) -> None:
    """Texts in a column on the left, from top to bottom as what they are of, each with a line to it."""
    labels = sorted(labels, key=lambda item: -item[1][1])
    for place, (text, target) in zip(np.linspace(0.93, 0.07, len(labels)), labels, strict=True):
        line: dict[str, Any] = {"arrowstyle": "-", "color": FAINT, "lw": 1.0, "shrinkA": 2, "shrinkB": 0}
        axes.annotate(
            text,
            tuple(1e3 * target),
            (0.015, place),
            textcoords="axes fraction",
            va="center",
            arrowprops={**line, "relpos": (1.0, 0.5)},
            **TEXT,
        )


def coil(start: FloatArray, end: FloatArray, turns: int = 5, width: float = 7e-4) -> FloatArray:
    """A spring in a drawing, from start to end [m], shape (n, 2)."""
    along = end - start
    across = np.array([-along[1], along[0]]) / max(float(np.linalg.norm(along)), 1e-12)
    share = np.concatenate([[0.0], np.linspace(0.2, 0.8, 2 * turns + 1), [1.0]])
    side = np.zeros(len(share))
    side[2:-2:2], side[3:-2:2] = 1.0, -1.0
    return np.asarray(start + share[:, None] * along + width * side[:, None] * across)


def main(arguments: list[str]) -> None:
    """Draw a result by the command's arguments; SystemExit says in a line what is wrong."""
    if len(arguments) not in (2, 3):
        raise SystemExit("usage: python -m tools.concepts_figure RESULT PICTURE [AZIMUTH,ELEVATION]")
    try:
        azimuth, elevation = map(float, arguments[2].split(",")) if len(arguments) == 3 else VIEW
    except ValueError:
        raise SystemExit(f"'{arguments[2]}': expected AZIMUTH,ELEVATION in degrees, such as 288,16") from None
    try:
        draw_concepts(load_result(Path(arguments[0])), Path(arguments[1]), View(azimuth, elevation))
    except (InputError, OutputError) as error:
        raise SystemExit(str(error)) from error


if __name__ == "__main__":
    main(sys.argv[1:])
