"""The referee on recorded sessions: an honest one with every mishap passes, what is forged in one is found by name."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest
from file_faults import Fault, at, attribute
from live_rings import FACTS, ended
from live_scripted import FIST, FREE, WAKING_NS, FakeAccounts, FakeClock, InStep, Moment, ScriptedGlove, make_setup
from planted_faults import failing, planted
from sampled import first_of_each, sampled

from hhsim.kernels.live import plausibility as looked_at
from hhsim.live.processes import RingReader
from hhsim.live.session import recorder
from hhsim.live.session.loop import loop_options
from hhsim.live.session.memory import SessionMemory
from hhsim.live.session.recorder import Recorder, SessionWriter
from hhsim.live.session.setup import LiveSetup, OutputLimits, SafetyLimits
from hhsim.recordings.dexmo_regression import DexmoRegression
from hhsim.result.miss_cause import by_name
from hhsim.result.reader import Result, load_result
from hhsim.result.safety import Safety
from hhsim.verify import session_checks as verify_session
from hhsim.verify.claim import HOLDS
from hhsim.verify.file_checks import file_claims
from hhsim.verify.verify import verify

PERIOD = 1_000_000
CLOSING = [Moment(FREE + (FIST - FREE) * i / 80) for i in range(80)]
HOLDING = [Moment(FIST)] * 60
SCRIPT = [
    *CLOSING,
    *HOLDING,
    *[Moment(FIST, good=False)] * 4,
    *HOLDING,
    *[Moment(None)] * 40,
    *HOLDING,
    Moment(FIST, gone=True),
    *HOLDING,
    Moment(FIST, send_fails=True),
    *HOLDING,
    # A jump in one sample, and back.
    Moment(0.2),
    *HOLDING,
    # Samples that come before their tick's deadline; one of them before any tick is due.
    *[Moment(FIST, early_ns=early) for early in (400_000, 250_000, 500_000, 800_000, 100_000) * 3],
    *HOLDING,
    # Not to the end of a period: the times that are made up for it below would end in the next.
    Moment(FIST, work_ns=12 * PERIOD + PERIOD // 2),
    # Longer than the log is silent about a mishap that it has told of.
    *HOLDING * 14,
]
SHORT = SCRIPT[:360]
"""Its first mishaps."""
HOLD = 130
"""A tick in which all fingers but the index finger, which touches nothing, are held at their full stiffness."""
STALE = 80 + 60 + 4 + 60 + 35
"""A tick without fresh input."""
OVERSLEPT = 100
"""The tick after this one comes three periods late."""
OUTPUT = OutputLimits(ramp=0.02)
LONG = 110
"""A tick that is solved into the next period, whose tick begins at once."""
FAILED = 170
"""A tick whose solver fails: there is no row of it, and the ramp begins anew."""
LIVE_CLAIMS = ("time", "periods", "samples", "reasons", "commands", "session figures")


class Scripted:
    """A loop that has run the script on a clock of its own: the same bytes every time."""

    def __init__(self, record: Path, script: Sequence[Moment] = SCRIPT, **changes: Any) -> None:
        given = {"output": OUTPUT, "safety": SafetyLimits(watchdog=False), "duration": 1e-3 * (len(script) + 1)}
        self.setup: LiveSetup = make_setup(**{**given, "record": record, **changes})
        self.memory = SessionMemory.create()
        clock = FakeClock()
        mishaps = {OVERSLEPT: lambda: clock.oversleep.append(int(3.4 * PERIOD)), FAILED: self.fail_once}
        mishaps[LONG] = lambda: self.once(lambda: clock.work(PERIOD * 12 // 10))
        glove = ScriptedGlove(clock, script, mishaps)
        both = InStep(self.setup, self.memory, glove, clock, accounts=FakeAccounts())
        self.loop = both.loop
        self.reason = both.run()
        # The solver measures by the true clock: its times are made those of the script's.
        ticks = self.memory.ticks.records
        ticks["duration"], ticks["duration_total"], ticks["duration_cpu"] = 1000, 120_000, 100_000
        latency = ticks["latency_ns"]
        # Where the sample was there before the loop woke, the driver's time is not within the tick.
        latency += np.select([latency < 0, latency == 0, latency < PERIOD], [0, 50_000, 150_000], 0)

    def fail_once(self) -> None:
        """The solver raises in the tick that is under way: it is not in the file."""

        def fail() -> None:
            raise ArithmeticError("planted")

        self.once(fail)

    def once(self, action: Callable[[], None]) -> None:
        """Let something happen before the tick that is under way is solved."""
        loop: Any = self.loop
        sound = loop.one_tick.solve

        def solve() -> None:
            loop.one_tick.solve = sound
            action()
            sound()

        loop.one_tick.solve = solve


def recorded(path: Path, script: Sequence[Moment] = SCRIPT, **changes: Any) -> Result:
    scripted = Scripted(path, script, **changes)
    assert scripted.reason == "duration"
    ended(scripted.memory, os.getpid())
    Recorder(scripted.setup, scripted.memory).run()
    return load_result(path)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return recorded(tmp_path_factory.mktemp("session") / "session.h5")


def test_an_honest_session_with_every_mishap_holds(session: Result) -> None:
    safety, missed = session["live/tick/safety"], session["live/tick/missed"]
    for why in (Safety.STALE_INPUT, Safety.NOT_FINITE, Safety.DEVICE_LOST, Safety.OVERRUN_STREAK, Safety.STOPPING):
        assert (safety & int(why)).any(), why
    assert missed[OVERSLEPT + 1] == 3 and missed.max() >= 10
    assert (np.diff(session["live/tick/period"]) - 1 - missed[1:]).tolist().count(1) == 1, "no tick failed"
    assert session["live/tick/command_stiffness"][HOLD, 2:].min() == pytest.approx(0.3), "nothing is held"
    assert session["force/total"][HOLD].any()
    early = session["live/tick/early"]
    assert sorted(set(early.tolist())) == [0, 100_000, 250_000, 400_000, 500_000, 750_000]
    assert (session["live/tick/wakeup"][(early > 0) & (early < 750_000)] == WAKING_NS).all()
    assert any(b"jumped by" in line for line in session["live/event/text"])
    found = verify(session, every=50)
    assert failing(found) == set()
    claims = {claim.name: claim for claim in found.claims}
    assert {name: claims[name].verdict for name in LIVE_CLAIMS} == dict.fromkeys(LIVE_CLAIMS, HOLDS)
    assert all(claims[name].checked > 300 for name in LIVE_CLAIMS if name != "session figures")
    assert "summary" not in claims


# Each fault: what is done to the file, and the claim that finds it.


def unsaid_overrun(file: h5py.File) -> None:
    tick = int(np.argmax(file["hands/right/live/tick/missed"][...]))
    file["hands/right/live/tick/safety"][tick] = 0


def seized_at_once(file: h5py.File) -> None:
    """Right after a fault, fingers are as stiff as before it."""
    first = int(np.flatnonzero(file["hands/right/live/tick/safety"][...])[-1])
    while file["hands/right/live/tick/safety"][first]:
        first -= 1
    begin = first
    while not file["hands/right/live/tick/safety"][begin - 1]:
        begin -= 1
    file["hands/right/live/tick/command_stiffness"][begin] = 0.3


def unsaid_failure(file: h5py.File) -> None:
    """A period has neither a tick nor a miss, and the log no longer tells why."""
    text = file["hands/right/live/event/text"]
    text[...] = [b"" if line.startswith(b"the solver failed") else line for line in text[...]]


def passed_over(file: h5py.File) -> None:
    """The two samples after the one in use had been handed over 1 ms before the tick woke."""
    tick = HOLD + 5
    used = int(file["hands/right/tick/input_seq"][tick])
    row = int(np.flatnonzero(file["hands/right/live/sample/seq"][:] == used)[0])
    woke = file["hands/right/live/tick/deadline"][tick] + file["hands/right/live/tick/wakeup"][tick]
    for name in ("time", "handed"):
        file[f"hands/right/live/sample/{name}"][row : row + 3] = woke - PERIOD + np.arange(3)


def handed_before_it_came(file: h5py.File) -> None:
    file["hands/right/live/sample/handed"][HOLD] = file["hands/right/live/sample/time"][HOLD] - 1


def samples_out_of_order(file: h5py.File) -> None:
    file["hands/right/live/sample/time"][HOLD] = file["hands/right/live/sample/time"][HOLD - 2]


def swapped_commands(file: h5py.File) -> None:
    for name in ("bend", "stiffness"):
        row = file[f"hands/right/live/tick/command_{name}"][HOLD]
        row[[1, 2]] = row[[2, 1]]
        file[f"hands/right/live/tick/command_{name}"][HOLD] = row


FAULTS: dict[Fault, str] = {
    at("pushed_though_stale", "hands/right/live/tick/command_stiffness", (STALE, 1), lambda x: 0.3): "commands",
    at("excused_though_pushed", "hands/right/live/tick/safety", HOLD, lambda x: int(Safety.NO_WATCHDOG)): "commands",
    at("unsaid_stale", "hands/right/live/tick/safety", STALE, lambda x: 0): "reasons",
    at("unsaid_bad_sample", "hands/right/live/tick/safety", 142, lambda x: 0): "reasons",
    unsaid_overrun: "reasons",
    at("unsaid_stop", "hands/right/live/tick/safety", -1, lambda x: 0): "reasons",
    at("unknown_reason", "hands/right/live/tick/safety", STALE, lambda x: 512): "reasons",
    at("beyond_the_setting", "hands/right/live/tick/command_stiffness", (HOLD, 2), lambda x: 0.31): "commands",
    seized_at_once: "commands",
    at("stiff_in_the_air", "hands/right/live/tick/command_stiffness", (10, 1), lambda x: 0.1): "commands",
    at("softer_than_said", "hands/right/live/tick/command_stiffness", (HOLD, 2), lambda x: 0.2): "commands",
    at("bend_beyond_a_fist", "hands/right/live/tick/command_bend", (HOLD, 3), lambda x: 1.001): "commands",
    at("leaping_set_point", "hands/right/live/tick/command_bend", (HOLD, 3), lambda x: x + 0.05): "commands",
    at("shifted_set_point", "hands/right/live/tick/command_bend", (HOLD, 3), lambda x: x - 1e-3): "commands",
    at("uncounted_miss", "hands/right/live/tick/missed", OVERSLEPT + 1, lambda x: x - 1): "periods",
    unsaid_failure: "periods",
    at("invented_miss", "hands/right/live/tick/missed", HOLD, lambda x: 1): "periods",
    at("moved_deadline", "hands/right/live/tick/deadline", HOLD, lambda x: x + 1000): "periods",
    at("leapt", "hands/right/live/tick/deadline", slice(HOLD, None), lambda x: x + PERIOD // 100): "periods",
    at("wrong_time", "tick/time", HOLD, lambda x: x + 1e-4): "time",
    at("early_wake_up", "hands/right/live/tick/wakeup", HOLD, lambda x: -5): "periods",
    at("overslept_and_not_missed", "hands/right/live/tick/wakeup", HOLD, lambda x: 2 * PERIOD): "periods",
    at("longer_than_its_period", "hands/right/tick/duration/total", HOLD, lambda x: PERIOD + PERIOD // 1000): "periods",
    at("older_sample", "hands/right/tick/input_seq", HOLD, lambda x: x - 1): "samples",
    at("bad_sample_used", "hands/right/live/sample/good", HOLD, lambda x: 0): "samples",
    samples_out_of_order: "samples",
    handed_before_it_came: "samples",
    passed_over: "samples",
    at("other_finger", "hands/right/tick/haptic/flexion", (HOLD, 2, 0), lambda x: x + 1e-4): "samples",
    at("unsaid_loss", "hands/right/live/tick/record", slice(HOLD, None), lambda x: x + 1): "periods",
    attribute("invented_loss", "hands/right/live", "lost_samples", lambda x: 3): "periods",
    attribute("stale_count", "summary/right", "kept_free_stale_input", lambda x: x - 1): "session figures",
    attribute("stale_latency", "summary/right", "latency_p99", lambda x: x * 0.99): "session figures",
    attribute("fewer_misses", "summary/right", "missed", lambda x: 1): "session figures",
    attribute("other_causes", "summary/right", "missed_host", lambda x: x + 2): "session figures",
    attribute("strange_figure", "summary/right", "comfort", lambda x: 1.0): "session figures",
    attribute("other_end", "hands/right/live", "ended", lambda x: "the user was happy"): "session figures",
    attribute(
        "died_in_order", "hands/right/live", "ended", lambda x: "the loop failed or was killed"
    ): "session figures",
    at("samples_shifted", "hands/right/tick/input_seq", slice(HOLD, HOLD + 30), lambda x: x + 1): "samples",
    at("held_input", "hands/right/tick/status", slice(HOLD, HOLD + 30), lambda x: x | 4): "reasons",
    at("bend_of_no_number", "hands/right/live/tick/command_bend", (HOLD, 3), lambda x: np.nan): "commands",
    swapped_commands: "commands",
}


@pytest.mark.parametrize("fault", first_of_each(FAULTS), ids=lambda fault: fault.__name__)
def test_what_is_forged_in_a_session_is_found_by_name(session: Result, tmp_path: Path, fault: Fault) -> None:
    forged = planted(session.path, tmp_path, fault)
    claims = file_claims(forged) if FAULTS[fault] == "time" else verify_session.session_claims(forged)
    claim = next(claim for claim in claims if claim.name == FAULTS[fault])
    assert claim.failed
    assert not claim.worst <= claim.tolerance


@pytest.mark.soak
def test_a_session_whose_recorder_lost_ticks_and_samples_is_judged_by_what_is_left(tmp_path: Path) -> None:
    scripted = Scripted(tmp_path / "gap.h5", SHORT)
    ticks = RingReader(scripted.memory.ticks).read(10**6)[1]
    samples = RingReader(scripted.memory.samples).read(10**6)[1]
    options = loop_options(scripted.setup.options, scripted.setup.rate)
    with SessionWriter(tmp_path / "gap.h5", scripted.setup, options, FACTS) as writer:
        writer.hands[0].lost = {"ticks": 11, "samples": 7, "events": 0}
        status, events = scripted.memory.status, RingReader(scripted.memory.events).read(1000)
        before = {"ticks": (0, ticks[:120]), "samples": (0, samples[:125]), "events": events}
        for taken in (before, {"ticks": (131, ticks[131:]), "samples": (132, samples[132:])}):
            writer.write([taken], status["counters"])
        writer.finish("duration", status["counters"], int(status["missed"]), by_name(status["missed_by"]))
    session = load_result(tmp_path / "gap.h5")
    assert session.ticks == len(ticks) - 11
    assert np.isnan(session["force_variation_rate"][120]) and session["force/total"][120].any()
    found = verify(session, every=50)
    assert failing(found) == set()

    stiffer = at("stiffer", "hands/right/live/tick/command_stiffness", (120, 1), lambda x: 0.4)
    assert failing(verify(planted(session.path, tmp_path, stiffer), every=50)) >= {"commands"}


@pytest.mark.soak
def test_a_dry_run_tells_so_in_every_tick(tmp_path: Path) -> None:
    session = recorded(tmp_path / "dry.h5", SHORT, dry_run=True)
    assert failing(verify(session, every=100)) == set()
    untold = attribute("untold", "hands/right/live", "dry_run", lambda x: 0)
    assert "reasons" in failing(verify(planted(session.path, tmp_path, untold), every=100))


@pytest.mark.parametrize("after_stall", sampled(["ease", "hold"], lambda _, after: after == "ease"))
@pytest.mark.soak
def test_a_stall_that_is_eased_or_held_is_judged_by_what_was_asked_for(tmp_path: Path, after_stall: str) -> None:
    safety = SafetyLimits(watchdog=False, after_stall=after_stall)
    short, long_ = (Moment(FIST, work_ns=periods * PERIOD + PERIOD // 2) for periods in (12, 25))
    script = [*CLOSING, *HOLDING, short, *HOLDING, long_, *HOLDING]
    session = recorded(tmp_path / "stall.h5", script, safety=safety)
    (tick,) = np.flatnonzero((session["live/tick/missed"] >= 10) & (session["live/tick/missed"] < 19))
    least = {"ease": 0.29, "hold": 0.3}[after_stall]
    assert session["live/tick/command_stiffness"][tick, 2:].min() >= least
    assert ((session["live/tick/safety"] & Safety.OVERRUN_STREAK) > 0).any(), "the longer one frees the fingers"
    assert failing(verify(session, every=100)) == set()
    stiffer = at("stiffer", "hands/right/live/tick/command_stiffness", tick + 3, lambda x: 0.4)
    assert "commands" in failing(verify(planted(session.path, tmp_path, stiffer), every=100))


def test_the_referee_and_the_loop_mean_the_same_numbers_and_words() -> None:
    """The referee has limits of its own, so as to share no code; here they are held against the loop's."""
    assert (recorder.LOOP_DIED, looked_at.MOST_ANGLE) == (verify_session.LOOP_DIED, verify_session.MOST_ANGLE)


def test_the_bend_of_the_referee_is_that_of_the_output() -> None:
    regression = DexmoRegression.default()
    flexion = np.random.default_rng(4).uniform(-0.5, 2.0, (200, 5, 3))
    slope, offset = regression.bend_lines()
    limits = {"bend": {"slope": slope.tolist(), "offset": offset.tolist()}}
    rows: Any = SimpleNamespace(limits=limits, result={"graphic/flexion": flexion})
    np.testing.assert_allclose(np.clip(verify_session._bends(rows), 0.0, 1.0), regression.bends(flexion), atol=1e-14)
