"""Seeded disturbances of a scripted motion: tremor of the palm, and noise of the joint sensors."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.kernels.rotation import rotate_quaternion
from hhsim.reproducible import dot, norm, sine_and_cosine
from hhsim.system.settings_file import between, check_fields

Angle = Annotated[float, between(0.0, math.pi, "rad")]


@dataclass(frozen=True)
class Disturbance:
    """Tremor and sensor noise; all off by default.

    Tremor is a sinusoid along a seeded ellipse in space whose longer half axis is the amplitude, so that the largest
    excursion is the amplitude; position and rotation have an ellipse each. Healthy hands: 8 to 12 Hz, 0.05 to 0.1 mm.
    Raises TrajectoryError for a value out of its range.
    """

    tremor_position: Annotated[float, between(0.0, 0.1, "m")] = 0.0  # amplitude of the palm's position [m]
    tremor_rotation: Angle = 0.0  # amplitude of the palm's rotation vector [rad]
    tremor_frequency: Annotated[float, between(0.01, 1000.0, "Hz")] = 10.0
    # Counts of the joint sensors per full turn; 0 for no quantisation.
    sensor_counts: Annotated[int, between(0, 2**32)] = 0
    sensor_noise: Angle = 0.0  # standard deviation of each joint angle before quantisation [rad]

    def __post_init__(self) -> None:
        check_fields(self, TrajectoryError)

    def apply(
        self, seed: int, time: FloatArray, position: FloatArray, orientation: FloatArray, flexion: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Disturb position, orientation and flexion; those without a disturbance are the given arrays.

        All but the seed are as in `hhsim.motion.trajectory.Trajectory`.
        """
        # One stream for each part, so that switching one on leaves the others as they were.
        streams = [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(3)]
        if self.tremor_position > 0.0:
            position = position + self._ellipse(streams[0], time, self.tremor_position)
        if self.tremor_rotation > 0.0:
            turn = self._ellipse(streams[1], time, self.tremor_rotation)
            turned = np.empty_like(orientation)
            for i in range(time.shape[0]):
                rotate_quaternion(orientation[i], turn[i, 0], turn[i, 1], turn[i, 2], turned[i])
            orientation = turned
        if self.sensor_noise > 0.0:
            flexion = flexion + streams[2].normal(scale=self.sensor_noise, size=flexion.shape)
        if self.sensor_counts > 0:
            count = 2.0 * math.pi / self.sensor_counts
            flexion = count * np.round(flexion / count)
        return position, orientation, flexion

    def _ellipse(self, stream: np.random.Generator, time: FloatArray, amplitude: float) -> FloatArray:
        """Return a sin ωt + b cos ωt with seeded a and b, scaled to a longer half axis of `amplitude`; shape (T, 3)."""
        axes = stream.normal(size=(3, 2))
        a, b = axes.T
        # The longer half axis: the largest singular value.
        square = 0.5 * (dot(a, a) + dot(b, b) + norm([dot(a, a) - dot(b, b), 2.0 * dot(a, b)]))
        axes *= amplitude / np.sqrt(square)
        sine, cosine = sine_and_cosine(2.0 * math.pi * self.tremor_frequency * time)
        return np.asarray(sine[:, None] * axes[:, 0] + cosine[:, None] * axes[:, 1])

    @property
    def is_off(self) -> bool:
        """True if there is no disturbance."""
        return not (self.tremor_position or self.tremor_rotation or self.sensor_counts or self.sensor_noise)
