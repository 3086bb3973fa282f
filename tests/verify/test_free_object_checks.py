"""The referee's claims of a free object: an honest result passes, and planted faults are found under their names."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from free_results import free_result
from planted_faults import forge_scene, planted
from sampled import first_of_each

from hhsim.metrics.run.registry import run_figure, run_metrics
from hhsim.metrics.run_ticks import result_ticks
from hhsim.result.reader import Result
from hhsim.verify.claim import Claim
from hhsim.verify.free_object_checks import free_claims, free_complementarity_claim, free_figures, free_hand_claim
from hhsim.verify.metric_checks import metric_claims
from hhsim.verify.object_frame import object_motion_claims, seen_by_referee
from hhsim.verify.tick_data import JudgedTicks

TICK = 200
"""A tick of the hold."""


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return free_result(tmp_path_factory.mktemp("free") / "free.h5")


def claims(result: Result) -> dict[str, Claim]:
    judge = JudgedTicks(result, np.array([TICK, TICK + 10]))
    return {claim.name: claim for claim in (*free_claims(result), free_hand_claim(judge))}


def failing(result: Result) -> set[str]:
    return {name for name, claim in claims(result).items() if claim.failed}


def test_an_honest_result_passes(honest: Result) -> None:
    assert honest.free and len(honest["contact/tick"]) > 1000
    chosen = np.arange(0, honest.ticks, 20)
    touching = free_complementarity_claim(JudgedTicks(honest.seen_by(seen_by_referee), chosen))
    found = {**claims(honest), **{claim.name: claim for claim in (touching, *object_motion_claims(honest))}}
    assert not [claim for claim in found.values() if claim.failed]
    assert all(claim.checked > 0 for claim in found.values())


def test_the_figures_are_those_of_the_referee(honest: Result) -> None:
    run, own = result_ticks(honest), free_figures(honest)
    names = [name for name, metric in run_metrics().items() if metric.free_only]
    assert names and set(own) == set(names)
    for name in names:
        assert run_figure(name, run) == pytest.approx(own[name], rel=1e-9, abs=1e-12, nan_ok=True), name
        assert honest.summary[name] == run_figure(name, run) or np.isnan(own[name])
    assert honest.summary["table_depth_max"] == 0.0 and honest.summary["cone_outside"] == 0.0
    assert "tracking_excess" not in honest.summary


def test_the_referee_finds_energy_that_nobody_gave(honest: Result, tmp_path: Path) -> None:
    faster = planted(honest.path, tmp_path, thrown_object)
    own = free_figures(faster)["energy_gained"]
    assert own == pytest.approx(0.5 * 50.0 * 0.1**2, rel=0.1)
    assert run_figure("energy_gained", result_ticks(faster)) == pytest.approx(own, rel=1e-9)
    assert next(claim for claim in metric_claims(faster) if claim.name == "summary").failed


def thrown_object(file: h5py.File) -> None:
    file["tick/object/velocity"][TICK] = (0.0, 0.1, 0.0)


# Each fault changes one tick, or the object's description, and nothing else.


def first_contact(file: h5py.File, of_table: bool) -> int:
    """The row of a contact that bears something at the tick."""
    chosen = (file["contact/tick"][...] == TICK) & ((file["contact/body"][...] == -1) == of_table)
    return int(np.flatnonzero(chosen)[file["contact/normal_force"][...][chosen].argmax()])


def pushed_object(file: h5py.File) -> None:
    file["tick/object/position"][TICK] += (1e-6, 0.0, 0.0)


def faster_object(file: h5py.File) -> None:
    file["tick/object/velocity"][TICK] += (0.0, 1e-4, 0.0)


def lighter_object(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["free"].update(mass=49.0))


def stronger_gravity(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["free"].update(gravity=[0.0, 0.0, -9.82]))


def wrong_moment(file: h5py.File) -> None:
    file["tick/object/table_wrench"][TICK, 4] += 1e-3


def helped_hand(file: h5py.File) -> None:
    file["tick/object/hand_wrench"][TICK, 2] += 1e-2


def pushed_harder(file: h5py.File) -> None:
    file["contact/normal_force"][first_contact(file, of_table=False)] *= 1.01


def smoother_object(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["free"].update(friction=0.2))


def too_much_torsion(file: h5py.File) -> None:
    row = first_contact(file, of_table=False)
    file["contact/torsional_moment"][row] = 0.02 * file["contact/normal_force"][row]


def pulling_table(file: h5py.File) -> None:
    file["contact/normal_force"][first_contact(file, of_table=True)] *= -1.0


def hidden_slip(file: h5py.File) -> None:
    slip = file["contact/slip"][...]
    file["contact/slip"][int(slip.argmax())] = 0.0


def halved_slip(file: h5py.File) -> None:
    """In a tick of several programs."""
    slip = file["contact/slip"][...]
    several = file["tick/work/linearisations"][...][file["contact/tick"][...]] > 1
    file["contact/slip"][int(np.where(several, slip, 0.0).argmax())] *= 0.5


def friction_off(file: h5py.File) -> None:
    file["tick/object/friction_residual"][TICK] += 1e-5


def claimed_to_stick(file: h5py.File) -> None:
    file["contact/sticks"][int(file["contact/slip"][...].argmax())] = 1


def friction_along(file: h5py.File) -> None:
    """All friction the other way round: what slides is driven by it."""
    file["contact/friction_force"][...] *= -1.0


def higher_object(file: h5py.File) -> None:
    file["tick/object/table_distance"][TICK] += 1e-6


def sunken_table(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["free"].update(table=scene["free"]["table"] + 1e-5))


def other_finger(file: h5py.File) -> None:
    row = first_contact(file, of_table=False)
    file["contact/body"][row] = (file["contact/body"][row] + 3) % 15


FAULTS: dict[Callable[[h5py.File], None], str] = {
    pushed_object: "object velocity",
    faster_object: "object velocity",
    lighter_object: "Newton",
    stronger_gravity: "Newton",
    wrong_moment: "table on object",
    helped_hand: "hand on object",
    pushed_harder: "equal and opposite",
    smoother_object: "friction cones",
    too_much_torsion: "torsion",
    pulling_table: "friction cones",
    hidden_slip: "slip",
    halved_slip: "slip",
    friction_off: "balanced",
    claimed_to_stick: "sticks",
    friction_along: "hand's balance",
    higher_object: "table",
    sunken_table: "table",
    other_finger: "hand's balance",
}


@pytest.mark.parametrize("fault", first_of_each(FAULTS), ids=lambda fault: fault.__name__)
def test_a_planted_fault_is_found_by_name(honest: Result, tmp_path: Path, fault: Callable[[h5py.File], None]) -> None:
    found = failing(planted(honest.path, tmp_path, fault))
    assert FAULTS[fault] in found - failing(honest)
