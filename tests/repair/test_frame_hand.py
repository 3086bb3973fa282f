"""Program of a frame's hand: rows against differences of the balls' distances, and steps that turn back."""

import numpy as np
import pytest
import trimesh
from repair_scenes import HAND, held, shape_case

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.kernels.mesh.bvh import build_mesh_bvh, mesh_signed_distance
from hhsim.repair.projection import CLOSER, FIRST_GAP, LONGEST_STEP, TOUCH, FrameHand
from hhsim.repair.tracks import HandJudge
from hhsim.repair.written_hand import NUMBERS, TIPS, WrittenHand, changed_hand

CASE = shape_case(trimesh.creation.icosphere(4, 0.05), held(1, 0.07, 0.7))
JUDGE = HandJudge(HAND, CASE.surface)
PLACED = forward_kinematics(HAND, *CASE.frames)
WRITTEN = WrittenHand(
    np.concatenate([PLACED.position[:, None], PLACED.joints.reshape(-1, 20, 3)], axis=1), HAND, CASE.frames, False
)
BVH = build_mesh_bvh(CASE.mesh.vertices, CASE.mesh.faces)


def ball_distances(hand: HandConfiguration) -> FloatArray:
    points, radii, _ = WRITTEN.samples(WRITTEN.posed(hand))
    return mesh_signed_distance(BVH, points) - radii


def test_rows_are_the_slopes_of_near_balls_and_of_tips_that_touch() -> None:
    change = np.random.default_rng(3).normal(0.0, 2e-3, (1, NUMBERS))
    start = changed_hand(CASE.frames, change)
    program = FrameHand(JUDGE, WRITTEN, start).program()
    value, recorded = ball_distances(start), ball_distances(CASE.frames)[TIPS].min(axis=1)
    touching = np.flatnonzero(recorded <= 5e-3)
    near = np.flatnonzero(value < LONGEST_STEP)
    assert len(near) > 20
    assert len(touching) >= 2
    step = 1e-7
    ends = [
        np.stack([ball_distances(changed_hand(start, sign * step * row[None])) for row in np.eye(NUMBERS)], axis=1)
        for sign in (1.0, -1.0)
    ]
    slopes = (ends[0] - ends[1]) / (2.0 * step)
    tips = TIPS[touching, value[TIPS[touching]].argmin(axis=1)]
    np.testing.assert_allclose(program.rows[: len(near), :NUMBERS], slopes[near], atol=1e-3)
    np.testing.assert_allclose(program.rows[len(near) :, :NUMBERS], -slopes[tips], atol=1e-3)
    np.testing.assert_array_equal(program.rows[len(near) :, NUMBERS:], np.eye(len(tips)))
    assert not program.rows[: len(near), NUMBERS:].any()
    np.testing.assert_allclose(program.bounds[: len(near)], FIRST_GAP - value[near], atol=1e-12)
    wanted = np.maximum(TOUCH, recorded[touching]) - CLOSER
    np.testing.assert_allclose(program.bounds[len(near) :], value[tips] - wanted, atol=1e-12)


def test_a_step_that_turns_back_is_shortened() -> None:
    hand = FrameHand(JUDGE, WRITTEN, CASE.frames._replace(position=CASE.frames.position + [0.0, 0.0, 0.1]))
    up = np.eye(NUMBERS)[2] * 0.02
    assert hand.moved(up) == LONGEST_STEP
    assert hand.moved(up) == LONGEST_STEP
    assert hand.moved(-up) == pytest.approx(0.5 * LONGEST_STEP)
    assert hand.posture.position[0, 2] - CASE.frames.position[0, 2] == pytest.approx(0.1 + 1.5 * LONGEST_STEP)
