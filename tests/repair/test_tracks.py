"""Repaired frames against the referee, in scenes, in a ring, in a sheet, in a block; the choice of tracks by force."""

from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from repair_scenes import HAND, Case, held, ring_case, scene_case, shape_case
from sampled import sampled

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.repair.projection import HandJudge, farthest
from hhsim.repair.tracks import NO_HAND, choose_tracks, repair_frames


class Repaired(NamedTuple):
    """Repaired frames, their depth before and after [m], how far they moved [m], and those that are not solved."""

    posture: HandConfiguration
    depth_before: FloatArray
    depth: FloatArray
    correction: FloatArray
    marked: BoolArray


def repaired(case: Case, max_correction: float = 0.03) -> Repaired:
    found = repair_frames(case.hand, case.surface, case.frames, max_correction)
    judge = HandJudge(case.hand, case.surface)
    before, after = (np.maximum(0.0, 0.0 - judge.clearance(hands)) for hands in (case.frames, found))
    moved = farthest(judge.points(found), judge.points(case.frames))
    return Repaired(found, before, after, moved, ~(after == 0.0) | (moved > max_correction))


SCENES = [("cup", "handle"), ("cup", "grasp"), ("bunny", "grasp"), ("teapot", "grasp"), ("shamrock", "leaf")]


@pytest.mark.parametrize(("name", "script"), sampled(SCENES, lambda place, _: place == 0))
def test_no_repaired_frame_penetrates(name: str, script: str) -> None:
    case = scene_case(name, script)
    found = repaired(case)
    assert (found.depth_before > 0.005).any()
    deepest = int(found.depth_before.argmax())
    assert case.referee_clearance(case.frames.part(deepest, deepest + 1)) < -0.004
    assert not found.marked.any()
    assert not found.depth.any()
    assert case.referee_clearance(found.posture.at(np.flatnonzero(found.correction > 0.0)[::6])) >= 0.0


def test_the_same_frames_give_the_same_bytes_and_free_ones_stay() -> None:
    case = scene_case("cup", "handle", 66)
    first, second = repaired(case), repaired(case)
    outside = first.depth_before == 0.0
    for a, b in zip((*first.posture, *first[1:]), (*second.posture, *second[1:])):
        np.testing.assert_array_equal(a, b)
    pairs = zip(case.frames, first.posture)
    free = np.all([np.equal(*pair).reshape(len(outside), -1).all(axis=1) for pair in pairs], axis=0)
    assert 0 < free.sum() < len(free)
    # A frame or two beside a contact may stay on the track that leads to it.
    assert (outside | ~free).all()
    assert (free == outside).mean() > 0.9


def test_a_palm_that_a_block_holds_up_rises_by_its_depth() -> None:
    # The hand stretched on a wide block: no rotation and no bending helps the palm's lowest points all at once.
    case = shape_case(trimesh.creation.box((1.0, 1.0, 0.4)), held(1, flexion=0.0))
    judge = HandJudge(HAND, case.surface)
    top = 0.2 - 1e-3 * 4
    lowest = float(judge.clearance(held(1, 1.0, 0.0), np.inf)[0]) - 0.8
    case = case._replace(frames=held(2, top - lowest, 0.0))
    found = repaired(case)
    np.testing.assert_allclose(found.depth_before, 0.004, atol=1e-6)
    assert not found.marked.any()
    assert (found.correction < 0.006).all()
    assert (found.correction > 0.001).all()
    assert case.referee_clearance(found.posture) >= 0.0


def test_a_finger_in_a_ring_stays_in_it() -> None:
    case = ring_case()
    found = repaired(case)
    np.testing.assert_allclose(found.depth_before, 1e-3, atol=4e-4)
    # Freed from outside, the finger would be a ring's radius away.
    assert (found.correction < 0.004).all()
    assert not found.marked.any()
    assert case.referee_clearance(found.posture) >= 0.0


def test_a_restart_frees_a_hand_on_the_side_that_both_passes_miss() -> None:
    # The recording jumps through a plate and back: both passes come from above, and the frames below touch it by 1 mm.
    case = shape_case(trimesh.creation.box((0.6, 0.6, 0.002)), held(1))
    gap = float(HandJudge(HAND, case.surface).clearance(held(1, -1.0), np.inf)[0])
    frames = sequence(held(2, 0.08), held(3, gap - 1.0 + 1e-3), held(2, 0.08))
    found = repaired(case._replace(frames=frames))
    below = np.arange(7) // 2 == 1
    below[4] = True
    np.testing.assert_allclose(found.depth_before, np.where(below, 1e-3, 0.0), atol=1e-6)
    assert not found.marked.any()
    assert (found.correction < 0.004).all()
    assert (HandJudge(HAND, case.surface).points(found.posture)[below, :, 2] < 0.0).all()
    assert case.referee_clearance(found.posture) >= 0.0


def test_fingers_that_are_recorded_through_a_sheet_all_come_to_one_side() -> None:
    sheet = trimesh.creation.box((0.3, 0.3, 0.002))
    case = shape_case(sheet, held(4, 0.03, 0.5))
    found = repaired(case, 0.1)
    assert (found.depth_before > 0.005).all()
    assert not found.marked.any()
    joints = HandJudge(HAND, case.surface).points(found.posture)
    assert (joints[..., 2] > 0.0).all() or (joints[..., 2] < 0.0).all()


def test_a_correction_beyond_the_limit_is_marked() -> None:
    case = shape_case(trimesh.creation.box((0.5, 0.5, 0.5)), held(2))
    found = repaired(case, 0.015)
    assert found.marked.all()
    assert (found.correction > 0.1).all()
    assert not found.depth.any()


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
