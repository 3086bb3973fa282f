"""Simulation displacement in PyBullet: free fall in closed form, and an object that a hand holds from below."""

import builtins
from typing import Any

import numpy as np
import pytest
from field_hands import HALF, hands_at, skin_hand

from hhsim.errors import InputError
from hhsim.metrics.field.displacement import GRAVITY, STEP, STEPS, simulation_displacements
from hhsim.metrics.field.field_table import field_rows
from hhsim.metrics.field.hands import FieldPair

FALL = GRAVITY * STEP**2 * STEPS * (STEPS + 1) / 2.0
"""Free fall by steps that change first the speed, then the place [m]."""
UNDER = [-0.2, -0.2, -HALF - 0.02], [0.2, 0.2, -HALF]
"""Corners of a hand that is a plate right under the box [m]."""


def test_an_object_falls_freely_without_a_hand_in_its_way() -> None:
    pytest.importorskip("pybullet", reason="pip install 'hhsim[pybullet]' brings PyBullet")
    away = skin_hand([0.5, 0.5, 0.5], [0.6, 0.6, 0.6])
    # Bullet damps motion by about 4 % a second, of which this is 0.15.
    assert simulation_displacements(away, (0, 0)) == pytest.approx([FALL] * 2, rel=0.006)
    above = skin_hand(*UNDER, down=np.array([[0.0, 0.0, 1.0]]))
    assert simulation_displacements(above, (0,)) == pytest.approx([FALL], rel=0.03)


def test_an_object_on_a_hand_stays_and_is_in_the_table() -> None:
    pytest.importorskip("pybullet", reason="pip install 'hhsim[pybullet]' brings PyBullet")
    held = skin_hand(*UNDER)
    pair = FieldPair(held, held, displacement_frames=(0,))
    rows = {row.name: row for row in field_rows(pair)}
    row = rows["displacement_max"]
    # Bullet's margin around convex parts lifts the box by a millimetre.
    assert row.before == row.after < 0.003
    assert row.parameters == "1 frames, 35 steps of 1/240 s, friction 3, 1 kg"
    assert "displacement_max" not in {row.name for row in field_rows(FieldPair(held, held))}


def test_what_cannot_be_simulated_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="no frame 1 for the simulation displacement; expected 0 to 0"):
        simulation_displacements(skin_hand(*UNDER), (1,))
    real = builtins.__import__

    def without(name: str, *others: Any) -> Any:
        if name == "pybullet":
            raise ImportError(name)
        return real(name, *others)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"needs PyBullet: pip install 'hhsim\[pybullet\]'"):
        simulation_displacements(skin_hand(*UNDER), (0,))
    monkeypatch.undo()
    pytest.importorskip("pybullet", reason="pip install 'hhsim[pybullet]' brings PyBullet")
    with pytest.raises(InputError, match="a hand with a skin or with cones"):
        simulation_displacements(hands_at(0.1), (0,))
