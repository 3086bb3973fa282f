"""Written hands and tracks: bones, derivatives, projections that end outside, frames by the referee in scenes."""

from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
import trimesh
from conftest import sampled
from hypothesis import given, settings
from hypothesis import strategies as st
from repair_scenes import HAND, Case, held, ring_case, scene_case, shape_case
from sphere_scenes import random_hand

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.motion.trajectory import RigidMotion
from hhsim.repair.projection import FrameProgram, HandJudge, Projection, farthest, steady_step
from hhsim.repair.repair import correct
from hhsim.repair.tracks import NO_HAND, choose_tracks, repair_frames
from hhsim.repair.written_hand import (
    NUMBERS,
    WrittenHand,
    bone_frames,
    change_between,
    changed_hand,
    mean_acceleration,
    moved_joints,
)

LEFT = HandModel.default("left")


def keypoints(hand: HandModel, frames: HandConfiguration) -> FloatArray:
    placed = forward_kinematics(hand, *frames)
    return np.concatenate([placed.position[:, None], placed.joints.reshape(-1, 20, 3)], axis=1)


def residual(joints: FloatArray, size: float) -> FloatArray:
    """Recorded joints that our hand does not fit: each is off by the same vector in every frame."""
    return joints + np.random.default_rng(7).normal(0.0, size, joints.shape[1:])


@pytest.mark.parametrize("hand", [HAND, LEFT], ids=["right", "left"])
@settings(max_examples=20)
@given(st.integers(0, 2**32))
def test_joints_of_our_hand_move_to_where_our_kinematics_puts_them(hand: HandModel, seed: int) -> None:
    random = np.random.default_rng(seed)
    fitted, posture = (random_hand(random, hand, 0.1) for _ in range(2))
    written = WrittenHand(keypoints(hand, fitted), hand, fitted, tip_on_surface=False)
    np.testing.assert_allclose(written.moved(written.joints, posture), keypoints(hand, posture), atol=1e-12)
    frames = bone_frames(hand, posture)
    np.testing.assert_allclose(frames @ frames.swapaxes(-1, -2), np.tile(np.eye(3), (1, 16, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)


@pytest.mark.parametrize("hand", [HAND, LEFT], ids=["right", "left"])
def test_derivatives_of_the_balls_are_their_differences(hand: HandModel) -> None:
    random = np.random.default_rng(1)
    fitted, posture = (random_hand(random, hand, 0.1) for _ in range(2))
    written = WrittenHand(residual(keypoints(hand, fitted), 2e-3), hand, fitted, tip_on_surface=True)
    points, radii, motion = written.samples(written.posed(posture))
    step = 1e-6
    for number in range(NUMBERS):
        change = np.zeros((1, NUMBERS))
        change[0, number] = step
        ends = [written.samples(written.posed(changed_hand(posture, sign * change)))[0] for sign in (1.0, -1.0)]
        np.testing.assert_allclose((ends[0] - ends[1]) / (2.0 * step), motion[:, :, number], atol=1e-8)
    assert (radii > 0.0).all()
    assert len(points) == len(radii)


def test_tips_on_the_skin_are_drawn_in_by_their_radius() -> None:
    frames = held(1)
    joints = keypoints(HAND, frames)
    skin = joints.copy()
    last = joints[:, 4::4] - joints[:, 3::4]
    skin[:, 4::4] += HAND.radius[:, 3:] * last / np.linalg.norm(last, axis=-1, keepdims=True)
    np.testing.assert_allclose(WrittenHand(skin, HAND, frames, tip_on_surface=True).axes, joints, atol=1e-15)


def depth(case: Case, written: WrittenHand, hands: HandConfiguration) -> FloatArray:
    return np.maximum(0.0, 0.0 - HandJudge(case.hand, case.surface).placed_clearance(written.placed(hands)))


@pytest.mark.parametrize("size", [0.0, pytest.param(1e-3, marks=pytest.mark.soak), 3e-3])
def test_no_written_hand_penetrates(size: float) -> None:
    case = scene_case("cup", "handle", 66)
    joints = residual(keypoints(case.hand, case.frames), size)
    written = WrittenHand(joints, case.hand, case.frames, tip_on_surface=False)
    free = repair_frames(case.hand, case.surface, case.frames, 0.03)
    found, marked = correct(written, free, case.surface, max_correction=0.03)
    changed, before = found.changed, depth(case, written, case.frames)
    assert (before > 0.004).any()
    assert not depth(case, written, found.posture).any()
    assert not marked.any()
    assert (changed | (before == 0.0)).all()
    assert mean_acceleration(found.joints) <= 1.1 * mean_acceleration(joints)
    # Far from contact nothing is touched, not a bit of it.
    assert not changed[:5].any()
    np.testing.assert_array_equal(found.joints[~changed], joints[~changed])
    np.testing.assert_array_equal(found.rotation[~changed], np.tile(np.eye(3), ((~changed).sum(), 16, 1, 1)))
    placed = written.placed(found.posture)
    np.testing.assert_allclose(placed.joints.reshape(-1, 20, 3), found.joints[:, 1:], atol=1e-9)
    assert case.referee_clearance_of(placed.at(np.flatnonzero(changed)[::4])) >= 0.0
    again = moved_joints(joints, case.frames.position, found.posture.position, found.rotation)
    np.testing.assert_allclose(found.joints, again, atol=1e-12)
    bones = [np.linalg.norm(np.diff(j[:, 1:].reshape(-1, 5, 4, 3), axis=2), axis=-1) for j in (joints, again)]
    np.testing.assert_allclose(bones[0], bones[1], atol=1e-12)


@pytest.mark.parametrize(("speed", "beside"), [(0.02, False), (0.0, True)])
def test_frames_that_need_nothing_stay_unless_the_motion_would_jump(speed: float, beside: bool) -> None:
    """An object jumps up into a still hand for five frames: out of its way is a jump only where the motion is calm."""
    case = shape_case(trimesh.creation.box((0.5, 0.5, 0.1)), held(30))
    dips = np.abs(np.arange(30) - 15) <= 2
    frames = case.frames._replace(position=case.frames.position + [0.0, 0.0, 0.1])
    written = WrittenHand(keypoints(HAND, frames), HAND, frames, tip_on_surface=False)
    above = HandJudge(HAND, case.surface).placed_clearance(written.placed(frames), np.inf)
    frames.position[:, 2] -= above + np.where(dips, 3e-3, -1e-4)
    swing = np.cumsum(speed * (-1.0) ** np.arange(30))[:, None] * [1.0, 0.0, 0.0]
    swing[:, 2] = np.where(dips, 3.1e-3, 0.0)
    moved = RigidMotion(np.tile([1.0, 0.0, 0.0, 0.0], (30, 1)), swing)
    settled = WrittenHand(keypoints(HAND, frames), HAND, frames, tip_on_surface=False)
    found, _ = correct(settled, frames, case.surface, object_moved=moved)
    np.testing.assert_array_equal(depth(case, settled, frames) > 0.0, dips)
    assert not depth(case, settled, found.posture).any()
    changed = found.changed
    assert changed[dips].all()
    assert (changed & ~dips).any() == beside
    assert not changed[np.abs(np.arange(30) - 15) > 8].any()


def test_a_recorded_hand_that_is_outside_stays_whatever_our_repair_would_change() -> None:
    case = shape_case(trimesh.creation.box((0.5, 0.5, 0.1)), held(4))
    fitted = held(4)
    # A unit quaternion up to rounding, whose product with its inverse is no identity.
    fitted.orientation[:] = np.array([0.9, 0.1, 0.3, 0.0]) / np.linalg.norm([0.9, 0.1, 0.3])
    fitted.position[:, 2] = 0.3
    joints = keypoints(HAND, fitted)
    repaired = fitted._replace(position=fitted.position + 0.01)
    kept, _ = correct(WrittenHand(joints, HAND, fitted, tip_on_surface=False), repaired, case.surface)
    assert not kept.changed.any()
    for before, after in zip(fitted, kept.posture):
        np.testing.assert_array_equal(before, after)
    np.testing.assert_array_equal(kept.joints, joints)


@settings(max_examples=24)
@given(st.integers(0, 2**32), st.sampled_from(["ball", "box", "ring"]))
def test_a_projection_ends_outside(seed: int, name: str) -> None:
    random = np.random.default_rng(seed)
    shapes = {
        "ball": lambda: trimesh.creation.icosphere(2, random.uniform(0.01, 0.05)),
        "box": lambda: trimesh.creation.box(random.uniform(0.01, 0.08, 3)),
        "ring": lambda: trimesh.creation.torus(0.03, random.uniform(0.004, 0.02)),
    }
    frames = random_hand(random, HAND, 0.05)
    case = shape_case(shapes[name](), frames)
    joints = residual(keypoints(HAND, frames), 2e-3)
    written = WrittenHand(joints, HAND, frames, tip_on_surface=False)
    projection = Projection(written, HandJudge(HAND, case.surface))
    free = projection.corrected(frames, projection.clearance(frames) < 0.0)
    inside = projection.clearance(frames)[0] < 0.0
    assert inside or not change_between(frames, free).any()
    # The shift that frees a hand where the programs do not is at most 5 cm: beyond, the hand stays as it was.
    if projection.clearance(free)[0] >= 0.0:
        assert case.referee_clearance_of(written.placed(free)) >= 0.0
    else:
        assert not change_between(frames, free).any()
        assert case.referee_clearance_of(written.placed(frames)) < -0.005


FRAMES, TOTAL = [2, 3, 4, 7], 9


def programs(random: np.random.Generator, slacks: int) -> list[FrameProgram]:
    found = []
    for _ in FRAMES:
        n = NUMBERS + slacks
        root = random.normal(size=(n, n))
        feasible = 0.1 * random.normal(size=n)
        rows = 30.0 * random.normal(size=(6, n))
        bounds = rows @ feasible - 30.0 * random.uniform(0.0, 1.0, 6)
        found.append(FrameProgram(root.T @ root + np.eye(n), random.normal(size=n), rows, bounds))
    return found


def by_quadprog(own: list[FrameProgram], change: FloatArray, steadiness: float) -> FloatArray:
    from quadprog import solve_qp

    n = len(own[0].pull)
    hessian, pull = np.zeros((len(own) * n,) * 2), np.concatenate([program.pull for program in own])
    second = np.diff(np.eye(TOTAL), 2, axis=0)
    metric = steadiness * np.mean([np.diag(program.hessian)[:NUMBERS] for program in own], axis=0)
    rows, bounds = [], []
    for k, program in enumerate(own):
        hessian[k * n : (k + 1) * n, k * n : (k + 1) * n] = program.hessian
        for row, bound in zip(program.rows, program.bounds):
            rows.append(np.concatenate([row if j == k else np.zeros(n) for j in range(len(own))]))
            bounds.append(bound)
    # The second differences of change + x, one number of the hand at a time.
    for number in range(NUMBERS):
        of = np.zeros((TOTAL, len(pull)))
        for k, frame in enumerate(FRAMES):
            of[frame, k * n + number] = 1.0
        hessian += metric[number] * (second @ of).T @ (second @ of)
        pull -= metric[number] * (second @ of).T @ (second @ change[:, number])
    return np.asarray(solve_qp(hessian, pull, np.array(rows).T, np.array(bounds))[0]).reshape(len(own), n)[:, :NUMBERS]


@pytest.mark.parametrize(("slacks", "steadiness"), [(0, 3.0), (2, 30.0), (1, 0.0)])
def test_the_steps_are_those_of_quadprog(slacks: int, steadiness: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hhsim.repair.projection.TOLERANCE", 1e-10)
    random = np.random.default_rng(slacks)
    own, change = programs(random, slacks), random.normal(size=(TOTAL, NUMBERS))
    step = steady_step(own, change, FRAMES, steadiness)
    np.testing.assert_allclose(step, by_quadprog(own, change, steadiness), atol=1e-6)


def test_rows_that_contradict_each_other_give_way_by_the_same() -> None:
    program = FrameProgram(np.eye(NUMBERS), np.zeros(NUMBERS), np.eye(NUMBERS)[[0, 0]] * [[1.0], [-1.0]], np.ones(2))
    step = steady_step([program], np.zeros((1, NUMBERS)), [0], 1.0)
    np.testing.assert_allclose(step, 0.0, atol=1e-5)


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
