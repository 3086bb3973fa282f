"""The graphic hand's solver: one object's sphere tree, one hand, one tick after another."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import HhsimError
from hhsim.hand import HandModel
from hhsim.kernels.pose import copy_configuration
from hhsim.kernels.tick import (
    STATUS_FULL,
    STATUS_HELD,
    STATUS_START_INSIDE,
    TickRecord,
    evaluate_pose,
    least_distance,
    run_block,
    set_haptic,
    tick,
)
from hhsim.kernels.tree import TreeArrays
from hhsim.solver_options import SolverOptions
from hhsim.workspace import tick_record, tick_state

FloatArray = NDArray[np.float64]
BlockRunner = Callable[[FloatArray, FloatArray, FloatArray, FloatArray, TickRecord], int]

CONTACT_ROWS = 8192
"""Contacts that fit into one program; the paper's heaviest scenes have a few hundred."""
START_LINEARISATIONS = 4000
"""Budget for the way from a free place back to an object that the haptic hand is inside of at the first tick."""


class HandSolver:
    """Keeps the graphic hand between ticks.

    Args:
        hand: The hand.
        tree: The object's sphere tree in the world frame.
        options: Method, stiffness and lengths.
    """

    def __init__(self, hand: HandModel, tree: TreeArrays, options: SolverOptions) -> None:
        """Allocate the workspaces; nothing is computed yet."""
        self.options = options
        self.hand = hand.arrays()
        self.tree = tree
        nodes = tree.radius.shape[0]
        leaves = nodes - tree.leaf_start
        self.tick_options = options.tick_options()
        self.state = tick_state(options.stiffness.diagonal(), leaves, nodes, CONTACT_ROWS)
        self._started = False

    def run(self, position: FloatArray, orientation: FloatArray, flexion: FloatArray, abduction: FloatArray) -> TickRecord:
        """Run one tick for each haptic configuration.

        Args:
            position: Palm origin [m], shape (B, 3), world.
            orientation: Palm quaternion (w, x, y, z), shape (B, 4).
            flexion: Joint angles [rad], shape (B, 5, 3).
            abduction: [rad], shape (B, 5).

        Returns:
            The B ticks.

        Raises:
            HhsimError: More pairs were near than the arrays hold.
        """
        arrays = [np.ascontiguousarray(a, np.float64) for a in (position, orientation, flexion, abduction)]
        record = tick_record(len(arrays[0]))
        status = 0
        if not self._started and len(arrays[0]):
            status = self._start(arrays[0][0], arrays[1][0], arrays[2][0], arrays[3][0])
        done = self._run_block(arrays[0], arrays[1], arrays[2], arrays[3], record)
        if len(arrays[0]):
            record.status[0] |= status
        if done < len(arrays[0]) or (done and record.status[done - 1] & STATUS_FULL):
            raise HhsimError(
                f"more than {CONTACT_ROWS} contacts are within the margin of {self.options.margin * 1e3:g} mm: "
                "use a smaller --margin or a coarser sphere tree"
            )
        return record

    def _run_block(
        self, position: FloatArray, orientation: FloatArray, flexion: FloatArray, abduction: FloatArray, record: TickRecord
    ) -> int:
        if self.options.qp != "active-set":
            from hhsim.backend import run_block_with_backend

            return run_block_with_backend(self, position, orientation, flexion, abduction, record)
        done: int = run_block(
            self.hand, self.tree, self.tick_options, self.state, position, orientation, flexion, abduction, record
        )
        return done

    def _clearance(self) -> float:
        evaluate_pose(self.hand, self.tree, self.tick_options, self.state)
        return float(min(least_distance(self.state.candidates), self.state.candidates.slack.min()))

    def _start(self, position: FloatArray, orientation: FloatArray, flexion: FloatArray, abduction: FloatArray) -> int:
        """Put the graphic hand on the haptic one, or, where that is inside, at a free place from which it then comes as near as it can."""
        self._started = True
        state = self.state
        if set_haptic(self.hand, position, orientation, flexion, abduction, state) & STATUS_HELD:
            # Nothing is known yet: wait, straight-fingered, at the origin of the palm's frame, if that is free.
            set_haptic(self.hand, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros((5, 3)), np.zeros(5), state)
        copy_configuration(state.haptic, state.pose)
        np.clip(state.pose.flexion, self.hand.flexion_min, self.hand.flexion_max, out=state.pose.flexion)
        if self._clearance() >= 0.0:
            return 0
        self._retreat()
        options = self.tick_options._replace(linearisations=START_LINEARISATIONS)
        tick(self.hand, self.tree, options, state)
        return STATUS_START_INSIDE

    def _retreat(self) -> None:
        """Shift the hand by the least distance, over 26 directions and the one away from the object, that frees it."""
        state = self.state
        origin = state.pose.position.copy()
        away = state.pose.joints.reshape(-1, 3).mean(axis=0) - np.array([self.tree.x[0], self.tree.y[0], self.tree.z[0]])
        directions = [np.array(d, float) for d in np.ndindex(3, 3, 3)]
        directions = [d - 1.0 for d in directions if np.any(d != 1.0)]
        if np.linalg.norm(away) > 0.0:
            directions.append(away)
        best: tuple[float, FloatArray] | None = None
        step = self.options.margin
        for direction in directions:
            unit = direction / np.linalg.norm(direction)
            shift = 0.0
            while best is None or shift < best[0]:
                state.pose.position[:] = origin + shift * unit
                state.candidates.slack[:] = -np.inf
                clearance = self._clearance()
                if clearance >= step:
                    best = (shift, unit)
                    break
                shift += max(step, -clearance)
        assert best is not None
        state.pose.position[:] = origin + best[0] * best[1]
        state.candidates.slack[:] = -np.inf
        self._clearance()
