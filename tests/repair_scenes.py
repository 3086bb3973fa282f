"""Recorded hands inside objects for the tests of the repair, and their clearance by the referee."""

from functools import cache
from typing import NamedTuple

import numpy as np
import trimesh

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.scene.scene import open_scene
from hhsim.trees.contact_surface import ContactSurface, contact_surface
from hhsim.verify.mesh_distance import TrueSurface

HAND = HandModel.default()


def referee_clearance(hand: HandModel, mesh: Mesh, placed: PlacedHand) -> float:
    """Least signed distance [m] of a hand to a mesh over some ticks; of an open mesh nothing is inside."""
    return float(TrueSurface(mesh, open_too=True).clearances(hand_shape(hand), placed, np.inf).min())


class Case(NamedTuple):
    """Frames of a hand, and the object that it stands in."""

    hand: HandModel
    mesh: Mesh
    surface: ContactSurface
    frames: HandConfiguration

    def referee_clearance(self, posture: HandConfiguration) -> float:
        return referee_clearance(self.hand, self.mesh, forward_kinematics(self.hand, *posture))

    def referee_clearance_of(self, placed: PlacedHand) -> float:
        return referee_clearance(self.hand, self.mesh, placed)


@cache
def scene_case(name: str, script: str, every: int = 33, first: int = 0, last: int | None = None) -> Case:
    """A script's haptic hand, seen 30 times a second or more slowly."""
    scene = open_scene(name, script)
    ticks = HandConfiguration.of(scene.hands[0].ticks)
    frames = ticks.at(np.arange(0, ticks.ticks, every)).part(first, last).copy()
    mesh = scene.solids[0].placed_mesh
    return Case(scene.hands[0].model, mesh, contact_surface("mesh", mesh, None), frames)


def shape_case(shape: trimesh.Trimesh, frames: HandConfiguration) -> Case:
    mesh = Mesh(shape.vertices, shape.faces)
    return Case(HAND, mesh, contact_surface("mesh", mesh, None), frames)


def held(frames: int, height: float = 0.0, flexion: float = 0.1) -> HandConfiguration:
    """A level hand that stands still."""
    return HandConfiguration(
        np.tile([0.0, 0.0, height], (frames, 1)),
        np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)),
        np.full((frames, 5, 3), flexion),
        np.zeros((frames, 5)),
    )


def ring_case(frames: int = 3, depth: float = 1e-3) -> Case:
    """A ring around the index finger, so far off its axis that the finger stands in it by a depth [m]."""
    hand = held(frames, flexion=1.0)
    hand.flexion[:, 1] = 0.0
    joints = HAND.joints(*hand.at(0))[1, 1:]
    axis = (joints[1] - joints[0]) / np.linalg.norm(joints[1] - joints[0])
    wire, inner = 0.002, 0.5 * float(HAND.radius[1, 1] + HAND.radius[1, 2])
    ring = trimesh.creation.torus(major_radius=inner + 0.002 + wire, minor_radius=wire)
    aside = np.cross(axis, [0.0, 0.0, 1.0])
    turn = np.eye(4)
    turn[:3, :3] = trimesh.geometry.align_vectors([0.0, 0.0, 1.0], axis)[:3, :3]
    turn[:3, 3] = 0.5 * (joints[0] + joints[1]) + (0.002 + depth) * np.cross(aside, axis)
    return shape_case(ring.apply_transform(turn), hand)
