"""The lines that a session shows of itself while it runs."""

import importlib

import numpy as np
import pytest

from hhsim.live.ipc.status import LIVE_STATUS
from hhsim.live.session.statistics import LiveTally

NOW = 20_000_000_000


@pytest.mark.parametrize(
    ("sample", "text"),
    [
        (-1, "no sample yet"),
        (NOW + 900_000, "last sample 0 ms ago"),
        (NOW - 4_200_000, "last sample 4 ms ago"),
        (NOW - 9_999_999_999, "last sample 10,000 ms ago"),
        (NOW - 12_000_000_000, "last sample 12 s ago"),
    ],
)
def test_the_age_of_the_last_sample_is_never_negative(sample: int, text: str) -> None:
    status = np.zeros((), LIVE_STATUS)
    status["ticks"], status["battery"], status["sample_ns"] = 1000, -1, sample
    status_rows = importlib.import_module("hhsim.cli.live.status_line").status_rows
    assert dict(status_rows(status, LiveTally(), "", NOW))["glove"] == f"battery —, {text}"
