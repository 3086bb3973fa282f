"""`progressive`: the paper's order, palm and then fingers, made safe."""

from typing import TYPE_CHECKING

from hhsim.solver.method import Method

if TYPE_CHECKING:
    from hhsim.solver.method import Engine
    from hhsim.solver.workspace import TickWorkspace


def _engine(workspace: "TickWorkspace") -> "Engine":
    from hhsim.kernels.tick.method import Progressive
    from hhsim.solver.linearising_engine import LinearisingEngine

    return LinearisingEngine(workspace, Progressive(workspace.tick_options))


METHOD = Method(
    summary="the paper's way made safe, first the palm, then each finger",
    engine=_engine,
    never_penetrates=True,
    follows_input=True,
    takes_threads=True,
)
