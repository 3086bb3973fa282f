"""The figures of force that need no hold, of ticks whose figures can be counted on fingers."""

import math

import numpy as np
import pytest

from hhsim.metrics.run.registry import run_figure
from hhsim.metrics.run_ticks import RunTicks

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
