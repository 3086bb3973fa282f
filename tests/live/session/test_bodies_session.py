"""A session beside several bodies: recorded as a replay of them, and run again bit for bit."""

from pathlib import Path

import numpy as np
import pytest
from body_tables import body, body_file
from live_scripted import FIST, FREE, Moment, ScriptedSession

from hhsim.hand.model import HandModel
from hhsim.live.gloves import PoseConfig, configure
from hhsim.live.session.setup import OutputLimits, make_live_scene
from hhsim.replay.repeat import run_again
from hhsim.result.reader import Result
from hhsim.scene.body import Fixed
from hhsim.scene.declared_bodies import load_object
from hhsim.scene.scene import tree_maker
from hhsim.solver.options import SolverOptions
from hhsim.verify.verify import verify

BODIES = (
    body("ball", [0.04, 0.04, 0.04], position=[0.0, 0.05, -0.05], mass=0.1),
    body("post", [0.02, 0.02, 0.06], position=[0.1, 0.05, -0.05], fixed=True),
)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    folder = tmp_path_factory.mktemp("bodies")
    bodies = load_object(body_file(folder, *BODIES)).with_trees(tree_maker(2))
    scene = make_live_scene(bodies, HandModel.default(), configure(), PoseConfig(), None, placed=True)
    moments = [Moment(FREE + (FIST - FREE) * i / 40) for i in range(60)]
    more = {"options": SolverOptions(surface="mesh"), "output": OutputLimits(ramp=0.02)}
    return ScriptedSession(moments, scene=scene.scene, record=folder / "session.h5", **more).run().recorded()


def test_all_bodies_are_in_the_file(result: Result) -> None:
    assert list(result.bodies) == ["ball", "post"] and result.complete and result.ticks > 50
    ball, post = result.bodies.values()
    # It falls, since nothing is under it, into the fist.
    assert ball["velocity"][5, 2] < -0.05 and ball["hand_wrench"].any() and not np.ptp(post["position"], axis=0).any()
    assert (ball.kind, post.kind) == ("free", "fixed") and "body_wrench" in post


def test_it_runs_again_bit_for_bit_and_every_claim_holds(result: Result) -> None:
    again = run_again(result)
    assert again.identical and again.ticks == result.ticks
    assert "bodies/post/tick/position" in {array.name for array in again.arrays}
    assert verify(result).passed


@pytest.mark.soak
def test_driven_bodies_stay_where_they_begin(tmp_path: Path) -> None:
    bodies = load_object("laptop").with_trees(tree_maker(2))
    scene = make_live_scene(bodies, HandModel.default(), configure(), PoseConfig(), None)
    (body,) = scene.scene.solids
    assert isinstance(body.motion, Fixed) and body.name == "laptop"
    assert len(body.mesh.faces) == sum(len(mesh.faces) for mesh in bodies.meshes.values())
