"""A session with free objects: its ticks are a replay's, its world waits out a stall, and its file holds all of it."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from body_tables import body, body_file
from live_scripted import CLOSING, FIST, FREE, Moment, ScriptedSession

from hhsim.hand.model import HandModel
from hhsim.kernels.tick.state import STATUS_START_INSIDE
from hhsim.live.gloves import PoseConfig, configure
from hhsim.live.session.loop import loop_options
from hhsim.live.session.recorder import SessionRows, SessionWriter
from hhsim.live.session.setup import OutputLimits, make_live_scene
from hhsim.metrics.run.registry import tick_figures
from hhsim.metrics.run_ticks import result_ticks
from hhsim.replay.repeat import run_again
from hhsim.result.reader import Result, load_result
from hhsim.result.safety import Safety
from hhsim.result.schema import CONTACT_COLUMNS, FREE_COLUMNS
from hhsim.scene.body import CLEARANCE
from hhsim.scene.declared_bodies import load_object
from hhsim.scene.scene import tree_maker
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import bodies_ticks
from hhsim.verify.free_object_checks import free_claims
from hhsim.verify.verify import verify
from tools.shapes.generators import sphere

MILLISECOND = 1_000_000
BALL = sphere(0.06, 1)
BALL = replace(BALL, vertices=BALL.vertices + np.array([0.0, 0.05, -0.05]))
"""Before the fingers of a flat hand at the origin; a fist closes on it."""
FALLING: dict[str, Any] = {"mass": 0.1, "friction": 0.8, "torsion": 5e-3}
ON_TABLE = {**FALLING, "table": float(BALL.bounds[0, 2]) - CLEARANCE}
TOUCHING = [*CLOSING, *[Moment(FIST)] * 40]


class Session(ScriptedSession):
    """A loop with a free object that has run a script to its end."""

    def __init__(
        self, script: Sequence[Moment] = TOUCHING, free: dict[str, Any] = ON_TABLE, oversleep: Sequence[int] = ()
    ) -> None:
        super().__init__(script, mesh=BALL, free=free, options=SolverOptions(surface="mesh"))
        self.clock.oversleep.extend(oversleep)
        self.run()
        self.object = bodies_ticks(self.ticks).bodies[0]


@pytest.fixture(scope="module")
def session() -> Session:
    return Session()


@pytest.fixture(scope="module")
def result(session: Session, tmp_path_factory: pytest.TempPathFactory) -> Result:
    return session.recorded(tmp_path_factory.mktemp("session") / "session.h5")


def test_the_world_waits_out_a_stall_which_frees_the_fingers() -> None:
    stalled = Session([Moment(FREE)] * 60, FALLING, oversleep=[0] * 30 + [14 * MILLISECOND])
    missed = stalled.ticks["missed"]
    at = int(missed.argmax())
    assert missed[at] == 14 and missed.sum() == 14
    assert stalled.ticks["safety"][at] & Safety.OVERRUN_STREAK
    # A tick of the fall a tick, however long the wait before it.
    speed = 9.81e-3 * np.arange(1, len(stalled.ticks) + 1)
    np.testing.assert_allclose(stalled.object.velocity[:, 2], -speed, rtol=1e-9)
    way = np.diff(stalled.object.shift[:, 2])
    np.testing.assert_allclose(way, -1e-3 * speed[1:], rtol=1e-6)


def test_the_file_holds_what_a_replays_does_and_runs_again(session: Session, result: Result) -> None:
    assert result.complete and result.body.is_free and result.frame and result.live is not None
    stored = session.setup.scene.solids[0].properties(session.setup.scene.plane)
    assert result.body.properties["mass"] == stored["mass"] and result.body.properties["table"] == stored["table"]
    assert "Saxcé" in result.scene["friction_law"]
    assert set(FREE_COLUMNS) <= set(result.body.columns)
    assert {f"contact/{column.name}" for column in CONTACT_COLUMNS} <= set(result.keys())
    np.testing.assert_array_equal(np.bincount(result["contact/tick"], minlength=101), np.diff(session.object.contact))
    np.testing.assert_array_equal(result.body["velocity"], session.object.velocity)
    np.testing.assert_array_equal(result["haptic/position"], session.ticks["haptic_position"])
    assert result["penetration_depth"].max() == 0.0
    again = run_again(result)
    assert again.identical and (again.ticks, again.notes) == (101, ())
    assert session.object.contact[-1] > 0 and np.linalg.norm(session.object.velocity[-1]) > 0.01
    assert {f"{result.body.group}/tick/position", "contact/slip"} <= {array.name for array in again.arrays}
    figures = tick_figures(result_ticks(result))
    assert figures["cone_outside"] == figures["table_depth_max"] == 0.0 and figures["object_momentum"] < 1e-6


def test_a_session_that_begins_inside_runs_again_bit_for_bit(tmp_path: Path) -> None:
    session = Session(TOUCHING[40:])
    assert session.ticks["status"][0] & STATUS_START_INSIDE
    assert run_again(session.recorded(tmp_path / "inside.h5")).identical


def test_columns_are_the_same_bytes_however_many_ticks_come_at_a_time(session: Session) -> None:
    whole, parts = (SessionRows(session.setup, session.setup.options, 1) for _ in range(2))
    sizes = [0, 1, 3, 60, len(session.ticks)]
    blocks = [parts.block(a, a, [session.ticks[a:b]], 0) for a, b in pairwise(sizes)]
    for of, one in whole.block(0, 0, [session.ticks], 0).items():
        for name, values in one.items():
            assert values.tobytes() == np.concatenate([block[of][name] for block in blocks]).tobytes(), name


def test_the_referee_judges_no_motion_across_lost_ticks(session: Session, result: Result, tmp_path: Path) -> None:
    assert not [claim for claim in free_claims(result) if claim.failed]
    path, setup, status = tmp_path / "lossy.h5", session.setup, session.memory.status
    facts = session.both.driver.facts() | {"real_time": {}}
    with SessionWriter(path, setup, loop_options(setup.options, setup.rate), facts) as writer:
        for begin, end in ((0, 70), (75, 101)):
            writer.write([{"ticks": (begin, session.ticks[begin:end])}], status["counters"])
        writer.complete("duration", status["counters"], 0, {})
    lossy = load_result(path)
    assert lossy.ticks == 96 and not [claim for claim in free_claims(lossy) if claim.failed]
    assert tick_figures(result_ticks(lossy))["object_momentum"] < 1e-6


BODIES = (
    body("ball", [0.04, 0.04, 0.04], position=[0.0, 0.05, -0.05], mass=0.1),
    body("post", [0.02, 0.02, 0.06], position=[0.1, 0.05, -0.05], fixed=True),
)


@pytest.fixture(scope="module")
def beside_others(tmp_path_factory: pytest.TempPathFactory) -> Result:
    folder = tmp_path_factory.mktemp("bodies")
    bodies = load_object(body_file(folder, *BODIES)).with_trees(tree_maker(2))
    scene = make_live_scene(bodies, HandModel.default(), configure(), PoseConfig(), None, placed=True)
    moments = [Moment(FREE + (FIST - FREE) * i / 40) for i in range(60)]
    more = {"options": SolverOptions(surface="mesh"), "output": OutputLimits(ramp=0.02)}
    return ScriptedSession(moments, scene=scene.scene, record=folder / "session.h5", **more).run().recorded()


def test_all_bodies_are_in_the_file(beside_others: Result) -> None:
    assert list(beside_others.bodies) == ["ball", "post"] and beside_others.complete and beside_others.ticks > 50
    ball, post = beside_others.bodies.values()
    # It falls, since nothing is under it, into the fist.
    assert ball["velocity"][5, 2] < -0.05 and ball["hand_wrench"].any() and not np.ptp(post["position"], axis=0).any()
    assert (ball.kind, post.kind) == ("free", "fixed") and "body_wrench" in post


def test_it_runs_again_bit_for_bit_and_every_claim_holds(beside_others: Result) -> None:
    again = run_again(beside_others)
    assert again.identical and again.ticks == beside_others.ticks
    assert "bodies/post/tick/position" in {array.name for array in again.arrays}
    assert verify(beside_others).passed
