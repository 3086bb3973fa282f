"""Figures of a run: force and energy by hand and planted, and what is said of a free object."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import sampled
from free_scenes import free_scene

from hhsim.hand.model import HandModel
from hhsim.kernels.tick.state import STATUS_LAG
from hhsim.metrics.run.free_object import energy_gains
from hhsim.metrics.run.registry import run_figure
from hhsim.metrics.run_ticks import FreeRun, RunTicks
from hhsim.motion.trajectory import ObjectMotion, TickPhase
from hhsim.replay.replay import replay_scene
from hhsim.solver.options import SolverOptions, Stiffness

MASS, OFFSET, PUSH = 2.0, 5e-7, 3.0
WAY = np.array([0.0, 1e-3, 4e-3])
SPEED = np.array([0.0, 0.3, 0.3])
USER = np.array([0.02, 0.02, 0.05])
SHOWN = np.array([0.0, 0.01, 0.01])


def pushed(**changed: Any) -> RunTicks:
    """Three ticks of a hand that pushes 2 kg along x by one contact of the index finger, on springs of 1,000 N/m."""
    still = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))
    along = np.array([1.0, 0.0, 0.0])
    columns: dict[str, Any] = {
        **{f"{whose}/orientation": still for whose in ("haptic", "graphic")},
        **{f"{whose}/flexion": np.zeros((3, 5, 3)) for whose in ("haptic", "graphic")},
        **{f"{whose}/abduction": np.zeros((3, 5)) for whose in ("haptic", "graphic")},
        # As the object sees them.
        "haptic/position": np.outer(USER - WAY, along),
        "graphic/position": np.outer(SHOWN - WAY, along),
        "object/position": np.outer(WAY, along),
        "object/orientation": still,
        "object/velocity": np.outer(SPEED, along),
        "object/angular_velocity": np.zeros((3, 3)),
        "contact/tick": np.array([1]),
        "contact/body": np.array([5]),
        "contact/point": np.zeros((1, 3)),
        "contact/normal": -along[None],
        "contact/normal_force": np.array([PUSH]),
        "contact/friction_force": np.zeros((1, 3)),
        "contact/torsional_moment": np.zeros(1),
        "force/total": np.outer([0.0, -PUSH, 0.0], along),
        "status": np.zeros(3, np.int32),
    }
    columns.update(changed)
    body, contacts = (
        {name.removeprefix(group): values for name, values in columns.items() if name.startswith(group)}
        for group in ("object/", "contact/")
    )
    properties = {"mass": MASS, "gravity": (-9.81, 0.0, 0.0), "center": (0.0,) * 3, "inertia": np.eye(3)}
    first = ObjectMotion(np.zeros(3), still[0])
    free = FreeRun(body, contacts, properties, first, Stiffness().diagonal(), OFFSET)
    return RunTicks(columns, 3, (), 1000.0, 5, hand=HandModel.default("right"), free=free)


def test_it_is_what_object_and_springs_have_more_than_the_user_and_the_clearance_gave() -> None:
    gains = energy_gains(pushed())
    assert np.isnan(gains[0])
    springs = 500.0 * np.array([0.01**2 - 0.02**2, 0.0])
    kinetic, potential = np.array([0.09, 0.0]), MASS * 9.81 * np.diff(WAY)
    share = np.array([OFFSET * PUSH, 0.0])
    # The user's hand goes on by 30 mm in the last tick: that is the user's work, and no gain.
    assert gains[1:] == pytest.approx(kinetic + potential + springs - share, abs=1e-9)
    assert run_figure("energy_gained", pushed()) == pytest.approx(MASS * 9.81 * 3e-3, abs=1e-9)


def test_what_turns_is_counted_and_what_no_one_knows_is_not() -> None:
    spin = np.zeros((3, 3))
    spin[1:, 2] = 0.5
    run = pushed(**{"object/angular_velocity": spin})
    assert (energy_gains(run) - energy_gains(pushed()))[1:] == pytest.approx([0.125, 0.0], abs=1e-9)
    lost = replace(run, breaks=np.array([False, True, False]))
    assert np.isnan(energy_gains(lost)).tolist() == [True, True, False]
    # In the second tick another hand pushes this one, too.
    pushed_back = pushed(**{"force/total": np.outer([0.0, 1e-3 - PUSH, 0.0], [1.0, 0.0, 0.0])})
    assert np.isnan(energy_gains(pushed_back)).tolist() == [True, True, False]
    # In it another body pushes the object. Of a tick that lags the stated force is that of its last program alone.
    contact = {"tick": [1, 1], "body": [5, -2], "point": np.zeros((2, 3)), "normal": [[-1.0, 0.0, 0.0]] * 2}
    contact |= {"normal_force": [PUSH, 2.0], "friction_force": np.zeros((2, 3)), "torsional_moment": [0.0, 0.0]}
    crowded = {f"contact/{name}": np.array(values) for name, values in contact.items()}
    work = (energy_gains(pushed()) - energy_gains(pushed(**crowded)))[1]
    assert work == pytest.approx(OFFSET * 2.0 - 2.0 * WAY[1], abs=1e-12)
    for known in (True, False):
        late = pushed(**({} if known else crowded), status=np.array([0, STATUS_LAG, 0], np.int32))
        assert np.isfinite(energy_gains(late)[1:]).tolist() == [known, True]
    # Nothing is known of a user whose hand is no number.
    unknown = pushed(**{"haptic/position": np.full((3, 3), np.nan)})
    assert run_figure("energy_gained", unknown) == 0.0


def test_the_users_work_by_spreading_a_finger_is_no_gain() -> None:
    spread = np.zeros((3, 5))
    spread[1:, 1] = 0.1
    run = pushed(**{"graphic/abduction": spread, "haptic/abduction": spread})
    hand = HandModel.default("right")
    arm = -(np.array([SHOWN[1], 0.0, 0.0]) + hand.base[1])
    moment = float(hand.dorsal[1] @ np.cross(arm, [-PUSH, 0.0, 0.0]))
    assert abs(moment) > 1e-3
    # The contacts do so much work on the finger, which the user takes.
    assert (energy_gains(run) - energy_gains(pushed()))[1] == pytest.approx(0.1 * moment, rel=1e-6)


def test_what_the_springs_lose_hides_no_gain_of_an_object_that_the_hand_does_not_touch() -> None:
    along = [1.0, 0.0, 0.0]
    follows = {"graphic/position": np.outer([0.0, 0.01, 0.02] - WAY, along)}
    gains = energy_gains(pushed(**follows))
    # The last tick has no contact: the hand goes to its user's, and the object rises by 3 mm.
    assert gains[2] == pytest.approx(MASS * 9.81 * 3e-3, abs=1e-9)
    touched = {"contact/tick": np.array([2]), "force/total": np.outer([0.0, 0.0, -PUSH], along)}
    gains = energy_gains(pushed(**follows, **touched))
    assert gains[2] == pytest.approx(MASS * 9.81 * 3e-3 + 500.0 * (0.03**2 - 0.04**2) - OFFSET * PUSH, abs=1e-9)


def test_a_planted_gain_is_found_and_misses_the_limit() -> None:
    still = {"object/position": np.zeros((3, 3)), "contact/tick": np.array([2])}
    still["force/total"] = np.outer([0.0, 0.0, -PUSH], [1.0, 0.0, 0.0])
    honest = pushed(**still, **{"haptic/position": np.outer(USER, [1.0, 0.0, 0.0])})
    speed = np.outer([0.0, 0.3, 0.3 + 1e-6], [1.0, 0.0, 0.0])
    planted = replace(honest, free=pushed(**still, **{"object/velocity": speed}).free)
    gained = run_figure("energy_gained", planted) - run_figure("energy_gained", honest)
    assert gained == pytest.approx(0.5 * MASS * ((0.3 + 1e-6) ** 2 - 0.09), rel=1e-3)


# A smooth object of a milligram that the fingers squeeze out took the hand with it, whose springs gained 30 mJ a tick.
LIGHT = [(1e-6, 0.0, "spheres"), (1e-6, 1.0, "mesh"), (1e-6, 0.3, "spheres"), (0.1, 0.6, "mesh"), (100.0, 1.0, "mesh")]


@pytest.mark.parametrize(("mass", "friction", "surface"), sampled(LIGHT, lambda place, _: LIGHT[place][2] == "mesh"))
def test_a_grasp_gains_none_however_light_the_object_is(
    mass: float, friction: float, surface: str, tmp_path: Path
) -> None:
    scene = free_scene(mass, friction)
    scene = replace(scene, bodies=(replace(scene.solids[0], torsion=0.0), *scene.bodies[1:]))
    found = replay_scene(scene, SolverOptions(surface=surface), tmp_path / "light.h5").attributes()
    assert found["energy_gained"] == 0.0


SIZE = np.array([0.0, 0.0, 2.0, 3.0, 3.0, 0.0])
TOUCHING = np.array([0, 1, 2, 2, 1, 0])


def run(scale: float = 1.0, breaks: np.ndarray | None = None, opposed: float = 0.0) -> RunTicks:
    force, phalanx = np.zeros((6, 3)), np.zeros((6, 5, 3, 3))
    force[:, 1] = scale * SIZE
    phalanx[2:5, 0, 2, 0], phalanx[2:5, 1, 2, 0] = opposed, -opposed
    variation = np.array([np.nan, np.nan, np.nan, 50.0, 0.0, 100.0])
    columns = {"force/total": force, "force/phalanx": phalanx, "contacts/touching": TOUCHING}
    columns["force_variation_rate"] = variation
    return RunTicks(columns, 6, (), 1000.0, 5, breaks=breaks)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        # Four ticks touch, the first of them without a force yet.
        ("force_contact_mean", 2.0),
        ("force_contact_max", 3.0),
        ("force_contact_step", 3.0),
        ("force_contact_step_share", 150.0),
        ("force_variation_contact", 25.0),
    ],
)
def test_figures_of_a_motion_without_a_hold(name: str, value: float) -> None:
    assert run_figure(name, run()) == value


def test_a_step_is_compared_with_what_fingers_press_whichever_way() -> None:
    # Thumb and index finger press with 2 N each in three of the four ticks, and leave no total.
    assert run_figure("force_contact_step_share", run(opposed=2.0)) == pytest.approx(100.0 * 3.0 / (2.0 + 3.0))


def test_a_force_is_a_touch_though_nothing_is_within_10_um() -> None:
    columns = {"force/total": np.array([[0.0, 0.0, 4.0]]), "contacts/touching": np.array([0])}
    assert run_figure("force_contact_mean", RunTicks(columns, 1, (), 1000.0, 5)) == 4.0


def test_what_the_recorder_lost_is_no_step() -> None:
    assert run_figure("force_contact_step", run(breaks=np.array([0, 0, 0, 0, 0, 1], bool))) == 2.0


def test_of_next_to_no_force_there_is_no_share() -> None:
    assert math.isnan(run_figure("force_contact_step_share", run(1e-3)))
    assert run_figure("force_contact_step", run(1e-3)) == pytest.approx(3e-3)
    assert math.isnan(run_figure("force_contact_mean", run(0.0))) is False


TICKS = 10
PALM = np.outer(np.clip(np.arange(TICKS) - 2.0, 0.0, None), [0.0, 0.0, 0.01])


def free_run(share: float) -> FreeRun:
    """An object that comes along by a share of the palm's way, with two contacts that slip and one of the table."""
    body = {"position": share * PALM, "orientation": np.tile([1.0, 0.0, 0.0, 0.0], (TICKS, 1))}
    contacts: dict[str, Any] = {
        "tick": np.array([3, 4, 5, 5]),
        "body": np.array([-1, 5, 2, 15]),
        "slip": np.array([1e-3, 1e-7, 2e-6, 3e-6]),
    }
    properties = {
        "mass": 0.1,
        "gravity": (0.0, 0.0, -10.0),
        "center": (0.0, 0.0, 0.0),
        "friction": 0.5,
        "torsion": 0.0,
        "table_friction": 0.2,
    }
    first = ObjectMotion(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    return FreeRun(body, contacts, properties, first, np.ones(21), 0.0)


def test_friction_is_told_as_a_share_of_what_can_be_borne() -> None:
    free = free_run(1.0)
    free.contacts.update({  # type: ignore[attr-defined]
        "friction_force": np.array([[9.0, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.4], [0.0, 0.2, 0.0]]),
        "normal_force": np.array([1.0, 1.0, 1.0, 0.5]),
        "torsional_moment": np.array([0.0, 0.0, 6e-3, 0.0]),
    })  # fmt: skip
    free.properties.update(torsion=0.01)  # type: ignore[attr-defined]
    # What the table bears is left out; of tick 5 it is the contact nearest to its limit.
    assert free.friction_share == pytest.approx([0.0] * 4 + [0.6, 1.0] + [0.0] * 4)


def test_creep_is_the_slip_of_contacts_in_a_hold_and_no_swing() -> None:
    free = free_run(1.0)
    free.body.update({"hand_wrench": np.ones((TICKS, 6))})  # type: ignore[attr-defined]
    ticks = RunTicks({}, TICKS, (TickPhase("hold", 0, 9),), 1000.0, 5, free=free)
    # The palm slips most in the hold's second half; the object goes 10 mm a tick with the hand.
    assert run_figure("object_creep", ticks) == pytest.approx(3e-6 * 1000.0 / 5)
    assert run_figure("object_slip", ticks) == pytest.approx(3e-6)


def test_weight_friction_and_way_are_those_of_the_object() -> None:
    free = free_run(1.0)
    assert free.friction.tolist() == [0.2, 0.5, 0.5, 0.5]
    assert free.of_hand.tolist() == [False, True, True, True]
    assert free.center[-1] == pytest.approx([0.0, 0.0, 0.07])
