"""Whether a run touches what its script demands, at the end of each hold."""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.kernels.tick.block import TickRecord
from hhsim.motion.trajectory import TickInput, Trajectory
from hhsim.scene.contact_goals import touch_distances
from hhsim.scene.script import Script
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.trees.sphere_tree import SphereTree


def hold_distances(
    script: Script, object_name: str, hand: HandModel, tree: SphereTree, ticks: TickInput, record: TickRecord
) -> list[FloatArray]:
    """For each hold, how far each demanded touch is from happening at its last tick [m]; see `touch_distances`.

    Args:
        script: That the motion was made from.
        tree: The object, whose frame is the world's.
    """
    found = []
    holds = [phase.last_tick for phase in ticks.phases if phase.name == "hold"]
    rotation = np.empty((3, 3))
    for tick, touches in zip(holds, script.hold_touches, strict=True):
        quaternion_to_matrix(record.orientation[tick].copy(), rotation)
        found.append(
            touch_distances(touches, object_name, hand, tree, record.joints[tick], record.position[tick], rotation)
        )
    return found


def check_holds(
    script: Script, object_name: str, hand: HandModel, tree: SphereTree, motion: Trajectory, options: SolverOptions
) -> list[FloatArray]:
    """Play a motion at 1 kHz and look at its holds, as `hold_distances`."""
    ticks = motion.resampled(1000.0)
    record = HandSolver(hand, tree.arrays(), options).run(*HandConfiguration.of(ticks))
    return hold_distances(script, object_name, hand, tree, ticks, record)
