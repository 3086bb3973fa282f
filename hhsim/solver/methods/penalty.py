"""`penalty`: spring-dampers at the contacts and no program: what the field uses where it does not optimise."""

from typing import TYPE_CHECKING

from hhsim.solver.method import Method

if TYPE_CHECKING:
    from hhsim.kernels.tick.block import HapticBlock, TickRecord
    from hhsim.solver.workspace import TickWorkspace


class PenaltyEngine:
    """Keeps the virtual mass's velocity besides the tick's state."""

    def __init__(self, workspace: "TickWorkspace") -> None:
        from hhsim.kernels.tick.penalty import PENALTY_STATE, Penalty, PenaltyOptions
        from hhsim.solver.workspace import zeroed

        options = workspace.options
        dynamics = PenaltyOptions(
            period=options.period,
            response=options.response,
            stiffness=options.stiffness.penalty,
            damping=options.stiffness.penalty * options.contact_response,
        )
        self.workspace = workspace
        self.method: Penalty = Penalty(workspace.tick_options, dynamics, zeroed(PENALTY_STATE))

    def begin(self) -> None:
        """See `Engine.begin`; the hand begins at rest."""
        self.method.work[0].velocity[:] = 0.0
        self.workspace.gather()

    def run(self, haptic: "HapticBlock", record: "TickRecord") -> int:
        """See `Engine.run`."""
        return self.workspace.run_block(self.method, haptic, record)


METHOD = Method(
    summary="spring-dampers at the contacts and no program",
    engine=PenaltyEngine,
    refuses_surfaces="its springs let the hand sink in, and triangles have no depth",
)
