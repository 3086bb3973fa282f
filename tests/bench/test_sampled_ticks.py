"""Which ticks are looked at where all would take too long."""

import numpy as np

from hhsim.bench.mesh_errors import sampled


def test_samples_are_spread_over_the_ticks() -> None:
    ticks = np.arange(100, 300, 2)
    chosen = sampled(ticks, 5)
    assert chosen.tolist() == [100, 148, 198, 248, 298]
    assert sampled(ticks, 3, [7]).tolist() == [7, 100, 198, 298]
    assert sampled(ticks[:2], 5).tolist() == [100, 102]
    assert sampled(np.zeros(0, np.int64), 5).tolist() == []
