"""A hand closed on an object: palm pose, finger postures, and distance of each body."""

from dataclasses import dataclass

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.hand import finger_closure as kernel
from hhsim.kernels.hand.kinematics import BODY_COUNT, PALM_BODY, HandArrays
from hhsim.kernels.sphere_tree import STACK_SIZE, TreeArrays
from hhsim.mesh.catalogue import OF_BODIES, body_file_names, object_description
from hhsim.scene.script import Placement, Script
from hhsim.trees.sphere_tree import SphereTree

DIP_PER_PIP = 2.0 / 3.0
"""Flexion of the last joint over that of the middle one in free flexion (Rijpkema & Girard 1991)."""
THUMB_RATE = (0.5, 1.0, 0.8)
"""Rates of the thumb's joints as it closes: the metacarpal has the shortest range."""
OPEN_SHARE = 0.6
"""Share of the joints' range beyond straight to which the open hand is extended."""
PALM_WAY = 0.03
"""A palm that touches is searched for within this distance [m] before and behind its stored place."""
REACH_DEPTH = 0.0005
"""A finger reaches the object when its command lies this deep [m] in it."""


@dataclass(frozen=True, eq=False)
class FingerClosure:
    """A grasp of one object: palm pose, open hand, and the postures that touch and press."""

    rotation: FloatArray  # palm to world, shape (3, 3)
    back: FloatArray  # unit direction of the retreat, shape (3,), world; by default the palm's normal
    # Palm origin where the fingers close [m], shape (3,), world; a palm that is to touch does so there.
    position: FloatArray
    open: FloatArray  # flexion of the open hand [rad], shape (5, 3)
    contact: FloatArray  # flexion at first contact; the open one for fingers that do not close [rad], shape (5, 3)
    command: FloatArray  # flexion commanded into the object [rad], shape (5, 3)
    abduction: FloatArray  # [rad], shape (5,)
    reached: tuple[str, ...]  # named fingers whose command lies inside the object
    missed: tuple[str, ...]  # named fingers that do not reach it
    slide: FloatArray  # unit direction of a slide, shape (3,), world; zeros where the script has none
    touching: FloatArray  # 1 for each phalanx that touches at first contact, else 0, shape (5, 3)
    # Signed distance of each body with the palm and all named fingers as commanded [m], shape (16,).
    distance: FloatArray

    def require_touch(self, script: Script, target: str) -> None:
        """Raise TrajectoryError if none of a script's fingers reaches the object, or its palm does not touch it."""
        if script.contact and not self.reached:
            raise TrajectoryError(f"script {script.name}: {', '.join(script.fingers)} cannot reach {target}")
        if script.palm_depth > 0.0 and self.distance[PALM_BODY] >= 0.0:
            raise TrajectoryError(f"script {script.name}: the palm cannot touch {target}")


class Closer:
    """Closes the fingers of a script's hand on an object at rest (`tree`, world frame), at any palm pose."""

    def __init__(self, script: Script, hand: HandModel, tree: SphereTree) -> None:
        self.script = script
        self.work = make_work(hand.arrays(), tree.arrays())
        self.hand = self.work.hand
        self.rates = closure_rates(script.curl)
        self.fingers = [FINGERS.index(name) for name in script.fingers] if script.contact else []

    def closed(
        self,
        place: tuple[FloatArray, FloatArray, FloatArray],
        opened: FloatArray,
        abduction: FloatArray,
        slide: FloatArray,
        unclosed: FloatArray | None = None,
    ) -> FingerClosure:
        """Close the script's fingers until they touch, and command them deeper; shapes as in `FingerClosure`.

        `place` is position, rotation and back of the palm, `opened` the flexion of the open hand [rad]. Fingers that do
        not close get the command `unclosed` [rad], None for the open hand's.
        """
        (position, rotation, back), work = place, self.work
        contact, touching = opened.copy(), np.zeros((len(FINGERS), 3))
        for f in self.fingers:
            kernel.close_finger(position, rotation, f, self.rates[f], abduction, contact, work, touching)
        command = contact.copy() if unclosed is None else unclosed
        for f in self.fingers:
            if touching[f].any():
                kernel.deepen_finger(f, self.rates[f], abduction, self.script.depth, command, work)
        pressed = position - self.script.palm_depth * back
        distances = body_distances(pressed, rotation, command, abduction, work)
        reached = [f for f in self.fingers if distances[3 * f : 3 * f + 3].min() < -REACH_DEPTH]
        return FingerClosure(
            rotation=rotation,
            back=back,
            position=position,
            open=opened,
            contact=contact,
            command=command,
            abduction=abduction,
            reached=tuple(FINGERS[f] for f in reached),
            missed=tuple(FINGERS[f] for f in self.fingers if f not in reached),
            slide=slide,
            touching=touching,
            distance=distances,
        )

    def opened(self, placement: Placement) -> FloatArray:
        """Return the flexion of the open hand at a place [rad], shape (5, 3)."""
        wide = OPEN_SHARE * np.minimum(self.hand.flexion_min, 0.0) + placement.open[:, None] * self.rates
        return np.ascontiguousarray(np.clip(wide, self.hand.flexion_min, self.hand.flexion_max))

    def close(self, placement: Placement) -> FingerClosure:
        """Close the fingers with the palm at a place."""
        rotation = rotation_matrix(placement.orientation)
        position, back = placement.position, placement.back
        opened, abduction = self.opened(placement), np.ascontiguousarray(placement.abduction)
        if self.script.palm_depth > 0.0:
            start = position + PALM_WAY * back
            gap, limit = np.zeros(BODY_COUNT), 2.0 * PALM_WAY
            travel, _ = kernel.advance_hand(start, rotation, opened, abduction, -back, gap, limit, self.work)
            position = start - travel * back
        return self.closed((position, rotation, back), opened, abduction, placement.slide)


def closure_rates(curl: float) -> FloatArray:
    """Return the rate of each joint as a finger closes, shape (5, 3)."""
    rates = np.tile([1.0, curl, curl * DIP_PER_PIP], (len(FINGERS), 1))
    rates[0] = THUMB_RATE
    return rates


def make_work(hand: HandArrays, tree: TreeArrays) -> kernel.ClosureWork:
    """Return a hand and an object to the kernels, with the workspace that they need."""
    return kernel.ClosureWork(
        hand=hand,
        tree=tree,
        joints=np.zeros((5, 4, 3)),
        direction=np.zeros((5, 3, 3)),
        axis=np.zeros((5, 3)),
        abduction_axis=np.zeros((5, 3)),
        stack=np.zeros(STACK_SIZE, dtype=np.int64),
    )


def body_distances(
    position: FloatArray, rotation: FloatArray, flexion: FloatArray, abduction: FloatArray, work: kernel.ClosureWork
) -> FloatArray:
    """Compute the signed distance of the 15 phalanges and the palm to the leaf spheres [m], shape (16,).

    `work` then holds the kinematics of that pose.
    """
    distance = np.empty(BODY_COUNT)
    kernel.body_distances(position, rotation, flexion, abduction, work, distance)
    return distance


def find_placement(script: Script, hand: HandModel, tree: SphereTree) -> Placement | None:
    """Return the script's own placement on the object of a tree; None where a search finds one.

    That of a left hand is the mirror image of a right hand's, where the placement has a mirror. Raises TrajectoryError
    for a script that is made for other objects, or for a right hand.
    """
    for placement in script.placements:
        if _is_of(placement.object_name, tree):
            if hand.side == "right":
                return placement
            if placement.mirror.any():
                return placement.mirrored()
            if script.objects:
                raise TrajectoryError(
                    f"script {script.name}: its place on the {placement.object_name} is a right hand's, with no mirror"
                )
            return None
    if script.objects:
        raise TrajectoryError(f"script {script.name} is made for {' and '.join(script.objects)}, not for this object")
    return None


def _is_of(name: str, tree: SphereTree) -> bool:
    """Return True if a tree is that of an object, or that of the bodies of a file, of the catalogue."""
    if name in body_file_names():
        return bool(tree.options.get(OF_BODIES) == name)
    return bool(tree.mesh_sha256) and object_description(name)["sha256"] == tree.mesh_sha256
