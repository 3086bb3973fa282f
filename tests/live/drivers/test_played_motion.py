"""Gloves and poses that need no hardware: the simulated glove, the replayed one, and where the palm is."""

import math
import time
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from hhsim.live.device import GLOVE_SAMPLE, FingerCommand, GloveDevice
from hhsim.live.drivers import poses
from hhsim.live.drivers.played import RETURN_TIME, Playback
from hhsim.live.drivers.poses import PalmKeys, make_pose_source, write_keyboard_pose
from hhsim.live.gloves import PoseConfig, configure, open_device
from hhsim.live.processes import LIVE_STATUS, SharedBlock
from hhsim.motion.trajectory import Trajectory
from hhsim.recordings.dexmo_regression import DexmoRegression


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """CLOCK_MONOTONIC [ns] that the drivers see; tests move it."""
    now = [10_000_000_000]
    monkeypatch.setattr(time, "monotonic_ns", lambda: now[0])
    return now


def motion(count: int = 50, rate: float = 100.0, start: float = 3.0) -> Trajectory:
    """A seeded motion in which no two samples are the same."""
    random = np.random.default_rng(7)
    return Trajectory(
        time=np.arange(count) / rate + start,
        position=random.uniform(-0.1, 0.1, (count, 3)),
        orientation=random.standard_normal((count, 4)),
        flexion=random.uniform(0.0, 1.0, (count, 5, 3)),
        abduction=random.uniform(-0.1, 0.1, (count, 5)),
        name="seeded",
    )


def read_all(device: GloveDevice, most: int = 4096) -> NDArray[np.void]:
    samples = np.zeros(most, GLOVE_SAMPLE)
    return samples[: device.read(samples)]


def read_on(device: GloveDevice, clock: list[int], steps: Iterable[int]) -> NDArray[np.void]:
    """All samples from now on, read again after each of these times [ns]."""
    parts = [read_all(device)]
    for step in steps:
        clock[0] += int(step)
        parts.append(read_all(device))
    return np.concatenate(parts)


@pytest.mark.parametrize("kind", ["sim", "replay"])
def test_a_glove_without_hardware_knows_when_its_next_sample_comes(clock: list[int], kind: str) -> None:
    device = open_device(configure(kind, playback=Playback(motion(rate=100.0))))
    assert len(read_all(device)) == 1
    for _ in range(20):
        pause = device.pause()
        assert 0.0 < pause <= 0.01
        clock[0] += round(1e9 * pause) - 1_000
        assert len(read_all(device)) == 0
        clock[0] += 2_000
        assert device.pause() == 0.0
        assert len(read_all(device)) == 1


@pytest.mark.parametrize("steps", [np.full(100, 7_000_000), np.random.default_rng(1).integers(0, 30_000_000, 60)])
def test_replay_gives_the_samples_of_the_motion_whenever_it_is_read(clock: list[int], steps: NDArray[np.int64]) -> None:
    given = motion()
    device = open_device(configure("replay", playback=Playback(given)))
    samples = read_on(device, clock, steps)
    assert device.counters.frames == device.counters.samples == len(samples)
    assert np.array_equal(samples["seq"], np.arange(len(samples))) and samples["good"].all()
    for name in ("flexion", "abduction"):
        assert np.array_equal(samples[name][:50], getattr(given, name))
    assert np.array_equal(samples["device_time_ns"][:50], np.round(1e9 * (given.time - given.time[0])))


def test_replay_goes_back_in_a_second_to_begin_anew(clock: list[int]) -> None:
    given = motion(rate=500.0, start=0.0)
    device = open_device(configure("replay", playback=Playback(given)))
    # 50 samples, then 1 s back in steps of 2 ms.
    samples = read_on(device, clock, [round(1e9 * (50.5 / 500.0 + RETURN_TIME))])
    assert np.array_equal(np.diff(samples["device_time_ns"]), np.full(len(samples) - 1, 2_000_000))
    assert np.array_equal(samples["flexion"][-2:], given.flexion[:2]), "the motion begins anew"
    back = samples["flexion"][49:-1]
    assert len(back) == 501
    assert np.allclose(back, back[0] + np.linspace(0.0, 1.0, 501)[:, None, None] * (back[-1] - back[0]))


def grasping() -> Trajectory:
    """All fingers close in one second along the regression and stay."""
    channels = np.zeros((401, 11))
    channels[:, 2::2] = np.clip(np.arange(401)[:, None] / 100.0, 0.0, 1.0) * 0.8
    flexion, abduction = DexmoRegression.default().angles(channels)
    place, level = np.zeros((401, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (401, 1))
    return Trajectory(np.arange(401) / 100.0, place, level, flexion, abduction)


def test_a_simulated_finger_makes_the_motion_and_stops_where_it_is_resisted(clock: list[int]) -> None:
    regression = DexmoRegression.default()
    device = open_device(configure("sim", playback=Playback(grasping()), seed=3))
    command = FingerCommand()
    command.bend[:] = 0.5
    command.stiffness[:] = (1.0, 1.0, 0.2, 0.0, 0.0)
    assert device.send(command)
    samples = read_on(device, clock, [5_000_000] * 400)
    assert len(samples) == 401
    bend = regression.bends(samples["flexion"])
    early = samples["device_time_ns"] < 5e8
    wanted = np.clip(samples["device_time_ns"] / 1e9, 0.0, 1.0)[:, None] * 0.8
    count = 5.0 / 2000.0
    assert np.abs(bend - wanted)[early].max() < count, "free fingers go where their user goes"
    expected = 0.8 - 0.3 * np.array([20.0 / 21.0, 20.0 / 21.0, 4.0 / 5.0, 0.0, 0.0])
    assert np.abs(bend[-1] - expected).max() < count, "springs against each other"
    assert np.allclose(np.clip(samples["channels"][:, :5], 0.0, 1.0), bend, atol=1e-9)
    assert device.release()
    last = read_on(device, clock, [5_000_000] * 40)
    assert np.abs(regression.bends(last["flexion"][-1:]) - 0.8).max() < count, "released fingers close again"


def test_the_simulated_glove_follows_its_seed(clock: list[int]) -> None:
    ways = []
    for step, seed in ((5_000_000, 1), (11_000_000, 1), (5_000_000, 2)):
        device = open_device(configure("sim", playback=Playback(motion()), seed=seed))
        ways.append(read_on(device, clock, [step] * 200)["flexion"][:200])
    assert np.array_equal(ways[0], ways[1])
    assert not np.array_equal(ways[0], ways[2])


def test_fingers_and_palm_of_one_motion_begin_together(clock: list[int]) -> None:
    given = motion()
    playback = Playback(given)
    device = open_device(configure("replay", playback=playback))
    source = make_pose_source(PoseConfig(kind="replay", playback=playback))
    read_all(device)
    for k in range(50):
        came, position, orientation = source.read(clock[0])
        assert came == clock[0]
        assert np.allclose(position, given.position[k], atol=1e-12)
        assert np.allclose(np.abs(orientation @ given.orientation[k]), 1.0, atol=1e-12)
        clock[0] += 10_000_000


def test_the_keyboard_pose_is_never_half_of_one_and_half_of_another() -> None:
    status = SharedBlock.create("test-status", LIVE_STATUS).array[0]
    source = make_pose_source(PoseConfig(kind="keyboard", position=(0.1, 0.2, 0.3)), status)
    assert source.read(5)[0] == 5
    assert source.read(5)[1].tolist() == [0.1, 0.2, 0.3]
    write_keyboard_pose(status, (1.0, 1.0, 1.0), (0.0, 1.0, 0.0, 0.0))
    assert [part.tolist() for part in source.read(6)[1:]] == [[1.0, 1.0, 1.0], [0.0, 1.0, 0.0, 0.0]]
    status["pose_version"] += 1
    status["pose_position"] = 2.0
    assert source.read(7)[1].tolist() == [1.0, 1.0, 1.0], "a pose in the making is not read"
    status["pose_version"] += 1
    status["pose_position"] = np.nan
    assert source.read(8)[1].tolist() == [1.0, 1.0, 1.0], "nor one that is not finite"


HOME = np.array([0.1, -0.2, 0.3])
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def settled(keys: str) -> PalmKeys:
    palm = PalmKeys(HOME, UPRIGHT)
    assert not palm.press(keys)
    palm.advance(1e9)
    return palm


@pytest.mark.parametrize(("key", "axis"), poses.MOVES.items())
def test_a_stroke_moves_the_palm_one_step_along_an_axis(key: str, axis: tuple[float, float, float]) -> None:
    palm = settled(key.upper())
    np.testing.assert_allclose(palm.position, HOME + poses.STEPS[2] * np.array(axis), atol=1e-15)
    np.testing.assert_array_equal(palm.orientation, UPRIGHT)


@pytest.mark.parametrize(("key", "axis"), poses.TURNS.items())
def test_a_stroke_turns_the_palm_about_its_own_axis(key: str, axis: tuple[float, float, float]) -> None:
    half = 0.5 * math.radians(poses.DEGREES_PER_METRE * poses.STEPS[2])
    palm = settled(key)
    expected = np.array([math.cos(half), *(math.sin(half) * np.array(axis))])
    np.testing.assert_allclose(palm.orientation, expected, atol=1e-12)
    # Behind a quarter turn about z, the palm's x is the world's y.
    turned = PalmKeys(HOME, [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])
    turned.press("i")
    turned.advance(1e9)
    product = math.sqrt(0.5) * np.array([math.cos(half), math.sin(half), math.sin(half), math.cos(half)])
    np.testing.assert_allclose(turned.orientation, product, atol=1e-12)


@pytest.mark.parametrize("key", poses.STOP)
def test_a_stop_key_ends_and_what_follows_is_not_taken(key: str) -> None:
    palm = PalmKeys(HOME, UPRIGHT)
    assert palm.press(f"w{key}dd")
    palm.advance(1e9)
    np.testing.assert_allclose(palm.position, HOME + [0.0, poses.STEPS[2], 0.0])


@given(st.text("adswfrkiuoljh+-xyz?", max_size=300), st.floats(1e-4, 0.1))
def test_the_palm_never_moves_faster_than_a_hand_nor_out_of_reach(keys: str, seconds: float) -> None:
    palm = PalmKeys(HOME, UPRIGHT)
    palm.press(keys)
    for _ in range(20):
        position, orientation = palm.position.copy(), palm.orientation.copy()
        palm.advance(seconds)
        assert np.linalg.norm(palm.position - position) <= poses.SPEED * seconds * (1.0 + 1e-9)
        angle = 2.0 * math.acos(min(1.0, abs(float(palm.orientation @ orientation))))
        assert angle <= poses.TURNING * seconds * (1.0 + 1e-6) + 1e-7
        assert abs(np.linalg.norm(palm.orientation) - 1.0) < 1e-9
        assert (np.abs(palm.position - HOME) <= poses.REACH + 1e-12).all()
    palm.advance(1e9)
    assert not palm.advance(1.0)
