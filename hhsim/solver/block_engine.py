"""Engine of `paper` and `penalty`, whose ticks are compiled for one hand at one object that stands still."""

from collections.abc import Callable
from typing import Any

from hhsim.kernels.tick.block import HapticBlock, TickRecord, run_block
from hhsim.kernels.tick.paper import PAPER_STATE, Paper, begin_paper
from hhsim.kernels.tick.penalty import PENALTY_STATE, Penalty, PenaltyOptions
from hhsim.kernels.world.record import WorldRecord
from hhsim.solver.workspace import TickWorkspace, of_hands, zeroed


class BlockEngine:
    """Runs the ticks of a compiled method for a hand alone; `begin` puts its own state to the graphic hand."""

    def __init__(self, workspace: TickWorkspace, method: Any, begin: Callable[[], None]) -> None:
        self.workspace, self.method, self.begin = workspace, method, begin

    def call(self, haptic: HapticBlock, record: TickRecord, bodies: WorldRecord) -> tuple[Any, tuple[Any, ...]]:
        """See `WorldEngine.call`."""
        space, rows = self.workspace, (of_hands(haptic, 0), of_hands(record, 0))
        return run_block, (self.method, space.hand, space.code, space.states, space.qp, *rows)

    def run(self, haptic: HapticBlock, record: TickRecord, bodies: WorldRecord) -> int:
        """See `Engine.run`."""
        kernel, arguments = self.call(haptic, record, bodies)
        return int(kernel(*arguments))


def paper_engine(workspace: TickWorkspace) -> BlockEngine:
    """Make the engine of `paper`, the baseline of every table, which begins at any configuration."""
    work = zeroed(PAPER_STATE)
    work[0].closed = workspace.options.frustum_ends == "spheres"
    method = Paper(workspace.tick_options, workspace.model.palm_tree.arrays(), workspace.surface, work)
    return BlockEngine(workspace, method, lambda: begin_paper(workspace.hand, workspace.states, work))


def penalty_engine(workspace: TickWorkspace) -> BlockEngine:
    """Make the engine of `penalty`, what the field uses where it does not optimise; the hand begins at rest."""
    options, work = workspace.options, zeroed(PENALTY_STATE)
    dynamics = PenaltyOptions(
        period=options.period,
        response=options.response,
        stiffness=options.stiffness.penalty,
        damping=options.stiffness.penalty * options.contact_response,
    )

    def begin() -> None:
        work[0].velocity[:] = 0.0
        workspace.gather()

    return BlockEngine(workspace, Penalty(workspace.tick_options, dynamics, work), begin)
