"""`coupled`: one program for the whole hand, converged, and no penetration by construction."""

from typing import TYPE_CHECKING

from hhsim.solver.method import Method

if TYPE_CHECKING:
    from hhsim.solver.method import Engine
    from hhsim.solver.workspace import TickWorkspace


def _engine(workspace: "TickWorkspace") -> "Engine":
    from hhsim.kernels.tick.method import Coupled
    from hhsim.solver.linearising_engine import LinearisingEngine

    return LinearisingEngine(workspace, Coupled(workspace.tick_options))


METHOD = Method(
    summary="one program for the whole hand",
    engine=_engine,
    never_penetrates=True,
    nearest_to_user=True,
    follows_input=True,
    takes_backends=True,
    takes_self_contact=True,
)
