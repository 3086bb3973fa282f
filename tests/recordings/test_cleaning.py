"""Every kind of damage: mended where that is safe, and flagged; refused in one line where it is not."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from recording_samples import cleaned, smooth_recording

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.model import HandModel
from hhsim.motion.sample_flags import SampleFlag, marked
from hhsim.motion.trajectory import ObjectMotion, Phase
from hhsim.recordings.cleaning import CleanedRecording, CleaningOptions
from hhsim.recordings.formats.hhsim import recording_of
from hhsim.recordings.frames import turned
from hhsim.recordings.recording import Recording, turn

CLEAN = smooth_recording()
PLAIN = cleaned(CLEAN).trajectory


def flagged(repaired: CleanedRecording, flag: SampleFlag) -> list[int]:
    return np.flatnonzero(marked(repaired.trajectory.flags, flag)).tolist()


def kinds(repaired: CleanedRecording) -> set[str]:
    return {finding.kind for finding in repaired.findings}


def changed(**arrays: FloatArray) -> Recording:
    return replace(CLEAN, **arrays)


def with_rows(key: str, rows: slice | int | list[int], value: float) -> Recording:
    values = getattr(CLEAN, key).copy()
    values[rows] = value
    return changed(**{key: values})


DEGREES = changed(flexion=np.degrees(CLEAN.flexion), abduction=np.degrees(CLEAN.abduction))
SHARE = 0.0584
FEW_DEGREES = changed(flexion=SHARE * DEGREES.flexion, abduction=SHARE * DEGREES.abduction)
IDENTITY = np.tile([1.0, 0.0, 0.0, 0.0], (CLEAN.sample_count, 1))
BESIDE = replace(CLEAN, object_motion=ObjectMotion(CLEAN.position + 0.1, IDENTITY))
LOST = np.where((np.arange(CLEAN.sample_count) > 100)[:, None], np.nan, CLEAN.position)
REFUSED: list[tuple[Recording, dict[str, Any], str]] = [
    (CLEAN.chosen(np.arange(0)), {}, "expected at least 2"),
    (CLEAN.chosen(np.arange(1)), {}, "expected at least 2"),
    (
        with_rows("position", slice(100, 220), np.nan),
        {},
        r"position is missing for 1\.2\d* s after 0\.9\d* s: too long",
    ),
    (with_rows("abduction", slice(0, 160), np.nan), {"max_gap": 9.0}, "missing in 160 of 300 samples"),
    (with_rows("flexion", slice(0, 300), np.nan), {}, "thumb_flex1 is missing in every sample"),
    (with_rows("time", slice(0, 100), np.nan), {}, "100 of 300 samples have no time stamp"),
    (changed(orientation=np.zeros((300, 4))), {}, "orientation is no unit quaternion in 300 of 300 samples"),
    (changed(time=np.zeros(300)), {}, "299 of 300 samples repeat the stamp"),
    (changed(time=CLEAN.time + 5.0 * (np.arange(300) >= 150)), {}, r"no sample for 5\.\d+ s after 1\.4\d+ s: too long"),
    (
        replace(CLEAN.chosen(np.arange(300) % 150), position=CLEAN.position),
        {},
        r"sample 150 \(.* two recordings in one",
    ),
    (replace(CLEAN.chosen(np.random.default_rng(5).permutation(300)), time=CLEAN.time), {}, "out of order"),
    *((changed(time=factor * CLEAN.time), {}, "--time-unit") for factor in (1e-3, 70.0, 1e12)),
    (changed(time=1e3 * CLEAN.time), {"time_unit": "s"}, "check --time-unit"),
    (changed(position=50.0 * CLEAN.position), {}, "cm, mm and inch are all possible; say --length-unit"),
    (changed(position=1e3 * CLEAN.position), {"length_unit": "m"}, "check --length-unit"),
    (changed(position=10.0 * CLEAN.position + 400.0), {}, "maybe not in metres, but cm, mm and inch are all possible"),
    (DEGREES, {"angle_unit": "rad"}, "check --angle-unit"),
    (FEW_DEGREES, {}, "say --angle-unit deg or rad"),
    (replace(CLEAN, stated=frozenset({"angle"})), {"angle_unit": "deg"}, "--angle-unit deg: .* states that unit"),
    (CLEAN, {"start": 50.0}, "no sample from 50 to inf s; the recording has stamps from 0 to"),
    (BESIDE, {"other_hand": True}, "would part the hand from the object"),
    (replace(CLEAN, object_motion=ObjectMotion(LOST, IDENTITY)), {"max_gap": 0.05}, "object position is missing"),
]


@pytest.mark.parametrize(("recording", "options", "message"), REFUSED, ids=[message[:30] for *_, message in REFUSED])
def test_what_cannot_be_mended_safely_is_refused(recording: Recording, options: dict[str, Any], message: str) -> None:
    units = {name: unit for name, unit in options.items() if name.endswith("_unit")}
    own = {name: value for name, value in options.items() if name not in units}
    with pytest.raises(InputError, match=message):
        cleaned(recording, CleaningOptions(**own), **units)


def test_a_clean_recording_comes_out_as_it_went_in() -> None:
    repaired = cleaned(CLEAN)
    motion = repaired.trajectory
    assert repaired.findings == () and repaired.mended == 0
    assert not motion.flags.any()
    for key in ("time", "position", "flexion", "abduction"):
        assert getattr(motion, key).tobytes() == getattr(CLEAN, key).tobytes(), key
    assert motion.hand == "right" and motion.name == "smooth"


@pytest.mark.parametrize("key", ["position", "orientation", "flexion", "abduction"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_missing_numbers_are_interpolated_and_flagged(key: str, value: float) -> None:
    repaired = cleaned(with_rows(key, slice(100, 110), value))
    flag = SampleFlag.PALM_FILLED if key in ("position", "orientation") else SampleFlag.FINGERS_FILLED
    assert flagged(repaired, flag) == list(range(100, 110))
    assert kinds(repaired) == {flag.word}
    assert repaired.mended == 10
    motion = repaired.trajectory
    # 11 steps of 10 ms of waves below 1.2 Hz: |x''| < (2π 1.2)² amplitude, and the chord is off by h²/8 of it.
    if key == "orientation":
        assert np.degrees(np.abs(turn(PLAIN.orientation, motion.orientation))).max() < 3.0
    else:
        amplitude = {"position": 0.12, "flexion": 0.4, "abduction": 0.06}[key]
        bound = 0.12**2 / 8.0 * (2.0 * np.pi * 1.2) ** 2 * amplitude + 1e-3
        assert np.abs(getattr(motion, key) - getattr(PLAIN, key)).max() < bound


IN_ORDER = np.arange(300)
SWAPPED = np.concatenate([IN_ORDER[:20], [23, 21, 22, 20], IN_ORDER[24:]])
HELD = np.concatenate([IN_ORDER[:100], np.full(8, 100), IN_ORDER[108:]])
LATE = CLEAN.time + np.where(IN_ORDER >= 298, 60.0, 0.0)
STAMPED_AWAY = np.where(IN_ORDER == 100, CLEAN.time[250] + 1e-3, CLEAN.time)
STAMPED_TWICE = np.where(IN_ORDER == 200, CLEAN.time[199], CLEAN.time)
MILLISECONDS = np.asarray(0.011 * np.arange(300), dtype=np.float64)


def moved(rows: slice, step: float) -> Recording:
    """The palm beside its way in some samples [m]."""
    position = CLEAN.position.copy()
    position[rows, 0] += step
    return changed(position=position)


SIGNS = np.where((IN_ORDER >= 50) & (IN_ORDER < 60), -1.0, 1.0)[:, None]
MENDED: dict[str, tuple[Recording, dict[SampleFlag, list[int]], int]] = {
    "holes at the ends": (
        with_rows("position", [*range(5), *range(296, 300)], np.nan),
        {SampleFlag.PALM_FILLED: [*range(5), *range(296, 300)]},
        300,
    ),
    "quaternions of length zero": (with_rows("orientation", [40, 41], 0.0), {SampleFlag.PALM_FILLED: [40, 41]}, 300),
    "quaternions of length two": (
        changed(orientation=2.0 * CLEAN.orientation),
        {SampleFlag.RENORMALISED: [*range(300)]},
        300,
    ),
    "quaternions of the other sign": (
        changed(orientation=SIGNS * CLEAN.orientation),
        {SampleFlag.FLIPPED: [*range(50, 60)]},
        300,
    ),
    "a spike that its force tells": (moved(slice(77, 78), 0.04), {SampleFlag.PALM_OUTLIER: [77]}, 300),
    "a small spike": (moved(slice(77, 78), 0.012), {SampleFlag.SUSPECT: [77]}, 300),
    "a jump that stays": (moved(slice(150, None), 0.3), {SampleFlag.JUMP: [150]}, 300),
    "a tracker that repeats itself": (
        replace(CLEAN.chosen(HELD), time=CLEAN.time),
        {SampleFlag.FROZEN: [*range(100, 108)]},
        300,
    ),
    "samples out of order": (CLEAN.chosen(SWAPPED), {SampleFlag.REORDERED: [20, 21, 22]}, 300),
    "a stamp that contradicts the motion": (changed(time=STAMPED_AWAY), {SampleFlag.CUT_BEFORE: [100]}, 299),
    "a stamp that is there twice": (changed(time=STAMPED_TWICE), {SampleFlag.CUT_BEFORE: [200]}, 299),
    "stamps that are missing": (with_rows("time", [5, 6], np.nan), {SampleFlag.CUT_BEFORE: [5]}, 298),
    "a gap": (CLEAN.chosen(np.delete(IN_ORDER, range(100, 140))), {SampleFlag.GAP_BEFORE: [100]}, 260),
    # Two samples lost of whole milliseconds are three steps, whatever the rounding of their differences.
    "a gap of three steps": (
        changed(time=MILLISECONDS).chosen(np.delete(IN_ORDER, [129, 130])),
        {SampleFlag.GAP_BEFORE: [129]},
        298,
    ),
    "a piece far from the others": (changed(time=LATE), {}, 298),
}


@pytest.mark.parametrize("fault", MENDED)
def test_what_is_safe_to_mend_is_mended_and_flagged(fault: str) -> None:
    recording, flags, count = MENDED[fault]
    repaired = cleaned(recording)
    motion = repaired.trajectory
    assert {flag: flagged(repaired, flag) for flag in flags} == flags and motion.sample_count == count
    # What jumps, or is left out, may stand out beside.
    others = {flag for flag in SampleFlag if flagged(repaired, flag)} - flags.keys()
    assert others <= {SampleFlag.SUSPECT, SampleFlag.GAP_BEFORE}
    if count == 300 and SampleFlag.JUMP not in flags and SampleFlag.FROZEN not in flags:
        held = 0.04 if fault == "holes at the ends" else 0.013
        assert np.abs(motion.position - PLAIN.position).max() < held
        assert np.degrees(np.abs(turn(PLAIN.orientation, motion.orientation))).max() < 0.5


def test_samples_in_no_order_are_sorted_by_their_stamps() -> None:
    everything = cleaned(CLEAN.chosen(np.random.default_rng(4).permutation(300)))
    assert everything.trajectory.flexion.tobytes() == CLEAN.flexion.tobytes()
    still = replace(CLEAN.chosen(np.zeros(300, dtype=np.int64)), time=CLEAN.time)
    assert cleaned(still).findings == (), "a hand that rests through the whole file is no lost hand"
    time = CLEAN.time + np.where(IN_ORDER >= 150, 5.0, 0.0)
    assert cleaned(changed(time=time), CleaningOptions(max_gap=6.0)).trajectory.duration > 7.0


@pytest.mark.parametrize("length", [1, 2, 5, 20])
def test_spikes_are_replaced(length: int) -> None:
    position, orientation, flexion = CLEAN.position.copy(), CLEAN.orientation.copy(), CLEAN.flexion.copy()
    position[50 : 50 + length] += [0.0, 0.5, 0.0]
    orientation[120 : 120 + length] = orientation[120 : 120 + length, [1, 0, 3, 2]]
    flexion[200 : 200 + length, 3, 1] += 1.5
    repaired = cleaned(replace(CLEAN, position=position, orientation=orientation, flexion=flexion))
    assert flagged(repaired, SampleFlag.PALM_OUTLIER) == [*range(50, 50 + length), *range(120, 120 + length)]
    assert flagged(repaired, SampleFlag.FINGERS_OUTLIER) == list(range(200, 200 + length))
    assert np.abs(repaired.trajectory.position - PLAIN.position).max() < 0.02
    assert np.abs(repaired.trajectory.flexion - PLAIN.flexion).max() < 0.1


@pytest.mark.parametrize(("factor", "word"), [(1e3, "ms"), (1e6, "µs"), (1e9, "ns")])
def test_stamps_in_another_unit(factor: float, word: str) -> None:
    phased = replace(CLEAN, time=factor * CLEAN.time, phases=(Phase("reach", 0.0, factor * 1.5),))
    repaired = cleaned(phased)
    assert f"taken for {word}" in repaired.findings[0].text
    assert np.allclose(repaired.trajectory.time, CLEAN.time)
    (phase,) = repaired.trajectory.phases
    assert phase.end_time == pytest.approx(1.5)
    assert len(flagged(repaired, SampleFlag.UNIT)) == 300


def test_stamps_since_1970_count_from_the_first() -> None:
    repaired = cleaned(changed(time=CLEAN.time + 1.7e9))
    assert repaired.trajectory.time[0] == 0.0 and kinds(repaired) == {"note"}
    assert np.allclose(repaired.trajectory.time, CLEAN.time, atol=1e-6)


def test_positions_in_millimetres_and_angles_in_degrees() -> None:
    repaired = cleaned(changed(position=1e3 * CLEAN.position))
    assert np.allclose(repaired.trajectory.position, CLEAN.position) and len(flagged(repaired, SampleFlag.UNIT)) == 300
    assert np.allclose(cleaned(DEGREES).trajectory.flexion, PLAIN.flexion)
    stated = cleaned(changed(position=50.0 * CLEAN.position), length_unit="cm")
    assert np.allclose(stated.trajectory.position, 0.5 * CLEAN.position)


@pytest.mark.parametrize(
    ("origin", "scale", "options"),
    [
        ([3200.0, -1800.0, 50.0], 1.0, {}),
        ([150.0, 20.0, 1.0], 1.0, {}),
        ([3200.0, -1800.0, 50.0], 1.0, {"length_unit": "m"}),
        ([6.0, 6.0, 1.0], 1.0, {"length_unit": "m"}),
        ([6e4, 6e4, 0.0], 1e3, {"length_unit": "mm"}),
    ],
)
def test_metres_far_from_the_origin_stay_metres_and_the_origin_moves(
    origin: list[float], scale: float, options: dict[str, Any]
) -> None:
    small = 0.3 * CLEAN.position
    far = scale * small + origin
    moved = ObjectMotion(far + 0.1 * scale, IDENTITY)
    repaired = cleaned(changed(position=far, object_motion=moved), **options)
    motion = repaired.trajectory
    assert np.linalg.norm(motion.position, axis=1).max() < 2.0 and repaired.mended == 0
    np.testing.assert_allclose(np.diff(motion.position, axis=0), np.diff(small, axis=0), atol=1e-11)
    np.testing.assert_allclose(motion.object_motion.position - motion.position, 0.1, atol=1e-11)
    (text,) = (finding.text for finding in repaired.findings if "origin" in finding.text)
    assert "m from the origin, which is moved to" in text


def test_degrees_of_a_nearly_flat_hand_are_not_taken_for_radians() -> None:
    assert np.abs(FEW_DEGREES.angles).max() < 3.4, "below 200° as radians"
    degrees = cleaned(FEW_DEGREES, angle_unit="deg").trajectory
    assert np.allclose(degrees.flexion, SHARE * PLAIN.flexion)
    assert flagged(cleaned(FEW_DEGREES, angle_unit="rad"), SampleFlag.LIMITED)


def test_a_joint_whose_zero_is_elsewhere_is_not_taken_for_degrees() -> None:
    flexion = CLEAN.flexion.copy()
    flexion[:, 0, :2] += 2.0
    assert not {"unit"} & kinds(cleaned(changed(flexion=flexion)))


def test_joints_stay_within_the_hand() -> None:
    flexion = CLEAN.flexion.copy()
    flexion[30:40, 1, 0] = np.linspace(1.2, 2.6, 10)
    flexion[40:50, 1, 0] = np.linspace(2.6, flexion[50, 1, 0], 10)
    repaired = cleaned(changed(flexion=flexion))
    assert flagged(repaired, SampleFlag.LIMITED) and "index_flex1" in repaired.findings[-1].text
    assert (repaired.trajectory.flexion <= HandModel.default().flexion_max).all()
    kept = cleaned(changed(flexion=flexion), CleaningOptions(limits=None))
    assert kept.trajectory.flexion.max() == pytest.approx(2.6) and not flagged(kept, SampleFlag.LIMITED)


def test_a_left_hand_can_become_a_right_one_and_back() -> None:
    once = cleaned(replace(CLEAN, hand="left"), CleaningOptions(other_hand=True)).trajectory
    assert once.hand == "right"
    assert np.allclose(once.position, PLAIN.position * [-1.0, 1.0, 1.0])
    # A point of the palm, seen in the mirror, is the mirror image's point of the mirrored palm.
    point = np.array([0.02, 0.07, -0.01])
    seen = (PLAIN.position + turned(PLAIN.orientation, point)) * [-1.0, 1.0, 1.0]
    assert np.allclose(once.position + turned(once.orientation, point * [-1.0, 1.0, 1.0]), seen)


def test_a_part_is_cut_out() -> None:
    motion = cleaned(CLEAN, CleaningOptions(start=0.5, end=1.0)).trajectory
    inside = (CLEAN.time >= 0.5) & (CLEAN.time <= 1.0)
    assert np.array_equal(motion.time, CLEAN.time[inside]) and np.array_equal(motion.flexion, CLEAN.flexion[inside])


@pytest.mark.parametrize("count", [2, 3, 4, 5, 7, 12, 15, 16, 17, 23])
def test_few_samples_are_enough(count: int) -> None:
    part = CLEAN.chosen(np.arange(count))
    assert cleaned(part).trajectory.position.tobytes() == CLEAN.position[:count].tobytes()
    position = part.position.copy()
    position[count // 2] = np.nan
    assert cleaned(part.changed(position=position)).trajectory.sample_count == count


def test_repairing_twice_changes_nothing() -> None:
    position = CLEAN.position.copy()
    position[50:53] += 0.4
    once = cleaned(changed(position=position, orientation=-1.5 * CLEAN.orientation)).trajectory
    twice = cleaned(recording_of(once))
    assert twice.trajectory.position.tobytes() == once.position.tobytes()
    assert (twice.trajectory.flags == once.flags).all()
    assert twice.findings == ()


def test_holes_in_the_objects_motion_are_filled_and_reported() -> None:
    place, turn_ = CLEAN.position + 0.1, IDENTITY.copy()
    place[40:44], turn_[60] = np.nan, 0.0
    repaired = cleaned(replace(CLEAN, object_motion=ObjectMotion(place, turn_)))
    moved = repaired.trajectory.object_motion
    assert (moved.orientation == [1.0, 0.0, 0.0, 0.0]).all()
    np.testing.assert_allclose(moved.position[40:44], CLEAN.position[40:44] + 0.1, atol=2e-3)
    (found,) = (finding for finding in repaired.findings if finding.kind == "object")
    assert found.samples == 5


def test_the_objects_motion_is_cut_sorted_and_scaled_with_the_hands() -> None:
    millimetres = BESIDE.chosen(np.arange(CLEAN.sample_count)[::-1]).resized(1e3)
    options = CleaningOptions(start=float(CLEAN.time[20]))
    motion = cleaned(millimetres, options, length_unit="mm").trajectory
    assert motion.sample_count < CLEAN.sample_count
    np.testing.assert_allclose(motion.object_motion.position, motion.position + 0.1, atol=1e-12)
