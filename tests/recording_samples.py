"""Recordings that test modules share: a synthetic hand that moves like one, ways to damage it, and its correction."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import quaternion, quaternion_from_matrix, rotation_matrix
from hhsim.motion.file import save_trajectory
from hhsim.motion.trajectory import Trajectory
from hhsim.recordings.cleaning import CleanedRecording, CleaningOptions, clean_recording
from hhsim.recordings.finger_ik import finger_axes
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import Content, Correction, ReadOptions, read_content
from hhsim.recordings.unit_detection import in_our_units
from hhsim.repair.written_hand import moved_joints


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


def bone_turns(posture: HandConfiguration, side: str) -> FloatArray:
    """Rotations from the straight hand in the palm frame to the world, of the palm and 15 bones, (T, 16, 3, 3)."""
    distal, dorsal, _ = finger_axes("left" if side == "left" else "right")
    sign = -1.0 if side == "left" else 1.0
    palm = rotation_matrix(posture.orientation)
    bones = [palm]
    for f in range(5):
        spread = Rotation.from_rotvec(sign * posture.abduction[:, f, None] * dorsal[f]).as_matrix()
        for k in range(3):
            bend = posture.flexion[:, f, : k + 1].sum(axis=1)[:, None] * np.cross(dorsal[f], distal[f])
            bones.append(palm @ spread @ Rotation.from_rotvec(bend).as_matrix())
    return np.stack(bones, axis=1)


def a_correction(
    recording: Recording, *, changed: slice = slice(3, 9), palm: bool = True, fingers: bool = True, turn: bool = True
) -> Correction:
    """A hand that turns and moves by some millimetres and opens its fingers in some samples, if those are whole."""
    count = recording.sample_count
    mask = np.zeros(count, dtype=bool)
    mask[changed] = True
    fitted = HandConfiguration.of(recording)
    mask &= np.isfinite(recording.angles).all(axis=1) & np.isfinite(recording.position).all(axis=1)
    if recording.joints is not None:
        mask &= np.isfinite(recording.joints).all(axis=(1, 2))
    step = mask[:, None] * np.linspace(0.5, 1.0, count)[:, None]
    place = fitted.position + palm * step * [0.004, -0.003, 0.006]
    turned = Rotation.from_rotvec(palm * turn * step * [0.05, 0.02, -0.07]).as_matrix()
    palms = quaternion_from_matrix(turned @ np.nan_to_num(rotation_matrix(fitted.orientation)))
    orientation = np.where(mask[:, None], palms, fitted.orientation)
    flexion = fitted.flexion - fingers * step[:, :, None] * np.linspace(0.02, 0.15, 15).reshape(5, 3)
    posture = HandConfiguration(place, orientation, flexion, fitted.abduction + fingers * step * 0.03)
    with np.errstate(invalid="ignore"):
        whole = HandConfiguration(*(np.nan_to_num(part) for part in fitted))
        moved = HandConfiguration(*(np.nan_to_num(part) for part in posture))
        before, after = bone_turns(whole, recording.hand), bone_turns(moved, recording.hand)
    rotation = np.where(mask[:, None, None, None], after @ np.swapaxes(before, 2, 3), np.eye(3))
    joints = np.full((count, 21, 3), np.nan)
    if recording.joints is not None:
        corrected = moved_joints(recording.joints, fitted.position, posture.position, rotation)
        joints = np.where(mask[:, None, None], corrected, recording.joints)
    return Correction(fitted, posture, rotation, joints, mask)
