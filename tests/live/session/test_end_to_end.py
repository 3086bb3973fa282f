"""A session of real processes: what the loop did is in the file, and comes out of it again."""

import json
import time

import numpy as np
import pytest
from live_rings import SCRIPT, make_setup
from sphere_scenes import bumpy_ball

from hhsim.hand.model import HandModel
from hhsim.kernels.live.deadlines import LARGEST_SHIFT
from hhsim.live.gloves import PoseConfig, configure
from hhsim.live.real_time import RealTimeWishes
from hhsim.live.session.setup import LiveSetup, make_live_scene
from hhsim.live.session.supervisor import SessionOutcome, Supervisor
from hhsim.motion.trajectory import Trajectory
from hhsim.replay.repeat import run_again
from hhsim.result.reader import Result, load_result
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.scene.motion_catalogue import resolve_trajectory
from hhsim.scene.script import parse_script
from tools.shapes.generators import sphere

pytestmark = pytest.mark.soak
TICKS = 700
Ran = tuple[Result, SessionOutcome]


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    path = tmp_path_factory.mktemp("session") / "session.h5"
    hand = HandModel.default()
    scene = make_live_scene(
        DeclaredBodies.of_mesh(sphere(0.076, 3), bumpy_ball(200)),
        hand,
        configure("sim"),
        PoseConfig(kind="replay"),
        parse_script(SCRIPT, name="short", where="short"),
    )
    setup = LiveSetup(
        **scene._asdict(),
        options=make_setup(None).options,
        duration=0.001 * TICKS,
        real_time=RealTimeWishes(punctual=False, lock_memory=False, cpu=-1),
        record=path,
    )
    with Supervisor(setup) as supervisor:
        while supervisor.poll():
            time.sleep(0.02)
        outcome = supervisor.end()
    return load_result(path), outcome


def test_the_session_runs_again_to_the_same_bits(session: Ran) -> None:
    result, _ = session
    assert result.complete
    assert result["contacts/candidates"].max() > 0
    again = run_again(result)
    assert again.identical
    assert (again.ticks, again.notes) == (result.ticks, ())
    motion = resolve_trajectory(result.path)
    assert isinstance(motion, Trajectory) and motion.name == "session" and motion.sample_count > 10


def test_every_period_and_every_sample_is_accounted_for(session: Ran) -> None:
    result, outcome = session
    assert result.live is not None
    assert result.live["ended"] == "duration"
    period, missed = result["live/tick/period"], result["live/tick/missed"]
    np.testing.assert_array_equal(np.diff(period), 1 + missed[1:])
    # The last period is the one in which the loop woke.
    assert period[-1] >= TICKS - 1
    assert result.ticks == outcome.tally.ticks == outcome.recorded
    assert (outcome.record_failed, outcome.record_lost) == ("", 0)
    assert (result.summary["ticks"], result.summary["missed"]) == (result.ticks, outcome.missed)
    assert json.loads(result.live["real_time"]) == outcome.facts["real_time"]
    moved = np.diff(result["live/tick/deadline"] + result["live/tick/early"]) - 1_000_000 * np.diff(period)
    assert np.abs(moved).max() <= LARGEST_SHIFT * 1_000_000
    seq = result["live/sample/seq"]
    np.testing.assert_array_equal(seq, np.arange(len(seq)))
    counters = json.loads(result.live["counters"])
    assert counters["frames"] == counters["samples"] == len(seq)
    used = result["input_seq"]
    assert used.min() >= 0
    assert used.max() <= seq[-1]
    assert (np.diff(used) >= 0).all()
    for name in ("flexion", "abduction"):
        np.testing.assert_array_equal(result[f"haptic/{name}"], result[f"live/sample/{name}"][used])
