"""Fingers that jump, stuck sensors, channels that say nothing: named, and nothing pushes there."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.arrays import FloatArray
from hhsim.kernels.live.plausibility import BURST, CAPACITY, JOINT_SPEED, NOTES, PAUSE, STUCK_TIME, TRUST, use_sample
from hhsim.live.device import GLOVE_SAMPLE, GloveInfo
from hhsim.live.session.loop import watch_record
from hhsim.live.session.story import doubts, found_in_sample
from hhsim.solver.workspace import zeroed

INFO = GloveInfo("a glove", ())
STEP = 5_000_000
"""Between two samples [ns]."""


class Run:
    """A glove whose samples a test makes."""

    def __init__(self, info: GloveInfo = INFO) -> None:
        self.watch = watch_record(info)[0]
        self.now = 10**9
        self.flexion = np.full((5, 3), np.nan)
        self.abduction = np.full(5, np.nan)
        self.texts = doubts(info)
        self.notes = zeroed(NOTES)[0]
        self.told = 0

    def step(self, flexion: FloatArray | float, abduction: float = 0.0, good: bool = True, step: int = STEP) -> bool:
        sample: Any = zeroed(GLOVE_SAMPLE)[0]
        self.now += step
        sample["time_ns"] = self.now
        sample["good"] = good
        sample["flexion"] = flexion
        sample["abduction"] = abduction
        used = use_sample(self.watch, self.notes, sample, self.flexion, self.abduction)
        while self.told < self.notes.written[0]:
            i = self.told % CAPACITY
            code, place, count = (int(getattr(self.notes, name)[i]) for name in ("code", "place", "count"))
            self.texts.append(found_in_sample(code, place, count, float(self.notes.value[i]))[1])
            self.told += 1
        return bool(used)


def bent(finger: int, angle: float, rest: float = 0.1) -> FloatArray:
    flexion = np.full((5, 3), rest)
    flexion[finger] += angle
    return flexion


TRUSTED_STEPS = round(1e9 * TRUST / STEP)
"""Plausible samples, one after the other, after which a finger is trusted."""


def steps_until_trusted(run: Run, finger: int, flexion: FloatArray | float = 0.1) -> int:
    """Take plausible samples until something may push on a finger again; how many it were."""
    for count in range(1, 2 * TRUSTED_STEPS):
        run.step(flexion)
        if not run.watch.free[finger]:
            return count
    raise AssertionError("it is never trusted again")


def test_a_finger_that_jumps_and_comes_back_never_moved() -> None:
    run = Run()
    for _ in range(3):
        assert run.step(0.1)
    assert not run.watch.free.any()
    assert run.step(bent(1, np.pi / 2))
    assert np.array_equal(run.flexion, np.full((5, 3), 0.1)), "the jump is not believed"
    assert run.watch.free.tolist() == [False, True, False, False, False]
    assert run.texts == ["index finger jumped by 90° in one sample: not believed until it stays, and kept free"]
    run.step(0.1)
    assert run.watch.free.tolist() == [False, True, False, False, False], "the next sample lifts no doubt"
    assert np.array_equal(run.flexion, np.full((5, 3), 0.1))
    assert run.texts[1:] == ["index finger came back from its jump: kept free until it was plausible for 1 s"]
    assert steps_until_trusted(run, 1) == TRUSTED_STEPS - 1


def test_a_jump_that_stays_is_followed_at_the_speed_of_a_joint() -> None:
    run = Run()
    run.step(0.1)
    believed, free = [], []
    for _ in range(30):
        run.step(bent(2, np.pi / 2))
        believed.append(run.flexion[2, 0])
        free.append(run.watch.free[2])
    path = np.array([0.1, *believed])
    assert np.diff(path).max() <= JOINT_SPEED * 1e-9 * STEP + 1e-12
    assert (path[:4] == 0.1).all(), "held until it was seen for long enough"
    assert path[-1] == 0.1 + np.pi / 2
    # 1.57 rad at 0.175 rad a sample: nine steps behind the three that were held; 18 of those since count as plausible.
    assert all(free)
    assert steps_until_trusted(run, 2, bent(2, np.pi / 2)) == TRUSTED_STEPS - 19
    text = "middle finger stays where it jumped to, and is followed: kept free until it was plausible for 1 s"
    assert run.texts[1:] == [text]


@pytest.mark.parametrize("hold", [1, 2, 4, 20, 60])
def test_bends_that_alternate_leave_their_fingers_free_without_a_break(hold: int) -> None:
    run = Run()
    run.step(0.1)
    run.step(bent(2, 1.5))
    for k in range(300):
        run.step(bent(2, 1.5 * (k // hold % 2)))
        assert run.watch.free.tolist() == [False, False, True, False, False]


def test_what_interrupts_plausible_samples_begins_the_time_anew() -> None:
    run = Run()
    run.step(0.1)
    run.step(bent(1, 1.5))
    for _ in range(TRUSTED_STEPS - 1):
        run.step(0.1)
    assert not run.step(np.nan)
    # The first one comes two steps after the last plausible sample.
    assert steps_until_trusted(run, 1) == TRUSTED_STEPS - 1
    # A glove that says nothing for long has not been plausible meanwhile.
    run.step(bent(1, 1.5))
    run.step(0.1, step=10 * round(1e9 * TRUST))
    assert steps_until_trusted(run, 1) == TRUSTED_STEPS - round(1e9 * PAUSE / STEP)


def test_samples_that_come_together_are_no_jump() -> None:
    run = Run()
    run.step(0.0)
    # A fast finger, 15 rad/s, whose samples of 20 ms come at once.
    for k in range(1, 81):
        angle = 15.0 * 0.005 * k
        run.step(angle, step=4 * STEP if k % 4 == 1 else 0)
        assert (run.flexion == angle).all()
    assert run.texts == []


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), rate=st.sampled_from([60.0, 200.0, 1000.0]))
def test_no_motion_of_a_glove_makes_a_joint_faster_than_the_limit(seed: int, rate: float) -> None:
    random = np.random.default_rng(seed)
    run = Run()
    run.step(0.0)
    begin, path = run.now, [run.flexion.copy()]
    steps = np.where(random.random(200) < 0.2, 0, round(1e9 / rate))
    flexion = np.zeros((5, 3))
    times = [0.0]
    for step in steps:
        flexion = flexion + random.standard_normal((5, 3)) * random.choice([0.01, 0.1, 1.0])
        assert run.step(np.clip(flexion, -3.0, 3.0), step=int(step))
        path.append(run.flexion.copy())
        times.append(1e-9 * (run.now - begin))
    moved = np.concatenate([np.zeros((1, 15)), np.abs(np.diff(np.reshape(path, (-1, 15)), axis=0)).cumsum(axis=0)])
    for start in np.flatnonzero(steps)[::7]:
        allowed = JOINT_SPEED * (np.array(times[start + 1 :]) - times[start] + BURST)
        assert (moved[start + 1 :] - moved[start] <= allowed[:, None] + 1e-9).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 7.0])
def test_what_is_not_finite_or_no_angle_is_not_used(value: float) -> None:
    run = Run()
    assert not run.step(value)
    assert np.isnan(run.flexion).all(), "nothing is written"
    assert run.step(0.2, abduction=0.1)
    assert not run.step(0.2, abduction=value)
    assert not run.step(0.2, good=False)
    assert (run.flexion == 0.2).all()
    assert (run.abduction == 0.1).all()


def moving(k: int, still: tuple[int, ...] = ()) -> FloatArray:
    """All fingers open and close within a second; some stay as they are."""
    flexion: FloatArray = np.full((5, 3), 0.6 - 0.5 * np.cos(2.0 * np.pi * k / 200.0)) + 0.01 * np.arange(5)[:, None]
    flexion[list(still)] = 0.25
    return flexion


def test_a_stuck_sensor_is_named_and_its_finger_free_until_it_moves() -> None:
    run = Run()
    steps = round(1e9 * STUCK_TIME / STEP)
    for k in range(steps + 1):
        run.step(moving(k, still=(1,)))
        if k < steps - 1:
            assert not run.watch.free.any()
    assert run.watch.free.tolist() == [False, True, False, False, False]
    assert len(run.texts) == 1
    assert run.texts[0].startswith("index finger has not changed by one bit in 2.0 s in which thumb and middle finger")
    run.step(moving(steps, still=(1,)) + 1e-6)
    assert run.texts[1] == "index finger moves again: kept free until it was plausible for 1 s"
    for k in range(TRUSTED_STEPS):
        assert run.watch.free.tolist() == [False, k < TRUSTED_STEPS - 1, False, False, False]
        run.step(moving(steps + 1 + k))


def test_a_hand_at_rest_and_a_finger_that_moves_alone_are_not_stuck() -> None:
    for still in ((0, 1, 2, 3, 4), (0, 1, 2, 3)):
        run = Run()
        for k in range(1000):
            run.step(moving(k, still=still))
        assert not run.watch.free.any()
        assert run.texts == []


def test_a_useless_channel_is_told_and_its_finger_always_free() -> None:
    run = Run(GloveInfo("a glove", (), doubtful=("pinky_bend spans 37 counts",), kept_free=(4,)))
    assert run.texts == [
        "pinky_bend spans 37 counts",
        "little finger: its bend says too little to push on; it is kept free",
    ]
    for _ in range(5):
        run.step(0.1)
        assert run.watch.free.tolist() == [False] * 4 + [True]
