"""Latency by the peer's clock, against sessions whose truth is known."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hhsim.live.simulators.round_trip import BEFORE, added_latencies


@given(st.integers(0, 2**32), st.integers(1, 200), st.floats(100.0, 1000.0))
def test_it_is_the_time_from_each_sample_to_its_first_command(seed: int, samples: int, rate: float) -> None:
    random = np.random.default_rng(seed)
    sent = (np.arange(samples) * 1e9 / rate + random.uniform(0, 1e5, samples)).astype(np.int64)
    ticks = np.arange(0, int(sent[-1]) + 5_000_000, 1_000_000) + random.integers(0, 300_000)
    newest = np.searchsorted(sent + 20_000, ticks, side="right") - 1
    first = np.diff(newest, prepend=-1) > 0
    done = ticks + random.integers(50_000, 400_000, ticks.size)
    received = done + random.integers(-BEFORE, 60_000, ticks.size)
    got = added_latencies(sent, received, done[first], newest[first])
    np.testing.assert_array_equal(got, received[first] - sent[newest[first]])


def test_commands_that_never_came_and_samples_nobody_sent_are_left_out() -> None:
    assert added_latencies([], [], [], []).size == 0
    assert added_latencies([1000], [5000], [4000], [1]).size == 0
    assert added_latencies([1000], [5000], [40_000], [0]).size == 0
    assert added_latencies([1000, 2000], [25_000, 90_000], [24_000, 70_000], [0, 1]).tolist() == [24_000, 88_000]


def test_a_doubt_makes_it_longer() -> None:
    # The first command is lost: the next one is taken, never the one before.
    received = [1_000_000, 3_000_000]
    assert added_latencies([1_500_000], received, [2_000_000], [0]).tolist() == [1_500_000]
