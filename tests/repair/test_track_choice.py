"""The choice of tracks against every sequence of them."""

from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.arrays import BoolArray, FloatArray
from hhsim.repair.tracks import NO_HAND, choose_tracks

WEIGHT = 5.0


def cost(off: FloatArray, valid: BoolArray, sequence: tuple[int, ...]) -> float:
    total = 0.0
    for t, k in enumerate(sequence):
        total += float((off[k, t] ** 2).sum(axis=1).mean()) if valid[k, t] else NO_HAND
        before = sequence[t - 1]
        if t and valid[k, t] and valid[before, t - 1]:
            total += WEIGHT * float(((off[k, t] - off[before, t - 1]) ** 2).sum(axis=1).mean())
    return total


@settings(max_examples=60)
@given(st.integers(0, 2**32), st.integers(1, 3), st.integers(1, 6))
def test_no_sequence_of_tracks_costs_less(seed: int, tracks: int, frames: int) -> None:
    random = np.random.default_rng(seed)
    off = 0.02 * random.normal(size=(tracks, frames, 2, 3))
    valid = random.random((tracks, frames)) < 0.8
    # Track 0 has all frames, the others some in the middle.
    first = np.where(np.arange(tracks) == 0, 0, random.integers(0, frames, tracks))
    last = np.where(np.arange(tracks) == 0, frames, random.integers(first, frames + 1))
    for k in range(tracks):
        valid[k, : first[k]] = valid[k, last[k] :] = False
    own = [slice(a, b) for a, b in zip(first.tolist(), last.tolist())]
    parts = [off[k, own[k]] for k in range(tracks)], [valid[k, own[k]] for k in range(tracks)]
    chosen = choose_tracks(first.tolist(), *parts, WEIGHT).tolist()
    assert all(valid[k, t] or (k == 0 and not valid[:, t].any()) for t, k in enumerate(chosen))
    best = min(cost(off, valid, sequence) for sequence in product(range(tracks), repeat=frames))
    assert cost(off, valid, tuple(chosen)) <= best + 1e-12


def test_of_equal_tracks_the_first_is_taken() -> None:
    off, valid = [np.zeros((4, 1, 3))] * 3, [np.ones(4, bool)] * 3
    np.testing.assert_array_equal(choose_tracks([0, 0, 0], off, valid, WEIGHT), 0)
