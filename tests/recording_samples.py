"""Recordings that test modules share: a synthetic hand that moves like one, and ways to damage it."""

from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import quaternion
from hhsim.motion.file import save_trajectory
from hhsim.motion.trajectory import Trajectory
from hhsim.recordings.cleaning import CleanedRecording, CleaningOptions, clean_recording
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import Content, ReadOptions, read_content
from hhsim.recordings.unit_detection import in_our_units


def read_as(form: str, data: str | bytes, *, name: str = "", **options: Any) -> Recording:
    """The recording in some bytes of a format."""
    content = Content(data=data.encode() if isinstance(data, str) else data, name=name)
    return read_content(content, ReadOptions(form=form, **options))


def smooth_recording(count: int = 300, rate: float = 100.0, seed: int = 1, jitter: float = 0.1) -> Recording:
    """A reach with closing fingers: sums of sines well below the sampling rate, irregular stamps, a little noise."""
    random = np.random.default_rng(seed)
    time = (np.arange(count) + jitter * random.uniform(-1.0, 1.0, count)) / rate
    time -= time[0]

    def waves(size: int, amplitude: float) -> FloatArray:
        frequency = random.uniform(0.2, 1.2, (3, size))
        phase = random.uniform(0.0, 2.0 * np.pi, (3, size))
        return np.asarray(amplitude * np.sin(2.0 * np.pi * frequency * time[:, None, None] + phase).sum(axis=1) / 3.0)

    noise = random.normal(0.0, 1e-4, (count, 3))
    return Recording(
        time=time,
        position=np.array([0.1, -0.2, 0.3]) + waves(3, 0.12) + noise,
        orientation=quaternion(waves(3, 0.6)),
        flexion=(0.5 + waves(15, 0.4)).reshape(count, 5, 3) * [0.5, 1.0, 1.0],
        abduction=waves(5, 0.06),
        stated=frozenset(),
        form="test",
        name="smooth",
        hand="right",
    )


def cleaned(recording: Recording, options: CleaningOptions | None = None, **units: Any) -> CleanedRecording:
    """Clean a recording in the units of its numbers, as one that is read is cleaned."""
    own = recording.chosen(np.arange(recording.sample_count))
    return clean_recording(in_our_units(own, ReadOptions(**units)), options)


def write_descent(path: Path, count: int = 50) -> None:
    """Write a motion of a flat hand that comes down from 0.2 to 0.1 m, at 100 Hz."""
    place = np.linspace([0.0, 0.0, 0.2], [0.0, 0.0, 0.1], count)
    level = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    angles = np.zeros((count, 5, 3)), np.zeros((count, 5))
    save_trajectory(Trajectory(np.arange(count) / 100.0, place, level, *angles, name="motion"), path)
