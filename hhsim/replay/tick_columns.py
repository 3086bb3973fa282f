"""What a result file keeps of each tick: the solver's record, and what is measured from it apart from the solver."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import FINGERS, HandModel
from hhsim.kernels.contact.detection import COUNT_NODE_TESTS, COUNT_PAIR_TESTS
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import (
    WORK_BODIES,
    WORK_CANDIDATES,
    WORK_LINEARISATIONS,
    WORK_QP_ITERATIONS,
    WORK_ROWS,
    WORK_TOUCHING,
    WORK_UNITS,
)
from hhsim.kernels.tick.step import DURATION_DETECT, DURATION_FINGERS, DURATION_FORCE, DURATION_PALM
from hhsim.metrics.metrics import force_variation_rate, penetration
from hhsim.solver.options import SolverOptions

Array = NDArray[Any]


class TickColumns:
    """Makes the columns of `hhsim.result.schema.TICK_COLUMNS`, block after block of one run.

    Args:
        tree: the object's sphere tree, world.
        hand: the hand.
        options: of the solver; fingers that the scene does not use have no penetration.
    """

    def __init__(self, tree: TreeArrays, hand: HandModel, options: SolverOptions) -> None:
        """No tick has gone before."""
        arrays = hand.arrays()
        self._tree = tree
        self._radius = hand.radius
        self._palm_center = np.stack([arrays.palm_x, arrays.palm_y, arrays.palm_z], axis=1)
        self._palm_radius = arrays.palm_radius
        self._fingers = np.array([finger in options.fingers for finger in FINGERS])
        self.forget()

    def forget(self) -> None:
        """The next tick follows on none: the rates of change of its forces are not defined."""
        self._total = np.full((1, 3), np.nan)
        self._finger = np.full((1, 5, 3), np.nan)

    def block(self, time: Array, input_seq: Array, haptic: HandConfiguration, record: TickRecord) -> dict[str, Array]:
        """The columns of the next ticks.

        Args:
            time: since the start of the motion [s], shape (B,).
            input_seq: number of the input sample in use, shape (B,).
            haptic: what the solver was given.
            record: what it made of it.
        """
        depth = penetration(
            self._tree,
            self._radius,
            self._palm_center,
            self._palm_radius,
            record.joints,
            record.position,
            record.orientation,
            self._fingers,
        )
        total = np.concatenate([self._total, record.total])
        finger = np.concatenate([self._finger, record.phalanx.sum(axis=2)])
        self._total, self._finger = total[-1:], finger[-1:]
        return {
            "time": time,
            "input_seq": input_seq,
            "status": record.status.astype(np.int32),
            "lag": record.lag,
            **{f"haptic/{name}": values for name, values in haptic._asdict().items()},
            "graphic/position": record.position,
            "graphic/orientation": record.orientation,
            "graphic/flexion": record.flexion,
            "graphic/abduction": record.abduction,
            "graphic/joints": record.joints,
            "penetration_depth": depth.depth,
            "penetration_palm": depth.palm,
            "penetration_finger": depth.finger,
            "force/phalanx": record.phalanx,
            "force/fingertip_normal": record.fingertip_normal,
            "force/palm_wrench": record.palm_wrench,
            "force/total": record.total,
            "force_variation_rate": force_variation_rate(total)[1:],
            "force_variation_finger": force_variation_rate(finger)[1:],
            "duration/detect": record.duration[:, DURATION_DETECT],
            "duration/palm": record.duration[:, DURATION_PALM],
            "duration/fingers": record.duration[:, DURATION_FINGERS],
            "duration/force": record.duration[:, DURATION_FORCE],
            "duration/total": record.duration_total,
            "duration/total_cpu": record.duration_cpu,
            "contacts/candidates": record.work[:, WORK_CANDIDATES],
            "contacts/touching": record.work[:, WORK_TOUCHING],
            "work/node_tests": record.work[:, COUNT_NODE_TESTS],
            "work/pair_tests": record.work[:, COUNT_PAIR_TESTS],
            "work/qp_iterations": record.work[:, WORK_QP_ITERATIONS],
            "work/linearisations": record.work[:, WORK_LINEARISATIONS],
            "work/rows": record.work[:, WORK_ROWS],
            "work/bodies": record.work[:, WORK_BODIES],
            "work/units": record.work[:, WORK_UNITS],
        }
