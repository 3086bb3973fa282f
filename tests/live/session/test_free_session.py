"""A session with a free object: its ticks are a replay's, its world waits out a stall, and its file holds all of it."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from live_scripted import CLOSING, FIST, FREE, Moment, ScriptedSession

from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_START_INSIDE
from hhsim.kernels.world.record import WorldRecord
from hhsim.live.session.loop import loop_options
from hhsim.live.session.recorder import SessionRows
from hhsim.metrics.run.registry import tick_figures
from hhsim.metrics.run_ticks import result_ticks
from hhsim.replay.repeat import run_again
from hhsim.result.reader import Result, load_result
from hhsim.result.safety import Safety
from hhsim.result.schema import CONTACT_COLUMNS, FREE_COLUMNS
from hhsim.scene.body import CLEARANCE
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.solver.scene_solver import bodies_ticks
from hhsim.verify.free_object_checks import free_claims
from tools.shapes.generators import sphere

MILLISECOND = 1_000_000
TIMINGS = {"duration", "duration_total", "duration_cpu"}
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
        self.object, _ = bodies_ticks(self.ticks)

    def again(self) -> tuple[TickRecord, WorldRecord]:
        """The same ticks in one block, as a replay runs them."""
        setup = self.setup
        options = loop_options(setup.options, setup.rate)
        solver = HandSolver(
            setup.worn[0].model, setup.seen.surface("mesh"), options, setup.seen.free, setup.seen.others
        )
        haptic = (self.ticks[f"haptic_{name}"] for name in ("position", "orientation", "flexion", "abduction"))
        return solver.run(*haptic), solver.object_ticks


@pytest.fixture(scope="module")
def session() -> Session:
    return Session()


@pytest.fixture(scope="module")
def result(session: Session, tmp_path_factory: pytest.TempPathFactory) -> Result:
    return session.recorded(tmp_path_factory.mktemp("session") / "session.h5")


@pytest.mark.parametrize("inside", [False, True])
def test_the_ticks_are_those_of_a_replay_bit_for_bit(session: Session, inside: bool) -> None:
    session = Session(TOUCHING[40:]) if inside else session
    assert bool(session.ticks["status"][0] & STATUS_START_INSIDE) == inside
    hand, moved = session.again()
    for name in set(TickRecord._fields) - TIMINGS:
        np.testing.assert_array_equal(getattr(hand, name), session.ticks[name], err_msg=name)
    bearing = session.object.contact[-1]
    assert bearing == moved.contact[-1] > 0 and np.linalg.norm(session.object.velocity[-1]) > 0.001
    for name, own in session.object._asdict().items():
        theirs = getattr(moved, name)
        np.testing.assert_array_equal(own, theirs[: len(own)], err_msg=name)


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
    assert {f"{result.body.group}/tick/position", "contact/slip"} <= {array.name for array in again.arrays}
    figures = tick_figures(result_ticks(result))
    assert figures["cone_outside"] == figures["table_depth_max"] == 0.0 and figures["object_momentum"] < 1e-6


def test_columns_are_the_same_bytes_however_many_ticks_come_at_a_time(session: Session) -> None:
    whole, parts = (SessionRows(session.setup, session.setup.options, 1) for _ in range(2))
    sizes = [0, 1, 3, 60, len(session.ticks)]
    blocks = [parts.block(a, a, [session.ticks[a:b]], 0) for a, b in pairwise(sizes)]
    for of, one in whole.block(0, 0, [session.ticks], 0).items():
        for name, values in one.items():
            assert values.tobytes() == np.concatenate([block[of][name] for block in blocks]).tobytes(), name


def test_the_referee_judges_no_motion_across_lost_ticks(session: Session, tmp_path: Path) -> None:
    result = session.recorded(tmp_path / "session.h5")
    assert not [claim for claim in free_claims(result) if claim.failed]
    path = tmp_path / "lossy.h5"
    path.write_bytes(result.path.read_bytes())
    kept = np.delete(np.arange(101), slice(70, 75))
    with h5py.File(path, "r+") as file:
        tick = file["contact/tick"][()]
        rows = np.isin(tick, kept)
        renumbered = np.searchsorted(kept, tick[rows])
        hand, body = "hands/right", next(iter(file["bodies"]))
        ticks = ("tick", f"{hand}/tick", f"{hand}/live/tick", f"bodies/{body}/tick")
        for group, chosen in (*((name, kept) for name in ticks), ("contact", rows)):
            names: list[str] = []
            file[group].visititems(
                lambda name, item, names=names: names.append(name) if isinstance(item, h5py.Dataset) else None
            )
            for name in names:
                values = file[group][name][()][chosen]
                file[group][name].resize(len(values), axis=0)
                file[group][name][()] = values
        file["contact/tick"][()] = renumbered
    lossy = load_result(path)
    assert not [claim for claim in free_claims(lossy) if claim.failed]
    assert tick_figures(result_ticks(lossy))["object_momentum"] < 1e-6
