"""`progressive`: the paper's order, palm and then fingers, made safe."""

from hhsim.solver.method import Method
from hhsim.solver.methods.coupled import world_engine

METHOD = Method(
    summary="the paper's way made safe, first the palm, then each finger",
    engine=world_engine,
    never_penetrates=True,
    follows_input=True,
    takes_threads=True,
)
