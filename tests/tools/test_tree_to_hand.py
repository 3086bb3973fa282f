"""From tree to hand: replays judged against the true mesh by coal, and what the judgement is made of."""

import json
from dataclasses import replace

import numpy as np
import pytest
from sampled import sampled
from sphere_scenes import brute_pairs

from hhsim.hand.forward_kinematics import forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object
from hhsim.motion.analytic_motion import still
from tools.tree_to_hand import EndToEnd, cells, end_to_end, main, sphere_distances

ROW = EndToEnd("cube", "grasp", 3, 512, 1e-3, 10, 0.0, 0.0, 0.9e-3, 0.8e-3, 5, 0.5e-3, 1e-3, 1e-5, 2e-5)


@pytest.mark.soak
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "level", "most"), sampled([("cube", 3, 1.2e-3), ("bunny", 4, 0.2e-3)], lambda place, case: place == 0)
)
def test_the_mesh_is_kept_out_of_and_the_hover_is_within_the_bound(name: str, level: int, most: float) -> None:
    row = end_to_end(load_object(name).mesh, level, "whole-hand", every=80)
    assert row.passed
    assert row.mesh_penetration <= 1e-6
    assert row.sphere_penetration <= 1e-6
    assert 0.0 < row.hover_hold <= row.hover <= row.bound
    assert row.contact_error_mean <= row.contact_error_max <= most
    assert row.touching >= row.ticks >= 5


def test_what_misses_a_bar() -> None:
    assert ROW.passed
    assert not replace(ROW, mesh_penetration=1.1e-6).passed
    assert not replace(ROW, hover=1.1e-3).passed
    assert not replace(ROW, touching=0).passed
    assert cells(ROW)[-1] == "ok"
    assert cells(replace(ROW, hover=1.1e-3))[-1] == "MISSED"


def test_distances_to_spheres_are_those_of_brute_force() -> None:
    hand, rng = HandModel.default(), np.random.default_rng(4)
    center, radius = rng.normal(scale=0.1, size=(40, 3)), rng.uniform(0.005, 0.02, 40)
    motion = still(np.array([0.01, 0.02, 0.03]), flexion=rng.uniform(0.0, 1.0, (5, 3)))
    pairs = brute_pairs(hand, center, radius, motion)
    found = sphere_distances(center, radius, hand_shape(hand), forward_kinematics(hand, *motion))[0]
    np.testing.assert_allclose(found[:15], pairs[:15].min(axis=1), atol=1e-12)
    assert found[15] == pytest.approx(pairs[15:].min(), abs=1e-12)


@pytest.mark.soak
def test_the_command_prints_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    lines: list[str] = []
    arguments = ["--object", "cube", "--level", "2", "--motion", "touch", "--every", "300"]
    assert main(arguments, lines.append) == 0
    table = capsys.readouterr().out.splitlines()
    assert len(table) == 3
    assert lines[0] in table[2]
    assert main([*arguments, "--json"], lines.append) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["passed"]
    assert row["hover"] <= row["bound"]
    with pytest.raises(SystemExit, match="unknown object"):
        main(["--object", "cbue"])
