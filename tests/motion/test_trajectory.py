"""Motions: what one is, the moving object, ticks of it, resampling, tremor, and motions by formula."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation, Slerp
from short_grasp import carried, swing

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import conjugate, quaternion, quaternion_product, rotation_vector
from hhsim.motion.analytic_motion import replayed, still, trajectory_of
from hhsim.motion.file import load_trajectory, save_trajectory
from hhsim.motion.resample import interpolate_monotone, interpolate_orientation, newest_sample, tick_times
from hhsim.motion.trajectory import ObjectMotion, Phase, ResampleMode, TickPhase, Trajectory
from hhsim.motion.tremor import Disturbance


def motion(count: int = 20, rate: float = 100.0, **changes: Any) -> Trajectory:
    """A smooth motion of every channel."""
    time = np.arange(count) / rate
    angle = 2.0 * time[:, None]
    axis = np.array([0.6, 0.0, 0.8])
    fields: dict[str, Any] = {
        "time": time,
        "position": np.stack([0.1 * time, np.sin(time), 0.2 * np.ones(count)], axis=1),
        "orientation": np.concatenate([np.cos(angle / 2), np.sin(angle / 2) * axis], axis=1),
        "flexion": np.linspace(0.0, 1.0, count)[:, None, None] * np.ones((5, 3)),
        "abduction": np.zeros((count, 5)),
    }
    return Trajectory(**(fields | changes))


def test_a_good_motion_is_kept_as_read_only_doubles_of_its_own() -> None:
    position = np.zeros((20, 3), dtype=np.float32)
    made = motion(position=position)
    position[:] = 1.0
    assert made.position.dtype == np.float64 and (made.position == 0.0).all()
    assert (made.sample_count, made.duration, made.mean_rate) == pytest.approx((20, 0.19, 100.0))
    for array in (made.time, made.position, made.orientation, made.flexion, made.abduction, made.object_position):
        assert array.flags.c_contiguous and not array.flags.writeable


def test_quaternions_are_normalised_and_flips_are_fixed() -> None:
    good = motion()
    signs = np.where(np.arange(20) % 3 == 0, -1.0, 1.0)[:, None]
    made = motion(orientation=good.orientation * signs * np.linspace(0.5, 3.0, 20)[:, None])
    np.testing.assert_allclose(made.orientation, -good.orientation, atol=1e-15)
    assert (np.sum(made.orientation[1:] * made.orientation[:-1], axis=1) > 0.0).all()


def spoiled(label: str, index: tuple[int, ...], value: float) -> dict[str, FloatArray]:
    array = np.array(getattr(motion(), label))
    array[index] = value
    return {label: array}


def moving(position: FloatArray, orientation: FloatArray) -> dict[str, Any]:
    return {"object_motion": ObjectMotion(position, orientation)}


BAD: list[tuple[dict[str, Any], str]] = [
    ({"time": np.zeros((20, 1))}, r"time has shape \(20, 1\); expected \(T,\)"),
    ({"time": np.zeros(0)}, "no samples"),
    ({"time": np.arange(19.0)}, r"position has shape \(20, 3\); expected \(19, 3\)"),
    ({"position": [[1.0, 2.0], [3.0]]}, "position does not hold numbers"),
    (spoiled("position", (7, 1), np.nan), r"position has 1 NaN .* first at sample 7, channel 1 \(t = 0.07 s\)"),
    (spoiled("flexion", (4, 2, 1), np.inf), r"flexion has 1 .* first at sample 4, channel 2, 1"),
    (spoiled("time", (5,), np.nan), "time has 1 NaN or infinite value"),
    (spoiled("time", (5,), 0.01), r"time goes backwards at sample 5 \(0.04 s, then 0.01 s\)"),
    (spoiled("time", (5,), 0.04), r"time repeats at sample 5 \(0.04 s, then 0.04 s\)"),
    ({"orientation": np.zeros((20, 4))}, "20 zero quaternion.*first at sample 0"),
    ({"orientation": np.full((20, 4), 1e200)}, "20 infinitely long quaternion.*first at sample 0"),
    ({"object_orientation": np.zeros(4)}, "object_orientation has 1 zero quaternion"),
    ({"object_position": np.zeros((2, 3))}, r"object_position has shape \(2, 3\)"),
    ({"object_position": np.array([0.0, np.nan, 0.0])}, "object_position has 1 NaN"),
    (spoiled("flexion", (9, 0, 0), 45.0), r"flexion is 45 at sample 9.*is it in degrees\?"),
    (spoiled("position", (9, 2), 412.0), r"position is 412 at sample 9.*is it in millimetres\?"),
    ({"phases": (Phase("hold", 0.1, 0.05),)}, "phase 'hold' from 0.1 s to 0.05 s; expected finite times in order"),
    ({"phases": (Phase("", 0.0, 0.1),)}, "has no name"),
    ({"phases": (Phase("a", 0.0, 0.1), Phase("b", 0.05, 0.2))}, "phase 'b' .* overlaps the one before"),
    *(({"flags": flags}, "flags") for flags in (np.zeros(19), np.full(20, -1), np.full(20, 0.5), np.full(20, np.nan))),
    ({"hand": "both"}, "hand is 'both'; expected right, left"),
    (moving(np.zeros((19, 3)), np.ones((20, 4))), r"object_position has shape \(19, 3\); expected \(20, 3\)"),
    (moving(np.full((20, 3), np.nan), np.ones((20, 4))), "object_position has 60 NaN or infinite"),
    (moving(np.full((20, 3), 400.0), np.ones((20, 4))), "object_position is 400 .* is it in millimetres"),
    (moving(np.zeros((20, 3)), np.zeros((20, 4))), "object_orientation has 20 zero quaternion"),
]


@pytest.mark.parametrize(("changes", "message"), BAD, ids=[message[:30] for _, message in BAD])
def test_bad_motions_are_refused_in_one_line(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(TrajectoryError, match=message) as caught:
        motion(**changes)
    assert "\n" not in str(caught.value)


def test_a_recording_that_starts_late_is_replayed_from_its_first_stamp() -> None:
    offset = 1.7e9
    late = motion(time=offset + np.arange(20) / 100.0, phases=(Phase("grasp", offset + 0.05, offset + 0.19),))
    ticks = late.resampled(1000.0)
    assert ticks.time[0] == 0.0
    assert ticks.phases == (TickPhase("grasp", 50, 190),)
    np.testing.assert_allclose(ticks.position, motion().resampled(1000.0).position, atol=1e-6)


def test_phases_become_ticks_that_do_not_overlap() -> None:
    phases = (Phase("approach", 0.0, 0.04), Phase("grasp", 0.04, 0.07), Phase("hold", 0.07, 0.1))
    given = motion(count=101, rate=1000.0, phases=phases)
    wanted = (TickPhase("approach", 0, 39), TickPhase("grasp", 40, 69), TickPhase("hold", 70, 100))
    assert given.resampled(1000.0).phases == wanted
    assert given.resampled(10.0).phases == (TickPhase("approach", 0, 0), TickPhase("hold", 1, 1))


LATE = np.append(np.arange(19) / 100.0, 1e9)


@pytest.mark.parametrize(
    ("rate", "mode", "time", "message"),
    [
        *((rate, "hold", None, "expected a positive number") for rate in (0.0, -5.0, np.nan, np.inf)),
        (1000.0, "linear", None, "'linear'; expected interpolate or hold"),
        (1000.0, "hold", LATE, r"lasts 1e\+09 s, which is more than 36,000,000 ticks at 1000 Hz"),
    ],
)
def test_ticks_that_cannot_be_are_refused(rate: float, mode: Any, time: FloatArray | None, message: str) -> None:
    changes: dict[str, Any] = {} if time is None else {"time": time}
    with pytest.raises(InputError, match=message):
        motion(**changes).resampled(rate, mode)


def test_the_first_ticks_are_those_of_the_whole_and_end_the_phase_under_way() -> None:
    phases = (Phase("approach", 0.0, 0.05), Phase("grasp", 0.05, 0.12), Phase("hold", 0.12, 0.19))
    whole = motion(phases=phases).resampled(1000.0)
    cut = whole.first(100)
    assert cut.tick_count == 100 and cut.rate == whole.rate
    for name in ("time", "input_seq", "position", "orientation", "flexion", "abduction"):
        assert np.array_equal(getattr(cut, name), getattr(whole, name)[:100])
    assert cut.phases == (TickPhase("approach", 0, 49), TickPhase("grasp", 50, 99))
    assert whole.first(10_000).phases == whole.phases and whole.first(10_000).tick_count == whole.tick_count


@given(st.integers(0, 2**32 - 1))
def test_what_the_object_sees_is_the_inverse_by_scipys_rotations(seed: int) -> None:
    random = np.random.default_rng(seed)
    now = Rotation.random(5, rng=random)
    first, place, was = Rotation.random(rng=random), random.normal(size=(5, 3)), random.normal(size=3)
    poses = ObjectMotion(place, now.as_quat(scalar_first=True))
    moved = poses.since(was, first.as_quat(scalar_first=True))
    points = random.normal(size=(5, 2, 3))
    turn = now * first.inv()
    for i in range(5):
        np.testing.assert_allclose(moved.points(points)[i], turn[i].apply(points[i] - was) + place[i], atol=1e-13)
        np.testing.assert_allclose(moved.vectors(points)[i], turn[i].apply(points[i]), atol=1e-13)
    np.testing.assert_allclose(moved.seen_points(moved.points(points)), points, atol=1e-13)
    np.testing.assert_allclose(moved.seen_vectors(moved.vectors(points)), points, atol=1e-13)
    np.testing.assert_allclose(moved.seen_orientations(moved.orientations(moved.turn)), moved.turn, atol=1e-13)


def test_ticks_on_a_sample_take_its_pose_bit_for_bit_and_others_lie_between() -> None:
    place = {"object_position": [0.1, -0.2, 0.3], "object_orientation": [0.8, 0.0, 0.6, 0.0]}
    given = carried(motion(40, 200.0, **place), swing(np.arange(40) / 200.0))
    poses = given.object_motion
    assert given.object_position.tobytes() == poses.position[0].tobytes()
    ticks = given.resampled(1000.0).object_motion
    for at_tick, at_sample in zip(ticks, poses):
        np.testing.assert_array_equal(at_tick[::5], at_sample)
    np.testing.assert_allclose(np.linalg.norm(ticks.orientation, axis=1), 1.0, atol=1e-15)
    np.testing.assert_array_equal(given.resampled(1000.0, "hold").object_motion.position[3], poses.position[0])


def stamps(rng: np.random.Generator, count: int) -> FloatArray:
    """Irregular stamps from 0 on, gaps of 1 to 40 ms."""
    return np.concatenate([[0.0], np.cumsum(rng.uniform(0.001, 0.04, count - 1))])


def test_tick_times_reach_the_last_stamp_in_spite_of_rounding() -> None:
    time = tick_times(np.float64(2999 * 0.001), 1000.0)
    assert time.shape == (3000,)
    assert time[-1] == 2999 / 1000.0
    assert tick_times(0.0, 1000.0).tolist() == [0.0]
    assert tick_times(0.0105, 1000.0).shape == (11,)


def test_newest_sample_is_the_last_one_not_after_the_tick() -> None:
    time = np.array([0.0, 0.010, 0.011, 0.030])
    ticks = np.array([0.0, 0.009, 0.010, 0.0105, 0.029, 0.030, 0.031])
    assert newest_sample(time, ticks).tolist() == [0, 0, 1, 1, 2, 3, 3]
    # 3 · 0.001 > 3 / 1000 in the last bit; the sample is there all the same.
    assert newest_sample(0.001 * np.arange(5.0), np.arange(5) / 1000.0).tolist() == [0, 1, 2, 3, 4]


@settings(max_examples=60)
@given(st.integers(3, 30), st.integers(0, 2**32 - 1), st.sampled_from([1e-300, 1e-6, 1.0, 1e6]))
def test_monotone_cubic_is_scipys_pchip(count: int, seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    time = stamps(rng, count)
    values = scale * rng.choice([rng.normal(size=(count, 4)), np.round(rng.normal(size=(count, 4)))])
    ticks = np.append(rng.uniform(0.0, time[-1], 200), time)
    ours = interpolate_monotone(time, values, ticks)
    if scale < 1e-200:
        # scipy's harmonic mean underflows there; the cubic scales, so compare at scale 1.
        theirs = scale * PchipInterpolator(time, values / scale)(ticks)
    else:
        theirs = PchipInterpolator(time, values)(ticks)
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-12 * scale)


@settings(max_examples=60)
@given(st.integers(2, 20), st.integers(0, 2**32 - 1), st.sampled_from([1e-9, 1e-4, 0.5, 1.5]))
def test_orientation_is_scipys_slerp(count: int, seed: int, step: float) -> None:
    rng = np.random.default_rng(seed)
    time = stamps(rng, count)
    rotation = Rotation.from_rotvec(np.cumsum(rng.normal(size=(count, 3)) * step, axis=0))
    quaternions = rotation.as_quat(scalar_first=True) * rng.choice([-1.0, 1.0], size=(count, 1))
    ticks = rng.uniform(0.0, time[-1], 100)
    ours = interpolate_orientation(time, quaternions, ticks)
    np.testing.assert_allclose(np.linalg.norm(ours, axis=1), 1.0, atol=1e-14)
    theirs = Slerp(time, rotation)(ticks)
    difference = (Rotation.from_quat(ours, scalar_first=True) * theirs.inv()).magnitude()
    assert difference.max() < 1e-9


def unmoved(count: int = 2000) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    time = np.arange(count) / 1000.0
    orientation = np.tile(Rotation.from_rotvec([0.3, -0.2, 1.0]).as_quat(scalar_first=True), (count, 1))
    return time, np.full((count, 3), 0.2), orientation, np.full((count, 5, 3), 0.5)


def test_tremor_has_the_stated_amplitude_and_frequency() -> None:
    time, position, orientation, flexion = unmoved()
    amplitude, angle = 1e-4, math.radians(0.2)
    tremor = Disturbance(tremor_position=amplitude, tremor_rotation=angle, tremor_frequency=10.0)
    for seed in range(5):
        moved, turned, same = tremor.apply(seed, time, position, orientation, flexion)
        assert same is flexion
        excursion = np.linalg.norm(moved - position, axis=1)
        assert excursion.max() == pytest.approx(amplitude, rel=1e-3)
        assert excursion.max() <= amplitude * (1.0 + 1e-12)
        turn = Rotation.from_quat(turned, scalar_first=True) * Rotation.from_quat(orientation, scalar_first=True).inv()
        assert turn.magnitude().max() == pytest.approx(angle, rel=1e-3)
        # Two whole seconds at 10 Hz: all of it in one line of the spectrum.
        spectrum = np.abs(np.fft.rfft(moved - position, axis=0)) ** 2
        assert spectrum[20].sum() == pytest.approx(spectrum.sum(), rel=1e-9)


def test_the_seed_decides_and_parts_do_not_depend_on_each_other() -> None:
    time, position, orientation, flexion = unmoved(200)
    both = Disturbance(tremor_position=1e-4, tremor_rotation=0.003, sensor_noise=0.001)
    one = both.apply(7, time, position, orientation, flexion)
    again = both.apply(7, time, position, orientation, flexion)
    other = both.apply(8, time, position, orientation, flexion)
    for a, b, c in zip(one, again, other):
        assert a.tobytes() == b.tobytes()
        assert a.tobytes() != c.tobytes()
    alone = Disturbance(tremor_position=1e-4).apply(7, time, position, orientation, flexion)
    assert alone[0].tobytes() == one[0].tobytes()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"tremor_position": -1e-4}, "tremor_position = -0.0001; expected a number from 0 to 0.1"),
        ({"sensor_counts": 1.5}, "sensor_counts = 1.5; expected a whole number"),
    ],
)
def test_values_out_of_range_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(TrajectoryError, match=message):
        Disturbance(**values)


def test_a_line_goes_at_constant_speed_and_arrives() -> None:
    start = still((0.0, 0.0, 0.1), quaternion(np.array([0.1, 0.0, 0.0])), 0.2)
    goal = still((0.1, 0.0, 0.0), quaternion(np.array([0.0, 0.9, 0.3])), 0.5, 0.1)
    motion = start.hold(3).line(goal, 10).hold(5)
    assert motion.ticks == 19
    for values, first, last in zip(motion, start, goal, strict=True):
        np.testing.assert_array_equal(values[:4], np.repeat(first, 4, axis=0))
        np.testing.assert_allclose(values[13:], np.repeat(last, 6, axis=0), atol=1e-15)
    steps = np.diff(motion.position[3:14], axis=0)
    np.testing.assert_allclose(steps, np.tile(steps[0], (10, 1)), atol=1e-15)
    turns = rotation_vector(quaternion_product(motion.orientation[4:14], conjugate(motion.orientation[3:13])))
    np.testing.assert_allclose(turns, np.tile(turns[0], (10, 1)), atol=1e-13)


HAND = HandModel.default()
WILD = StressOptions(wild=True, hold=20)


def equal(one: HandConfiguration, other: HandConfiguration) -> bool:
    return all(a.tobytes() == b.tobytes() for a, b in zip(one, other))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_a_replay_from_a_file_gets_the_replayed_motion_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    motion = replayed(RandomTargets(HAND, seed, WILD).take(200))
    path: Path = tmp_path_factory.mktemp("motion") / "wild.h5"
    save_trajectory(trajectory_of(motion, name="wild", source="a test"), path)
    modes: tuple[ResampleMode, ...] = ("hold", "interpolate")
    for mode in modes:
        ticks = load_trajectory(path).resampled(1000.0, mode)
        assert equal(HandConfiguration.of(ticks), motion)
        assert ticks.input_seq.tolist() == list(range(200))
        assert ticks.position.flags.writeable and ticks.position.flags.c_contiguous
    assert equal(replayed(motion), motion)
