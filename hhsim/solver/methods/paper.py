"""`paper`: the method as printed, the baseline of every table."""

from typing import TYPE_CHECKING

from hhsim.solver.method import Method

if TYPE_CHECKING:
    from hhsim.kernels.tick.block import HapticBlock, TickRecord
    from hhsim.solver.workspace import TickWorkspace


class PaperEngine:
    """Keeps the Euler angles and the walk of both trees besides the tick's state."""

    def __init__(self, workspace: "TickWorkspace") -> None:
        from hhsim.kernels.tick.paper import PAPER_STATE, Paper
        from hhsim.solver.workspace import zeroed

        work = zeroed(PAPER_STATE)
        work[0].closed = workspace.options.frustum_ends == "spheres"
        self.workspace = workspace
        self.method: Paper = Paper(workspace.tick_options, workspace.model.palm_tree.arrays(), workspace.surface, work)

    def begin(self) -> None:
        """See `Engine.begin`; any configuration will do."""
        from hhsim.kernels.tick.paper import begin_paper

        begin_paper(self.workspace.hand, self.workspace.states, self.method.work)

    def run(self, haptic: "HapticBlock", record: "TickRecord") -> int:
        """See `Engine.run`."""
        return self.workspace.run_block(self.method, haptic, record)


METHOD = Method(
    summary="the paper's way as printed",
    engine=PaperEngine,
    refuses_surfaces="the paper's constraints are between frustums and spheres",
    defaults={"force": "paper", "linearisations": 1, "margin": 5e-4},
)
"""Defaults as printed: forces by Eq. 14, one linearisation a tick, Δr = 0.5 mm."""
