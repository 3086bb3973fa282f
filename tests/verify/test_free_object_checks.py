"""The referee's claims of a free object: an honest result passes, and planted faults are found under their names."""

import importlib
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from file_faults import Fault, at, of_properties, with_name
from free_scenes import free_result, free_scene
from planted_faults import planted
from sampled import first_of_each
from short_grasp import result_of

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import quaternion, quaternion_product
from hhsim.kernels.tick.state import STATUS_START_INSIDE
from hhsim.metrics.run.registry import run_figure
from hhsim.metrics.run_ticks import result_ticks
from hhsim.result.reader import Result, load_result
from hhsim.verify.body_checks import body_claims
from hhsim.verify.claim import HOLDS, NOT_JUDGED, Claim
from hhsim.verify.free_motion import FreeMotion
from hhsim.verify.free_object_checks import free_claims, free_complementarity_claim, free_hand_claim, hand_frames
from hhsim.verify.judged_body import seen_by_referee
from hhsim.verify.kinematics import OwnHand, configurations, own_hand, pose, rotations
from hhsim.verify.metric_checks import metric_claims
from hhsim.verify.tick_data import JudgedTicks

TICK = 200
"""A tick of the hold."""


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return free_result(tmp_path_factory.mktemp("free") / "free.h5")


def claims(result: Result) -> dict[str, Claim]:
    judge = JudgedTicks(result, np.minimum([TICK, TICK + 10], result.ticks - 1))
    found = (*free_claims(result), free_hand_claim(judge), *body_claims(result))
    return {claim.name: claim for claim in found}


def failing(result: Result) -> set[str]:
    return {name for name, claim in claims(result).items() if claim.failed}


def test_an_honest_result_passes(honest: Result) -> None:
    assert honest.body.is_free and len(honest["contact/tick"]) > 1000
    chosen = np.arange(0, honest.ticks, 20)
    touching = free_complementarity_claim(JudgedTicks(honest.seen_by(seen_by_referee), chosen))
    found = {**claims(honest), **{claim.name: claim for claim in (touching, *body_claims(honest))}}
    assert not [claim for claim in found.values() if claim.failed]
    # Two triangles at an edge have a row each.
    assert {name for name, claim in found.items() if claim.checked == 0} == {"single contacts"}


def test_the_figures_are_those_of_the_contacts_one_by_one(honest: Result) -> None:
    motion, ways = FreeMotion(honest), np.zeros((16, honest.ticks))
    for tick, body, way in zip(motion.tick, motion.touching, motion.slip):
        if body >= 0:
            ways[body, tick] = max(ways[body, tick], way)
    wrench = honest.body["hand_wrench"] + honest.body["table_wrench"]
    expected = {
        "object_raised": (motion.center[1:, 2] - motion.center[1, 2]).max(),
        "object_slip": ways.sum(axis=1).max(),
        "object_momentum": motion.unbalanced(wrench[:, :3]).max(),
        "friction_residual_max": honest.body["friction_residual"][np.unique(motion.tick)].max(),
        **dict.fromkeys(("table_depth_max", "cone_outside"), 0.0),
    }
    assert {name: honest.summary[name] for name in expected} == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert "tracking_excess" not in honest.summary
    assert not [claim for claim in metric_claims(honest) if claim.failed]


@pytest.mark.parametrize(("status", "found"), [(STATUS_START_INSIDE, set()), (0, {"slip", "balanced"})])
def test_the_slip_of_a_hand_that_began_inside_is_what_the_file_says(
    honest: Result, tmp_path: Path, status: int, found: set[str]
) -> None:
    """It was put beside the object first, by a way that the file does not have; `status` judges the tick."""

    def slid(file: h5py.File) -> None:
        of_hand = np.flatnonzero((file["contact/tick"][...] == TICK) & (FreeMotion(honest).touching >= 0))
        file["contact/slip"][of_hand] = 1e-4
        file["bodies/cylinder/tick/friction_residual"][TICK] = 1e-4 * honest.body.properties["friction"]
        file["hands/right/tick/status"][TICK] |= status

    assert failing(planted(honest.path, tmp_path, slid)) & {"slip", "balanced"} == found


def test_the_referee_finds_energy_that_nobody_gave(honest: Result, tmp_path: Path) -> None:
    faster = planted(honest.path, tmp_path, thrown_object)
    assert run_figure("energy_gained", result_ticks(faster)) == pytest.approx(0.5 * 50.0 * 0.1**2, rel=0.1)
    assert next(claim for claim in metric_claims(faster) if claim.name == "summary").failed


# Each fault changes one tick, or the object's description, and nothing else.


def first_contact(file: h5py.File, of_table: bool) -> int:
    """The row of a contact that bears something at the tick."""
    chosen = (file["contact/tick"][...] == TICK) & ((file["contact/a"][...] >= 16) == of_table)
    return int(np.flatnonzero(chosen)[file["contact/normal_force"][...][chosen].argmax()])


def of_contact(name: str, column: str, change: Callable[[Any], Any], of_table: bool = False) -> Fault:
    """Change what a contact with the hand, or the table, says."""

    def fault(file: h5py.File) -> None:
        row = first_contact(file, of_table)
        file[f"contact/{column}"][row] = change(file[f"contact/{column}"][row])

    return with_name(name, fault)


def too_much_torsion(file: h5py.File) -> None:
    row = first_contact(file, of_table=False)
    file["contact/torsional_moment"][row] = 0.02 * file["contact/normal_force"][row]


def hidden_slip(file: h5py.File) -> None:
    slip = file["contact/slip"][...]
    file["contact/slip"][int(slip.argmax())] = 0.0


def halved_slip(file: h5py.File) -> None:
    """In a tick of several programs."""
    slip = file["contact/slip"][...]
    several = file["hands/right/tick/work/linearisations"][...][file["contact/tick"][...]] > 1
    file["contact/slip"][int(np.where(several, slip, 0.0).argmax())] *= 0.5


def claimed_to_stick(file: h5py.File) -> None:
    file["contact/sticks"][int(file["contact/slip"][...].argmax())] = 1


def other_finger(file: h5py.File) -> None:
    row = first_contact(file, of_table=False)
    file["contact/a"][row] = (file["contact/a"][row] + 3) % 15


def long_normal(file: h5py.File) -> None:
    """Half the push along twice the normal: the force is the same."""
    row = first_contact(file, of_table=False)
    file["contact/normal"][row] *= 2.0
    file["contact/normal_force"][row] *= 0.5


def swapped_wrenches(file: h5py.File) -> None:
    hand, table = file["bodies/cylinder/tick/hand_wrench"], file["bodies/cylinder/tick/table_wrench"]
    hand[TICK], table[TICK] = table[TICK], hand[TICK]


def split_contact(file: h5py.File) -> None:
    """One contact as two of half its force at one place."""
    row = first_contact(file, of_table=False)
    for name in ("normal_force", "friction_force", "torsional_moment"):
        file[f"contact/{name}"][row] = 0.5 * file[f"contact/{name}"][row]
    for name in file["contact"]:
        values, attributes = file[f"contact/{name}"][...], dict(file[f"contact/{name}"].attrs)
        del file[f"contact/{name}"]
        file[f"contact/{name}"] = np.insert(values, row, values[row], axis=0)
        file[f"contact/{name}"].attrs.update(attributes)


thrown_object = at("thrown_object", "bodies/cylinder/tick/velocity", TICK, lambda x: (0.0, 0.1, 0.0))
# The mass halved, the gravity doubled: the weight is the same, what moves is not.
pulled_down_twice = of_properties("pulled_down_twice", lambda free: free.update(mass=25.0, gravity=[0.0, 0.0, -19.62]))
heavier_to_turn = of_properties(
    "heavier_to_turn", lambda free: free.update(inertia=(1.1 * np.array(free["inertia"])).tolist())
)
FAULTS: dict[Fault, str] = {
    at("pushed_object", "bodies/cylinder/tick/position", TICK, lambda x: x + (1e-6, 0.0, 0.0)): "object velocity",
    at("faster_object", "bodies/cylinder/tick/velocity", TICK, lambda x: x + (0.0, 1e-4, 0.0)): "object velocity",
    of_properties("lighter_object", lambda free: free.update(mass=49.0)): "Newton",
    of_properties("stronger_gravity", lambda free: free.update(gravity=[0.0, 0.0, -9.82])): "Newton",
    at("wrong_moment", "bodies/cylinder/tick/table_wrench", (TICK, 4), lambda x: x + 1e-3): "table on object",
    at("helped_hand", "bodies/cylinder/tick/hand_wrench", (TICK, 2), lambda x: x + 1e-2): "hand on object",
    of_contact("pushed_harder", "normal_force", lambda x: x * 1.01): "equal and opposite",
    of_properties("smoother_object", lambda free: free.update(friction=0.2)): "friction cones",
    too_much_torsion: "torsion",
    of_contact("pulling_table", "normal_force", lambda x: x * -1.0, of_table=True): "friction cones",
    hidden_slip: "slip",
    halved_slip: "slip",
    at("friction_off", "bodies/cylinder/tick/friction_residual", TICK, lambda x: x + 1e-5): "balanced",
    claimed_to_stick: "sticks",
    at("friction_along", "contact/friction_force", ..., lambda x: x * -1.0): "hand's balance",
    at("higher_object", "bodies/cylinder/tick/table_distance", TICK, lambda x: x + 1e-6): "table",
    of_properties("sunken_table", lambda free: free.update(table=free["table"] + 1e-5)): "table",
    other_finger: "hand's balance",
    long_normal: "contact rows",
    of_contact("sticks_twice", "sticks", lambda x: 2): "contact rows",
    of_contact("tilted_table", "normal", lambda x: (1e-3, 0.0, np.sqrt(1.0 - 1e-6)), of_table=True): "contact rows",
    swapped_wrenches: "hand on object",
    of_contact("slip_of_no_number", "slip", lambda x: np.nan): "slip",
    of_properties("other_start", lambda free: free.update(velocity=[0.0, 0.0, 1e-3])): "Newton",
    at("turned_twice", "bodies/cylinder/tick/orientation", TICK, lambda x: x * -1.0): "body poses",
    of_contact("point_elsewhere", "point", lambda x: x + (0.0, 1e-4, 0.0)): "hand on object",
}


@pytest.fixture(scope="module")
def found_in_honest(honest: Result) -> set[str]:
    """Claims that fail without a fault: none that is planted here."""
    return failing(honest)


@pytest.mark.parametrize("fault", first_of_each(FAULTS), ids=lambda fault: fault.__name__)
def test_a_planted_fault_is_found_by_name(
    honest: Result, found_in_honest: set[str], tmp_path: Path, fault: Fault
) -> None:
    assert FAULTS[fault] not in found_in_honest
    assert FAULTS[fault] in failing(planted(honest.path, tmp_path, fault))


@pytest.mark.soak
def test_a_contact_in_two_is_found_where_each_is_of_its_own_sphere(tmp_path: Path) -> None:
    result = result_of(free_scene(), tmp_path / "spheres.h5", {"hand_file": None})
    assert "single contacts" not in failing(result)
    assert "single contacts" in failing(planted(result.path, tmp_path, split_contact))


def test_the_weight_counts_among_the_forces(tmp_path: Path) -> None:
    """Of what is heavy and falls freely nothing is borne, and its velocity is rounded all the same."""
    path = tmp_path / "falls.h5"
    words = [
        *("cube", "lift", "--free", "--surface", "mesh", "--mass", "1e9"),
        *("--table", "none", "--ticks", "20", "--quiet", "--out"),
    ]
    assert importlib.import_module("hhsim.cli.replay").command.main([*words, str(path)], standalone_mode=False) == 0
    newton = claims(load_result(path))["Newton"]
    assert newton.verdict == HOLDS and 1e-6 < newton.worst < 1e-6 * 9.81e9
    faster = at("faster", "bodies/cube/tick/velocity", 10, lambda x: x + (0.0, 0.0, 1e-6))
    assert claims(planted(path, tmp_path, faster))["Newton"].failed


STRAIGHT = 1e-6
"""Share of a tick's turns that is as good as its tangent."""


def turned_by_straight_steps(honest: Result, folder: Path, curl: float, way: float) -> Path:
    """Let fingers curl, or the hand come, while the palm turns, and contacts slip as by the solver's straight step.

    The fingers curl by `curl` [rad], and the hand comes `way` [m] towards the object at the first contact of a tick.
    """
    path, rng, ticks = folder / "turned.h5", np.random.default_rng(0), np.arange(TICK, honest.ticks, 4)
    shutil.copy(honest.path, path)
    hand, motion, shown = own_hand(honest), FreeMotion(honest), configurations(honest, "graphic")
    slip = np.where(motion.own & (motion.tick >= TICK), 0.0, motion.slip)
    for values in shown:
        values[TICK:] = values[TICK - 1]
    for tick in ticks.tolist():
        turn, bends = 0.004 * rng.normal(size=3), curl * rng.normal(size=(5, 3))
        rows = np.flatnonzero((motion.tick == tick) & motion.own)
        come = -way * motion.normal[rows[0]]
        straight, whole = (_turned(shown, share * turn, share * bends, share * come) for share in (STRAIGHT, 1.0))
        before, after = (_frames_of(hand, of, tick) for of in (shown, straight))
        local = np.einsum(
            "cji,cj->ci", before[1][motion.touching[rows]], motion.point[rows] - before[0][motion.touching[rows]]
        )
        moved = after[0][motion.touching[rows]] + np.einsum("cij,cj->ci", after[1][motion.touching[rows]], local)
        slid = (moved - motion.point[rows]) / STRAIGHT
        along = (slid * motion.normal[rows]).sum(axis=1)
        slip[rows] = np.linalg.norm(slid - along[:, None] * motion.normal[rows], axis=1)
        for values, new in zip(shown, whole):
            values[tick:] = new[tick:]
    with h5py.File(path, "r+") as file:
        file["contact/slip"][...] = slip
        file["hands/right/tick/work/linearisations"][TICK:] = 1
        for name in ("position", "orientation"):
            file[f"bodies/cylinder/tick/{name}"][TICK:] = file[f"bodies/cylinder/tick/{name}"][TICK - 1]
        for name, values in shown._asdict().items():
            file[f"hands/right/tick/graphic/{name}"][...] = values
    return path


def _turned(shown: HandConfiguration, turn: FloatArray, bends: FloatArray, way: FloatArray) -> HandConfiguration:
    turned = quaternion_product(np.repeat(quaternion(turn[None]), shown.ticks, axis=0), shown.orientation)
    return shown._replace(position=shown.position + way, orientation=turned, flexion=shown.flexion + bends)


def _frames_of(hand: OwnHand, shown: HandConfiguration, tick: int) -> tuple[FloatArray, FloatArray]:
    at = shown.at(np.array([tick]))
    origin, axes = hand_frames(pose(hand, at), rotations(at.orientation)[0].as_matrix())
    return origin[0], axes[0]


@pytest.mark.parametrize(("curl", "way"), [(0.02, 0.0), (0.0, 0.002)])
@pytest.mark.quick("0.02-0.0")
def test_the_slip_of_straight_steps_holds_where_the_hand_turns(
    honest: Result, tmp_path: Path, curl: float, way: float
) -> None:
    """Fingers that curl against a palm that turns hardly move, and their contacts bend off all the same.

    A hand that comes while it turns is at the contact with another point than before, as far as it comes.
    """
    path = turned_by_straight_steps(honest, tmp_path, curl, way)
    slip = claims(load_result(path))["slip"]
    assert slip.verdict == HOLDS and 0.2 < slip.worst / slip.tolerance < 1.0
    with h5py.File(path, "r+") as file:
        row = int(np.flatnonzero(file["contact/tick"][...] == slip.tick)[0])
        file["contact/slip"][row] += 2.0 * slip.tolerance + 2.0 * slip.worst
    assert claims(load_result(path))["slip"].failed


@pytest.mark.parametrize(
    ("programs", "of_table", "judged"), [(3, True, False), (2, True, True), (1, True, True), (3, False, True)]
)
def test_the_slip_on_the_table_is_judged_where_the_object_cannot_have_tilted_and_come_back(
    honest: Result, tmp_path: Path, programs: int, of_table: bool, judged: bool
) -> None:
    def slid(file: h5py.File) -> None:
        file["hands/right/tick/work/linearisations"][TICK] = programs
        file["contact/slip"][first_contact(file, of_table)] += 1e-4

    slip = claims(planted(honest.path, tmp_path, slid))["slip"]
    assert slip.failed == judged and (slip.tick == TICK or not judged)
    assert "with the table in ticks of three programs or more" in slip.note or programs < 3


@pytest.mark.parametrize(("column", "change"), [("a", lambda x: 18), ("tick", lambda x: x - 1)])
def test_a_contact_of_no_body_or_out_of_order_is_damage(
    honest: Result, tmp_path: Path, column: str, change: Callable[[Any], Any]
) -> None:
    with pytest.raises(InputError, match="a contact of no tick, or of no body"):
        free_claims(planted(honest.path, tmp_path, of_contact("damaged", column, change)))


@pytest.mark.parametrize("fault", [heavier_to_turn, pulled_down_twice])
def test_another_solid_is_not_judged_and_said_so(honest: Result, tmp_path: Path, fault: Fault) -> None:
    """Of an object that hardly moves no motion tells its inertia: a program may have given it."""
    assert claims(honest)["solid"].verdict == HOLDS
    assert claims(planted(honest.path, tmp_path, fault))["solid"].verdict == NOT_JUDGED


@pytest.mark.soak
def test_a_body_that_floats_by_the_solvers_rounding_holds(honest: Result) -> None:
    """All ticks, in which bodies float by what friction is off and as much more as the last step was long."""
    judge = JudgedTicks(honest.seen_by(seen_by_referee), np.arange(honest.ticks))
    assert free_complementarity_claim(judge).verdict == HOLDS


TURN = 0.017
"""Turn of hand and object in a tick [rad]."""


def test_what_turns_together_stands_off_by_straight_steps(honest: Result, tmp_path: Path) -> None:
    """Hand and object turn about points of their own and the hand goes straight: a finger comes off the object."""
    path, motion = tmp_path / "together.h5", FreeMotion(honest)
    shutil.copy(honest.path, path)
    center, normal = motion.center[TICK + 1], motion.normal[(motion.tick == TICK) & motion.own][0]
    with h5py.File(path, "r+") as file:
        of_object, of_hand = (file[f"{of}/position"] for of in ("bodies/cylinder/tick", "hands/right/tick/graphic"))
        arm = of_hand[TICK] - center
        # About the axis for which that finger goes farthest off.
        axis = normal - arm / np.linalg.norm(arm)
        turn = TURN * axis / np.linalg.norm(axis)
        of_object[TICK] = center + rotations(quaternion(turn[None]))[0].apply(of_object[TICK] - center)[0]
        of_hand[TICK] += np.cross(turn, arm)
        for turned in (file[f"{of}/orientation"] for of in ("bodies/cylinder/tick", "hands/right/tick/graphic")):
            turned[TICK] = quaternion_product(quaternion(turn[None]), turned[TICK : TICK + 1])[0]
    bend = 0.5 * TURN**2 * float(np.linalg.norm(arm))
    stands = touching_at_tick(path)
    assert stands.verdict == HOLDS and 4e-6 < stands.worst < bend < stands.tolerance < bend + 2e-6
    with h5py.File(path, "r+") as file:
        file["hands/right/tick/graphic/position"][TICK] += 1.05 * (stands.tolerance - stands.worst) * normal
    assert touching_at_tick(path).failed


def touching_at_tick(path: Path) -> Claim:
    seen = load_result(path).seen_by(seen_by_referee)
    return free_complementarity_claim(JudgedTicks(seen, np.array([TICK])))
