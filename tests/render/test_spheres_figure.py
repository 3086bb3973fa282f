"""The picture of a tree: what its pixels say of the spheres and the mesh."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from hhsim.render.spheres_figure import draw_tree
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.options import TreeOptions
from tools.shapes.generators import cube


@pytest.mark.soak
def test_it_draws_a_tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hhsim.render.spheres_figure.PIXELS", 150)
    path = tmp_path / "cube.png"
    draw_tree(path, cube(0.1), build_sphere_tree(cube(0.1), TreeOptions(level=2, leaves=30)))
    shown = imread(path)[:, :, :3]
    assert shown.shape == (690, 1920, 3)
    for left, right in ((0, 620), (640, 1240), (1400, 1920)):
        assert (shown[:, left:right] < 0.9).any(axis=2).mean() > 0.01
    # The mesh is grey, the spheres are not.
    spread = np.ptp(shown, axis=2)
    assert spread[:, :600].max() < 0.2 < 0.5 < spread[:, 640:1200].max()
