"""hhsim beside MuJoCo on two hands and several things: measures by closed forms, and the balance of what is held."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from cut_scene import placed_meshes
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull

from hhsim.bench.manipulation.stage import block
from hhsim.bench.peers import capsule_hand
from hhsim.engines.rigid_hand import lack_of
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.quaternion import quaternion
from hhsim.kernels.mesh.bvh import build_mesh_bvh, mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import RigidMotion
from hhsim.solver.free_engine import Thing
from hhsim.solver.free_object import FreeObject
from hhsim.trees.contact_surface import ContactSurface
from tools import bench_bimanual as bench

MISSING = lack_of("mujoco", "mujoco", "coacd")
needs_mujoco = pytest.mark.skipif(bool(MISSING), reason=f"MuJoCo {MISSING}")
SQUARE = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
CORNERS = np.concatenate([np.insert(SQUARE, 2, z, axis=1) for z in (-1.0, 1.0)])


def moved(turn: ArrayLike, shift: ArrayLike) -> RigidMotion:
    return RigidMotion(quaternion(np.atleast_2d(turn)), np.atleast_2d(shift).astype(np.float64))


def depth_of_boxes(turn: np.ndarray, shift: np.ndarray) -> float:
    """Depth of a cube of side 2 in another one, which is turned and shifted."""
    still, other = moved(np.zeros(3), np.zeros(3)), moved(turn, shift)
    points = [motion.points(CORNERS[None]) for motion in (still, other)]
    return float(bench.box_depth(points[0], bench.axes_of(still), points[1], bench.axes_of(other))[0])


def test_a_phase_s_end_is_repeated_where_the_next_one_begins() -> None:
    index, where = bench.paused([2, 5, 8], [0, 2], 4)
    assert index.tolist() == [0, 1, 2, 3, 3, 3, 3, 3, 4, 5, 6, 7, 8, 8, 8, 8, 8]
    assert where == [slice(3, 7), slice(12, 16)]
    assert [set(index[part]) for part in where] == [{3}, {8}]


def test_the_depth_of_boxes_is_that_of_faces_and_of_edges() -> None:
    eighth = np.array([0.0, 0.0, np.pi / 4])
    assert depth_of_boxes(np.zeros(3), np.array([0.3, 1.9, -0.2])) == pytest.approx(0.1)
    assert depth_of_boxes(np.zeros(3), np.array([0.3, 2.1, -0.2])) == 0.0
    # A corner's edge against a face.
    assert depth_of_boxes(eighth, np.array([2.3, 0.0, 0.0])) == pytest.approx(1.0 + np.sqrt(2.0) - 2.3)
    # Two edges across each other: no corner of either is in the other one.
    first, second = moved([np.pi / 4, 0.0, 0.0], np.zeros(3)), moved([0.0, np.pi / 4, 0.0], [0.0, 0.0, 2.7])
    points = [motion.points(CORNERS[None]) for motion in (first, second)]
    found = bench.box_depth(points[0], bench.axes_of(first), points[1], bench.axes_of(second))
    assert found == pytest.approx(2.0 * np.sqrt(2.0) - 2.7)


def test_creep_is_the_slope_and_not_the_swing() -> None:
    time = np.arange(2000) / 1000.0
    still = 1e-3 * np.sin(2.0 * np.pi * 10.0 * time)[:, None, None] * np.ones((1, 2, 3))
    creeps = still.copy()
    creeps[:, 1] += time[:, None] * [3e-4, 0.0, 4e-4]
    assert bench.drift(creeps) == pytest.approx(5e-4, rel=0.2)
    assert bench.drift(still) < 1e-4
    assert bench.drift(creeps[:, :1] * 0.0) == 0.0


def test_a_hand_is_as_deep_in_a_thing_as_its_lowest_point() -> None:
    hand = capsule_hand()
    pose = HandConfiguration(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 5, 3)), np.zeros((1, 5)))
    placed = forward_kinematics(hand, *pose)
    lowest = min(
        float((placed.joints[0, :, :, 2] - hand.radius).min()),
        float((hand.palm_tree.leaf_center[:, 2] - hand.palm_tree.leaf_radius).min()),
    )
    thing = block((1.0, 1.0, 1.0))
    for depth in (0.003, -0.003):
        # The thing is that much above the hand's lowest point.
        up = moved(np.zeros(3), np.array([0.0, 0.0, lowest + depth - 0.5]))
        assert bench.depth_in(thing, up, [(hand, placed)]) == pytest.approx(max(depth, 0.0), abs=1e-6)


def a_play(mesh: Mesh, friction: float = 0.5) -> bench.Play:
    hand = capsule_hand()
    away = HandConfiguration(
        np.tile([0.0, 0.0, 1.0], (200, 1)), np.tile([1.0, 0.0, 0.0, 0.0], (200, 1)), np.full((200, 5, 3), 0.3),
        np.zeros((200, 5)),
    )  # fmt: skip
    low = float(mesh.bounds[0, 2])
    thing = Thing(ContactSurface(None, (), mesh), FreeObject.of_mesh(mesh, mass=0.3, friction=friction, table=low))
    return bench.Play((hand,), (away,), (thing,), ())


def test_a_thing_on_edge_is_as_deep_in_the_table_as_its_edge() -> None:
    thing = block((0.1, 0.1, 0.1))
    on_edge = moved(np.array([np.pi / 4, 0.0, 0.0]), np.zeros(3))
    play = a_play(thing)
    assert bench.depth_in_table(play, 0, on_edge) == pytest.approx(0.05 * (np.sqrt(2.0) - 1.0))
    assert bench.depth_in_table(play, 0, moved(np.zeros(3), np.array([0.0, 0.0, 0.01]))) == 0.0


def test_a_block_around_a_hole_is_convex_parts_that_leave_the_hole_open() -> None:
    _, hole = placed_meshes("peg", solid=False)
    parts = bench.around_hole(hole)
    assert len(parts) == 48
    hulls = [ConvexHull(part) for part in parts]
    assert sum(hull.volume for hull in hulls) == pytest.approx(hole.volume, rel=1e-6)
    rng = np.random.default_rng(0)
    low, high = hole.bounds
    points = rng.uniform(low, high, (400, 3))
    bvh = build_mesh_bvh(hole.vertices, hole.faces)
    inside = mesh_signed_distance(bvh, points) < 0.0
    filled = np.any(
        [(points @ hull.equations[:, :3].T + hull.equations[:, 3] < 1e-9).all(axis=1) for hull in hulls], axis=0
    )
    assert 20 < np.sum(~inside) < 380
    np.testing.assert_array_equal(filled, inside)
    assert bench.around_hole(block((0.04, 0.04, 0.04))) == []
    peg, _ = placed_meshes("peg", solid=False)
    assert bench.around_hole(peg) == []


def test_a_peg_is_as_deep_in_the_wall_of_the_hole_as_it_is_off() -> None:
    peg, hole = placed_meshes("peg", solid=False)
    middle = hole.bounds.mean(axis=0) * [1.0, 1.0, 0.0]
    things = tuple(
        Thing(ContactSurface(None, (), mesh), FreeObject.of_mesh(mesh, mass=0.05, table=None), name == "hole", name)
        for mesh, name in ((peg, "peg"), (hole, "hole"))
    )
    play = replace(a_play(peg), things=things)
    for off, depth in ((0.0, 0.0), (4e-4, 0.0), (8e-4, 3e-4)):
        # Along a side's normal, half an edge from a corner of the 48.
        angle = np.pi / 48
        way = middle + off * np.array([np.cos(angle), np.sin(angle), 0.0]) + [0.0, 0.0, 1e-6]
        motions = [moved(np.zeros((play.ticks, 3)), np.tile(way, (play.ticks, 1))), bench.still(play.ticks)]
        points = [bench.box_points(mesh, motion) for mesh, motion in zip((peg, hole), motions)]
        found = bench.depth_in_each_other(play, motions, points, 0, 1)
        assert found == pytest.approx(depth, abs=5e-5)


def test_the_way_to_a_hole_is_changed_by_what_the_thing_was_off() -> None:
    play = bench.play_of(bench.TASKS["insert"], 0.05)
    assert play.aim is not None
    above, off = play.pauses[0][1], np.array([1e-3, -2e-3, 0.0])
    assert play.aim.stop == above.start
    hole, foot = (play.mesh(k).bounds.mean(axis=0) * [1.0, 1.0, 0.0] for k in (1, 0))

    class Carried:
        """A method whose thing is off the hole by a fixed way, once it is above it."""

        def __init__(self, play: bench.Play) -> None:
            self.course = bench.Course()

        def run(self, part: slice) -> None:
            count = part.stop - part.start
            motion = RigidMotion(np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), np.tile(hole - foot - off, (count, 1)))
            self.course.keep([], [motion], np.zeros(count, bool), np.zeros(count))

    changed = bench.aimed(play, cast(Any, Carried))
    further = changed.haptic[0].position - play.haptic[0].position
    assert not further[: play.aim.start + 1].any()
    np.testing.assert_allclose(further[above.start :], np.tile(off, (play.ticks - above.start, 1)), atol=1e-12)
    assert (np.diff(further[:, 0]) >= 0.0).all()
    assert bench.aimed(replace(play, aim=None), cast(Any, Carried)).haptic is play.haptic


@needs_mujoco
def test_in_mujoco_a_thing_has_its_mass_and_inertia_and_the_hand_no_weight() -> None:
    play = a_play(block((0.1, 0.06, 0.04)))
    theirs = bench.Theirs(play, bench.Hard)
    body = theirs.model.body("0/object")
    free = play.things[0].free
    assert body.mass[0] == free.mass
    np.testing.assert_allclose(sorted(body.inertia), np.linalg.eigvalsh(np.array(free.inertia)), rtol=1e-12)
    theirs.run(slice(0, 200))
    shown = theirs.course.hand(0)
    np.testing.assert_allclose(shown.position[-1], play.haptic[0].position[-1], atol=1e-9)
    np.testing.assert_allclose(shown.flexion[-1], play.haptic[0].flexion[-1], atol=1e-9)
    # The table bears m g.
    assert theirs.of_contacts()[2] == pytest.approx(free.mass * 9.81, rel=1e-3)
    assert not np.concatenate(theirs.course.bears).any()


@needs_mujoco
@pytest.mark.parametrize("name", ["stack", "lift-both", "insert"])
def test_what_is_held_hangs_by_its_friction(name: str) -> None:
    task = bench.TASKS[name]
    play = bench.play_of(task, 0.5)
    free, end = play.things[0].free, play.pauses[0][1].stop
    weight = free.mass * 9.81
    ours, theirs = bench.Ours(play), bench.Theirs(play, bench.StiffNoSlip)
    for method in (ours, theirs):
        for begun in range(0, end, 500):
            method.run(slice(begun, min(begun + 500, end)))
    bears = np.concatenate(ours.course.bears)
    assert bears[end - 500 :].all() and not bears[:500].any()
    for method, within in ((ours, 1e-6), (theirs, 1e-4)):
        # In the air the contacts bear the weight, and what the swing on the springs of the hands adds to it.
        last = RigidMotion(*(values[-3:] for values in method.course.thing(0)))
        first, second, third = last.points(np.broadcast_to(free.center, (3, 3)))
        acceleration = 1e6 * (third - 2.0 * second + first)
        assert abs(acceleration[2]) < 0.05 * 9.81
        balance = method.of_contacts() - free.mass * (acceleration - free.gravity)
        assert np.linalg.norm(balance) < within * weight
    for method in (ours, theirs):
        course = method.course
        so_far = replace(play, haptic=tuple(haptic.part(0, end) for haptic in play.haptic), pauses=(play.pauses[0],))
        found = bench.figures(so_far, course, np.concatenate(course.cpu), bears)
        assert found.done and found.rise[0] == pytest.approx(play.pauses[0][0].lift, rel=0.1)
        # The springs of the hands give by more than they may be deep.
        assert found.in_thing < (1e-9 if method is ours else 1e-3)
        assert found.in_table < (1e-9 if method is ours else 1e-3)


def test_a_table_names_what_was_left_behind() -> None:
    ours = bench.Figures(2e-5, 1e-4, 0.0, np.nan, 0.0, (1e-6, 2e-6), (0.1,), True, True, 0)
    theirs = replace(ours, p50=4e-5, p99=5e-5, in_thing=1e-3, rise=(0.0,), lifted=False, done=False)
    lines = bench.table({"lift": {"coupled": ours, "other": theirs}}).splitlines()
    assert lines[2] == "| lift | coupled | 100.0 | 20 µs / 100 µs | 0 | — | 0 | 2.000 |"
    assert lines[3] == "| lift | other | 0.0, left behind | 2.0 × / 0.5 × | 1.000 | — | 0 | — |"
    assert json.loads(json.dumps(theirs.to_json(), allow_nan=False))["of_things"] is None


def test_without_mujoco_it_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(bench, "lack_of", lambda *names: lack_of("mujoco", "no_such_engine"))
    assert bench.main(["stack", "--out", str(tmp_path / "out.json")]) == 2
    assert "no_such_engine, which is not installed: pip install 'hhsim[mujoco]'" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        bench.main(["no-such-scene"])
    assert not list(tmp_path.iterdir())
