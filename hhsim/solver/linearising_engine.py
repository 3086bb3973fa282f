"""Engines of the methods that converge over linearisations, also beside parts that move."""

from typing import Any

import numpy as np

from hhsim.errors import InputError
from hhsim.kernels.contact.linearise import ROW_CAPACITY
from hhsim.kernels.parts.surface import JointedSurface
from hhsim.kernels.parts.tick import SQUEEZE, SQUEEZED_DOF, Jointed
from hhsim.kernels.qp.active_set import new_work
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.kernels.tick.method import Coupled, Progressive
from hhsim.solver.options import UNLIMITED, SolverOptions
from hhsim.solver.workspace import TickWorkspace, zeroed

_SOLVED_WITH = {"method": ("coupled", "progressive"), "qp": ("active-set",), "threads": (1,), "force": ("kkt",)}
"""Options that bodies of several parts go with."""


def require_jointed(options: SolverOptions) -> None:
    """Raise an InputError unless a body of several parts can be touched with these options."""
    for name, expected in _SOLVED_WITH.items():
        if (found := getattr(options, name)) not in expected:
            wanted = " or ".join(map(str, expected))
            raise InputError(f"{name} {found} has no bodies of several parts: expected {wanted}")


class LinearisingEngine:
    """Runs the ticks of `coupled` and `progressive`, with helping threads, or of `coupled` by another QP solver.

    Where parts move a tick begins with them; an approach is beside parts that stand still.
    """

    def __init__(self, workspace: TickWorkspace, method: Coupled | Progressive) -> None:
        self.workspace, self.method = workspace, method
        self.parts_move = isinstance(workspace.surface, JointedSurface)
        if self.parts_move:
            qp = np.empty(1, new_work(SQUEEZED_DOF, ROW_CAPACITY).dtype)
            self._squeeze = zeroed(SQUEEZE), qp.view(np.recarray)

    @property
    def tick_method(self) -> Any:
        """Method of a whole tick."""
        return Jointed(self.method, self.workspace.surface.motion, *self._squeeze) if self.parts_move else self.method

    def begin(self) -> None:
        """See `Engine.begin`."""
        self.workspace.gather()

    def run(self, haptic: HapticBlock, record: TickRecord) -> int:
        """See `Engine.run`."""
        return self._run(self.tick_method, haptic, record)

    def approach(self, linearisations: int, haptic: HapticBlock, record: TickRecord) -> int:
        """Run ticks with up to so many linearisations each."""
        options = self.method.options._replace(linearisations=linearisations, budget=UNLIMITED, snap_step=np.inf)
        return self._run(self.method._replace(options=options), haptic, record)

    def _run(self, method: Any, haptic: HapticBlock, record: TickRecord) -> int:
        workspace = self.workspace
        if workspace.options.qp == "active-set":
            if workspace.options.threads > 1:
                # Compiled before there are helpers, which would look on, each on a processor of its own.
                workspace.run_block(method, HapticBlock(*(values[:0] for values in haptic)), record)
            with workspace.thread_team.at_work(self.method.options):
                return workspace.run_block(method, haptic, record)
        from hhsim.solver.backend_programs import run_block_with_backend

        assert isinstance(method, Coupled)
        return run_block_with_backend(workspace, method, haptic, record)
