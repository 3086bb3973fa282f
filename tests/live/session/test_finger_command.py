"""What the fingers are told: limits that hold whatever the solver gives, what frees them, and what the log says."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError, InputError
from hhsim.kernels.live import finger_command as bits
from hhsim.kernels.live.finger_command import judge, update_command
from hhsim.kernels.live.tick import usual_interval
from hhsim.live.device import FingerCommand
from hhsim.live.session.loop import commander_record, interlock_record
from hhsim.live.session.memory import FACT_BYTES, SessionMemory
from hhsim.live.session.setup import OutputLimits, SafetyLimits
from hhsim.live.session.story import QUIET_NS, SafetyLog, interval_hint
from hhsim.recordings.dexmo_regression import DexmoRegression
from hhsim.result.safety import Safety

PERIOD = 1e-3
NOBODY = np.zeros(5, np.int64)
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
REGRESSION = DexmoRegression.default()
BEND_LINES = REGRESSION.bend_lines()
ROUNDING = 1e-12

numbers = st.one_of(st.floats(-10.0, 10.0), st.sampled_from([np.nan, np.inf, -np.inf, 1e300]))
limits = st.builds(
    OutputLimits,
    stiffness=st.tuples(*[st.floats(0.0, 1.0)] * 5),
    stiffness_rise=st.floats(0.1, 1000.0),
    bend_speed=st.floats(0.1, 1000.0),
    ramp=st.floats(0.0, 0.02),
    contact_force=st.floats(0.0, 1.0),
)


@dataclass
class Input:
    flexion: float
    force: float
    safety: int
    free: int


inputs = st.builds(
    Input,
    flexion=numbers,
    force=numbers,
    safety=st.one_of(st.just(0), st.just(0), st.sampled_from([int(bit) for bit in Safety])),
    free=st.one_of(st.just(-1), st.integers(0, 4)),
)


def fill(flexion: float, force: float) -> tuple[FloatArray, FloatArray]:
    return np.full((5, 3), flexion), np.full((5, 3, 3), force)


class FingerCommander:
    """Record of the commander with its command."""

    def __init__(self, limits: OutputLimits, lines: tuple[FloatArray, FloatArray] = BEND_LINES, **of: bool) -> None:
        self.at = commander_record(limits, lines, PERIOD, **of)[0]
        self.command = FingerCommand(self.at.bend, self.at.stiffness, self.at.phalanx)
        self.force = self.at.force


@settings(max_examples=200)
@given(limits, st.lists(inputs, min_size=1, max_size=40))
def test_no_input_breaks_the_limits(limits: OutputLimits, steps: list[Input]) -> None:
    stage = FingerCommander(limits)
    command = stage.command
    before, bend_before, begun, since = command.stiffness.copy(), None, False, 0
    for step in steps:
        kept_free = (np.arange(5) == step.free).astype(np.int64)
        safety = update_command(stage.at, *fill(step.flexion, step.force), LEVEL, step.safety, kept_free)
        assert np.isfinite(command.stiffness).all()
        assert np.isfinite(command.bend).all()
        assert ((command.bend >= 0.0) & (command.bend <= 1.0)).all()
        assert (command.stiffness <= np.array(limits.stiffness)).all()
        assert (command.stiffness <= before + limits.stiffness_rise * PERIOD + ROUNDING).all()
        assert safety & step.safety == step.safety
        if safety:
            assert (command.stiffness == 0.0).all()
            since = 0
        else:
            since += 1
            # The ramp, in ticks without a fault.
            most = np.array(limits.stiffness) * min(1.0, since * PERIOD / max(limits.ramp, PERIOD))
            assert (command.stiffness <= most + ROUNDING).all()
        assert (command.stiffness[kept_free == 1] == 0.0).all()
        # Each of three phalanges feels this along three axes. NaN compares false.
        if not 3.0 * np.sqrt(3.0) * abs(step.force) >= limits.contact_force - ROUNDING:
            assert (command.stiffness == 0.0).all()
        if begun and bend_before is not None:
            assert (np.abs(command.bend - bend_before) <= limits.bend_speed * PERIOD + ROUNDING).all()
        before, bend_before = command.stiffness.copy(), command.bend.copy()
        begun = begun or bool(np.isfinite(step.flexion) and abs(step.force) < 1e150)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", ["flexion", "force"])
@pytest.mark.parametrize("finger", [0, 4])
def test_a_solver_that_is_not_finite_has_failed(bad: float, place: str, finger: int) -> None:
    stage = FingerCommander(OutputLimits(ramp=0.0))
    for _ in range(100):
        update_command(stage.at, *fill(0.5, 1.0), LEVEL, 0, NOBODY)
    bend = stage.command.bend.copy()
    flexion, force = fill(0.5, 1.0)
    (flexion if place == "flexion" else force)[finger, 2, ...] = bad
    assert update_command(stage.at, flexion, force, LEVEL, 0, NOBODY) == Safety.SOLVER_FAILED
    assert (stage.command.stiffness == 0.0).all()
    assert np.array_equal(stage.command.bend, bend)


def test_set_points_are_those_of_the_regression() -> None:
    random = np.random.default_rng(1)
    stage = FingerCommander(OutputLimits(bend_speed=1e6))
    for _ in range(100):
        flexion = random.uniform(-0.3, 2.0, (5, 3))
        update_command(stage.at, flexion, np.zeros((5, 3, 3)), LEVEL, 0, NOBODY)
        np.testing.assert_allclose(stage.command.bend, REGRESSION.bends(flexion), atol=1e-12)


def test_a_finger_whose_bend_means_nothing_is_told_zero() -> None:
    slope = REGRESSION.slope.copy()
    slope[3:6] = 0.0
    dead = DexmoRegression(REGRESSION.open, REGRESSION.closed, slope, REGRESSION.offset)
    stage = FingerCommander(OutputLimits(), dead.bend_lines())
    update_command(stage.at, *fill(0.5, 1.0), LEVEL, 0, NOBODY)
    assert stage.command.bend[1] == dead.bends(np.full((5, 3), 0.5))[1] == 0.0


def test_only_a_finger_that_carries_force_is_held() -> None:
    stage = FingerCommander(OutputLimits(ramp=0.0, stiffness_rise=1e6, contact_force=0.1))
    force = np.zeros((5, 3, 3))
    # Forces that are opposed are forces too.
    force[1, 0, 0], force[1, 1, 0] = 0.06, -0.06
    force[3, 2] = 0.05, 0.0, 0.0
    update_command(stage.at, np.zeros((5, 3)), force, LEVEL, 0, NOBODY)
    assert stage.command.stiffness.tolist() == [0.0, 0.3, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(stage.force, [0.0, 0.12, 0.0, 0.05, 0.0])
    update_command(stage.at, np.zeros((5, 3)), np.zeros((5, 3, 3)), LEVEL, 0, NOBODY)
    assert (stage.command.stiffness == 0.0).all(), "it falls at once"


def test_forces_are_in_the_palms_frame_and_come_and_go_with_the_stiffness() -> None:
    limits = OutputLimits(ramp=0.1, stiffness_rise=1e6)
    stage, numb = FingerCommander(limits, feels=True), FingerCommander(limits)
    force, kept_free = np.zeros((5, 3, 3)), (np.arange(5) == 4).astype(np.int64)
    force[0, 2], force[1, 0], force[4, 2] = (0.0, 0.0, 2.0), (1.0, 0.0, 0.0), (0.0, 0.0, 3.0)
    # A palm whose fingers (y) point to the world's -x: turned by 90° about z.
    turn = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    for tick in range(1, 121):
        for each in (stage, numb):
            update_command(each.at, np.zeros((5, 3)), force, turn, 0, kept_free)
        share = min(tick / 100, 1.0)
        np.testing.assert_allclose(stage.command.force[0, 2], [0.0, 0.0, 2.0 * share], atol=1e-12)
        np.testing.assert_allclose(stage.command.force[1, 0], [0.0, -share, 0.0], atol=1e-12)
    assert not stage.command.force[[2, 3, 4]].any(), "a finger that is kept free feels nothing"
    assert numb.command.stiffness.any()
    assert not numb.command.force.any(), "of a glove that takes none it stays 0"
    update_command(stage.at, np.zeros((5, 3)), force, turn, int(Safety.STALE_INPUT), kept_free)
    assert not stage.command.force.any(), "it falls at once"


NOW = 10**12
MS = 1_000_000
GOOD: dict[str, Any] = {"sample_ns": NOW, "pose_ns": NOW, "usable": True, "missed": 0, "watchdog_ns": NOW}
GOOD |= {"armed": True, "lost": False, "stopping": False}
"""What the interlock judges, in the order of `judge`, and nothing wrong."""


def judged(interlock: Any, **change: Any) -> int:
    return int(judge(interlock[0], NOW, *(GOOD | change).values()))


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"sample_ns": NOW - 25 * MS}, 0),
        ({"sample_ns": NOW - 25 * MS - 1}, Safety.STALE_INPUT),
        ({"pose_ns": NOW - 25 * MS - 1}, Safety.STALE_INPUT),
        ({"sample_ns": NOW + 5 * MS}, 0),
        ({"sample_ns": -1}, Safety.NO_INPUT_YET),
        ({"pose_ns": -1}, Safety.NO_INPUT_YET),
        ({"usable": False}, Safety.NOT_FINITE),
        ({"missed": 9}, 0),
        ({"missed": 10}, Safety.OVERRUN_STREAK),
        ({"watchdog_ns": NOW - 100 * MS}, 0),
        ({"watchdog_ns": NOW - 100 * MS - 1}, Safety.NO_WATCHDOG),
        ({"watchdog_ns": 0, "armed": False}, Safety.NO_WATCHDOG),
        ({"armed": False}, Safety.NO_WATCHDOG),
        ({"lost": True}, Safety.DEVICE_LOST),
        ({"stopping": True}, Safety.STOPPING),
        ({"stopping": True, "lost": True, "usable": False}, Safety.STOPPING | Safety.DEVICE_LOST | Safety.NOT_FINITE),
    ],
)
def test_each_reason_has_its_bit(change: dict[str, Any], expected: int) -> None:
    assert judged(interlock_record(SafetyLimits()), **change) == expected


def test_a_flicker_is_told_once_a_second_with_its_reason() -> None:
    log = SafetyLog()
    log.detail[Safety.DEVICE_LOST] = "no answer"
    bit = int(Safety.DEVICE_LOST)
    (first,) = log.changed(bit, NOW)
    assert first[1].endswith("the fingers are free: no answer")
    assert [text for _, text in log.changed(0, NOW + 1)] == ["the glove is back"]
    assert log.changed(bit, NOW + 2) == log.changed(0, NOW + 3) == []
    assert len(log.changed(bit, NOW + QUIET_NS)) == 1


@pytest.mark.parametrize(
    ("after_stall", "rate", "released"),
    [
        ("release", 1000, 10),
        ("ease", 1000, 19),
        ("hold", 1000, 19),
        ("hold", 500, 10),
        ("ease", 100, 10),
        ("hold", 4000, 79),
    ],
)
def test_no_policy_holds_longer_than_the_watchdog_waits(after_stall: str, rate: int, released: int) -> None:
    limits, period = SafetyLimits(watchdog=False, after_stall=after_stall), 1_000_000_000 // rate
    assert limits.release_at(period) == released
    for missed in (9, 10, released - 1, released):
        interlock = interlock_record(limits, period_ns=period)
        bits = judged(interlock, missed=missed)
        assert bits == (Safety.OVERRUN_STREAK if missed >= released else 0)
        assert (interlock[0].eases == 1) == (after_stall == "ease" and missed >= 10)


def test_the_bits_are_those_of_the_file() -> None:
    assert {why.name: getattr(bits, str(why.name)) for why in Safety} == {why.name: int(why) for why in Safety}


def usual(times: list[int]) -> float:
    found = 0.0
    for before, after in pairwise(times):
        found = float(usual_interval(found, after - before))
    return found


def glove(rate: float, *more: int) -> float:
    """The usual interval of a glove that was seen for 10 s, and whose samples then came at `more` [ns]."""
    jitter = np.random.default_rng(0).normal(0.0, 0.1 / rate, round(rate * 10.0))
    return usual([*(round(1e9 * (i / rate + late)) for i, late in enumerate(jitter)), *more])


def test_a_limit_that_one_lost_sample_exceeds_is_named_with_one_that_fits() -> None:
    assert interval_hint(glove(90.0), 0.025) == interval_hint(glove(200.0), 0.025) == interval_hint(0.0, 0.025) == ""
    slow = usual([i * 16_666_667 for i in range(5)])
    assert interval_hint(slow, 0.025) == (
        "; samples come 60 times a second, so that one that is lost frees the fingers: --stale 42 would let it pass"
    )
    assert interval_hint(slow, 0.042) == ""


def test_a_system_without_such_memory_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr("os.memfd_create")
    with pytest.raises(HhsimError, match="need Linux"):
        SessionMemory.create()


def test_facts_are_replaced_whole_and_bounded() -> None:
    memory = SessionMemory.create()
    assert memory.facts.read() == {}
    memory.facts.write({"long": "x" * 1000})
    memory.facts.write({"short": 1})
    assert memory.facts.read() == {"short": 1}
    with pytest.raises(ValueError, match="fit"):
        memory.facts.write({"too": "x" * FACT_BYTES})
    assert memory.facts.read() == {"short": 1}


@pytest.mark.parametrize(
    ("kind", "wrong", "word"),
    [
        (OutputLimits, {"stiffness": (0.5,) * 4}, "stiffness = .* five numbers"),
        (OutputLimits, {"stiffness": (1.1,) * 5}, "stiffness.1. = 1.1; expected a number from 0 to 1"),
        (OutputLimits, {"stiffness": (float("nan"),) * 5}, "stiffness.1. = nan"),
        (OutputLimits, {"stiffness_rise": 0.0}, "stiffness_rise = 0.0; .* above 0"),
        (OutputLimits, {"bend_speed": float("inf")}, "bend_speed = inf; .* above 0"),
        (OutputLimits, {"ramp": -1.0}, "ramp = -1.0; .* from 0 on"),
        (SafetyLimits, {"stale": 0.0}, "stale = 0.0; .* above 0"),
        (SafetyLimits, {"overruns": 0}, "overruns = 0; .* from 1"),
        (SafetyLimits, {"after_stall": "pray"}, "after_stall: unknown after_stall 'pray': known: ease, hold, release"),
    ],
)
def test_limits_that_are_none_are_refused(kind: type, wrong: dict[str, object], word: str) -> None:
    with pytest.raises(InputError, match=word):
        kind(**wrong)
