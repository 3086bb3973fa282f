"""Which reasons free the fingers, and what the log says of them."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.kernels.live import finger_command as bits
from hhsim.kernels.live.finger_command import judge
from hhsim.live.session.loop import interlock_record
from hhsim.live.session.settings import SafetyLimits
from hhsim.live.session.story import LOGGED, QUIET_NS, SafetyLog
from hhsim.result.safety import Safety

NOW = 10**12
MS = 1_000_000
GOOD: dict[str, Any] = {
    "sample_ns": NOW,
    "pose_ns": NOW,
    "usable": True,
    "missed": 0,
    "watchdog_ns": NOW,
    "armed": True,
    "lost": False,
    "stopping": False,
}


def judged(interlock: Any, now: int, **of: Any) -> int:
    names = ("sample_ns", "pose_ns", "usable", "missed", "watchdog_ns", "armed", "lost", "stopping")
    return int(judge(interlock[0], now, *(of[name] for name in names)))


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
    assert judged(interlock_record(SafetyLimits()), NOW, **(GOOD | change)) == expected


def test_a_streak_is_periods_missed_without_one_in_time() -> None:
    gate = interlock_record(SafetyLimits(overruns=4))
    found = [judged(gate, NOW, **(GOOD | {"missed": missed})) for missed in (1, 1, 1, 0, 1, 1, 1, 1, 0)]
    assert found == [0, 0, 0, 0, 0, 0, 0, Safety.OVERRUN_STREAK, 0]
    assert gate[0].streak == 0


@given(st.lists(st.integers(0, 2**10 - 1), max_size=100))
def test_a_log_tells_each_beginning_at_most_once_a_second_and_each_end_of_what_it_told(bits: list[int]) -> None:
    log = SafetyLog()
    lines = [line for i, safety in enumerate(bits) for line in log.changed(safety, NOW + i * MS)]
    beginnings = [text for level, text in lines if level > 0]
    assert len(beginnings) == len(set(beginnings)) <= len(LOGGED)
    assert len(lines) - len(beginnings) <= len(beginnings)


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
    given = {"sample_ns": 0, "pose_ns": 0, "usable": True, "watchdog_ns": 0, "armed": 0, "lost": False}
    for missed in (9, 10, released - 1, released):
        interlock = interlock_record(limits, period_ns=period)
        bits = judged(interlock, 0, **given, missed=missed, stopping=False)
        assert bits == (Safety.OVERRUN_STREAK if missed >= released else 0)
        assert (interlock[0].eases == 1) == (after_stall == "ease" and missed >= 10)


def test_the_bits_are_those_of_the_file() -> None:
    assert {why.name: getattr(bits, str(why.name)) for why in Safety} == {why.name: int(why) for why in Safety}
