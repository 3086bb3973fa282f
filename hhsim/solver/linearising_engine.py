"""Engine of the methods that converge over linearisations."""

from typing import Any

from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.kernels.tick.method import Coupled, Progressive
from hhsim.solver.options import UNLIMITED
from hhsim.solver.workspace import TickWorkspace


class LinearisingEngine:
    """Runs the ticks of `coupled` and `progressive`, with helping threads, or of `coupled` by another QP solver."""

    def __init__(self, workspace: TickWorkspace, method: Coupled | Progressive) -> None:
        self.workspace = workspace
        self.method = method

    @property
    def tick_method(self) -> Any:
        """Method of a whole tick."""
        return self.method

    def begin(self) -> None:
        """See `Engine.begin`."""
        self.workspace.gather()

    def run(self, haptic: HapticBlock, record: TickRecord) -> int:
        """See `Engine.run`."""
        return self._run(self.method, haptic, record)

    def approach(self, linearisations: int, haptic: HapticBlock, record: TickRecord) -> int:
        """Run ticks with up to so many linearisations each."""
        return self._run(self.patient(linearisations), haptic, record)

    def patient(self, linearisations: int) -> Coupled | Progressive:
        """Return the method with up to so many linearisations in a tick."""
        return self.method._replace(
            options=self.method.options._replace(linearisations=linearisations, budget=UNLIMITED)
        )

    def _run(self, method: Coupled | Progressive, haptic: HapticBlock, record: TickRecord) -> int:
        workspace = self.workspace
        if workspace.options.qp == "active-set":
            if workspace.options.threads > 1:
                # Compiled before there are helpers, which would look on, each on a processor of its own.
                workspace.run_block(method, HapticBlock(*(values[:0] for values in haptic)), record)
            with workspace.thread_team.at_work(method.options):
                return workspace.run_block(method, haptic, record)
        from hhsim.solver.backend_programs import run_block_with_backend

        assert isinstance(method, Coupled)
        return run_block_with_backend(workspace, method, haptic, record)
