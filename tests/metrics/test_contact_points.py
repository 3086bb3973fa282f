"""Contacts by brute force over every pair, and the hand against the true mesh: trimesh, and a ball in closed form."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from file_faults import changed
from hypothesis import given, settings
from hypothesis import strategies as st
from live_rings import make_setup, session_file, solved_ticks
from mesh_oracle import to_cone
from short_grasp import short_grasp, short_scene
from sphere_scenes import bumpy_ball, palm_spheres

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import DamagedFileError
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.surface import ContactPoints
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.live.device import DeviceCounters
from hhsim.live.session.recorder import LOOP_DIED
from hhsim.live.session.statistics import LiveTally
from hhsim.live.session.supervisor import SessionOutcome
from hhsim.mesh.features import mesh_features
from hhsim.metrics.brute_force_distance import round_cone_distance
from hhsim.metrics.mesh_penetration import contact_error, find_contact_points
from hhsim.metrics.run_ticks import PLACED, result_ticks
from hhsim.metrics.session_faults import FaultCounts, broken_off, ended_before_its_time, recorded_faults
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.result.safety import Safety
from hhsim.result.schema import FAULT, INFORMATION, WARNING
from hhsim.solver.options import TOUCH, SolverOptions

NEAR = 1e-3


HAND, TREE = HandModel.default(), bumpy_ball(250)


@pytest.fixture(scope="module")
def placed() -> PlacedHand:
    """Comes down on the ball, turned a little further at each tick."""
    ticks = 12
    turn = np.linspace(-0.6, 0.6, ticks)
    orientation = np.stack([np.cos(turn), 0.0 * turn, np.sin(turn), 0.0 * turn], axis=1)
    position = np.stack([0.02 * turn, np.full(ticks, -0.06), np.linspace(0.09, 0.03, ticks)], axis=1)
    return forward_kinematics(HAND, position, orientation, np.full((ticks, 5, 3), 0.2), np.zeros((ticks, 5)))


@pytest.fixture(scope="module")
def found(placed: PlacedHand) -> ContactPoints:
    return find_contact_points(TREE.arrays(), hand_shape(HAND), placed, NEAR)


def balls(placed: PlacedHand, tick: int) -> tuple[FloatArray, FloatArray, IntArray]:
    """Centres [m] and radii [m] of balls that each body is made of, the palm's and 2,001 along each phalanx."""
    center = [palm_spheres(HAND.palm_tree.leaf_center, placed.position, placed.orientation)[tick]]
    radius = [HAND.palm_tree.leaf_radius]
    part = [np.arange(15, 15 + len(radius[0]))]
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    for body in range(15):
        f, k = divmod(body, 3)
        center.append((1.0 - share) * placed.joints[tick, f, k] + share * placed.joints[tick, f, k + 1])
        radius.append((1.0 - share[:, 0]) * HAND.radius[f, k] + share[:, 0] * HAND.radius[f, k + 1])
        part.append(np.full(len(share), body))
    return np.concatenate(center), np.concatenate(radius), np.concatenate(part)


def test_the_points_are_those_of_every_touching_pair(placed: PlacedHand, found: ContactPoints) -> None:
    assert np.all(np.diff(found.tick) >= 0)
    assert len(found.tick) > 300, "more than the room at first"
    tick = 8
    center, radius, part = balls(placed, tick)
    away = np.linalg.norm(center[:, None] - TREE.leaf_center, axis=2)
    gap = away - radius[:, None] - TREE.leaf_radius
    expected = []
    for one in range(part.max() + 1):
        mine = np.flatnonzero(part == one)
        best = mine[gap[mine].argmin(axis=0)]
        leaf = np.flatnonzero(gap[best, np.arange(len(best))] <= NEAR)
        best = best[leaf]
        along = (TREE.leaf_center[leaf] - center[best]) / away[best, leaf][:, None]
        expected.append(center[best] + radius[best, None] * along)
    ours, theirs = found.point[found.tick == tick], np.concatenate(expected)
    assert len(ours) == len(theirs) > 5
    apart = np.linalg.norm(ours[:, None] - theirs, axis=2)
    assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 2e-5


def test_the_points_on_a_mesh_are_those_of_every_touching_triangle(placed: PlacedHand) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.04)
    vertices, faces = np.array(ball.vertices, np.float64), np.array(ball.faces, np.int64)
    mesh, _ = mesh_features(vertices, faces, closed=True)
    found = find_contact_points(mesh, hand_shape(HAND), placed, NEAR)
    closest: Any = trimesh.triangles.closest_point
    tick, seen = 7, 0
    center, radius, part = balls(placed, tick)
    ours = found.tick == tick
    touched = set()
    for triangle in vertices[faces]:
        near = np.flatnonzero(np.linalg.norm(center - triangle.mean(axis=0), axis=1) < radius + 0.01)
        point = closest(np.repeat(triangle[None], len(near), axis=0), center[near])
        away = np.linalg.norm(center[near] - point, axis=1)
        gap = away - radius[near]
        for one in np.unique(part[near]):
            mine = np.flatnonzero(part[near] == one)
            best = mine[gap[mine].argmin()]
            if gap[best] > NEAR:
                continue
            ball_of = near[best]
            normal = (center[ball_of] - point[best]) / away[best]
            same = found.body[ours] == min(one, 15)
            off = np.linalg.norm(found.point[ours][same] - center[ball_of] + radius[ball_of] * normal, axis=1)
            assert off.min() < 3e-5
            assert (found.normal[ours][same][off.argmin()] @ normal) > 1.0 - 1e-5
            touched.add(min(int(one), 15))
            seen += 1
    assert touched == set(found.body[ours].tolist())
    assert seen > 50


def test_each_point_lies_on_its_body_with_the_normal_out_of_the_object(
    placed: PlacedHand, found: ContactPoints
) -> None:
    np.testing.assert_allclose(np.linalg.norm(found.normal, axis=1), 1.0, atol=1e-12)
    assert {*found.body.tolist()} >= {1, 7, 15}, "phalanges and palm"
    palm = palm_spheres(HAND.palm_tree.leaf_center, placed.position, placed.orientation)
    for tick, body, point, normal in zip(*found):
        joints = placed.joints[tick]
        if body == 15:
            on_hand = np.abs(np.linalg.norm(palm[tick] - point, axis=1) - HAND.palm_tree.leaf_radius).min()
        else:
            f, k = divmod(int(body), 3)
            ends = joints[f, k], joints[f, k + 1]
            on_hand = abs(round_cone_distance(point[None], *ends, *HAND.radius[f, k : k + 2])[0])
        assert on_hand < 1e-12
        # Against the normal from the point lies the leaf's surface, `NEAR` away at most, and the leaf's centre.
        away = point - TREE.leaf_center
        along = away @ normal
        straight = np.linalg.norm(away - along[:, None] * normal, axis=1) < 1e-9
        assert (straight & (along - TREE.leaf_radius <= NEAR)).any()


def test_fingers_and_ticks_can_be_left_out(placed: PlacedHand, found: ContactPoints) -> None:
    middle = [False, False, True, False, False]
    some = find_contact_points(TREE.arrays(), hand_shape(HAND), placed, NEAR, chosen=[3, 9], fingers=middle)
    kept = np.isin(found.tick, [3, 9]) & np.isin(found.body, [6, 7, 8, 15])
    assert kept.sum() > 5
    for ours, theirs in zip(some, found):
        np.testing.assert_array_equal(ours, theirs[kept])


def test_contact_error_is_the_distance_from_the_mesh() -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    bvh = build_mesh_bvh(np.array(box.vertices, np.float64), np.array(box.faces, np.int64))
    found = contact_error(bvh, np.array([[0.0, 0.0, 0.051], [0.0, 0.01, 0.048], [0.05, 0.05, 0.05]]))
    assert found == pytest.approx([1e-3, 2e-3, 0.0], abs=1e-12)
    assert contact_error(bvh, np.zeros((0, 3))).shape == (0,)


@pytest.fixture(scope="module")
def grasp(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A grasp of a coarse tree."""
    path = tmp_path_factory.mktemp("grasp") / "grasp.h5"
    summary = replay_scene(short_scene(short_grasp(), "cylinder", 2, "right"), SolverOptions(), path)
    assert any("off the mesh: 64 spheres (level 2)" in note and "--level 3" in note for note in summary.notes)
    return load_result(path)


def test_it_is_what_trimesh_measures_at_every_contact(grasp: Result) -> None:
    run = result_ticks(grasp)
    touched = run.touched
    placed = PlacedHand(*(grasp[name] for name in PLACED))
    contacts = find_contact_points(touched.surface, touched.shape, placed, touched.touch)
    points = [contacts.point[contacts.tick == tick] for tick in range(grasp.ticks)]
    surface = trimesh.Trimesh(touched.mesh.vertices, touched.mesh.faces, process=False)
    closest: Any = trimesh.proximity.closest_point
    expected = np.full(grasp.ticks, np.nan)
    for tick in np.flatnonzero([len(found) > 0 for found in points])[::7]:
        expected[tick] = closest(surface, points[tick])[1].max()
    looked = np.isfinite(expected)
    assert looked.sum() > 10
    np.testing.assert_allclose(run.contact_error[looked], expected[looked], atol=1e-9)
    assert grasp.summary["contact_error_max"] == np.nanmax(run.contact_error) > 1e-3
    assert (np.isfinite(run.contact_error) == [len(found) > 0 for found in points]).all()


def test_what_touches_the_spheres_is_no_farther_from_the_mesh_than_the_bound(grasp: Result) -> None:
    bound = short_scene(short_grasp(), "cylinder", 2, "right").solids[0].placed_tree.errors[-1].bound
    assert 0.5 * bound < grasp.summary["contact_error_max"] <= bound + TOUCH


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_a_round_cone_is_the_union_of_the_spheres_on_its_axis(seed: int) -> None:
    random = np.random.default_rng(seed)
    a, b = random.normal(0.0, 0.02, (2, 3))
    length = float(np.linalg.norm(b - a))
    radius_a = random.uniform(0.005, 0.02)
    radius_b = radius_a - random.uniform(0.0, 0.95) * min(length, radius_a)
    points = random.normal(0.0, 0.04, (30, 3))
    wanted, exact = to_cone(points, a, b, radius_a, radius_b), round_cone_distance(points, a, b, radius_a, radius_b)
    outside = wanted > 0.0
    np.testing.assert_allclose(exact[outside], wanted[outside], atol=1e-12)
    assert (exact[~outside] <= 1e-15).all()


FRAMES, MALFORMED, FREED = 50, 3, 20


@pytest.fixture(scope="module")
def ticks(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    return solved_ticks(make_setup(tmp_path_factory.mktemp("ticks") / "none.h5"))


def recorded(path: Path, ticks: np.ndarray, ended: str, *levels: int) -> Result:
    ticks = ticks.copy()
    ticks["safety"] = 0
    ticks["safety"][:FREED] = int(Safety.DEVICE_LOST | Safety.STALE_INPUT)
    ticks["safety"][-FREED:] = int(Safety.STOPPING)
    events = [(0, level, "the glove is gone") for level in levels]
    return session_file(path, ticks, ended, events, frames=FRAMES, malformed=MALFORMED)


@pytest.mark.parametrize(
    ("ended", "levels", "early", "faults"),
    [
        ("duration", (INFORMATION, WARNING), 0, 0),
        ("SIGTERM", (FAULT, FAULT), 0, 2),
        # Killed by kill -9: nobody was left to log it.
        (LOOP_DIED, (INFORMATION,), 1, 1),
        (LOOP_DIED, (FAULT, FAULT), 1, 2),
        ("", (), 1, 1),
    ],
)
def test_an_end_that_was_not_in_order_is_a_fault(
    tmp_path: Path, ticks: np.ndarray, ended: str, levels: tuple[int, ...], early: int, faults: int
) -> None:
    session = recorded(tmp_path / "session.h5", ticks, ended, *levels)
    counts = recorded_faults(session)
    assert counts == FaultCounts(early, faults, MALFORMED, FRAMES, FREED, len(ticks))
    assert counts.figures == {
        "ended_early": early,
        "faults": faults,
        "malformed_share": 100.0 * MALFORMED / FRAMES,
        "freed_share": 100.0 * FREED / len(ticks),
    }
    assert f"faults: {faults}{' (ended early)' if early else ''}; malformed packets: 3 of 50;" in counts.line
    assert f"freed for safety: {FREED} of {len(ticks)}" in counts.line
    assert bool(broken_off(session)) == bool(early)


@pytest.mark.parametrize(
    ("ended", "asked", "early", "told"),
    [
        ("the command was killed", 30.0, True, "the command was killed after 0.7 of 30 s"),
        ("the command was killed", None, True, "the command was killed"),
        ("SIGTERM", 30.0, True, "ended by SIGTERM after 0.7 of 30 s"),
        ("SIGTERM", None, False, ""),
        ("stopped", 30.0, False, "stopped after 0.7 of 30 s"),
        ("duration", 0.7, False, ""),
    ],
)
def test_a_session_that_its_user_did_not_stop_has_to_last_as_long_as_was_asked(
    tmp_path: Path, ticks: np.ndarray, ended: str, asked: float | None, early: bool, told: str
) -> None:
    session = recorded(tmp_path / "session.h5", ticks, ended)
    session.scene["duration"] = asked
    assert recorded_faults(session).early == early
    assert (broken_off(session) or ended_before_its_time(session)) == told


def test_what_a_damaged_file_does_not_tell_is_undefined_and_the_rest_is_told(tmp_path: Path, ticks: np.ndarray) -> None:
    path = tmp_path / "session.h5"
    recorded(path, ticks, "duration")
    with changed(path) as file:
        file["hands/right/live"].attrs["counters"] = "no JSON"
    counts = recorded_faults(load_result(path))
    assert np.isnan([counts.malformed, counts.frames, counts.figures["malformed_share"]]).all()
    assert (counts.faults, counts.freed) == (0, FREED)
    assert "malformed packets: — of —" in counts.line


def test_a_live_session_says_at_its_end_what_its_recording_says(tmp_path: Path, ticks: np.ndarray) -> None:
    session = recorded(tmp_path / "session.h5", ticks, LOOP_DIED)
    told = [(0.1, FAULT, "the loop was killed"), (0.2, FAULT, "which the file cannot know")]
    outcome = SessionOutcome("SIGKILL", 0.7, 700, 0, LiveTally(), {}, DeviceCounters(), session.path, 700, notices=told)
    summary = importlib.import_module("hhsim.cli.live.summary")
    assert summary.judged(outcome)[0] == recorded_faults(session)
    assert summary.summary_json(outcome)["faults"] == 1


def test_levels_that_are_no_numbers_are_named(tmp_path: Path, ticks: np.ndarray) -> None:
    path = tmp_path / "words.h5"
    recorded(path, ticks, "duration", FAULT)
    with changed(path) as file:
        count = len(file["hands/right/live/event/level"])
        del file["hands/right/live/event/level"]
        file["hands/right/live/event/level"] = np.full(count, b"2")
    with pytest.raises(DamagedFileError, match="live/event/level"):
        recorded_faults(load_result(path))
