"""The recorder: what the rings held is in the file, and whatever happens to it, the file can be read."""

import json
import os
import signal
import subprocess
import threading
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import sampled
from file_faults import bare_datasets
from hypothesis import given
from hypothesis import strategies as st
from live_peers import until
from live_rings import BEGAN, CHANNELS, FACTS, ended, make_setup, numbered_samples, pour, session_process, solved_ticks
from numpy.typing import NDArray

from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.live import device
from hhsim.live.processes import LoopProcess, SharedRing, Stage, ring_type
from hhsim.live.session.memory import LIVE_TICK, TICK_CAPACITY, SessionMemory
from hhsim.live.session.recorder import CUT_SHORT, LOOP_DIED, Recorder
from hhsim.live.session.statistics import LiveTally
from hhsim.replay.repeat import run_again
from hhsim.result.reader import Result, load_result
from hhsim.result.safety import Safety
from hhsim.solver.options import SolverOptions
from hhsim.system.log_histogram import LogHistogram

Records = NDArray[Any]
COUNTERS = [1000, 140, 14, 3, 2, 1, 0, 699, 1]


@pytest.fixture(scope="module")
def ticks() -> Records:
    return solved_ticks(make_setup(None))


def recorded(
    path: Path, ticks: Records, samples: Records | None = None, options: SolverOptions | None = None
) -> Result:
    """A session whose rings held these records when the recorder came."""
    memory = SessionMemory.create()
    pour(memory.ticks, ticks)
    pour(memory.samples, numbered_samples(ticks) if samples is None else samples)
    memory.log(0, "the loop runs", BEGAN)
    memory.log(2, "Störung: " + "ö" * 200, BEGAN + 5)
    memory.status["counters"] = COUNTERS
    memory.status["missed"] = 7
    ended(memory, os.getpid())
    Recorder(make_setup(path, options), memory).run()
    assert memory.status["recorder_ticks"] == load_result(path).ticks
    return load_result(path)


@pytest.fixture(scope="module")
def session(ticks: Records, tmp_path_factory: pytest.TempPathFactory) -> Result:
    return recorded(tmp_path_factory.mktemp("session") / "session.h5", ticks)


def test_a_session_runs_again_to_the_same_bits(session: Result) -> None:
    again = run_again(session)
    assert again.identical
    assert (again.ticks, again.notes) == (700, ())
    assert session["contacts/candidates"].max() > 0


@pytest.mark.parametrize("method", sampled(["progressive", "paper", "penalty"], lambda place, method: place == 0))
def test_every_method_runs_again(tmp_path: Path, method: str) -> None:
    options = SolverOptions(method=method, threads=2 if method == "progressive" else 1)
    ticks = solved_ticks(make_setup(None, options))
    assert run_again(recorded(tmp_path / "session.h5", ticks, options=options)).identical


def test_every_dataset_states_its_units_and_meaning(session: Result) -> None:
    assert bare_datasets(session.path) == []


def test_every_tick_and_every_sample_good_or_not_is_in_the_file(session: Result, ticks: Records) -> None:
    samples = numbered_samples(ticks)
    assert session.complete and session.ticks == len(ticks)
    assert [session.scene[name] for name in ("rate", "object", "device", "seed")] == [1000.0, "ball", "sim", 3]
    assert session.scene["solver"]["period"] == 0.001
    np.testing.assert_allclose(session["time"], 0.001 * np.arange(700), atol=1e-15)
    expected = {
        **{f"haptic/{name}": ticks[f"haptic_{name}"] for name in HandConfiguration._fields},
        **{f"graphic/{name}": ticks[name] for name in HandConfiguration._fields},
        "input_seq": np.arange(700) // 5,
        "live/tick/record": np.arange(700),
        **{f"live/tick/{name}": ticks[name] for name in ("safety", "command_bend")},
        **{f"live/tick/{name}": ticks[f"{name}_ns"] for name in ("wakeup", "latency")},
        "live/tick/deadline": ticks["time_ns"],
        "live/sample/seq": np.arange(140),
        "live/sample/good": np.arange(140) % 10 != 9,
        "live/sample/channel": samples["channels"][:, : len(CHANNELS)],
        "live/sample/time": samples["time_ns"],
        **{f"live/sample/{name}": samples[name] for name in ("battery", "flexion", "abduction")},
    }
    for name, values in expected.items():
        np.testing.assert_array_equal(session[name], values, err_msg=name)


def test_the_file_says_how_the_session_was(session: Result) -> None:
    assert json.loads(session.live["device"]) == FACTS["device"]
    assert json.loads(session.live["real_time"]) == FACTS["real_time"]
    assert session.command == ("hhsim", "live", "glove")
    assert json.loads(session.live["counters"]) == dict(zip(device.COUNTERS, COUNTERS, strict=True))
    assert (session.live["ended"], session.live["pose"], session.live["dry_run"]) == ("duration", "fixed", 0)
    assert [session.live[f"lost_{ring}"] for ring in ("ticks", "samples", "events")] == [0, 0, 0]
    texts = [bytes(text).decode() for text in session["live/event/text"]]
    assert texts[0] == "the loop runs"
    assert texts[1] == "Störung: " + "ö" * 115
    np.testing.assert_array_equal(session["live/event/level"], [0, 2])
    assert abs(session.live["utc_offset"] + time.monotonic_ns() - time.time_ns()) < 60e9


def test_the_summary_is_that_of_all_ticks(session: Result, ticks: Records) -> None:
    summary = session.summary
    assert (summary["ticks"], summary["missed"], summary["lost_ticks"]) == (700, 7, 0)
    for name, values in (("wakeup", ticks["wakeup_ns"]), ("latency", ticks["latency_ns"][::5])):
        for label, percent in (("p50", 50.0), ("p99", 99.0), ("p999", 99.9)):
            exact = 1e-9 * np.percentile(values, percent, method="inverted_cdf")
            assert summary[f"{name}_{label}"] == pytest.approx(exact, rel=LogHistogram.RATIO - 1.0)
        assert summary[f"{name}_max"] == pytest.approx(1e-9 * values.max())
    assert summary["penetration_max"] == session["penetration_depth"].max()
    assert summary["kept_free_no_input_yet"] == 1
    assert summary["samples_used"] == 140


def test_a_hand_that_is_not_finite_is_recorded_and_hides_nothing(ticks: Records, tmp_path: Path) -> None:
    spoiled = ticks.copy()
    spoiled["joints"][650:] = np.nan
    spoiled["joints"][640] = ticks["joints"][0]
    spoiled["total"][650:] = np.nan
    result = recorded(tmp_path / "session.h5", spoiled)
    assert result.ticks == 700
    assert np.isfinite(result.summary["penetration_max"])
    assert np.isfinite(result.summary["force_max"])
    assert not run_again(result).identical


def test_what_was_overwritten_is_counted_and_told(ticks: Records, tmp_path: Path) -> None:
    """The ring goes round while the recorder does not look: what is left follows on nothing."""
    memory = SessionMemory.create()
    writer_saw: list[int] = []
    recorder = Recorder(make_setup(tmp_path / "session.h5"), memory)
    pour(memory.ticks, ticks[:600])
    memory.facts.write(FACTS)
    memory.status["loop_pid"] = os.getpid()
    wait = recorder._loop.wait

    def late(timeout: float = 0.0, other: LoopProcess | None = None) -> None:
        """Stay away for longer than the ring lasts, once."""
        if timeout and not writer_saw:
            writer_saw.append(int(memory.status["recorder_ticks"]))
            filler = np.repeat(ticks[600:601], TICK_CAPACITY)
            filler["tick"] = np.arange(600, 600 + TICK_CAPACITY)
            pour(memory.ticks, filler)
            pour(memory.ticks, ticks[:10])
            pour(memory.samples, numbered_samples(ticks))
            ended(memory, os.getpid())
        wait(timeout)

    recorder._loop.wait = late
    recorder.run()
    result = load_result(tmp_path / "session.h5")
    lost = 10 + 1
    assert result.live["lost_ticks"] == result.summary["lost_ticks"] == memory.status["recorder_lost"] == lost
    assert result.ticks == 600 + TICK_CAPACITY + 10 - lost
    record = result["live/tick/record"]
    assert (np.flatnonzero(np.diff(record) != 1) == [599]).all()
    assert record[600] - record[599] == 1 + lost
    assert np.isnan(result["force_variation_rate"][600])
    again = run_again(result)
    assert (again.ticks, again.ticks_stored) == (600, result.ticks)
    assert not again.same and again.sentence == f"not all ticks run: 600 of {result.ticks:,}"
    assert all(array.identical for array in again.arrays)
    assert again.notes == (
        "the recorder lost 11 ticks after tick 599: what followed on them cannot be run again, and was not compared",
    )


def test_a_session_that_lost_its_beginning_cannot_be_run_again(ticks: Records, tmp_path: Path) -> None:
    result = recorded(tmp_path / "session.h5", ticks)
    with h5py.File(result.path, "r+") as file:
        file["hands/right/live/tick/record"][...] += 3
    with pytest.raises(InputError, match="lost its first 3 ticks"):
        run_again(load_result(result.path))


RECORDER = ("-m", "hhsim.live.session.recorder")


def started(memory: SessionMemory) -> None:
    memory.facts.write(FACTS)
    memory.status["loop_pid"] = os.getpid()
    memory.status["stage"] = Stage.RUNNING


@pytest.mark.soak
def test_a_place_that_cannot_be_written_is_told_at_once(tmp_path: Path) -> None:
    memory = SessionMemory.create()
    with session_process(make_setup(tmp_path / "no" / "session.h5"), memory, *RECORDER) as process:
        assert process.wait() == 2
        assert process.stderr.read().startswith(f"hhsim: there is no folder {tmp_path / 'no'}")
    assert memory.status["recorder_failed"] == 1


@pytest.mark.soak
def test_told_to_stop_it_writes_what_came(ticks: Records, tmp_path: Path) -> None:
    path, memory = tmp_path / "session.h5", SessionMemory.create()
    started(memory)
    with session_process(make_setup(path), memory, *RECORDER) as process:
        pour(memory.ticks, ticks[:60])
        until(lambda: memory.status["recorder_ticks"] >= 50)
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGTERM)
        assert process.wait() == 0
    result = load_result(path)
    assert (result.complete, result.ticks) == (False, memory.ticks.written)
    assert result.live["ended"] == CUT_SHORT


def test_a_loop_that_is_killed_ends_the_recording_in_order(ticks: Records, tmp_path: Path) -> None:
    path, memory = tmp_path / "session.h5", SessionMemory.create()
    started(memory)
    recorder = threading.Thread(target=Recorder(make_setup(path), memory).run)
    with subprocess.Popen(["sleep", "600"]) as loop:
        try:
            memory.status["loop_pid"] = loop.pid
            recorder.start()
            pour(memory.ticks, ticks[:60])
            until(lambda: memory.status["recorder_ticks"] >= 50)
        finally:
            loop.kill()
        recorder.join()
    result = load_result(path)
    assert result.complete
    assert result.ticks == memory.ticks.written
    assert result.live["ended"] == LOOP_DIED


def test_a_session_that_never_began_leaves_no_file(tmp_path: Path) -> None:
    memory = SessionMemory.create()
    memory.status["stage"] = Stage.ENDED
    Recorder(make_setup(tmp_path / "a.h5"), memory).run()
    memory.facts.write(FACTS)
    Recorder(make_setup(tmp_path / "b.h5"), memory).run()
    assert list(tmp_path.iterdir()) == []


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
