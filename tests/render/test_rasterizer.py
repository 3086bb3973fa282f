"""Shaded pictures: the nearest surface is seen, glass lets through what lies behind, all of a scene is in the frame."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hhsim.errors import InputError, OutputError
from hhsim.render.figure import new_figure, save_figure
from hhsim.render.rasterizer import OVERSAMPLING, Camera, Layer, blend, frame, lit, rasterise, shade
from hhsim.render.triangle_soup import SKIN, SPHERE, look_from, round_cone_surface


def test_nearest_triangle_is_seen() -> None:
    corners = np.array([[1.0, 1.0], [9.0, 1.0], [1.0, 9.0]])
    screen, towards = np.concatenate([corners, corners]), np.array([1.0, 1.0, 1.0, 2.0, 2.0, 0.0])
    depth, weight, face = rasterise(screen, towards, np.array([[0, 1, 2], [3, 4, 5]]), (10, 10))
    assert face[2, 2] == 1
    assert face[7, 2] == 0
    assert face[9, 9] == -1
    np.testing.assert_allclose(weight.sum(axis=0), 1.0, rtol=1e-12)
    assert depth[2, 2] == pytest.approx(2.0 - 2.0 / 8.0)
    assert depth[7, 2] == 1.0


@pytest.mark.parametrize("towards", [(1.0, 0.0, 0.0), (0.3, -2.0, 0.5), (-1.0, 1.0, -3.0)])
def test_views_are_rotations_that_keep_up_upright(towards: tuple[float, float, float]) -> None:
    rotation = look_from(towards)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(
        rotation @ np.array(towards), np.array((0.0, 0.0, float(np.linalg.norm(towards)))), atol=1e-15
    )
    assert (rotation @ [0.0, 0.0, 1.0])[0] == pytest.approx(0.0, abs=1e-15)
    assert (rotation @ [0.0, 0.0, 1.0])[1] > 0.0


@pytest.mark.parametrize("shape", [(60, 200), (200, 60)])
def test_a_frame_holds_all_points(shape: tuple[int, int]) -> None:
    points = np.random.default_rng(0).normal(size=(100, 3)) + 5.0
    camera = frame(points, look_from((1.0, 2.0, 0.5)), shape, margin=0.1)
    seen = (points - camera.center) @ camera.rotation.T
    width = camera.height * shape[1] / shape[0]
    reach = np.abs(seen[:, :2]).max(axis=0) / (0.5 * camera.height, 0.5 * width)[::-1]
    assert reach.max() == pytest.approx(0.8)


def test_a_sphere_is_a_disc_of_its_size() -> None:
    sphere = round_cone_surface(np.zeros(3), np.zeros(3), 0.01, 0.01, SKIN)
    layer = shade(sphere, Camera(look_from((1.0, 0.0, 0.0)), np.zeros(3), 0.04, (100, 120)))
    assert layer.color.shape == (100 * OVERSAMPLING, 120 * OVERSAMPLING, 3)
    area = layer.seen().mean() * 0.04 * 0.048
    assert area == pytest.approx(np.pi * 0.01**2, rel=0.01)
    assert layer.depth[layer.seen()].max() == pytest.approx(0.01, rel=1e-3)
    assert layer.facing[100, 120] == pytest.approx(1.0, abs=1e-2)


def plain(color: float, depth: float) -> Layer:
    shape = (2 * OVERSAMPLING, 3 * OVERSAMPLING)
    return Layer(np.full((*shape, 3), color), np.full(shape, depth), np.ones(shape))


def test_glass_lets_through_what_lies_behind() -> None:
    near, far = plain(0.0, 1.0), plain(0.5, 0.0)
    for layers in ([(near, 0.25), (far, 1.0)], [(far, 1.0), (near, 0.25)]):
        np.testing.assert_allclose(blend(layers), np.full((2, 3, 3), 0.375))
    np.testing.assert_allclose(blend([(near, 1.0), (far, 1.0)]), 0.0)
    nowhere = replace(near, depth=np.full_like(near.depth, -np.inf))
    np.testing.assert_allclose(blend([(nowhere, 1.0)]), 1.0)
    np.testing.assert_allclose(blend([(nowhere, 1.0), (far, 0.5)]), 0.75)


def test_touching_bodies_are_sorted_pixel_by_pixel() -> None:
    left = round_cone_surface(np.zeros(3), np.zeros(3), 0.01, 0.01, SKIN)
    right = round_cone_surface(np.array([0.0, 0.01, 0.0]), np.array([0.0, 0.01, 0.0]), 0.01, 0.01, SPHERE)
    camera = Camera(look_from((1.0, 0.0, 0.0)), np.array([0.0, 0.005, 0.0]), 0.04, (80, 80))
    one, other = shade(left, camera), shade(right, camera)
    both = blend([(one, 1.0), (other, 1.0)])
    # Which way the camera's right is along y decides the sides.
    near_left, near_right = (one, other) if camera.rotation[0, 1] > 0.0 else (other, one)
    np.testing.assert_allclose(both[:, :39], blend([(near_left, 1.0)])[:, :39])
    np.testing.assert_allclose(both[:, 41:], blend([(near_right, 1.0)])[:, 41:])


def test_a_picture_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"xyz"):
        save_figure(new_figure(1, 1), tmp_path / "picture.xyz")
    for name in ("picture.png", "picture.jpg"):
        with pytest.raises(OutputError, match="cannot write"):
            save_figure(new_figure(1, 1), tmp_path / "nowhere" / name)


def test_a_frame_beyond_any_size_is_lit_without_a_blur() -> None:
    depth, normals = np.zeros((4, 6)), np.tile([0.0, 0.0, 1.0], (24, 1))
    size = Camera(look_from((1.0, 0.0, 0.0)), np.zeros(3), 1e300, (4, 6))
    near = replace(size, height=0.04)
    assert np.isfinite(lit(depth, normals, 0.5 * np.ones((24, 3)), size).color).all()
    pictures = [lit(depth, normals, np.ones((24, 3)), camera).color for camera in (size, near)]
    np.testing.assert_array_equal(pictures[0], pictures[1])
