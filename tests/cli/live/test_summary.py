"""The table that a live session ends with."""

from pathlib import Path

import pytest

from cli.live.summary import summary_rows
from hhsim.live.device import DeviceCounters
from hhsim.live.session.statistics import LiveTally
from hhsim.live.session.supervisor import SessionOutcome


@pytest.mark.parametrize(
    ("recorded", "failed", "handless"),
    [(6, "", "3"), (9, "", None), (6, "the recording stopped: the disk is full", None)],
)
def test_every_tick_is_recorded_lost_or_had_no_hand(
    recorded: int, failed: str, handless: str | None, tmp_path: Path
) -> None:
    outcome = SessionOutcome(
        reason="duration",
        seconds=0.01,
        ticks=10,
        missed=0,
        tally=LiveTally(),
        facts={},
        counters=DeviceCounters(),
        record=tmp_path / "none.h5",
        recorded=recorded,
        record_lost=1,
        record_failed=failed,
    )
    rows = {label: value for label, value, _ in summary_rows(outcome)}
    assert rows["ticks recorded, lost"] == f"{recorded}, 1"
    assert rows.get("ticks without a hand, not recorded") == handless
