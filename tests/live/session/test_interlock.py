"""Which reasons free the fingers, and what the log says of them."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from hhsim.kernels.live import finger_command as bits
from hhsim.kernels.live.finger_command import judge
from hhsim.kernels.live.tick import usual_interval
from hhsim.live.session.loop import interlock_record
from hhsim.live.session.setup import SafetyLimits
from hhsim.live.session.story import QUIET_NS, SafetyLog, interval_hint
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
