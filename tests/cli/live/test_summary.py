"""What a live session prints at its end says how well its recording holds, as a replay's table does."""

import importlib
from dataclasses import replace
from pathlib import Path

import pytest
from short_grasp import short_grasp, short_result

from hhsim.live.device import DeviceCounters
from hhsim.live.session.statistics import LiveTally
from hhsim.live.session.supervisor import SessionOutcome
from hhsim.metrics.session_faults import FaultCounts
from hhsim.result.reader import Result
from hhsim.result.schema import FAULT, WARNING

summary = importlib.import_module("hhsim.cli.live.summary")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("session") / "session.h5", short_grasp(release=0.05))


def ended(record: Path | None, failed: str = "") -> SessionOutcome:
    recorded = 250 if record is not None else 0
    return SessionOutcome("duration", 0.25, 250, 0, LiveTally(), {}, DeviceCounters(), record, recorded, 0, failed)


def table(outcome: SessionOutcome) -> list[tuple[str, str, str]]:
    rows: list[tuple[str, str, str]] = summary.summary_rows(outcome, summary.judged(outcome)[1])
    return rows


def test_the_table_says_how_deep_the_recorded_hand_is(recording: Result) -> None:
    outcome = ended(recording.path)
    rows = {label: (shown, unit) for label, shown, unit in table(outcome)}
    assert rows["penetration in the recording, max"] == ("0.000", "µm")
    assert summary.summary_json(outcome)["penetration_max"] < 1e-9


@pytest.mark.parametrize(("recorded", "failed"), [(False, ""), (True, "the disk is full")])
def test_without_a_whole_recording_there_is_no_such_line(recording: Result, recorded: bool, failed: str) -> None:
    outcome = ended(recording.path if recorded else None, failed)
    assert not [label for label, _, _ in table(outcome) if "in the recording" in label]
    assert summary.summary_json(outcome)["penetration_max"] is None


@pytest.mark.parametrize(
    ("recorded", "failed", "handless"),
    [(6, "", "3"), (9, "", None), (6, "the recording stopped: the disk is full", None)],
)
def test_every_tick_is_recorded_lost_or_had_no_hand(
    recorded: int, failed: str, handless: str | None, tmp_path: Path
) -> None:
    outcome = replace(ended(tmp_path / "none.h5", failed), ticks=10, recorded=recorded, record_lost=1)
    rows = {label: value for label, value, _ in table(outcome)}
    assert rows["ticks recorded, lost"] == f"{recorded}, 1"
    assert rows.get("ticks without a hand, not recorded") == handless


def test_the_end_says_in_a_line_what_went_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    outcome = replace(
        ended(None),
        counters=DeviceCounters(frames=60, malformed=2),
        notices=[(0.1, WARNING, "late"), (0.2, FAULT, "the glove is gone")],
    )
    outcome.tally.ticks, outcome.tally.freed = 250, 10
    assert summary.judged(outcome)[0] == FaultCounts(0, 1, 2, 60, 10, 250)
    summary.print_summary(outcome, "a session")
    assert summary.judged(outcome)[0].line in capsys.readouterr().out.splitlines()
    assert summary.summary_json(outcome)["freed_share"] == 4.0
    # Of a loop that was killed nobody may have told.
    assert summary.judged(replace(outcome, notices=[], loop_failed="SIGKILL"))[0][:2] == (1, 1)
