"""A method of one's own, in a minute: the user's hand, moved out of the object along the palm's way.

It shows how a method is written and is a poor one. No finger bends: the whole hand moves by what its deepest ball
takes. Phalanges between their joints are not looked at, so they go into the object. Nothing is kept from tick to tick,
so the hand jumps where another side of the object is nearer. All force is on the palm.

hhsim methods check project_out:ProjectOut
hhsim replay sphere grasp --method project_out:ProjectOut
"""

import numpy as np

import hhsim


class ProjectOut:
    """Shifts the whole hand out of the object's spheres by what its deepest ball is inside, again and again."""

    gives_forces = True
    gives_work = True

    def __init__(self, scene: hhsim.MethodScene) -> None:
        """Keep the object's leaf spheres and the balls that stand for the hand."""
        assert scene.tree is not None
        self.hand, self.stiffness = scene.hand, scene.options.stiffness.translation
        self.center, self.radius = scene.tree.leaf_center, scene.tree.leaf_radius
        palm = scene.hand.palm_tree
        self.palm_center, self.palm_radius = palm.leaf_center, palm.leaf_radius

    def begin(self, pose: hhsim.HandConfiguration) -> None:
        """Nothing is kept from tick to tick."""

    def tick(self, haptic: hhsim.HandConfiguration) -> hhsim.TickAnswer:
        """Push the hand out; the force on the palm is a spring's to the user's hand, the work the pairs looked at."""
        joints = self.hand.joints(*haptic).reshape(-1, 3)
        w, x, y, z = haptic.orientation
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        balls = np.concatenate([joints, haptic.position + self.palm_center @ turn.T])
        sizes = np.concatenate([self.hand.radius.ravel(), self.palm_radius])
        shift, work = np.zeros(3), 0
        for _ in range(20):
            moved = balls + shift
            square = (moved**2).sum(axis=1)[:, None] + (self.center**2).sum(axis=1) - 2.0 * moved @ self.center.T
            depth = sizes[:, None] + self.radius - np.sqrt(np.maximum(square, 0.0))
            work += depth.size
            i, j = np.unravel_index(depth.argmax(), depth.shape)
            if depth[i, j] <= 0.0:
                break
            away = moved[i] - self.center[j]
            shift += depth[i, j] * away / np.linalg.norm(away)
        pose = haptic._replace(position=haptic.position + shift)
        return hhsim.TickAnswer(pose, np.zeros((5, 3, 3)), self.stiffness * shift, work=work)
