"""Engine of the methods that converge over linearisations, beside parts that move."""

import numpy as np

from hhsim.errors import InputError
from hhsim.kernels.contact.linearise import ROW_CAPACITY
from hhsim.kernels.parts.tick import SQUEEZE, SQUEEZED_DOF, Jointed
from hhsim.kernels.qp.active_set import new_work
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.solver.linearising_engine import LinearisingEngine
from hhsim.solver.method import Engine
from hhsim.solver.options import SolverOptions
from hhsim.solver.workspace import TickWorkspace, zeroed

_SOLVED_WITH = {"method": ("coupled", "progressive"), "qp": ("active-set",), "threads": (1,), "force": ("kkt",)}
"""Options that things of several parts go with."""


def require_jointed(options: SolverOptions) -> None:
    """Raise an InputError unless a thing of several parts can be touched with these options."""
    for name, expected in _SOLVED_WITH.items():
        if (found := getattr(options, name)) not in expected:
            wanted = " or ".join(map(str, expected))
            raise InputError(f"{name} {found} has no things of several parts: expected {wanted}")


class JointedEngine(LinearisingEngine):
    """Runs the ticks of a hand beside parts that move; an approach at the start is beside parts that stand still."""

    def __init__(self, workspace: TickWorkspace, inner: Engine) -> None:
        require_jointed(workspace.options)
        assert isinstance(inner, LinearisingEngine)
        super().__init__(workspace, inner.method)
        self.qp = np.empty(1, new_work(SQUEEZED_DOF, ROW_CAPACITY).dtype)
        self.squeeze = zeroed(SQUEEZE)

    @property
    def tick_method(self) -> Jointed:
        """Method of a whole tick, in which the parts move."""
        return Jointed(self.method, self.squeeze, self.qp.view(np.recarray))

    def run(self, haptic: HapticBlock, record: TickRecord) -> int:
        """See `Engine.run`."""
        return self.workspace.run_block(self.tick_method, haptic, record)
