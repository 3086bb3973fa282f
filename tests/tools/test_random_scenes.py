"""Random scenes: short ones are clean, their judge agrees with other code, and it finds what is planted."""

import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_NO_PLACE
from hhsim.motion import analytic_motion
from hhsim.motion.trajectory import RigidMotion
from hhsim.result.reader import load_result
from hhsim.scene.body import Body
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.triangle_tree import triangle_tree
from hhsim.verify.free_object_checks import gyrated
from hhsim.verify.kinematics import pose
from hhsim.verify.mesh_distance import HandReferee
from tools.convex_solids import Solid, box, random_solid, separation
from tools.random_scenes import STILL, draw, main, played, random_turn
from tools.scene_judge import Moved, Recorded, hand_distance, judge, own_hand_of

TICKS, EVERY = 300, 10
RIGHT, LEFT = HandModel.default("right"), HandModel.default("left")
SCENES = {"fixed": 28, "several": 9, "free": 9}
"""A scene of some kinds in which hands touch: one with fingers that meet; of several bodies one of two hands."""


@cache
def clean(kind: str) -> Recorded:
    with tempfile.TemporaryDirectory() as folder:
        case = draw(kind, 0, SCENES[kind], TICKS)
        return case.ticks_of(load_result(played(case, Path(folder))))


def still(solid: Solid, ticks: int) -> Moved:
    body = Body("still", solid.mesh, triangle_tree(solid.mesh, 1))
    return Moved(body, solid, np.tile(STILL, (ticks, 1)), np.zeros((ticks, 3)))


@pytest.mark.parametrize("kind", SCENES)
def test_a_short_scene_is_clean_and_its_hands_touch(kind: str) -> None:
    found = judge(clean(kind), EVERY)
    assert found.findings == []
    assert found.touching and max(found.deepest.values()) == 0.0
    assert found.newton < 1e-6 and found.euler < 1e-6
    assert bool(found.equations) == (kind != "fixed")


@pytest.mark.soak
def test_a_hand_that_bodies_squeezed_into_itself_follows_its_user_when_they_are_open_again(tmp_path: Path) -> None:
    case = draw("joint-driven", 0, 4, 1200)
    found = judge(case.ticks_of(load_result(played(case, tmp_path))), EVERY)
    assert found.findings == [] and found.touching


def test_the_command_runs_a_scene_and_prints_the_table(capsys: pytest.CaptureFixture[str], tmp_path: Any) -> None:
    out = tmp_path / "figures.json"
    arguments = f"--kind fixed --scenes 1 --scene-ticks 200 --out {out}".split()
    assert main(arguments) == 0
    printed = capsys.readouterr()
    assert "| fixed | 1 | 200 | 2 |" in printed.out and not printed.err
    assert '"failures": []' in out.read_text()


def changed(kind: str, change: Callable[[Recorded, Moved], None]) -> list[str]:
    """Find what is wrong in a scene of which a copy of the motion of the free body that hands push most was changed."""
    scene = clean(kind)
    pushed = [np.abs(one.wrench[0]).sum() if one.free else 0.0 for one in scene.bodies]
    place = int(np.argmax(pushed))
    body = scene.bodies[place]
    values = {name: getattr(body, name).copy() for name in ("turn", "shift", "velocity", "spin", "wrench")}
    bodies = [*scene.bodies[:place], replace(body, **values), *scene.bodies[place + 1 :]]
    scene = replace(scene, bodies=tuple(bodies), status=scene.status.copy())
    change(scene, scene.bodies[place])
    return [finding.what for finding in judge(scene, EVERY).findings]


def faults() -> dict[str, Callable[[Recorded, Moved], None]]:
    def scaled(part: int, columns: slice, by: float) -> Callable[[Recorded, Moved], None]:
        def change(scene: Recorded, body: Moved) -> None:
            body.wrench[part, :, columns] *= by

        return change

    def faster(scene: Recorded, body: Moved) -> None:
        body.velocity[150] += 1e-6

    def spinning(scene: Recorded, body: Moved) -> None:
        body.spin[150:] += [0.0, 0.0, 1e-3]

    def lower(scene: Recorded, body: Moved) -> None:
        body.shift[:, 2] -= 1e-3

    def pushed(scene: Recorded, body: Moved) -> None:
        body.wrench[2, 150:, 0] += 1e-3

    return {
        "Newton's equation": scaled(1, slice(3), 1.0001),
        "Euler's equation": scaled(0, slice(3, 6), 2.0),
        "force on the hands": scaled(0, slice(3), 1.0001),
        "velocity off its poses": faster,
        "Euler": spinning,
        "body in table": lower,
        "forces of bodies on each other": pushed,
    }


@pytest.mark.parametrize("what", faults())
def test_what_is_planted_in_a_bodys_motion_is_found(what: str) -> None:
    assert any(found.startswith(what) for found in changed("several", faults()[what]))


def test_a_shown_hand_that_is_off_by_a_millimetre_is_found() -> None:
    scene = clean("fixed")
    shown, *others = scene.shown
    found: list[str] = []
    for way in 1e-3 * np.concatenate([np.eye(3), -np.eye(3)]):
        moved = replace(scene, shown=(shown._replace(position=shown.position + way), *others))
        found += [finding.what for finding in judge(moved, EVERY).findings]
    assert "hand in body, depth [m]" in found


def test_fingers_and_hands_that_go_through_each_other_are_found() -> None:
    scene = clean("fixed")
    (commanded,) = scene.haptic
    own = judge(replace(scene, shown=scene.haptic), EVERY)
    assert own.deepest["hand in itself"] > 1e-3
    assert "hand in itself, depth [m]" in [finding.what for finding in own.findings]
    other = commanded._replace(position=commanded.position + [0.07, 0.0, 0.0])
    both: dict[str, Any] = {"hands": (RIGHT, LEFT), "shown": (commanded, other), "haptic": (commanded, other)}
    both["status"] = np.zeros((2, TICKS), np.int64)
    kept = judge(replace(scene, **both, self_contact=False), 100)
    assert kept.deepest["hand in hand"] > 1e-3
    assert "hand in hand, depth [m]" in [finding.what for finding in kept.findings]


def test_a_body_that_is_lifted_into_another_one_is_found() -> None:
    scene = clean("several")
    one, two = sorted(scene.bodies, key=lambda body: body.free is None)[:2]
    there = replace(two, shift=one.shift.copy(), turn=one.turn.copy(), solid=one.solid)
    what = [finding.what for finding in judge(replace(scene, bodies=(one, there)), EVERY).findings]
    assert "body in body, depth [m]" in what


def test_a_hand_that_stops_is_found_where_no_contact_bears_its_pull() -> None:
    scene = clean("fixed")
    rest = [type(of)(*(np.repeat(values[:1], TICKS, axis=0) for values in of)) for of in scene.shown]
    asked = [of._replace(position=of.position + [0.01, 0.0, 0.0]) for of in rest]
    for status, stops in ((0, 0), (STATUS_LAG, 1)):
        still_there = np.full((1, TICKS), status)
        found = judge(replace(scene, shown=tuple(rest), haptic=tuple(asked), status=still_there))
        assert (found.stops, found.explained) == (stops, 0)
        assert [finding.what[:18] for finding in found.findings] == ["a hand has stopped"] * stops


def test_a_hand_that_presses_on_a_body_is_explained_by_its_contacts() -> None:
    solid = box((0.4, 0.4, 0.05))
    solver = HandSolver(RIGHT, contact_surface("mesh", solid.mesh, None), SolverOptions(surface="mesh"))
    above, inside = analytic_motion.still([0.0, 0.0, 0.12]), analytic_motion.still([0.0, 0.0, 0.02])
    solver.run(*above.line(inside, 60))
    asked = inside.hold(TICKS)
    record = solver.run(*asked)
    shown = type(asked)(*(getattr(record, name) for name in asked._fields))
    status = np.full((1, TICKS), STATUS_LAG)
    scene = Recorded((RIGHT,), (shown,), (asked,), status, np.ones(TICKS, np.int64), (still(solid, TICKS),))
    pressed = judge(scene)
    assert (pressed.stops, pressed.explained, pressed.findings) == (1, 1, [])
    lifted = judge(replace(scene, haptic=(above.hold(TICKS),)))
    assert (lifted.stops, lifted.explained) == (1, 0)


def test_depth_in_ticks_without_a_place_is_counted_apart_and_open_bodies_are_told() -> None:
    scene = clean("fixed")
    moved = scene.shown[0]._replace(
        position=np.repeat(scene.bodies[0].solid.mesh.vertices.mean(axis=0)[None], TICKS, axis=0)
    )
    status = np.full((1, TICKS), STATUS_NO_PLACE)
    found = judge(replace(scene, shown=(moved,), status=status, released=True, self_contact=False))
    assert found.deepest["hand in body"] == 0.0 and found.squeezed_deepest > 1e-3 and found.squeezed == TICKS
    assert "a hand has no place" in found.findings[-1].what
    assert "hand in body" in judge(replace(scene, shown=(moved,), self_contact=False)).findings[0].what


@pytest.mark.parametrize("seed", range(5))
def test_solids_are_closed_and_are_their_pieces(seed: int) -> None:
    solid = random_solid(np.random.default_rng(seed)).transformed(random_turn(np.random.default_rng(seed)), np.ones(3))
    volume = sum(ConvexHull(piece.corners).volume for piece in solid.pieces)
    assert solid.mesh.volume == pytest.approx(volume, rel=1e-9)


def overlap(one: Any, two: Any) -> bool:
    """Whether two convex sets of corners share a point, by linear programming."""
    a, b = len(one), len(two)
    equal = np.block([[one.T, -two.T], [np.ones((1, a)), np.zeros((1, b))], [np.zeros((1, a)), np.ones((1, b))]])
    return bool(linprog(np.zeros(a + b), A_eq=equal, b_eq=[0.0, 0.0, 0.0, 1.0, 1.0]).status == 0)


def test_separating_axes_agree_with_linear_programming() -> None:
    rng, said, unmoved = np.random.default_rng(3), [], RigidMotion(STILL[None], np.zeros((1, 3)))
    for _ in range(60):
        solids = [random_solid(rng).transformed(random_turn(rng), rng.normal(0.0, 0.02, 3)) for _ in range(2)]
        meets = any(overlap(a.corners, b.corners) for a in solids[0].pieces for b in solids[1].pieces)
        gap = separation(solids[0], solids[1], unmoved, unmoved)[0]
        assert (gap < 0.0) == meets
        said.append(meets)
    assert 10 < sum(said) < 50


def test_the_distance_of_a_hand_agrees_with_the_collision_library() -> None:
    rng, inside = np.random.default_rng(4), []
    for hand in (RIGHT, LEFT):
        own = own_hand_of(hand)
        at = clean("fixed").shown[0].at(slice(40, 41))
        posed = pose(own, at)
        for _ in range(15):
            place = posed.joints[0, rng.integers(5), rng.integers(4)] + rng.normal(0.0, 0.03, 3)
            solid = random_solid(rng, 0.01, 0.05).transformed(random_turn(rng), place)
            placed = PlacedHand(posed.joints, posed.position, at.orientation)
            wanted = HandReferee(solid.mesh).clearances(hand_shape(hand), placed, 1e-3).min()
            found = hand_distance(own, posed, still(solid, 1), np.array([0]))[0]
            assert (found < 0.0) == (wanted < -1e-8)
            inside.append(wanted < 0.0)
    assert 5 < sum(inside) < 25


@pytest.mark.parametrize("period", [1e-3, 1e-2])
def test_gyration_keeps_a_spin_about_a_principal_axis_and_loses_energy_about_others(period: float) -> None:
    """Also of a body that turns by three radians in a tick."""
    inertia = np.diag([1e-6, 2e-6, 4e-6])
    along, other = gyrated(inertia, np.array([[0.0, 500.0, 0.0], [300.0, -200.0, 100.0]]), period)
    np.testing.assert_allclose(along, [0.0, 500.0, 0.0])
    off = inertia @ (other - [300.0, -200.0, 100.0]) / period + np.cross(other, inertia @ other)
    assert np.abs(off).max() < 1e-12
    assert other @ inertia @ other < np.array([300.0, -200.0, 100.0]) @ inertia @ [300.0, -200.0, 100.0]
