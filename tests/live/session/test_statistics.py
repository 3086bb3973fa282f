"""Figures of a session from the ring of its ticks, against the ticks that were put there."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from live_rings import pour

from hhsim.live.processes import SharedRing, ring_type
from hhsim.live.session.memory import LIVE_TICK
from hhsim.live.session.statistics import LiveTally
from hhsim.result.safety import Safety


def ring_of(ticks: np.ndarray) -> SharedRing:
    ring = SharedRing(np.zeros(1, ring_type(LIVE_TICK, 64)))
    pour(ring, ticks)
    return ring


def made(seed: int, count: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    ticks = np.zeros(count, LIVE_TICK)
    ticks["wakeup_ns"] = random.integers(10_000, 200_000, count)
    ticks["missed"] = random.integers(0, 3, count)
    ticks["input_seq"] = np.cumsum(random.integers(0, 3, count)) - 1
    new = np.diff(ticks["input_seq"], prepend=-1) > 0
    ticks["latency_ns"] = np.where(new, random.integers(50_000, 900_000, count), -1)
    ticks["safety"] = random.integers(0, 2, count) * int(Safety.STALE_INPUT)
    ticks["total"] = random.normal(size=(count, 3))
    ticks["command_stiffness"][:, 1] = random.integers(0, 2, count) * 0.3
    ticks["work"] = random.integers(0, 4, ticks["work"].shape)
    return ticks


@given(st.integers(0, 2**32), st.integers(1, 60), st.integers(0, 60))
def test_everything_is_counted_once_however_the_ticks_come(seed: int, count: int, split: int) -> None:
    ticks = made(seed, count)
    ring = ring_of(ticks[:split])
    tally = LiveTally(ring)
    tally.read()
    pour(ring, ticks[split:])
    tally.read()
    tally.read()
    assert (tally.ticks, tally.lost) == (count, 0)
    assert tally.missed == ticks["missed"].sum()
    assert tally.new_samples == (ticks["latency_ns"] >= 0).sum() == tally.latency.count
    # Every sample up to the newest one was used or superseded.
    assert tally.new_samples + tally.superseded == ticks["input_seq"][-1] + 1
    assert tally.free_for[Safety.STALE_INPUT] == tally.freed == (ticks["safety"] > 0).sum()
    assert tally.free_for[Safety.DEVICE_LOST] == 0
    assert tally.stiff == (ticks["command_stiffness"][:, 1] > 0).sum()
    assert tally.force_max == np.linalg.norm(ticks["total"], axis=1).max()
    assert abs(tally.wakeup.percentile(100) - ticks["wakeup_ns"].max()) <= 0.002 * ticks["wakeup_ns"].max()
    assert tally.figures()["ticks"] == count


def test_the_rate_is_that_of_late() -> None:
    tally = LiveTally(ring_of(np.zeros(0, LIVE_TICK)))
    assert tally.rate == 0.0
    tally.note(0, 10**9)
    assert tally.rate == 0.0
    tally.note(50, 10**9 + 5 * 10**7)
    assert tally.rate == 1000.0
    # What is long ago does not count: half the ticks in the last second.
    tally.note(100, 10**9 + 4 * 10**9)
    assert tally.rate == 0.0
    tally.note(600, 10**9 + 5 * 10**9)
    assert tally.rate == 500.0
