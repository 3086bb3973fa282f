import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.motion.tremor import Disturbance


def still(count: int = 2000) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    time = np.arange(count) / 1000.0
    orientation = np.tile(Rotation.from_rotvec([0.3, -0.2, 1.0]).as_quat(scalar_first=True), (count, 1))
    return time, np.full((count, 3), 0.2), orientation, np.full((count, 5, 3), 0.5)


def test_tremor_has_the_stated_amplitude_and_frequency() -> None:
    time, position, orientation, flexion = still()
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
    time, position, orientation, flexion = still(200)
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
