"""A picture of the hand model: `python -m hhsim.hand_figure docs/hand.png`.

The figure shows what the kernels collide with: each phalanx is the surface of its round cone, the palm is its mesh, and
the second half shows the palm as the leaf spheres of its tree (paper, Fig. 4).
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hhsim.destination import check_destination
from hhsim.errors import InputError, OutputError
from hhsim.hand import FINGERS, HandModel
from hhsim.mesh import Mesh

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

OPEN_POSE = (
    ((-8.0, 8.0, 8.0), (8.0, 10.0, 6.0), (8.0, 10.0, 6.0), (10.0, 12.0, 8.0), (12.0, 14.0, 8.0)),
    (-8.0, 4.0, 0.0, -3.0, -8.0),
)
"""Flexion and abduction [degrees] of a relaxed open hand."""

CURLED_POSE = (
    ((12.0, 22.0, 30.0), (42.0, 48.0, 30.0), (46.0, 52.0, 32.0), (50.0, 55.0, 34.0), (54.0, 56.0, 34.0)),
    (18.0, 2.0, 0.0, -2.0, -4.0),
)
"""Flexion and abduction [degrees] of a hand around a ball."""

SKIN = np.array([0.91, 0.70, 0.58])
NAIL = np.array([0.97, 0.83, 0.77])
SPHERE = np.array([0.42, 0.62, 0.78])
LIGHT = np.array([-0.45, 0.55, 0.90])
"""Towards the key light, in the picture's frame (right, up, towards the viewer)."""

PIXELS = 460
"""Width of a panel [pixels], drawn twice as large and averaged."""


@dataclass(frozen=True)
class Surface:
    """Triangles with a normal and a colour a vertex; [m], shapes (n, 3), (n, 3), (n, 3), (m, 3)."""

    points: FloatArray
    normals: FloatArray
    colors: FloatArray
    faces: IntArray


def draw_hand(path: str | Path, hand: HandModel | None = None) -> None:
    """Draw the hand, open and curled, as surfaces and as the hybrid model.

    Args:
        path: Picture file; matplotlib chooses the format by its ending.
        hand: The hand; the default right hand if not given.

    Raises:
        OutputError: The picture cannot be written.
        InputError: matplotlib has no such picture format.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    check_destination(Path(path))
    hand = hand or HandModel.default()
    panels = [
        ("Open, palm", OPEN_POSE, False, view(0.0, -14.0)),
        ("Curled, thumb side", CURLED_POSE, False, view(70.0, -8.0)),
        ("Hybrid model, palm", OPEN_POSE, True, view(0.0, -14.0)),
        ("Hybrid model, thumb side", CURLED_POSE, True, view(70.0, -8.0)),
    ]
    figure = Figure(figsize=(14.0, 5.0), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    for column, (title, pose, hybrid, rotation) in enumerate(panels):
        axes = figure.add_axes((0.25 * column, 0.0, 0.25, 0.93))
        axes.imshow(render(hand_surface(hand, pose, hybrid), rotation, 0.21 * hand.hand_length / 0.19))
        axes.set_axis_off()
        axes.set_title(title, fontsize=13, color="0.25", pad=4)
    try:
        figure.savefig(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot write the picture: {error.strerror or error}") from error
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error


def view(turn: float, tilt: float) -> FloatArray:
    """Rows right, up and towards the viewer, shape (3, 3), for a look at the palm.

    `turn` [degrees] walks round the fingers' axis from the palm to the thumb side, `tilt` looks down from the tips.
    """
    a, b = np.radians(turn), np.radians(tilt)
    towards = np.array([-np.sin(a), 0.0, -np.cos(a)])
    right = np.cross([0.0, 1.0, 0.0], towards)
    up = np.array([0.0, 1.0, 0.0])
    return np.array([right, np.cos(b) * up - np.sin(b) * towards, np.sin(b) * up + np.cos(b) * towards])


def hand_surface(
    hand: HandModel, pose: tuple[tuple[tuple[float, ...], ...], tuple[float, ...]], hybrid: bool
) -> Surface:
    """The hand's surface in the palm frame; `hybrid` shows the palm as its leaf spheres."""
    flexion, abduction = np.radians(pose[0]), np.radians(pose[1])
    joints = hand.joints(np.zeros(3), (1.0, 0.0, 0.0, 0.0), flexion, abduction)
    parts = []
    if hybrid:
        parts += [
            round_cone_surface(center, center, radius, radius, SPHERE, rings=14, sides=44)
            for center, radius in zip(hand.palm_tree.leaf_center, hand.palm_tree.leaf_radius)
        ]
    else:
        parts.append(mesh_surface(hand.palm_mesh, SKIN))
    for finger in range(len(FINGERS)):
        for k in range(3):
            radius_a, radius_b = hand.radius[finger, k : k + 2]
            parts.append(round_cone_surface(joints[finger, k], joints[finger, k + 1], radius_a, radius_b, SKIN))
        parts[-1] = with_nail(parts[-1], joints[finger])
    offsets = np.cumsum([0] + [len(part.points) for part in parts])
    return Surface(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.colors for part in parts]),
        np.concatenate([part.faces + offset for part, offset in zip(parts, offsets)]),
    )


def round_cone_surface(
    a: FloatArray, b: FloatArray, radius_a: float, radius_b: float, color: FloatArray, rings: int = 28, sides: int = 48
) -> Surface:
    """Surface of revolution of the hull of two spheres [m]; one sphere where a and b coincide."""
    length = float(np.linalg.norm(b - a))
    axis = (b - a) / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    tangent = float(np.arcsin(min((radius_a - radius_b) / length, 1.0))) if length > 0.0 else 0.0
    rear, front = np.linspace(-0.5 * np.pi, tangent, rings), np.linspace(tangent, 0.5 * np.pi, rings)
    latitude = np.concatenate([rear, front])
    radius = np.repeat([radius_a, radius_b], rings)
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    across /= np.linalg.norm(across)
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    radial = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * np.cross(axis, across)
    normals = np.sin(latitude)[:, None, None] * axis + np.cos(latitude)[:, None, None] * radial
    points = np.repeat([a, b], rings, axis=0)[:, None] + radius[:, None, None] * normals
    ring, side = np.meshgrid(np.arange(2 * rings - 1), np.arange(sides), indexing="ij")
    p, q = (ring * sides + side).ravel(), (ring * sides + (side + 1) % sides).ravel()
    faces = np.concatenate([np.stack([p, q, q + sides], axis=1), np.stack([p, q + sides, p + sides], axis=1)])
    normals = normals.reshape(-1, 3)
    return Surface(points.reshape(-1, 3), normals, np.tile(color, (len(normals), 1)), faces.astype(np.int64))


def mesh_surface(mesh: Mesh, color: FloatArray) -> Surface:
    """A mesh with area-weighted vertex normals."""
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    normals = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], np.cross(b - a, c - a))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Surface(mesh.vertices, normals, np.tile(color, (len(normals), 1)), mesh.faces)


def with_nail(distal: Surface, joints: FloatArray) -> Surface:
    """Colour the nail on the back of a distal phalanx; joints of its finger [m], shape (4, 3)."""
    axis = joints[3] - joints[2]
    length = float(np.linalg.norm(axis))
    axis = axis / length
    previous = joints[2] - joints[1]
    bend = previous - (previous @ axis) * axis
    back = bend / np.linalg.norm(bend)
    side = np.cross(axis, back)
    offset = distal.points - joints[3]
    along = offset @ axis / (0.55 * length)
    across = offset @ side / (0.4 * length)
    nail = ((np.abs(along + 0.1) ** 3 + np.abs(across) ** 3) < 1.0) & (distal.normals @ back > 0.3)
    return Surface(distal.points, distal.normals, np.where(nail[:, None], NAIL, distal.colors), distal.faces)


def render(surface: Surface, rotation: FloatArray, height: float) -> FloatArray:
    """Shaded orthographic picture, shape (rows, columns, 3), white where nothing is; `height` [m] fills the panel."""
    from scipy.ndimage import gaussian_filter

    size = 2 * PIXELS
    rows = size * 4 // 3
    scale = rows / height
    points = surface.points @ rotation.T
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    screen = np.stack(
        [(points[:, 0] - middle[0]) * scale + 0.5 * size, (middle[1] - points[:, 1]) * scale + 0.5 * rows], axis=1
    )
    faces = surface.faces[((surface.normals @ rotation[2])[surface.faces] > 0.0).any(axis=1)]
    depth, weight, face = rasterise(screen, points[:, 2], faces, (rows, size))
    seen = face >= 0
    corner = faces[face]
    normals = np.einsum("rck,rcki->rci", weight, surface.normals[corner]) @ rotation.T
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-12)
    color = np.einsum("rck,rcki->rci", weight, surface.colors[corner])
    light = LIGHT / np.linalg.norm(LIGHT)
    half = light + np.array([0.0, 0.0, 1.0])
    diffuse = np.clip((normals @ light + 0.25) / 1.25, 0.0, None)
    shine = np.clip(normals @ (half / np.linalg.norm(half)), 0.0, None) ** 30
    # What lies behind its surroundings gets less light: depth against its blur stands in for ambient occlusion.
    far = np.where(seen, depth, depth[seen].min())
    blur = gaussian_filter(far, 0.006 * scale)
    shade = np.clip(1.0 - np.clip(blur - far, 0.0, None) / 0.012, 0.45, 1.0)
    ambient = 0.36 + 0.10 * normals[:, :, 1]
    picture = color * ((ambient + 0.66 * diffuse) * shade)[:, :, None] + 0.10 * shine[:, :, None]
    # Skin lets red through where it turns away from the light.
    picture[:, :, 0] += 0.05 * (1.0 - diffuse)
    picture = np.where(seen[:, :, None], np.clip(picture, 0.0, 1.0), 1.0)
    return np.asarray(picture.reshape(rows // 2, 2, size // 2, 2, 3).mean(axis=(1, 3)))


def rasterise(
    screen: FloatArray, towards: FloatArray, faces: IntArray, shape: tuple[int, int]
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Nearest triangle at each pixel.

    Args:
        screen: Column and row of each vertex [pixels], shape (n, 2).
        towards: Its coordinate towards the viewer [m], shape (n,).
        faces: Shape (m, 3).
        shape: Rows and columns of the picture.

    Returns:
        Coordinate towards the viewer [m], shape (rows, columns); barycentric weights, shape (rows, columns, 3); the
        triangle or -1, shape (rows, columns).
    """
    depth = np.full(shape[0] * shape[1], -np.inf)
    weight = np.zeros((shape[0] * shape[1], 3))
    owner = np.full(shape[0] * shape[1], -1, dtype=np.int64)
    corners = screen[faces]
    low = np.floor(corners.min(axis=1)).astype(np.int64)
    span = (np.ceil(corners.max(axis=1)).astype(np.int64) - low).max(axis=1) + 1
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
    order = np.argsort(span, kind="stable")
    order = order[np.abs(area[order]) > 1e-9]
    for chunk in np.array_split(order, max(1, len(order) // 256)):
        if not len(chunk):
            continue
        grid = np.arange(span[chunk].max())
        x = low[chunk, 0, None, None] + grid[None, None, :]
        y = low[chunk, 1, None, None] + grid[None, :, None]
        px, py = x - corners[chunk, 0, 0, None, None], y - corners[chunk, 0, 1, None, None]
        u = (px * e2[chunk, 1, None, None] - py * e2[chunk, 0, None, None]) / area[chunk, None, None]
        v = (py * e1[chunk, 0, None, None] - px * e1[chunk, 1, None, None]) / area[chunk, None, None]
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (x >= 0) & (x < shape[1]) & (y >= 0) & (y < shape[0])
        index, _, _ = np.nonzero(hit)
        pixel = (y * shape[1] + x)[hit]
        bary = np.stack([1.0 - u[hit] - v[hit], u[hit], v[hit]], axis=1)
        z = np.einsum("pk,pk->p", bary, towards[faces[chunk[index]]])
        # Of several triangles at one pixel the last assignment wins: the nearest must come last.
        near = np.argsort(z, kind="stable")
        near = near[z[near] > depth[pixel[near]]]
        depth[pixel[near]], weight[pixel[near]], owner[pixel[near]] = z[near], bary[near], chunk[index[near]]
    return depth.reshape(shape), weight.reshape((*shape, 3)), owner.reshape(shape)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit("usage: python -m hhsim.hand_figure PICTURE, for example docs/hand.png")
    try:
        draw_hand(sys.argv[1])
    except (InputError, OutputError) as error:
        raise SystemExit(str(error)) from error
