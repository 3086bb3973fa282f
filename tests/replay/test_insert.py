"""A peg that two fingertips put into a hole: how it is held, how it goes in, and what the clearance leaves it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from short_grasp import result_of

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.tick.state import STATUS_STUCK
from hhsim.result.reader import Result
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import open_scene
from hhsim.scene.script import Script

pytestmark = pytest.mark.soak

PEG, HOLE = (f"bodies/{name}" for name in ("peg", "hole"))
WEIGHT = 0.05 * 9.81
THUMB, INDEX, FIXED = 2, 5, -3
"""Bodies of the contacts: the last phalanges, and the second thing."""
SIDES = 48
INSCRIBED = np.cos(np.pi / SIDES)
RADIUS, GAP, CHAMFER, LENGTH, TOP = 0.010, 0.0005, 0.002, 0.060, 0.040
"""Of the peg, on each side of it, of its foot and both rims, of the peg, of the block [m] (tools/build_bodies.py)."""
MIDDLE = np.array([-0.12, -0.06])
SLACK = (RADIUS + GAP) / INSCRIBED - RADIUS * INSCRIBED
"""The gap on each side where corners of the hole's 48 sides are opposite to sides of the peg's [m]: 0.54 mm."""


def played(script: Script, path: Path) -> Result:
    return result_of(open_scene("peg", script, solid=False), path, surface="mesh")


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return played(load_script("insert"), tmp_path_factory.mktemp("insert") / "insert.h5")


@pytest.fixture(scope="module")
def missed(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """The same motion, but of a peg that is beside the hole's middle by 0.9 and 1.0 mm."""
    script = load_script("insert")
    phases = [replace(phase, way=(-0.1199, -0.0616, 0.0)) if phase.name == "move" else phase for phase in script.phases]
    return played(replace(script, phases=tuple(phases)), tmp_path_factory.mktemp("missed") / "missed.h5")


def last(result: Result, number: int) -> int:
    """Last tick of a phase: approach, pinch, hold, lift, move, lift, hold, release."""
    return result.phases[number].last_tick


def turn_of(result: Result, thing: str = PEG) -> FloatArray:
    return np.asarray(rotation_matrix(np.asarray(result[f"{thing}/tick/orientation"])))


def foot_of(result: Result) -> FloatArray:
    """Middle of the peg's lower end over the table, (T, 3): it begins at the origin."""
    return np.asarray(result[f"{PEG}/tick/position"])


def tilt_of(result: Result) -> FloatArray:
    axis = turn_of(result)[:, :, 2]
    return np.arctan2(np.hypot(axis[:, 0], axis[:, 1]), axis[:, 2])


def within_sides(points: FloatArray, apothem: FloatArray) -> BoolArray:
    """Return whether points (..., 3) are inside the prism of 48 sides about z that has an apothem [m] there."""
    angle = 2.0 * np.pi * (np.arange(SIDES) + 0.5) / SIDES
    # The side that a point is farthest out on is that next to its direction.
    nearest = np.floor(np.arctan2(points[..., 1], points[..., 0]) / (2.0 * np.pi / SIDES)).astype(int) % SIDES
    out = points[..., 0] * np.cos(angle[nearest]) + points[..., 1] * np.sin(angle[nearest])
    return np.asarray(out < apothem)


def corners_in_the_other(result: Result, turn: FloatArray, foot: FloatArray, by: float = 1e-9) -> int:
    """Return how many corners of peg and hole are in the other one by more than a length [m], at any of some ticks."""
    count = 0
    peg, hole = (np.asarray(result[f"{thing}/mesh/vertices"]) for thing in (PEG, HOLE))
    for part in np.array_split(np.arange(len(foot)), 1 + len(foot) // 100):
        points = np.einsum("tij,vj->tvi", turn[part], peg) + foot[part, None] - [*MIDDLE, 0.0]
        x, y, z = np.moveaxis(points, -1, 0)
        block = (np.abs(x) < 0.03 - by) & (np.abs(y) < 0.03 - by) & (z > by) & (z < TOP - by)
        rim = np.maximum(0.0, np.maximum(z - (TOP - CHAMFER), CHAMFER - z))
        count += int((block & ~within_sides(points, RADIUS + GAP + rim * INSCRIBED + by)).sum())
        seen = np.einsum("tji,tvj->tvi", turn[part], hole - foot[part, None])
        z = seen[..., 2]
        along = (z > by) & (z < LENGTH - by)
        apothem = (RADIUS - np.maximum(0.0, CHAMFER - z)) * INSCRIBED
        count += int((along & within_sides(seen, apothem - by)).sum())
    return count


def share_of_the_gap(turn: FloatArray, foot: FloatArray) -> FloatArray:
    """Compute the share of the gap that the peg's axis takes up, at each tick that it is 1 mm or more in the hole.

    The largest one of depth x tan(tilt) over 2 c, and of the axis' distance from the hole's over c, at both ends of
    where the level section of the peg's straight part is whole and in that of the hole.
    """
    axis, upper = turn[:, :, 2], TOP - CHAMFER
    low = foot[:, 2] + CHAMFER * axis[:, 2] + RADIUS * np.hypot(axis[:, 0], axis[:, 1])
    lower = np.maximum(low, CHAMFER)
    inside = (upper - lower > 1e-3) & (np.hypot(*(foot[:, :2] - MIDDLE).T) < RADIUS)
    foot, axis, lower = foot[inside], axis[inside], lower[inside]
    shares = [(upper - lower) * np.hypot(axis[:, 0], axis[:, 1]) / axis[:, 2] / (2.0 * SLACK)]
    for height in (lower, np.full(len(lower), upper)):
        at = foot + axis * ((height - foot[:, 2]) / axis[:, 2])[:, None]
        shares.append(np.hypot(*(at[:, :2] - MIDDLE).T) / SLACK)
    return np.asarray(np.max(shares, axis=0))


def test_two_fingertips_hold_the_peg_by_friction_until_they_let_go(result: Result) -> None:
    held = slice(last(result, 1) + 1, last(result, 6) + 1)
    names = ("tick", "body", "normal", "normal_force", "friction_force", "slip")
    tick, body, normal, pressed, friction, slip = (np.asarray(result.contacts[name]) for name in names)
    hand = (body >= 0) & (tick >= held.start) & (tick < held.stop)
    assert set(body[hand].tolist()) == {THUMB, INDEX}
    for fingertip in (THUMB, INDEX):
        mine = hand & (body == fingertip)
        assert np.bincount(tick[mine], pressed[mine], result.ticks)[held].min() > 0.8
        assert slip[mine].sum() < 5e-4, "it is held, and does not slide out"
    assert np.abs(normal[hand, 2]).max() < 0.1, "level: nothing carries it from below"
    # In the air all of its weight is on them, and most of that on friction.
    air = slice(last(result, 4) - 200, last(result, 4) + 200)
    np.testing.assert_allclose(result[f"{PEG}/tick/hand_wrench"][air, 2], WEIGHT, rtol=0.05)
    on_friction = -np.bincount(tick[hand], friction[hand, 2], result.ticks)
    assert on_friction[air].min() > 0.9 * WEIGHT
    assert foot_of(result)[air, 2].min() > TOP + CHAMFER
    for wrench in ("table_wrench", "body_wrench"):
        assert not result[f"{PEG}/tick/{wrench}"][air].any()
    assert not result[f"{HOLE}/tick/hand_wrench"].any(), "the hand touches the peg alone"


def test_the_peg_goes_in_as_deep_as_the_script_says_and_rests_there(result: Result) -> None:
    script, foot, tilt = load_script("insert"), foot_of(result), tilt_of(result)
    # Over the table by what the hand comes down less than it went up, but for its springs, which the weight loads.
    over = script.way("lift")
    assert over == pytest.approx(0.0005) and abs(foot[last(result, 6), 2] - over) < 6e-4
    assert foot[last(result, 6), 2] < 1e-4, "the hand puts it down, it does not let it fall"
    assert abs(foot[-1, 2]) < 1e-6 and tilt[-1] < 1e-6, "it stands on the table, through the whole hole"
    assert np.hypot(*(foot[-1, :2] - MIDDLE)) <= SLACK
    assert np.abs(np.diff(foot[-200:], axis=0)).max() == 0.0 and np.abs(np.diff(tilt[-200:])).max() == 0.0
    for name, force in (("hand_wrench", 0.0), ("body_wrench", 0.0), ("table_wrench", WEIGHT)):
        np.testing.assert_allclose(result[f"{PEG}/tick/{name}"][-1, 2], force, atol=1e-9)


def test_in_the_hole_the_peg_leans_no_more_than_clearance_and_depth_allow(result: Result) -> None:
    share = share_of_the_gap(turn_of(result), foot_of(result))
    assert len(share) > 1500 and share.max() <= 1.0
    assert np.degrees(tilt_of(result)[last(result, 6)]) < 0.5


def test_a_peg_that_is_off_the_hole_tilts_as_far_as_can_be_and_jams(missed: Result) -> None:
    share, held = share_of_the_gap(turn_of(missed), foot_of(missed)), last(missed, 6)
    assert len(share) > 500 and 0.8 < share.max() <= 1.0
    assert foot_of(missed)[held, 2] > 0.01 and np.degrees(tilt_of(missed)[held]) > 2.0
    still = foot_of(missed)[held - 200 : held]
    assert np.ptp(still, axis=0).max() < 1e-6, "friction holds it there, though the hand presses"
    assert missed[f"{PEG}/tick/hand_wrench"][held, 2] < -WEIGHT
    wedged = (np.asarray(missed["contact/tick"]) == held) & (missed.contacts["body"] == FIXED)
    normal = np.asarray(missed["contact/normal"])[wedged]
    assert (normal @ normal.T).min() < -0.5, "on both walls"


@pytest.mark.parametrize("which", ["result", "missed"])
def test_nothing_enters_anything(which: str, request: pytest.FixtureRequest) -> None:
    found: Result = request.getfixturevalue(which)
    assert corners_in_the_other(found, turn_of(found), foot_of(found)) == 0
    for column in ("penetration_depth", "penetration_finger", "penetration_palm"):
        assert not np.asarray(found[column]).any()
    assert found.body["table_distance"].min() >= 0.0
    assert not (np.asarray(found["status"]) & STATUS_STUCK).any()


def test_what_is_looked_at_here_tells_a_peg_in_the_wall(result: Result) -> None:
    rows = slice(-3, None)
    turn, foot = turn_of(result)[rows], foot_of(result)[rows]
    for off, is_in in ((0.00045, False), (0.0006, True)):
        at = np.array([*MIDDLE, 0.0]) + [off, 0.0, 0.0] + 0.0 * foot + [0.0, 0.0, 1e-6]
        assert (corners_in_the_other(result, turn, at) > 0) is is_in
        assert bool(share_of_the_gap(turn, at).max() > 1.0) is is_in
    for more in (0.9, 1.1):
        tilt = more * 2.0 * SLACK / (TOP - 2.0 * CHAMFER)
        turn = rotation_matrix(np.array([[np.cos(0.5 * tilt), np.sin(0.5 * tilt), 0.0, 0.0]]))
        at = np.array([[*MIDDLE, 0.5 * TOP]]) - 0.5 * TOP * turn[:, :, 2]
        assert bool(share_of_the_gap(turn, at).max() > 1.0) is (more > 1.0)
