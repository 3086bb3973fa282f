"""Pictures: triangles of bodies and hands, the rasteriser, and the figures made of them."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.image import imread
from mesh_oracle import to_cone
from PIL import Image
from scipy.spatial.transform import Rotation

from hhsim.errors import InputError, OutputError
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.brute_force_distance import round_cone_distance
from hhsim.render import triangle_soup as soup
from hhsim.render.before_after import FRAMES, JUST_INSIDE, SIDE, TITLE, deepest_frames, draw_before_after
from hhsim.render.figure import new_figure, save_figure
from hhsim.render.hand_picture import arrow_layers, label, with_hidden
from hhsim.render.rasterizer import OVERSAMPLING, Camera, Layer, blend, frame, lit, rasterise, shade
from hhsim.render.spheres_figure import draw_tree
from hhsim.render.triangle_soup import joined, round_cone_surface
from hhsim.render.viewpoint import PieceForce
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.options import TreeOptions
from tools.shapes.generators import cube, sphere


@pytest.mark.parametrize("tip", [0.01, 0.006])
@pytest.mark.parametrize("end", [(0.03, 0.01, -0.02), (0.0, 0.0, 0.0)])
def test_surface_is_the_round_cones(tip: float, end: tuple[float, float, float]) -> None:
    a, b = np.zeros(3), np.array(end)
    tip = 0.01 if not b.any() else tip
    surface = round_cone_surface(a, b, 0.01, tip, soup.SKIN)
    for away in (0.0, 0.001):
        distance = to_cone(surface.points + away * surface.normals, a, b, 0.01, tip)
        np.testing.assert_allclose(distance, away, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("length", [0.05, 0.004])
def test_an_arrow_reaches_from_its_start_to_its_tip(length: float) -> None:
    start, direction = np.array([0.01, 0.02, 0.03]), np.array([0.6, 0.0, 0.8])
    surface = soup.arrow_surface(start, length * direction, 0.001, soup.SKIN)
    along = (surface.points - start) @ direction
    assert along.max() == pytest.approx(length, abs=3e-4)
    assert -0.002 < along.min() <= 0.0
    across = np.linalg.norm(surface.points - start - along[:, None] * direction, axis=1)
    assert across.max() <= 0.0025 + 1e-12


def shape(solid: trimesh.Trimesh) -> Mesh:
    return Mesh(solid.vertices, solid.faces, "shape", "shape")


def area(mesh: Mesh) -> float:
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def test_a_door_without_a_corner_near_is_cut_to_the_box() -> None:
    low, high = np.array([-0.2, -0.3, -0.1]), np.array([0.1, 0.3, 0.5])
    part = soup.clipped(shape(trimesh.creation.box((0.9, 0.04, 2.0))), low, high)
    np.testing.assert_allclose(part.bounds, [(-0.2, -0.02, -0.1), (0.1, 0.02, 0.5)], atol=1e-12)
    # Of the six sides only the front and the back go through the box.
    assert area(part) == pytest.approx(2 * 0.3 * 0.6)
    assert soup.clipped(part, high + 1.0, high + 2.0) is None


def test_a_large_object_is_cut_near_the_hands_and_a_small_one_is_whole() -> None:
    hands = np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]])
    size = np.linalg.norm(hands[1] - hands[0])
    door = shape(trimesh.creation.box((0.9, 0.04, 2.0)))
    height = soup.near_hands(door, hands).bounds[:, 2]
    np.testing.assert_allclose(height, (-soup.NEAR * size, 0.1 + soup.NEAR * size), atol=1e-12)
    ball = shape(trimesh.creation.icosphere(1, soup.FAR * size - 1e-3))
    assert soup.near_hands(ball, hands) is ball
    # A hand that is nowhere near it is shown with all of it.
    assert soup.near_hands(door, hands + 50.0) is door


TICKS = 40


def motion(seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    orientation = random.normal(size=(TICKS, 4))
    orientation /= np.linalg.norm(orientation, axis=1, keepdims=True)
    flexion = random.uniform(-0.5, 1.7, (TICKS, 5, 3))
    return random.normal(size=(TICKS, 3)), orientation, flexion, random.uniform(-0.6, 0.8, (TICKS, 5))


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_pieces_are_where_the_kinematics_put_them(side: Literal["right", "left"]) -> None:
    hand = HandModel.default(side)
    position, orientation, flexion, abduction = motion()
    poses = soup.piece_poses(hand, position, orientation, flexion, abduction)
    placed = forward_kinematics(hand, position, orientation, flexion, abduction)
    np.testing.assert_allclose(poses.translation[:, :15].reshape(TICKS, 5, 3, 3), placed.joints[:, :, :3], atol=1e-14)
    np.testing.assert_array_equal(poses.translation[:, 15], position)
    np.testing.assert_allclose(np.linalg.norm(poses.quaternion, axis=2), 1.0, atol=1e-14)
    rotation = Rotation.from_quat(poses.quaternion.reshape(-1, 4), scalar_first=True)
    along = rotation.apply([0.0, 1.0, 0.0]).reshape(TICKS, 16, 3)
    lengths = hand.length.reshape(15, 1)
    ends = placed.joints[:, :, 1:].reshape(TICKS, 15, 3)
    np.testing.assert_allclose(poses.translation[:, :15] + lengths * along[:, :15], ends, atol=1e-14)
    # Out of the back at zero angles is the model's own direction.
    rest = soup.piece_poses(hand, np.zeros((1, 3)), [[1.0, 0.0, 0.0, 0.0]], np.zeros((1, 5, 3)), np.zeros((1, 5)))
    back = Rotation.from_quat(rest.quaternion[0], scalar_first=True).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(back[:15], np.repeat(hand.dorsal, 3, axis=0), atol=1e-14)


def test_the_pieces_together_are_the_hand() -> None:
    hand = HandModel.default()
    position, orientation, *angles = (values[7] for values in motion(3))
    joints = hand.joints(position, orientation, *angles)
    surfaces = soup.piece_surfaces(hand)
    assert (len(surfaces), soup.PIECES[0], soup.PIECES[15]) == (len(soup.PIECES), "thumb/proximal", "palm")
    whole = soup.hand_surface(hand, (position, orientation, *angles), surfaces)
    ends = np.cumsum([len(surface.points) for surface in surfaces])
    np.testing.assert_allclose(np.linalg.norm(whole.normals, axis=1), 1.0, atol=1e-12)
    for k, points in enumerate(np.split(whole.points, ends[:-1])[:15]):
        f, phalanx = divmod(k, 3)
        radius = hand.radius[f, phalanx : phalanx + 2].tolist()
        distance = round_cone_distance(points, joints[f, phalanx], joints[f, phalanx + 1], *radius)
        assert np.abs(distance).max() < 1e-12
    palm = Rotation.from_quat(orientation, scalar_first=True).apply(surfaces[15].points) + position
    np.testing.assert_allclose(whole.points[ends[14] :], palm, atol=1e-14)


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
    rotation = soup.look_from(towards)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(rotation @ towards, [0.0, 0.0, np.linalg.norm(towards)], atol=1e-15)
    assert (rotation @ [0.0, 0.0, 1.0])[0] == pytest.approx(0.0, abs=1e-15)
    assert (rotation @ [0.0, 0.0, 1.0])[1] > 0.0


@pytest.mark.parametrize("shape", [(60, 200), (200, 60)])
def test_a_frame_holds_all_points(shape: tuple[int, int]) -> None:
    points = np.random.default_rng(0).normal(size=(100, 3)) + 5.0
    camera = frame(points, soup.look_from((1.0, 2.0, 0.5)), shape, margin=0.1)
    seen = (points - camera.center) @ camera.rotation.T
    width = camera.height * shape[1] / shape[0]
    reach = np.abs(seen[:, :2]).max(axis=0) / (0.5 * camera.height, 0.5 * width)[::-1]
    assert reach.max() == pytest.approx(0.8)


def test_a_sphere_is_a_disc_of_its_size() -> None:
    sphere = round_cone_surface(np.zeros(3), np.zeros(3), 0.01, 0.01, soup.SKIN)
    layer = shade(sphere, Camera(soup.look_from((1.0, 0.0, 0.0)), np.zeros(3), 0.04, (100, 120)))
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
    left = round_cone_surface(np.zeros(3), np.zeros(3), 0.01, 0.01, soup.SKIN)
    right = round_cone_surface(np.array([0.0, 0.01, 0.0]), np.array([0.0, 0.01, 0.0]), 0.01, 0.01, soup.SPHERE)
    camera = Camera(soup.look_from((1.0, 0.0, 0.0)), np.array([0.0, 0.005, 0.0]), 0.04, (80, 80))
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
    size = Camera(soup.look_from((1.0, 0.0, 0.0)), np.zeros(3), 1e300, (4, 6))
    near = replace(size, height=0.04)
    assert np.isfinite(lit(depth, normals, 0.5 * np.ones((24, 3)), size).color).all()
    pictures = [lit(depth, normals, np.ones((24, 3)), camera).color for camera in (size, near)]
    np.testing.assert_array_equal(pictures[0], pictures[1])


BALL = sphere(0.08, subdivisions=3)
FINGER = sphere(0.04, subdivisions=2)
DEPTH = np.array([-0.005, 0.002, 0.006, 0.001])
"""Depth of the finger in the ball at each frame [m]."""


def fingers(depth: np.ndarray) -> np.ndarray:
    """Skins of the finger, so deep in the ball, at its side, shape (T, V, 3)."""
    return np.asarray(FINGER.vertices + np.array([[[0.06 - d, 0.0, 0.0]] for d in depth]))


def red_pixels(path: Path) -> np.ndarray:
    """Number of red pixels of each picture, shape (rows, 4)."""
    with Image.open(path) as picture:
        pixels = np.asarray(picture, dtype=np.float64)
    rows = round(pixels.shape[0] / (SIDE + TITLE))
    red = pixels[:, :, 0] - pixels[:, :, 1] > 65.0
    return np.array([[part.sum() for part in np.array_split(line, 4, 1)] for line in np.array_split(red, rows, 0)])


@given(st.lists(st.floats(-0.01, 0.03), min_size=1, max_size=200))
def test_drawn_frames_are_the_deepest_ones_apart_from_each_other(depth: list[float]) -> None:
    found = deepest_frames(np.array(depth))
    assert 1 <= len(found) <= FRAMES and depth[found[0]] == max(depth)
    assert all(depth[one] >= depth[other] > JUST_INSIDE for one, other in pairwise(found))
    gap = max(1, round(0.05 * len(depth)))
    assert all(abs(one - other) > gap for i, one in enumerate(found) for other in found[:i])
    near = {frame for one in found for frame in range(one - gap, one + gap + 1)}
    left = [value for frame, value in enumerate(depth) if frame not in near]
    if len(found) < FRAMES:
        assert all(value <= JUST_INSIDE for value in left)
    else:
        assert all(value <= depth[found[-1]] for value in left)


def draw(before: np.ndarray, after: np.ndarray, path: Path) -> np.ndarray:
    """Draw the fingers in the ball; number of red pixels of each picture, shape (rows, 4)."""
    count = len(before)
    draw_before_after(
        [BALL] * count, before, after, FINGER.faces, path, np.arange(4.0), range(4), [np.zeros(count)] * 2
    )
    return red_pixels(path)


def test_what_stands_inside_is_red_and_only_that(tmp_path: Path) -> None:
    red = draw(fingers(DEPTH)[2:3], fingers(np.full(1, -1e-3)), tmp_path / "worst.png")
    assert red.shape == (1, 4)
    assert (red[0, [0, 2]] > 30).all() and (red[0, [1, 3]] == 0).all()
    assert red[0, 2] > red[0, 0]


@pytest.mark.soak
def test_frames_are_drawn_in_their_order(tmp_path: Path) -> None:
    before = fingers(DEPTH)[[0, 2]]
    red = draw(before, before, tmp_path / "worst.png")
    assert (red[0] == 0).all() and (red[1] > 0).all()
    np.testing.assert_array_equal(red[:, 0], red[:, 1])


CAMERA = Camera(soup.look_from((1.0, 0.0, 0.0)), np.zeros(3), 0.12, (300, 300))


@pytest.mark.parametrize(
    ("contact", "is_hidden"),
    [
        ((-0.008, 0.0, 0.0), False),  # behind its own finger, which is before no other
        ((-0.05, 0.0, 0.02), True),  # of a finger behind that one
        ((-0.05, 0.04, 0.0), False),  # beside the finger in front
        ((-0.05, 1.0, 0.0), False),  # outside the picture
    ],
)
def test_a_force_behind_another_part_of_the_hand_is_hollow_and_has_its_fingers_name(
    contact: tuple[float, float, float], is_hidden: bool
) -> None:
    fingers = [
        round_cone_surface(np.array([x, 0.0, -0.04]), np.array([x, 0.0, 0.04]), 0.01, 0.01, soup.SKIN)
        for x in (0.0, -0.05)
    ]
    force = PieceForce("thumb/distal", np.array(contact), np.array([0.0, 1.0, 0.0]))
    (marked,) = with_hidden([force], shade(joined(fingers), CAMERA), CAMERA)
    assert marked.is_hidden == is_hidden
    (solid, _), (drawn, _) = (arrow_layers([one], CAMERA)[0] for one in (replace(force, is_hidden=False), marked))
    assert (drawn.seen() <= solid.seen()).all()
    assert (0 < drawn.seen().sum() < 0.5 * solid.seen().sum()) == is_hidden
    axes = new_figure(2.0, 2.0).add_subplot()
    label(axes, [marked], CAMERA)
    assert axes.texts[0].get_text() == ("1.0 N thumb" if is_hidden else "1.0 N")


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
