"""Long runs, cut short: everything is accounted for, and what is not is found."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sampled import sampled

from hhsim.live.real_time import RealTimeWishes
from hhsim.live.session.supervisor import SessionOutcome
from hhsim.result.reader import Result
from tools.soak import BEFORE, SoakFigures, added_latencies, figures, make_setup, soak, table
from tools.soak_peers import PEERS, PeerSeen, places_of


@given(st.integers(0, 2**32), st.integers(1, 60), st.floats(0.0, 0.3))
def test_rows_that_were_read_are_found_among_those_that_were_sent(seed: int, count: int, loss: float) -> None:
    random = np.random.default_rng(seed)
    # Few values, so that rows come again.
    sent = np.cumsum(random.integers(0, 2, (count, 2)), axis=0)
    kept = np.sort(random.choice(count, max(1, round(count * (1.0 - loss))), replace=False))
    places = places_of(sent, sent[kept])
    np.testing.assert_array_equal(sent[places], sent[kept])
    assert (np.diff(places) > 0).all()


@pytest.mark.soak
@pytest.mark.parametrize("device", sampled(["dexmo", "opengloves", "udp"], lambda place, device: device == "dexmo"))
def test_a_short_run_accounts_for_everything_and_finds_what_is_missing(
    device: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    accounted: list[tuple[str, SessionOutcome, Result, PeerSeen]] = []

    def kept(device: str, outcome: SessionOutcome, result: Result, seen: PeerSeen, *, again: bool) -> SoakFigures:
        accounted.append((device, outcome, result, seen))
        return figures(device, outcome, result, seen, again=again)

    monkeypatch.setattr("tools.soak.figures", kept)
    kind = PEERS[device]
    with kind(tmp_path, kind.usual_rate, 3) as peer:
        setup = make_setup(peer.config, "cube", tmp_path / "run.h5", 1.5, RealTimeWishes())
        run = soak(peer, setup)
    assert run.frames_lost == 0
    assert run.frames_sent == run.frames_decoded + run.frames_left
    assert 0 < run.samples_used <= run.ticks
    assert run.ticks + run.missed >= 1_490
    assert run.commands_received >= run.commands_sent - 1
    assert run.latencies >= 0.9 * run.samples_used
    # No sample can come out before it was sent.
    assert 0.0 < run.latency_p50 <= run.latency_p99 <= run.latency_max
    assert (run.penetration_max, run.identical, run.recorder_lost) == (0.0, True, 0)
    text = table([run])
    assert f"{run.frames_sent:,} / {run.frames_decoded:,}" in text
    # How late the machine is, and with it whether a finger was pressed long enough, is not for a test to judge.
    allowed = ("added latency", "no finger was ever", "frames were left")
    assert [line for line in run.missed_limits if not any(word in line for word in allowed)] == []
    ((_, outcome, result, seen),) = accounted
    hidden = replace(outcome, counters=replace(outcome.counters, frames=outcome.counters.frames - 3))
    found = figures(device, hidden, result, seen, again=False)
    assert found.frames_lost == 3
    assert "3 frames are not accounted for" in found.missed_limits
    deaf = replace(seen, received=seen.received[: len(seen.received) // 2])
    assert any("the glove got" in line for line in figures(device, outcome, result, deaf, again=False).missed_limits)


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
