"""Columns of a result file for each tick: the solver's record, and what is measured from it apart from the solver."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.metrics.metrics import force_variation_rate, penetration
from hhsim.metrics.moving_parts import MovingParts
from hhsim.result.schema import TICK_COLUMNS
from hhsim.solver.options import SolverOptions


class KeptColumns:
    """Named datasets kept block by block, such as those that the table of a run needs."""

    def __init__(self, names: Iterable[str]) -> None:
        self._blocks: dict[str, list[AnyArray]] = {name: [] for name in names}

    def keep(self, block: Mapping[str, AnyArray]) -> None:
        """Keep the datasets of the next block."""
        for name, blocks in self._blocks.items():
            blocks.append(block[name])

    def __getitem__(self, name: str) -> AnyArray:
        blocks = self._blocks[name]
        blocks[:] = [np.concatenate(blocks)] if len(blocks) > 1 else blocks
        return blocks[0]


class TickColumns:
    """Makes the columns of `hhsim.result.schema.TICK_COLUMNS`, block after block of one run.

    `surface` is that of the body, world; `parts` are several bodies, in place of it. Fingers that the
    options leave out have no penetration.
    """

    def __init__(self, surface: Any, hand: HandModel, options: SolverOptions, parts: MovingParts | None = None) -> None:
        self._surface, self._shape = surface, hand_shape(hand)
        self._parts, self._kind, self._ticks = parts, options.surface, 0
        self._fingers = np.array([finger in options.fingers for finger in FINGERS])
        self.forget()

    def forget(self) -> None:
        """Leave the force variation of the next tick undefined, since it follows on none."""
        self._total = np.full((1, 3), np.nan)
        self._finger = np.full((1, 5, 3), np.nan)

    def rewind(self) -> None:
        """Have the next block take the poses of parts from their first tick on."""
        self._ticks = 0

    def block(
        self, time: AnyArray, input_seq: AnyArray, haptic: HandConfiguration, record: TickRecord
    ) -> dict[str, AnyArray]:
        """Return the columns of the next B ticks: `record` is the solver's output for `haptic`.

        `time` is since the start of the motion [s], `input_seq` the number of the input sample in use, shape (B,).
        """
        placed = PlacedHand(record.joints, record.position, record.orientation)
        ticks = slice(self._ticks, self._ticks + len(time))
        self._ticks = ticks.stop
        if self._parts is None:
            depth = penetration(self._surface, self._shape, placed, self._fingers)
        else:
            depth = self._parts.penetration(self._kind, self._shape, placed, self._fingers, ticks)
        total = np.concatenate([self._total, record.total])
        finger = np.concatenate([self._finger, record.phalanx.sum(axis=2)])
        self._total, self._finger = total[-1:], finger[-1:]
        given = {"input_seq": input_seq, **{f"haptic_{name}": values for name, values in haptic._asdict().items()}}
        fields = {**given, **record._asdict()}
        return {
            "time": time,
            **{column.name: column.taken(fields) for column in TICK_COLUMNS if column.source},
            "penetration_depth": depth.depth,
            "penetration_palm": depth.palm,
            "penetration_finger": depth.finger,
            "force_variation_rate": force_variation_rate(total)[1:],
            "force_variation_finger": force_variation_rate(finger)[1:],
        }
