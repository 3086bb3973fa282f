"""The picture of a tree: what its pixels say of the spheres and the mesh."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hhsim.render.rasterizer import OVERSAMPLING, Camera
from hhsim.render.tree_figure import COLORS, _spheres, draw_tree
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree
from tools.shapes.generators import cube


def picture(path: Path) -> np.ndarray:
    from matplotlib.image import imread

    return np.asarray(imread(path))[:, :, :3]


@pytest.fixture(autouse=True)
def _few_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hhsim.render.tree_figure.PIXELS", 150)


@pytest.fixture(scope="module")
def tree() -> SphereTree:
    return build_sphere_tree(cube(0.1), TreeOptions(level=2, leaves=30))


def test_it_draws_a_tree(tmp_path: Path, tree: SphereTree) -> None:
    path = tmp_path / "cube.png"
    draw_tree(path, cube(0.1), tree)
    shown = picture(path)
    assert shown.shape == (690, 1920, 3)
    for left, right in ((0, 620), (640, 1240), (1400, 1920)):
        assert (shown[:, left:right] < 0.9).any(axis=2).mean() > 0.01
    # The mesh is grey, the spheres are not.
    spread = np.ptp(shown, axis=2)
    assert spread[:, :600].max() < 0.2 < 0.5 < spread[:, 640:1200].max()


def test_the_size_of_the_object_makes_no_difference(tmp_path: Path, tree: SphereTree) -> None:
    draw_tree(tmp_path / "small.png", cube(0.1), tree)
    # And, in the panel on the right, the gap that it is said to have.
    errors = tuple(replace(error, gap_max=1e-4) for error in tree.errors)
    draw_tree(tmp_path / "large.png", cube(0.1).scaled(8.0), replace(tree, errors=errors).scaled(8.0))
    small, large = (picture(tmp_path / f"{name}.png") for name in ("small", "large"))
    assert np.abs(small - large)[70:, :1200].max() < 0.02
    assert (small != large)[:, 1400:].any()


def test_a_ball_is_coloured_by_its_height_over_the_mesh() -> None:
    from matplotlib import colormaps

    # A sphere around the middle of the cube sticks out of the middle of a face by 10 mm, in the middle of the picture.
    camera = Camera(np.eye(3), np.zeros(3), 0.2, (40, 40))
    layer = _spheres(cube(0.1), np.zeros((1, 3)), np.array([0.06]), 1.0, 0.02, camera)
    middle = 20 * OVERSAMPLING
    assert layer.depth[middle, middle] == pytest.approx(0.06)
    assert layer.facing[middle, middle] == pytest.approx(1.0)
    assert layer.seen().mean() == pytest.approx(np.pi * 0.06**2 / 0.2**2, rel=0.03)
    wanted, lit = np.array(colormaps[COLORS](0.5)[:3]), layer.color[middle, middle]
    # Light changes how bright it is; which colour is strongest stays.
    assert lit.argsort().tolist() == wanted.argsort().tolist()
