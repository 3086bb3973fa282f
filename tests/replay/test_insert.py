"""A peg that two fingertips put into a hole: it ends where the script says, and the table alone bears it."""

from pathlib import Path

import numpy as np
import pytest
from short_grasp import result_of

from hhsim.hand.quaternion import rotation_matrix
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import open_scene

WEIGHT = 0.05 * 9.81
RADIUS, GAP = 0.010, 0.0005
"""Of the peg, and on each side of it [m] (tools/build_bodies.py)."""
INSCRIBED = np.cos(np.pi / 48)
MIDDLE = np.array([-0.12, -0.06])


@pytest.mark.soak
def test_the_peg_goes_in_as_deep_as_the_script_says_and_rests_there(tmp_path: Path) -> None:
    scene = open_scene("peg", load_script("insert"), solid=False)
    peg = result_of(scene, tmp_path / "insert.h5", surface="mesh").bodies["peg"]
    foot, axis = np.asarray(peg["position"]), rotation_matrix(np.asarray(peg["orientation"]))[:, :, 2]
    assert abs(foot[-1, 2]) < 1e-6 and axis[-1, 2] > 1.0 - 1e-12, "it stands on the table, through the whole hole"
    assert np.hypot(*(foot[-1, :2] - MIDDLE)) <= (RADIUS + GAP) / INSCRIBED - RADIUS * INSCRIBED
    assert np.abs(np.diff(foot[-200:], axis=0)).max() == 0.0
    for name, force in (("hand_wrench", 0.0), ("body_wrench", 0.0), ("table_wrench", WEIGHT)):
        np.testing.assert_allclose(np.asarray(peg[name])[-1, 2], force, atol=1e-9)
