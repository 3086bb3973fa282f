"""What went wrong in a session is counted by its file alone, and a session that was killed is a fault."""

import importlib
from pathlib import Path

import numpy as np
import pytest
from live_rings import make_setup, session_file, solved_ticks
from sealed_change import changed

from hhsim.errors import DamagedFileError
from hhsim.live.device import DeviceCounters
from hhsim.live.session.recorder import LOOP_DIED
from hhsim.live.session.statistics import LiveTally
from hhsim.live.session.supervisor import SessionOutcome
from hhsim.metrics.session_faults import FaultCounts, broken_off, ended_before_its_time, recorded_faults
from hhsim.result.reader import Result, load_result
from hhsim.result.safety import Safety
from hhsim.result.schema import FAULT, INFORMATION, WARNING

FRAMES, MALFORMED, FREED = 50, 3, 20


@pytest.fixture(scope="module")
def ticks(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    return solved_ticks(make_setup(tmp_path_factory.mktemp("ticks") / "none.h5"))


def recorded(path: Path, ticks: np.ndarray, ended: str, *levels: int) -> Result:
    ticks = ticks.copy()
    ticks["safety"] = 0
    ticks["safety"][:FREED] = int(Safety.DEVICE_LOST | Safety.STALE_INPUT)
    ticks["safety"][-FREED:] = int(Safety.STOPPING)
    events = [(0, level, "the glove is gone") for level in levels]
    return session_file(path, ticks, ended, events, frames=FRAMES, malformed=MALFORMED)


@pytest.mark.parametrize(
    ("ended", "levels", "early", "faults"),
    [
        ("duration", (INFORMATION, WARNING), 0, 0),
        ("SIGTERM", (FAULT, FAULT), 0, 2),
        # Killed by kill -9: nobody was left to log it.
        (LOOP_DIED, (INFORMATION,), 1, 1),
        (LOOP_DIED, (FAULT, FAULT), 1, 2),
        ("", (), 1, 1),
    ],
)
def test_an_end_that_was_not_in_order_is_a_fault(
    tmp_path: Path, ticks: np.ndarray, ended: str, levels: tuple[int, ...], early: int, faults: int
) -> None:
    session = recorded(tmp_path / "session.h5", ticks, ended, *levels)
    counts = recorded_faults(session)
    assert counts == FaultCounts(early, faults, MALFORMED, FRAMES, FREED, len(ticks))
    assert counts.figures == {
        "ended_early": early,
        "faults": faults,
        "malformed_share": 100.0 * MALFORMED / FRAMES,
        "freed_share": 100.0 * FREED / len(ticks),
    }
    assert f"faults: {faults}{' (ended early)' if early else ''}; malformed packets: 3 of 50;" in counts.line
    assert f"freed for safety: {FREED} of {len(ticks)}" in counts.line
    assert bool(broken_off(session)) == bool(early)


@pytest.mark.parametrize(
    ("ended", "asked", "early", "told"),
    [
        ("the command was killed", 30.0, True, "the command was killed after 0.7 of 30 s"),
        ("the command was killed", None, True, "the command was killed"),
        ("SIGTERM", 30.0, True, "ended by SIGTERM after 0.7 of 30 s"),
        ("SIGTERM", None, False, ""),
        ("stopped", 30.0, False, "stopped after 0.7 of 30 s"),
        ("duration", 0.7, False, ""),
    ],
)
def test_a_session_that_its_user_did_not_stop_has_to_last_as_long_as_was_asked(
    tmp_path: Path, ticks: np.ndarray, ended: str, asked: float | None, early: bool, told: str
) -> None:
    session = recorded(tmp_path / "session.h5", ticks, ended)
    session.scene["duration"] = asked
    assert recorded_faults(session).early == early
    assert (broken_off(session) or ended_before_its_time(session)) == told


def test_what_a_damaged_file_does_not_tell_is_undefined_and_the_rest_is_told(tmp_path: Path, ticks: np.ndarray) -> None:
    path = tmp_path / "session.h5"
    recorded(path, ticks, "duration")
    with changed(path) as file:
        file["hands/right/live"].attrs["counters"] = "no JSON"
    counts = recorded_faults(load_result(path))
    assert np.isnan([counts.malformed, counts.frames, counts.figures["malformed_share"]]).all()
    assert (counts.faults, counts.freed) == (0, FREED)
    assert "malformed packets: — of —" in counts.line


def test_a_live_session_says_at_its_end_what_its_recording_says(tmp_path: Path, ticks: np.ndarray) -> None:
    session = recorded(tmp_path / "session.h5", ticks, LOOP_DIED)
    told = [(0.1, FAULT, "the loop was killed"), (0.2, FAULT, "which the file cannot know")]
    outcome = SessionOutcome("SIGKILL", 0.7, 700, 0, LiveTally(), {}, DeviceCounters(), session.path, 700, notices=told)
    summary = importlib.import_module("hhsim.cli.live.summary")
    assert summary.judged(outcome)[0] == recorded_faults(session)
    assert summary.summary_json(outcome)["faults"] == 1


def test_levels_that_are_no_numbers_are_named(tmp_path: Path, ticks: np.ndarray) -> None:
    path = tmp_path / "words.h5"
    recorded(path, ticks, "duration", FAULT)
    with changed(path) as file:
        count = len(file["hands/right/live/event/level"])
        del file["hands/right/live/event/level"]
        file["hands/right/live/event/level"] = np.full(count, b"2")
    with pytest.raises(DamagedFileError, match="live/event/level"):
        recorded_faults(load_result(path))
