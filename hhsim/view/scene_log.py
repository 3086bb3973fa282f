"""Object, hands, contacts, forces and plots as a rerun recording, many ticks in one call.

World in metres, z up. Each rigid piece of a hand is a mesh that is sent once, moved by a column of transforms.

| entity | what |
|---|---|
| world/object | the object's mesh; where it moves, with a transform a tick since the first one, as its spheres |
| world/object/… | in its place, the mesh of each part of a body of several, with a pose a tick, as its spheres |
| world/spheres | the leaf spheres of its tree, where they are asked for |
| world/graphic/… | the graphic hand: each phalanx, and the palm |
| world/haptic/… | the haptic hand |
| world/skin | the shown hand's own mesh, where a result has one; the graphic hand's pieces are hidden then |
| world/contacts/points, normals | touching pairs: the point of the hand, and the normal from the object to the hand |
| world/forces | the contact force on each phalanx and on the palm, in red, as long as `FORCE_LENGTH` says |
| plots/… | `hhsim.view.plots` |
| states/… | phases of the motion, and the state of the ticks |
| log | what happened in a live session |
| run | what was run, in words |

Timelines: `tick`, and `time` [s].
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import InputError
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.surface import ContactPoints
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.kernels.tick import state
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.mesh_penetration import find_contact_points
from hhsim.metrics.metrics import FORCE_FLOOR
from hhsim.metrics.moving_parts import MovingParts, placed_mesh
from hhsim.metrics.run_ticks import HOLD
from hhsim.motion.trajectory import RigidMotion
from hhsim.render import triangle_soup as soup
from hhsim.render.viewpoint import GHOST, PieceForce, View, arrow, viewpoint
from hhsim.result.reader import Result
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree
from hhsim.view.plots import SHOWN_COLUMNS, Plot, ShownTicks, body_forces, shown_ticks, sizes

if TYPE_CHECKING:
    import rerun as rr


APPLICATION = "hhsim"

STONE_COLOR = (204, 204, 199, 200)
SPHERE_COLOR = (120, 160, 190)
HAPTIC_COLOR = (64, 133, 242, 70)
FORCE_COLOR = (217, 26, 20)
CONTACT_COLOR = (30, 30, 30)

FORCE_LENGTH = 0.02
"""Length of the arrow of 1 N [m]; it grows with the square root of the force, so that small ones can be seen."""
FORCE_RADIUS = 1.5e-3
"""Radius of an arrow's head [m]; the shaft's is half of it."""
POINT_RADIUS = 1.2e-3
NORMAL_LENGTH = 8e-3
NORMAL_RADIUS = 5e-4

OBJECT, SPHERES, SKIN_MESH = "world/object", "world/spheres", "world/skin"
EVENT_LEVELS = ("INFO", "WARN", "ERROR")
"""rerun's names of the levels of a session's log."""

INNER = 3e-4
"""Thickness [m] by which the haptic hand is drawn thinner, so that it shows only beside the graphic one."""

STATE_COLORS: Mapping[str, Mapping[str, tuple[int, int, int]]] = {
    "ticks": {"settled": (70, 110, 75), "lag": (242, 142, 43), "stuck": (225, 87, 89), "full": (225, 87, 89)},
    "fingers": {"held where they touch": (70, 110, 75)},
}
"""Colours of the usual states by lane; rerun colours the others, and the phases."""

SETTLED = "settled"
WORDS = (
    (state.STATUS_CAPACITY_EXCEEDED, "full"),
    (state.STATUS_NO_PLACE, "no place"),
    (state.STATUS_STUCK, "stuck"),
    (state.STATUS_LAG, "lag"),
    (state.STATUS_SNAP, "snaps"),
    (state.STATUS_INPUT_INVALID, "input held"),
    (state.STATUS_ABDUCTION_HELD, "abduction held"),
    (state.STATUS_START_INSIDE, "began inside"),
)
"""Words for how a tick ended, the most urgent first."""


@dataclass(frozen=True, eq=False)
class ShownScene:
    """A scene without what changes with time."""

    mesh: Mesh  # the object and its sphere tree [m], world; a body of several parts where it begins
    tree: SphereTree
    hand: HandModel
    fingers: BoolArray  # True for each finger that the scene uses, shape (5,); the others go through the object
    touch: float  # distance [m] below which pairs touch
    surface: str = "spheres"  # name of the surface that the hand touches
    spheres: bool = False  # True to send the leaf spheres too
    text: str = ""  # what was run, Markdown
    parts: MovingParts | None = None

    @property
    def bodies(self) -> dict[str, tuple[Mesh, SphereTree]]:
        """Mesh and tree of the object, or of each part in its own frame, by the end of its entity's name."""
        if self.parts is None:
            return {"": (self.mesh, self.tree)}
        bodies = zip(self.parts.meshes, self.parts.trees)
        return {f"/{name}": body for name, body in zip(self.parts.names, bodies)}

    @cached_property
    def surface_arrays(self) -> tuple[Any, ...]:
        """Arrays of the touched surface of each body as the kernels read them."""
        return tuple(contact_surface(self.surface, *body).arrays for body in self.bodies.values())

    def placed(self, moved: Sequence[RigidMotion]) -> Mesh:
        """Return the object's mesh at a tick, or all parts' as one; `moved` is that of `Result.meshes_moved`."""
        return placed_mesh([mesh for mesh, _ in self.bodies.values()], moved) if moved else self.mesh

    @cached_property
    def shape(self) -> HandShape:
        """Sizes of the hand."""
        return hand_shape(self.hand)


@dataclass(eq=False)
class RerunScene:
    """Writes a scene into a recording whose sinks are set."""

    stream: "rr.RecordingStream"
    scene: ShownScene
    root: str = ""  # begin of its entities' names, such as "file-2/"

    def log_static(self, plots: Sequence[Plot]) -> None:
        """Send what does not change: meshes, spheres, names and colours of the plots, the text."""
        import rerun as rr

        scene = self.scene
        self._fixed("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        for name, (mesh, tree) in scene.bodies.items():
            self._fixed(f"{OBJECT}{name}", rerun_mesh(soup.mesh_surface(mesh, soup.STONE), STONE_COLOR))
            if scene.spheres:
                center, radius = tree.leaf_center, tree.leaf_radius
                balls = rr.Ellipsoids3D(centers=center, radii=radius, colors=SPHERE_COLOR, fill_mode="solid")
                self._fixed(f"{SPHERES}{name}", balls)
        for name, surface in zip(soup.PIECES, soup.piece_surfaces(scene.hand)):
            self._fixed(f"world/graphic/{name}", rerun_mesh(surface))
            inner = replace(surface, points=surface.points - INNER * surface.normals)
            self._fixed(f"world/haptic/{name}", rerun_mesh(inner, HAPTIC_COLOR))
        self._fixed("world/contacts/points", rr.Points3D.from_fields(colors=CONTACT_COLOR, radii=POINT_RADIUS))
        self._fixed("world/contacts/normals", rr.Arrows3D.from_fields(colors=CONTACT_COLOR, radii=NORMAL_RADIUS))
        self._fixed("world/forces", rr.Arrows3D.from_fields(colors=FORCE_COLOR, radii=FORCE_RADIUS))
        for lane, colors in STATE_COLORS.items():
            self._fixed(f"states/{lane}", rr.StateConfiguration(values=list(colors), colors=list(colors.values())))
        for plot in plots:
            lines = rr.SeriesLines(names=list(plot.series), colors=list(plot.series.values()), widths=1.2)
            self._fixed(plot.path, lines)
        if scene.text:
            self._fixed("run", rr.TextDocument(scene.text, media_type="text/markdown"))

    def log_ticks(self, ticks: ShownTicks) -> None:
        """Send some ticks."""
        import rerun as rr

        if len(ticks.tick) == 0:
            return
        # Made once: every entity has the same.
        times = [rr.TimeColumn("tick", sequence=ticks.tick), rr.TimeColumn("time", duration=ticks.time)]
        for whose, hand in (("graphic", ticks.graphic), ("haptic", ticks.haptic)):
            poses = soup.piece_poses(self.scene.hand, *hand)
            for k, name in enumerate(soup.PIECES):
                columns = rerun_poses(poses.translation[:, k], poses.quaternion[:, k])
                self._columns(f"world/{whose}/{name}", times, columns)
        for name, moved in zip(self.scene.bodies, ticks.moved):
            for entity in (OBJECT, *([SPHERES] if self.scene.spheres else [])):
                self._columns(f"{entity}{name}", times, rerun_poses(moved.shift, moved.turn))
        contacts = contact_points(self.scene, ticks)
        lengths, places = np.bincount(contacts.tick, minlength=len(ticks.tick)), contacts.point.astype(np.float32)
        self._columns("world/contacts/points", times, rr.Points3D.columns(positions=places).partition(lengths))
        normals = rr.Arrows3D.columns(origins=places, vectors=(NORMAL_LENGTH * contacts.normal).astype(np.float32))
        self._columns("world/contacts/normals", times, normals.partition(lengths))
        force = body_forces(ticks.phalanx, ticks.total)
        size = sizes(force)
        felt = size >= FORCE_FLOOR
        start = force_places(ticks, contacts, force, self.scene.hand.radius)
        arrows = rr.Arrows3D.columns(
            origins=start[felt].astype(np.float32),
            vectors=(FORCE_LENGTH * force[felt] / np.sqrt(size[felt])[:, None]).astype(np.float32),
        )
        self._columns("world/forces", times, arrows.partition(felt.sum(axis=1)))
        for plot, values in ticks.plots.items():
            columns = rr.Scalars.columns(scalars=np.ascontiguousarray(values).ravel())
            self._columns(plot.path, times, columns.partition(np.full(len(values), len(plot.series))))

    def log_skin(self, ticks: ShownTicks, vertices: FloatArray, faces: IntArray) -> None:
        """Send the skin of some ticks [m], world, shape (T, V, 3), and its triangles, shape (F, 3)."""
        import rerun as rr

        color = rr.components.AlbedoFactor(np.append(soup.SKIN, 1.0))
        self._fixed(SKIN_MESH, rr.Mesh3D.from_fields(triangle_indices=faces, albedo_factor=color))
        times = [rr.TimeColumn("tick", sequence=ticks.tick), rr.TimeColumn("time", duration=ticks.time)]
        normals = np.array([vertex_normals(points, faces) for points in vertices])
        columns = rr.Mesh3D.columns(
            vertex_positions=vertices.reshape(-1, 3).astype(np.float32),
            vertex_normals=normals.reshape(-1, 3).astype(np.float32),
        )
        self._columns(SKIN_MESH, times, columns.partition(np.full(len(vertices), vertices.shape[1])))

    def log_states(self, lane: str, tick: Sequence[int], time: Sequence[float], states: Sequence[str]) -> None:
        """Send when a lane of the state timeline changed to which state; "" for none."""
        import rerun as rr

        if len(states) == 0:
            return
        times = [rr.TimeColumn("tick", sequence=tick), rr.TimeColumn("time", duration=time)]
        self._columns(f"states/{lane}", times, rr.StateChange.columns(state=list(states)))

    def log_event(self, time: float, level: str, text: str) -> None:
        """Send a line of a log: time [s], level as `rerun.TextLogLevel` names it."""
        import rerun as rr

        self._columns("log", [rr.TimeColumn("time", duration=[time])], rr.TextLog.columns(text=[text], level=[level]))

    def _fixed(self, path: str, what: Any) -> None:
        self.stream.log(f"{self.root}{path}", what, static=True, strict=True)

    def _columns(self, path: str, times: Sequence["rr.TimeColumn"], columns: Any) -> None:
        self.stream.send_columns(f"{self.root}{path}", indexes=times, columns=columns, strict=True)


def contact_points(scene: ShownScene, ticks: ShownTicks) -> ContactPoints:
    """Return the touching pairs of ticks, world."""
    found = [_of_body(scene, ticks, *body) for body in zip_longest(scene.surface_arrays, ticks.moved)]
    if len(found) == 1:
        return found[0]
    order = np.argsort(np.concatenate([of.tick for of in found]), kind="stable")
    return ContactPoints._make(np.concatenate(columns)[order] for columns in zip(*found))


def _of_body(scene: ShownScene, ticks: ShownTicks, surface: Any, moved: RigidMotion | None) -> ContactPoints:
    placed = PlacedHand(ticks.joints, ticks.graphic.position, ticks.graphic.orientation)
    # Contacts are looked for where the object stands still.
    placed = placed if moved is None else moved.seen_hand(placed)
    contacts = find_contact_points(
        surface,
        scene.shape,
        PlacedHand(*(np.ascontiguousarray(values, np.float64) for values in placed)),
        scene.touch,
        chosen=ticks.touching,
        fingers=scene.fingers,
    )
    if moved is None:
        return contacts
    there = RigidMotion(moved.turn[contacts.tick], moved.shift[contacts.tick])
    return contacts._replace(point=there.points(contacts.point), normal=there.vectors(contacts.normal))


def force_places(ticks: ShownTicks, contacts: ContactPoints, force: FloatArray, radius: FloatArray) -> FloatArray:
    """Return where each force is drawn [m], shape (T, 16, 3): amid its body's contacts, or at the pressed skin."""
    count = len(ticks.tick)
    middle = np.empty((count, 16, 3))
    middle[:, :15] = 0.5 * (ticks.joints[:, :, :3] + ticks.joints[:, :, 1:]).reshape(count, 15, 3)
    thickness = 0.5 * (radius[:, :3] + radius[:, 1:]).reshape(15)
    size = sizes(force[:, :15])
    unit = force[:, :15] / np.maximum(size, 1e-12)[:, :, None]
    middle[:, :15] -= thickness[:, None] * unit
    middle[:, 15] = ticks.graphic.position
    body = contacts.tick * 16 + contacts.body
    number = np.bincount(body, minlength=16 * count)
    there = number > 0
    places = middle.reshape(-1, 3)
    for axis in range(3):
        total = np.bincount(body, contacts.point[:, axis], minlength=16 * count)
        places[there, axis] = total[there] / number[there]
    return places.reshape(count, 16, 3)


def rerun_poses(translation: FloatArray, quaternion: FloatArray) -> Any:
    """Return poses as rerun takes them: translations [m], shape (T, 3), and unit quaternions w x y z, shape (T, 4)."""
    import rerun as rr

    turn = np.roll(quaternion, -1, axis=1).astype(np.float32)
    return rr.Transform3D.columns(translation=translation.astype(np.float32), quaternion=turn)


def vertex_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return unit normals of vertices (V, 3), the means of their triangles' by area; 0 where no triangle is."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    area, normals = np.cross(b - a, c - a), np.empty_like(vertices)
    for axis in range(3):
        normals[:, axis] = np.bincount(faces.ravel(), np.repeat(area[:, axis], 3), minlength=len(vertices))
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300))


def rerun_mesh(surface: soup.Surface, color: tuple[int, int, int, int] | None = None) -> Any:
    """Return a surface as rerun takes it, in its own colours or in one."""
    import rerun as rr

    return rr.Mesh3D(
        vertex_positions=surface.points,
        triangle_indices=surface.faces,
        vertex_normals=surface.normals,
        vertex_colors=None if color else np.rint(255.0 * surface.colors).astype(np.uint8),
        albedo_factor=color,
    )


def status_words(status: int) -> str:
    """Return the most urgent of a tick's status bits in words; `SETTLED` where none is set."""
    return next((words for bit, words in WORDS if status & bit), SETTLED)


@dataclass(frozen=True)
class Moment:
    """One tick, world: the graphic hand, the haptic one in blue, the forces that can be felt, and the contacts."""

    graphic: soup.Surface
    haptic: soup.Surface
    forces: list[PieceForce]
    contacts: ContactPoints

    @property
    def hands(self) -> tuple[soup.Surface, soup.Surface]:
        """Both hands."""
        return self.graphic, self.haptic

    @property
    def arrows(self) -> FloatArray:
        """Arrows of the forces [m], shape (k, 3)."""
        return np.array([arrow(force) for force in self.forces]).reshape(-1, 3)


def moment(result: Result, scene: ShownScene, tick: int, pieces: Sequence[soup.Surface] = ()) -> Moment:
    """Return what a picture shows of a tick; `pieces` as of `hand_surface`. InputError if there is no such tick."""
    values = result.at(tick, SHOWN_COLUMNS)
    ticks = shown_ticks(lambda name: values[name][None], [tick], [0], [0], moved=result.meshes_moved(tick))
    graphic, haptic = (
        soup.hand_surface(scene.hand, (part[0] for part in pose), pieces) for pose in (ticks.graphic, ticks.haptic)
    )
    if result.skin_faces is not None:
        (vertices,) = result.skin(slice(tick, tick + 1))
        graphic = soup.mesh_surface(Mesh(vertices, result.skin_faces), soup.SKIN)
    contacts, force = contact_points(scene, ticks), body_forces(ticks.phalanx, ticks.total)
    places = force_places(ticks, contacts, force, scene.hand.radius)[0]
    felt = np.flatnonzero(sizes(force[0]) >= FORCE_FLOOR)
    forces = [PieceForce(soup.PIECES[k], places[k], force[0, k]) for k in felt]
    return Moment(graphic, soup.painted(haptic, GHOST), forces, contacts)


def clearest_view(shown: Moment, body: soup.Surface) -> View:
    """Return the view that shows most of a tick beside an object, as `viewpoint`."""
    return viewpoint(shown.graphic, body, shown.contacts.point, shown.arrows)


def both_hands(moments: Sequence[Moment]) -> Moment:
    """Return one tick of several results of one object and time in one picture; the contacts are the first one's."""
    if len(moments) == 1:
        return moments[0]
    graphic, haptic = (soup.joined([getattr(one, whose) for one in moments]) for whose in ("graphic", "haptic"))
    return Moment(graphic, haptic, [force for one in moments for force in one.forces], moments[0].contacts)


def overview_tick(result: Result) -> int:
    """Return the last tick of the first hold; else that of largest force, or the last; InputError without a tick."""
    if result.ticks == 0:
        raise InputError(f"{result.path} holds no tick")
    if any(phase.name == HOLD for phase in result.phases):
        return int(result.phase(HOLD).stop) - 1
    size = np.nan_to_num(sizes(result["force/total"]))
    return int(np.argmax(size)) if size.max() >= FORCE_FLOOR else result.ticks - 1
