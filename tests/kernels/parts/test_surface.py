"""Parts that move: how far a point moves past one."""

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hhsim.kernels.parts.surface import part_dtype, passing


@given(st.integers(0, 2**32 - 1))
def test_a_point_passes_a_part_by_what_it_moves_in_its_frame(seed: int) -> None:
    random = np.random.default_rng(seed)
    here, there = Rotation.random(2, rng=random)
    place, goal, point = random.normal(0.0, 0.1, (3, 3))
    part: Any = np.zeros(1, part_dtype()).view(np.recarray)[0]
    part.position[:], part.rotation[:] = place, here.as_matrix()
    way = np.concatenate([goal, there.as_quat(scalar_first=True)])
    wanted = np.linalg.norm(here.inv().apply(point - place) - there.inv().apply(point - goal))
    assert abs(passing(part, way, point) - wanted) < 1e-15 + 1e-12 * wanted
