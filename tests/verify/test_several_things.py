"""The referee's claims of several things: an honest result passes, and planted faults are found under their names."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from body_tables import TABLE, body, body_file
from file_faults import Fault, at, with_name
from planted_faults import planted
from sampled import first_of_each
from sealed_change import changed
from short_grasp import result_of

from hhsim.result.contacts import ON_TABLE
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import HAND_BODIES
from hhsim.scene.scene import open_scene
from hhsim.verify.claim import HOLDS, NOT_JUDGED, Claim
from hhsim.verify.depth_checks import depth_claims
from hhsim.verify.force_checks import TURN
from hhsim.verify.free_motion import FreeMotion
from hhsim.verify.free_object_checks import free_claims, free_complementarity_claim, free_hand_claim
from hhsim.verify.judged_body import seen_by_referee
from hhsim.verify.metric_checks import CORRECTION, INPUT_HAND, input_hand_claims, metric_claims
from hhsim.verify.posture_checks import posture_claims
from hhsim.verify.tick_data import LAG, STUCK, JudgedTicks

TICKS, AT_REST, HELD = 1600, 300, 1590
"""Ticks of the run, one in which no hand is near, and one in which the hand bears on both things."""
HALVES = [
    body(name, [0.019999, 0.04, 0.04], position=[x, 0.0, 0.02], mass=0.05)
    for name, x in (("one", -0.01), ("two", 0.01))
]
"""A block in two halves, which the fingers press on each other."""
ONE, TWO = (f"bodies/{name}/tick" for name in ("one", "two"))


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Result:
    folder = tmp_path_factory.mktemp("halves")
    scene = open_scene(body_file(folder, *HALVES, TABLE), "stack", solid=False, level=2)
    return result_of(scene.first(TICKS), folder / "halves.h5", surface="mesh")


def claims(result: Result, ticks: Any = (AT_REST, HELD)) -> dict[str, Claim]:
    chosen = np.asarray(ticks)
    world, seen = JudgedTicks(result, chosen), JudgedTicks(result.seen_by(seen_by_referee), chosen)
    found = [*free_claims(result), free_hand_claim(world), free_complementarity_claim(seen), *depth_claims(seen)]
    return {claim.name: claim for claim in found}


def failing(result: Result) -> set[str]:
    return {name for name, claim in claims(result).items() if claim.failed}


def test_an_honest_result_passes_where_the_hand_bears_on_both(honest: Result) -> None:
    motion = FreeMotion(honest)
    assert (~motion.alone).sum() > 200 and np.abs(honest[f"{ONE}/hand_wrench"][HELD]).max() > 1.0
    found = claims(honest, np.arange(0, TICKS, 10))
    assert not [claim for claim in found.values() if claim.failed]
    assert found["hand's balance"].checked == found["complementarity"].checked == TICKS // 10
    for name in ("object velocity", "object angular", "Newton", "Euler"):
        assert found[name].checked > 2 * (TICKS - 20) and "the worst is that of" in found[name].note


def begun_in_each_other(file: h5py.File) -> None:
    """On spheres two bodies may bear on each other in the first tick already."""
    scene = json.loads(file.attrs["scene"])
    scene["solver"]["surface"] = "spheres"
    file.attrs["scene"] = json.dumps(scene)
    file["contact/b"][:2] = HAND_BODIES + 2


def test_bodies_that_bear_on_each_other_in_the_first_tick_are_judged(honest: Result, tmp_path: Path) -> None:
    result = planted(honest.path, tmp_path, with_name("begun", begun_in_each_other))
    assert set(FreeMotion(result).touching[:2]) == {ON_TABLE - 2} and result["contact/tick"][1] == 0
    (single,) = (claim for claim in free_claims(result) if claim.name == "single contacts")
    assert single.verdict == HOLDS and single.checked == len(result["contact/tick"])


def given_to_another(file: h5py.File) -> None:
    """What one body bears is given to the next one that bears something: the sum is the same."""
    phalanx = file["hands/right/tick/force/phalanx"][HELD].reshape(15, 3)
    one, other = np.flatnonzero(np.abs(phalanx).any(axis=1))[:2]
    phalanx[[one, other]] = phalanx[[other, one]]
    file["hands/right/tick/force/phalanx"][HELD] = phalanx.reshape(5, 3, 3)


def force_in_the_air(file: h5py.File) -> None:
    """A body that touches nothing bears half a newton, and another one less."""
    phalanx = file["hands/right/tick/force/phalanx"][HELD].reshape(15, 3)
    bears = np.abs(phalanx).any(axis=1)
    phalanx[np.flatnonzero(~bears)[0], 2] += 0.5
    phalanx[np.flatnonzero(bears)[0], 2] -= 0.5
    file["hands/right/tick/force/phalanx"][HELD] = phalanx.reshape(5, 3, 3)


def of_second(name: str, column: str, tick: int, change: Callable[[Any], Any]) -> Fault:
    return at(name, f"{TWO}/{column}", tick, change)


def into_the_hand(file: h5py.File) -> None:
    """The second thing, where its hand's force has it, half a millimetre on."""
    push = file[f"{TWO}/hand_wrench"][HELD, :3]
    file[f"{TWO}/position"][HELD] -= 5e-4 * push / np.linalg.norm(push)


FAULTS: dict[Fault, str] = {
    of_second("faster", "velocity", AT_REST, lambda x: x + (0.0, 1e-4, 0.0)): "object velocity",
    of_second("spinning", "angular_velocity", AT_REST, lambda x: x + (0.0, 0.0, 1e-4)): "object angular",
    of_second("pulled", "table_wrench", AT_REST, lambda x: x + (1e-3, 0.0, 0.0, 0.0, 0.0, 0.0)): "Newton",
    of_second("twisted", "table_wrench", AT_REST, lambda x: x + (0.0, 0.0, 0.0, 0.0, 0.0, 1e-3)): "Euler",
    of_second("twisted by the hand", "hand_wrench", HELD, lambda x: x + (0.0, 0.0, 0.0, 0.01, 0.0, 0.0)): "Euler",
    of_second("sunken", "position", AT_REST, lambda x: x - (0.0, 0.0, 1e-6)): "table",
    of_second(
        "turned in itself", "body_wrench", AT_REST, lambda x: x + (0.0, 0.0, 0.0, 0.0, 0.0, 1e-3)
    ): "between bodies",
    of_second("helped", "hand_wrench", HELD, lambda x: x + (0.0, 0.0, 1e-3, 0.0, 0.0, 0.0)): "hands on bodies",
    at("of another object", f"{ONE}/hand_wrench", (HELD, 2), lambda x: x + 1e-3): "hand on object",
    at("first elsewhere", f"{ONE}/velocity", (HELD, 2), lambda x: x + 1e-6): "object velocity",
    given_to_another: "hand's balance",
    force_in_the_air: "complementarity",
    into_the_hand: "non-penetration",
    with_name("deep_in_the_hand", lambda file: into_the_hand(file)): "depth",
    of_second("overlapping", "position", AT_REST, lambda x: x - (1e-5, 0.0, 0.0)): "bodies apart",
    of_second("in one place", "position", AT_REST, lambda x: x - (0.02, 0.0, 0.0)): "bodies apart",
}


@pytest.fixture(scope="module")
def found_in_honest(honest: Result) -> set[str]:
    """Claims that fail without a fault: none that is planted here."""
    return failing(honest)


@pytest.mark.parametrize("fault", first_of_each(FAULTS), ids=lambda fault: fault.__name__)
@pytest.mark.quick("pulled", "overlapping")
def test_a_planted_fault_is_found_by_name(
    honest: Result, found_in_honest: set[str], tmp_path: Path, fault: Fault
) -> None:
    assert FAULTS[fault] not in found_in_honest
    assert FAULTS[fault] in failing(planted(honest.path, tmp_path, fault))


@pytest.mark.soak
def test_the_last_of_several_programs_in_a_tick_may_step_back(honest: Result, tmp_path: Path) -> None:
    judge = JudgedTicks(honest, np.array([HELD]))
    size = float(np.linalg.norm(judge.pull[HELD] * judge.scale))
    allowance = TURN * size * float(judge.options["step_tolerance"]) / judge.rolling

    def fails(share: float, programs: int) -> bool:
        def pushed_in_the_air(file: h5py.File) -> None:
            file["hands/right/tick/work/linearisations"][HELD] = programs
            # A body that bears nothing, against the palm: the sum is the same.
            bare = np.argwhere(~file["hands/right/tick/force/phalanx"][HELD].any(axis=2))[0]
            file["hands/right/tick/force/phalanx"][HELD, bare[0], bare[1]] = (0.0, 0.0, share * allowance)

        return claims(planted(honest.path, tmp_path, pushed_in_the_air), [HELD])["hand's balance"].failed

    assert judge.moved[HELD] < 0.2 * judge.options["step_tolerance"]
    # Where one program moves nothing, no step turns a normal.
    assert [fails(0.6, 1), fails(0.6, 2), fails(1.1, 2)] == [True, False, True]


@pytest.mark.parametrize("status", [STUCK, LAG])
@pytest.mark.soak
def test_a_result_without_a_settled_tick_has_a_verdict(honest: Result, tmp_path: Path, status: int) -> None:
    def settles_never(file: h5py.File) -> None:
        file["hands/right/tick/status"][:] = status

    found = claims(planted(honest.path, tmp_path, settles_never), np.arange(0, TICKS, 400))
    assert found["hand's balance"].verdict == NOT_JUDGED and found["hand's balance"].checked == 0
    assert found["bodies apart"].verdict == HOLDS


def left_of_two(file: h5py.File) -> None:
    """A second hand like the first one."""
    for group in ("hands", "summary"):
        file.copy(f"{group}/right", f"{group}/left")
    names = json.loads(file["contact"].attrs["names"])
    file["contact"].attrs["names"] = json.dumps([*names[:16], *(name.replace("right", "left") for name in names)])


@pytest.mark.parametrize(
    ("fault", "holds"),
    [
        (at("none", "hands/right/tick/lag", HELD, lambda x: x), True),
        (at("less work", "hands/right/tick/work/linearisations", HELD, lambda x: x - 1), False),
        (at("farther", "hands/right/tick/lag", HELD, lambda x: 1.0), False),
        (at("negative", "hands/right/tick/lag", HELD, lambda x: -1e-8), False),
        (left_of_two, False),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_thing_may_lag_where_the_hand_does_not(honest: Result, tmp_path: Path, fault: Fault, holds: bool) -> None:
    """The first hand has the flag of a thing that has distance to go past another one, and no distance of its own."""

    def lags(file: h5py.File) -> None:
        file["hands/right/tick/status"][HELD], file["hands/right/tick/lag"][HELD] = LAG, 0.0
        file["hands/right/tick/work/linearisations"][HELD] = honest.scene["solver"]["linearisations"]
        fault(file)

    judge = JudgedTicks(list(planted(honest.path, tmp_path, lags).hands.values())[-1], np.array([HELD]))
    lag = next(claim for claim in posture_claims(judge) if claim.name == "lag")
    assert (lag.verdict == HOLDS) == holds and (not holds or "in 1 tick the hand is done" in lag.note)
    assert holds or lag.tick == HELD


def test_figures_of_the_users_hand_are_there(honest: Result, tmp_path: Path) -> None:
    def verdicts(change: dict[str, Any]) -> dict[str, Claim]:
        result = planted(honest.path, tmp_path, lambda file: file["summary/right"].attrs.update(change))
        return {claim.name: claim for claim in input_hand_claims(JudgedTicks(result, np.array([HELD])))}

    assert verdicts({})["correction"].verdict == HOLDS
    assert verdicts(dict.fromkeys(CORRECTION, np.nan))["correction"].failed
    with_none = tmp_path / "none.h5"
    shutil.copy(honest.path, with_none)
    with changed(with_none) as file:
        for name in INPUT_HAND:
            del file["summary/right"].attrs[name]
    result = load_result(with_none)
    assert {claim.name for claim in metric_claims(result) if claim.failed} == {"summary"}
    assert any(claim.failed for claim in input_hand_claims(JudgedTicks(result, np.array([HELD]))))
