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
    middle, end = (shown.shape[1] - 130) // 2, shown.shape[1] - 130
    assert shown.shape[0] == 720 and 0.75 * 720 <= middle <= 1.5 * 720
    for left, right in ((0, middle), (middle, end), (end, end + 130)):
        assert (shown[:, left:right] < 0.9).any(axis=2).mean() > 0.01
    # The mesh is grey, the spheres are not.
    spread = np.ptp(shown, axis=2)
    assert spread[:, :middle].max() < 0.2 < 0.5 < spread[:, middle:end].max()
