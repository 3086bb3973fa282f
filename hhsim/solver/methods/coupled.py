"""`coupled`: one program for the whole hand, converged, and no penetration by construction."""

from typing import TYPE_CHECKING

from hhsim.solver.method import Method

if TYPE_CHECKING:
    from hhsim.solver.method import Engine
    from hhsim.solver.workspace import TickWorkspace


def world_engine(workspace: "TickWorkspace") -> "Engine":
    """Make the engine of hands and bodies for a hand beside one object."""
    from hhsim.solver.world_engine import WorldEngine

    return WorldEngine(workspace, None)


METHOD = Method(
    summary="one program for the whole hand",
    engine=world_engine,
    never_penetrates=True,
    nearest_to_user=True,
    follows_input=True,
    takes_backends=True,
    takes_self_contact=True,
)
