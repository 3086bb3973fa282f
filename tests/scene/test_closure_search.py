"""Demanded touches and their distances; closures that a search finds, and those that ship."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sphere_scenes import ball, object_tree, record_clearance, sphere_tree

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.kernels.hand import finger_closure as kernel
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.metrics.brute_force_distance import round_cone_contact
from hhsim.scene import closure_search
from hhsim.scene.closure_search import encoded, plan_finger_closure, shipped_closures
from hhsim.scene.contact_goals import Touch, holds, object_regions, touch_distances
from hhsim.scene.finger_closure import body_distances, closure_rates, make_work
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.script import Script, ScriptPhase
from hhsim.trees.sphere_tree import SphereTree
from tools.build_closures import searched

HAND = HandModel.default()


@pytest.mark.parametrize("seed", range(3))
def test_a_region_counts_only_leaves_that_would_be_touched_within_it(seed: int) -> None:
    random, work = np.random.default_rng(seed), make_work(HAND.arrays(), object_tree("cup", 3).arrays())
    rotation = np.ascontiguousarray(Rotation.random(rng=random).as_matrix())
    position, flexion = random.uniform(-0.1, 0.1, 3), random.uniform(0.0, 1.0, (5, 3))
    body_distances(position, rotation, flexion, np.zeros(5), work)
    touch, coarse, joints = Touch("middle", "inside"), object_tree("cup", 2), work.joints
    (found,) = touch_distances([touch], "cup", HAND, coarse, joints, position, rotation)
    best = np.inf
    for k in range(3):
        for center, radius in zip(coarse.leaf_center, coarse.leaf_radius):
            distance, places = round_cone_contact(
                center[None], np.array([radius]), joints[2, k], joints[2, k + 1], *HAND.radius[2, k : k + 2]
            )
            if holds(object_regions("cup")["inside"], places)[0]:
                best = min(best, float(distance[0]))
    assert found == pytest.approx(best, abs=1e-12)
    (anywhere,) = touch_distances([Touch("middle")], "cup", HAND, coarse, joints, position, rotation)
    assert anywhere <= found


NAMED = [(name, region) for name in object_names() for region in object_regions(name)]


@pytest.mark.parametrize(("name", "region"), NAMED)
def test_every_shipped_region_holds_some_of_the_surface_and_not_most_of_it(name: str, region: str) -> None:
    triangles = load_object(name).mesh.triangles
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    share = area[holds(object_regions(name)[region], triangles.mean(axis=1))].sum() / area.sum()
    assert 0.005 < share < 0.75


def cluster(seed: int, count: int = 60) -> SphereTree:
    """Random balls in a flattened heap, 70 to 100 mm across."""
    rng = np.random.default_rng(seed)
    center = rng.normal(size=(count, 3))
    center /= np.linalg.norm(center, axis=1, keepdims=True)
    center *= rng.uniform(0.4, 1.0, size=(count, 1)) * rng.uniform(0.025, 0.04, size=3)
    return sphere_tree(center, rng.uniform(0.006, 0.012, size=count))


def near(tree: SphereTree, *pose: FloatArray) -> FloatArray:
    """Distance of each body at a palm's position and rotation, flexion and abduction."""
    return body_distances(*pose, make_work(HAND.arrays(), tree.arrays()))


def random_pose(rng: np.random.Generator, distance: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Palm position and rotation, flexion within the limits, abduction."""
    direction = rng.normal(size=3)
    position = distance * direction / np.linalg.norm(direction)
    rotation = np.ascontiguousarray(Rotation.random(rng=rng).as_matrix())
    flexion = HAND.flexion_min + rng.uniform(size=(5, 3)) * (HAND.flexion_max - HAND.flexion_min)
    return position, rotation, flexion, rng.uniform(-0.2, 0.2, size=5)


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.3))
def test_body_distances_are_the_brute_force_ones(seed: int, distance: float) -> None:
    tree = cluster(seed)
    position, rotation, *angles = pose = random_pose(np.random.default_rng(seed), distance)
    orientation = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    placed = forward_kinematics(HAND, position[None], orientation[None], *(values[None] for values in angles))
    clearance = record_clearance(HAND, tree, placed)[0]
    np.testing.assert_allclose(near(tree, *pose), clearance, rtol=0.0, atol=1e-12)


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_the_hand_advances_to_its_gaps_and_through_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree = cluster(seed)
    position, rotation, flexion, abduction = random_pose(rng, 0.4)
    posture = rotation, flexion, abduction
    direction = -position / np.linalg.norm(position)
    gap = rng.uniform(0.0, 0.01, size=16)
    work = make_work(HAND.arrays(), tree.arrays())
    travel, body = kernel.advance_hand(position, *posture, direction, gap, 1.0, work)
    for share in np.linspace(0.0, 1.0, 200):
        left = near(tree, position + share * travel * direction, *posture) - gap
        assert (left >= -1e-12).all()
    if body >= 0:
        assert int(np.argmin(left)) == body
        assert 0.0 <= left[body] <= kernel.CONTACT
    else:
        assert travel == 1.0


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.integers(0, 4))
def test_a_closing_finger_stops_at_contact_or_at_its_limits(seed: int, finger: int) -> None:
    rng = np.random.default_rng(seed)
    hand = HAND.arrays()
    # A heap below the fingers, wherever it happens to be; starts that touch already are of no interest.
    tree = cluster(seed).transformed(np.eye(3), np.array([0.0, 0.06, -0.08]) + rng.uniform(-0.03, 0.03, size=3))
    rate = closure_rates(rng.uniform(0.2, 1.5))[finger]
    own = slice(3 * finger, 3 * finger + 3)
    if near(tree, np.zeros(3), np.eye(3), np.zeros((5, 3)), np.zeros(5))[own].min() <= kernel.CONTACT:
        return
    flexion, touching = np.zeros((5, 3)), np.full((5, 3), np.nan)
    work = make_work(hand, tree.arrays())
    kernel.close_finger(np.zeros(3), np.eye(3), finger, rate, np.zeros(5), flexion, work, touching)
    others = np.delete(flexion, finger, axis=0)
    assert (others == 0.0).all()
    reached = near(tree, np.zeros(3), np.eye(3), flexion, np.zeros(5))[own]
    assert (reached > 0.0).all()
    assert (reached[touching[finger] == 1.0] <= kernel.CONTACT).all()
    # Every joint that could still move is held by a phalanx in contact at it or beyond, or is at its limit.
    for k in range(3):
        held = touching[finger, k:].any()
        assert held or flexion[finger, k] == pytest.approx(hand.flexion_max[finger, k], abs=1e-8)


def test_a_hand_that_must_not_touch_keeps_its_distance_at_every_stage() -> None:
    script = load_script("never")
    axes = [np.arange(-0.5 * size + 0.0075, 0.5 * size, 0.015) for size in (0.06, 0.045, 0.09)]
    center = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
    tree = sphere_tree(center, np.full(len(center), 0.012))
    closure = plan_finger_closure(script, HAND, tree)
    assert closure.reached == () and closure.missed == ()
    stages = [closure.open + share * (closure.command - closure.open) for share in np.linspace(0.0, 1.0, 101)]
    gaps = [near(tree, closure.position, closure.rotation, stage, closure.abduction).min() for stage in stages]
    assert 0.05 <= min(gaps) < 0.08


def test_the_plan_moves_with_the_object() -> None:
    script = load_script("grasp")
    shift = np.array([0.5, -0.25, 1.0])
    here = plan_finger_closure(script, HAND, cluster(4))
    there = plan_finger_closure(script, HAND, cluster(4).transformed(np.eye(3), shift))
    np.testing.assert_allclose(there.position, here.position + shift, atol=1e-6)
    np.testing.assert_allclose(there.command, here.command, atol=1e-5)


def test_what_no_finger_can_reach_is_refused() -> None:
    phases = ScriptPhase("approach", 1.0), ScriptPhase("touch", 1.0, ("little",))
    straight = Script(name="stiff", phases=phases, palm_gap=0.3)
    with pytest.raises(TrajectoryError, match=r"script stiff: little cannot reach the object, 0.02 m across"):
        plan_finger_closure(straight, HAND, ball(0.01))


DUE = "not what ships: raise SEARCH_VERSION if the search changed, and run `python -m tools.build_closures`"


@pytest.fixture
def searches(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A name for each search of a process that has searched for nothing."""
    done: list[str] = []
    keep = closure_search.kept_closure

    def counted(script: Any, hand: Any, tree: Any, search: Any) -> Any:
        def noted() -> Any:
            done.append(script.name)
            return search()

        return keep(script, hand, tree, noted)

    monkeypatch.setattr(closure_search, "_found", {})
    monkeypatch.setattr("hhsim.scene.closure_search.kept_closure", counted)
    return done


@pytest.mark.soak
def test_all_that_ship_are_what_the_search_finds() -> None:
    assert searched(object_names()) == shipped_closures(), DUE


def test_the_catalogue_needs_no_search(searches: list[str]) -> None:
    plan_finger_closure(load_script("grasp"), HandModel.default(), object_tree("bunny"))
    assert searches == []


def test_a_search_is_kept_by_the_process(searches: list[str]) -> None:
    question = load_script("pinch"), HandModel.default(hand_length=0.2), object_tree("cube", 2)
    first = plan_finger_closure(*question)
    found = encoded(first)
    first.open[:] = 0.0
    assert encoded(plan_finger_closure(*question)) == found and len(searches) == 1
