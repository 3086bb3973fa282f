"""A scene as its engine sees it.

With nothing free the frame of a hand's ticks goes along with the object of the motion; beside free bodies hands are
given in the world, and returned as the first free body sees them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hhsim.hand.configuration import HandConfiguration
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.moving_parts import MovingParts, placed_mesh
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.scene.body import Body, Driven, HalfSpace
from hhsim.scene.declared_bodies import joined_tree
from hhsim.scene.overlap import raised
from hhsim.scene.scene import Scene
from hhsim.trees.contact_surface import ContactSurface, contact_surface
from hhsim.trees.sphere_tree import SphereTree

STRAY = 1e-9
"""Distance [m], or change of a quaternion, by which a body that goes along with a frame strays from it by rounding."""


@dataclass(frozen=True, eq=False)
class EngineScene:
    """A scene in the frame of its engine, which is the world's at the first tick.

    Attributes:
        mesh: What a hand closes on at the first tick [m]: the first free body, or all where none is free.
        tree: Its sphere tree.
        place: Pose of the object's frame, or of that of the bodies' file, at the first tick, (3,) and (4,), world.
        carrier: That pose at each tick, which the engine's frame goes along with; None if the frame is the world's.
        haptic: Hands at the ticks, in the frame.
        free: The first free body.
        parts: Several bodies with their poses, which those of free ones become when ticks have run.
        others: Bodies beside a free one, and the plane.
    """

    mesh: Mesh
    tree: SphereTree
    place: ObjectMotion
    carrier: ObjectMotion | None
    haptic: tuple[HandConfiguration, ...]
    free: Body | None
    parts: MovingParts | None
    others: tuple[Body | HalfSpace, ...] = ()

    @property
    def beside(self) -> tuple[Body, ...]:
        """Bodies beside a free one."""
        return tuple(body for body in self.others if isinstance(body, Body))

    def surface(self, kind: str) -> ContactSurface:
        """Return what hands touch, but bodies beside a free one, as `spheres` or `mesh`."""
        if self.parts is not None and self.free is None:
            return self.parts.surface(kind)
        return contact_surface(kind, self.mesh, self.tree)


def engine_scene(scene: Scene) -> EngineScene:
    """Return a scene in its engine's frame: that of an object that moves as recorded, else the world's."""
    solids, first = list(scene.solids), scene.hands[0]
    hands = tuple(HandConfiguration.of(hand.ticks) for hand in scene.hands)
    moves = [body for body in solids if body.is_free]
    if moves:
        solids.sort(key=lambda body: body is not moves[0])
    body = solids[0]
    place = ObjectMotion(body.position, body.orientation)
    if len(solids) > 1:
        place = ObjectMotion(first.trajectory.object_position, first.trajectory.object_orientation)
    if moves:
        planes = [body for body in scene.bodies if isinstance(body, HalfSpace)]
        mesh, tree = replace(body.placed_mesh, name=scene.name), body.placed_tree
        parts = _free_parts(scene, solids) if len(solids) > 1 else None
        return EngineScene(mesh, tree, place, None, hands, body, parts, (*solids[1:], *planes))
    carrier = first.ticks.object_motion
    if len(solids) == 1:
        carrier = body.motion.poses if isinstance(body.motion, Driven) else None
    moved = None if carrier is None else carrier.since(*carrier.at(0))
    if len(solids) == 1:
        haptic = tuple(seen_hand(hand, moved) for hand in hands)
        mesh = replace(body.placed_mesh, name=scene.name)
        return EngineScene(mesh, body.placed_tree, place, carrier, haptic, None, None)
    motions = [_poses(solid, scene.ticks.tick_count) for solid in solids]
    driven = {solid.name: solid.motion.values for solid in solids if isinstance(solid.motion, Driven)}
    joints = {name: values for name, values in driven.items() if values is not None}
    carried = [motion for solid, motion in zip(solids, motions) if solid.name not in joints]
    if moved is not None and not all(_goes_along(motion, moved) for motion in carried):
        carrier = moved = None
    begin = [RigidMotion(solid.orientation[None], solid.position[None]) for solid in solids]
    names, meshes, trees = zip(*((solid.name, solid.mesh, solid.tree) for solid in solids))
    mesh = placed_mesh(meshes, begin, scene.name)
    tree = joined_tree(trees, begin, scene.name, mesh)
    poses = np.stack([np.concatenate(motion, axis=1) for motion in motions], axis=1)
    parts = MovingParts(scene.name, names, meshes, trees, poses, joints, moved)
    haptic = tuple(seen_hand(hand, moved) for hand in hands)
    return EngineScene(mesh, tree, place, carrier, haptic, None, parts)


def seen_hand(hand: HandConfiguration, moved: RigidMotion | None) -> HandConfiguration:
    """Return a hand, given in the world, as a frame that has moved sees it; None is the world's frame."""
    if moved is None:
        return hand
    places, turns = moved.seen_points(hand.position), moved.seen_orientations(hand.orientation)
    return hand._replace(position=places, orientation=turns)


def _poses(body: Body, count: int) -> ObjectMotion:
    if isinstance(body.motion, Driven):
        return body.motion.poses
    return ObjectMotion(np.tile(body.position, (count, 1)), np.tile(body.orientation, (count, 1)))


def _goes_along(poses: ObjectMotion, along: RigidMotion) -> bool:
    """Return True if a body stands still in a moving frame."""
    seen = along.seen_points(poses.position), along.seen_orientations(poses.orientation)
    return all(bool((np.abs(values - values[0]) < STRAY).all()) for values in seen)


def _free_parts(scene: Scene, solids: Sequence[Body]) -> MovingParts:
    """Return room for the poses of all bodies at the ticks, and the motion of the driven ones."""
    moved = ((solid, solid.motion.poses) for solid in solids if isinstance(solid.motion, Driven))
    driven = {solid.name: poses.since(solid.position, solid.orientation) for solid, poses in moved}
    meshes, trees = tuple(solid.placed_mesh for solid in solids), tuple(solid.placed_tree for solid in solids)
    names, room = tuple(solid.name for solid in solids), np.zeros((scene.ticks.tick_count, len(solids), 7))
    return MovingParts(scene.name, names, meshes, trees, room, {}, free=True, driven=driven)


def standing_apart(scene: Scene, surface: str) -> Scene:
    """Return a scene in which no free body begins in the spheres of another one, if these are the surface."""
    if surface != "spheres" or len(scene.solids) < 2:
        return scene
    solids = {body.name: body for body in raised(scene.solids)}
    return replace(scene, bodies=tuple(solids.get(body.name, body) for body in scene.bodies))
