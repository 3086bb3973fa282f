"""One tick of a result as pictures show it: both hands, the forces on them, and the contacts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.kernels.contact.surface import ContactPoints
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import FORCE_FLOOR
from hhsim.metrics.moving_parts import placed_mesh
from hhsim.metrics.run_ticks import HOLD
from hhsim.render.hand_picture import GHOST, PieceForce, View, arrow, viewpoint
from hhsim.render.triangle_soup import PIECES, SKIN, STONE, Surface, hand_surface, joined, mesh_surface, painted
from hhsim.result.reader import Result
from hhsim.view.plots import SHOWN_COLUMNS, body_forces, shown_ticks, sizes
from hhsim.view.scene_log import ShownScene, contact_points, force_places


@dataclass(frozen=True)
class Moment:
    """One tick, world: the graphic hand, the haptic one in blue, the forces that can be felt, and the contacts."""

    graphic: Surface
    haptic: Surface
    forces: list[PieceForce]
    contacts: ContactPoints

    @property
    def hands(self) -> tuple[Surface, Surface]:
        """Both hands."""
        return self.graphic, self.haptic

    @property
    def arrows(self) -> FloatArray:
        """Arrows of the forces [m], shape (k, 3)."""
        return np.array([arrow(force) for force in self.forces]).reshape(-1, 3)


def moment(result: Result, scene: ShownScene, tick: int, pieces: Sequence[Surface] = ()) -> Moment:
    """Return what a picture shows of a tick; `pieces` as of `hand_surface`. InputError if there is no such tick."""
    values = result.at(tick, SHOWN_COLUMNS)
    ticks = shown_ticks(lambda name: values[name][None], [tick], [0], [0], moved=result.meshes_moved(tick))
    graphic, haptic = (
        hand_surface(scene.hand, (part[0] for part in pose), pieces) for pose in (ticks.graphic, ticks.haptic)
    )
    if result.skin_faces is not None:
        (vertices,) = result.skin(slice(tick, tick + 1))
        graphic = mesh_surface(Mesh(vertices, result.skin_faces), SKIN)
    contacts, force = contact_points(scene, ticks), body_forces(ticks.phalanx, ticks.total)
    places = force_places(ticks, contacts, force, scene.hand.radius)[0]
    felt = np.flatnonzero(sizes(force[0]) >= FORCE_FLOOR)
    forces = [PieceForce(PIECES[k], places[k], force[0, k]) for k in felt]
    return Moment(graphic, painted(haptic, GHOST), forces, contacts)


def clearest_view(
    result: Result, scene: ShownScene, tick: int, shown: Moment, body: Surface, usual: View | None = None
) -> View:
    """Return the view that shows most of a tick, as `viewpoint`; of several bodies most of the one that is moved."""
    rest, moved = None, result.meshes_moved(tick)
    if result.body.is_free and len(moved) > 1:
        meshes = [mesh for mesh, _ in scene.bodies.values()]
        body, rest = (mesh_surface(placed_mesh(meshes[of], moved[of]), STONE) for of in (slice(1), slice(1, None)))
    return viewpoint(shown.graphic, body, shown.contacts.point, shown.arrows, usual, rest=rest)


def both_hands(moments: Sequence[Moment]) -> Moment:
    """Return one tick of several results of one object and time in one picture; the contacts are the first one's."""
    if len(moments) == 1:
        return moments[0]
    graphic, haptic = (joined([getattr(one, whose) for one in moments]) for whose in ("graphic", "haptic"))
    return Moment(graphic, haptic, [force for one in moments for force in one.forces], moments[0].contacts)


def overview_tick(result: Result) -> int:
    """Return the last tick of the first hold; else that of largest force, or the last; InputError without a tick."""
    if result.ticks == 0:
        raise InputError(f"{result.path} holds no tick")
    if any(phase.name == HOLD for phase in result.phases):
        return int(result.phase(HOLD).stop) - 1
    size = np.nan_to_num(sizes(result["force/total"]))
    return int(np.argmax(size)) if size.max() >= FORCE_FLOOR else result.ticks - 1
