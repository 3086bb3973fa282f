"""Long runs, cut short: everything is accounted for, and what is not is found."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.errors import HhsimError
from hhsim.live.ipc.config import RealTimeWishes
from hhsim.live.session.supervisor import Supervisor
from hhsim.live.simulators.soak import figures, make_setup, soak, table
from hhsim.live.simulators.soak_peers import PEERS, places_of
from hhsim.result.reader import load_result


@given(st.integers(0, 2**32), st.integers(1, 60), st.floats(0.0, 0.3))
def test_rows_that_were_read_are_found_among_those_that_were_sent(seed: int, count: int, loss: float) -> None:
    random = np.random.default_rng(seed)
    # Few values, so that rows come again.
    sent = np.cumsum(random.integers(0, 2, (count, 2)), axis=0)
    kept = np.sort(random.choice(count, max(1, round(count * (1.0 - loss))), replace=False))
    places = places_of(sent, sent[kept])
    np.testing.assert_array_equal(sent[places], sent[kept])
    assert (np.diff(places) > 0).all()


def test_rows_that_were_never_sent_are_noticed() -> None:
    sent = np.arange(20).reshape(10, 2)
    with pytest.raises(HhsimError, match="from sample 3 on"):
        places_of(sent, np.concatenate([sent[2:5], [[0, 0]], sent[5:]]))
    with pytest.raises(HhsimError, match="from sample 0 on"):
        places_of(sent, np.array([[7, 7]]))


@pytest.mark.parametrize("device", ["dexmo", "opengloves"])
def test_a_short_run_accounts_for_everything(device: str, tmp_path: Path) -> None:
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


def test_what_is_missing_is_found(tmp_path: Path) -> None:
    with PEERS["udp"](tmp_path, 500.0, 3) as peer:
        setup = make_setup(peer.config, "cube", tmp_path / "run.h5", 0.5, RealTimeWishes())
        with Supervisor(setup) as session:
            while session.poll():
                pass
        outcome = session.end()
        result = load_result(tmp_path / "run.h5")
        seen = peer.seen(result)
    assert figures("udp", outcome, result, seen, again=False).frames_lost == 0
    hidden = replace(outcome, counters=replace(outcome.counters, frames=outcome.counters.frames - 3))
    found = figures("udp", hidden, result, seen, again=False)
    assert found.frames_lost == 3
    assert "3 frames are not accounted for" in found.missed_limits
    deaf = replace(seen, received=seen.received[: len(seen.received) // 2])
    assert any("the glove got" in line for line in figures("udp", outcome, result, deaf, again=False).missed_limits)
