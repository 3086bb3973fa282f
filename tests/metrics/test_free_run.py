"""What is said of a free object's run: how far it goes, its friction, grip, slip and creep."""

from typing import Any

import numpy as np
import pytest

from hhsim.metrics.run.registry import run_figure
from hhsim.metrics.run_ticks import FreeRun, RunTicks
from hhsim.motion.trajectory import ObjectMotion, TickPhase

TICKS = 10
PALM = np.outer(np.clip(np.arange(TICKS) - 2.0, 0.0, None), [0.0, 0.0, 0.01])


def run(share: float) -> FreeRun:
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
    free = run(1.0)
    free.contacts.update({  # type: ignore[attr-defined]
        "friction_force": np.array([[9.0, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.4], [0.0, 0.2, 0.0]]),
        "normal_force": np.array([1.0, 1.0, 1.0, 0.5]),
        "torsional_moment": np.array([0.0, 0.0, 6e-3, 0.0]),
    })  # fmt: skip
    free.properties.update(torsion=0.01)  # type: ignore[attr-defined]
    # What the table bears is left out; of tick 5 it is the contact nearest to its limit.
    assert free.friction_share == pytest.approx([0.0] * 4 + [0.6, 1.0] + [0.0] * 4)


def test_creep_is_the_slip_of_contacts_in_a_hold_and_no_swing() -> None:
    free = run(1.0)
    free.body.update({"hand_wrench": np.ones((TICKS, 6))})  # type: ignore[attr-defined]
    ticks = RunTicks({}, TICKS, (TickPhase("hold", 0, 9),), 1000.0, 5, free=free)
    # The palm slips most in the hold's second half; the object goes 10 mm a tick with the hand.
    assert run_figure("object_creep", ticks) == pytest.approx(3e-6 * 1000.0 / 5)
    assert run_figure("object_slip", ticks) == pytest.approx(3e-6)


def test_weight_friction_and_way_are_those_of_the_object() -> None:
    free = run(1.0)
    assert free.friction.tolist() == [0.2, 0.5, 0.5, 0.5]
    assert free.of_hand.tolist() == [False, True, True, True]
    assert free.center[-1] == pytest.approx([0.0, 0.0, 0.07])
