"""Shaded pictures of surfaces: orthographic view, nearest surface first, transparent layers.

matplotlib sorts triangles by their middles, which fails where bodies touch; here each pixel is decided alone.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.kernels.sphere_rasterizer import nearest_spheres
from hhsim.render.triangle_soup import Surface, count_up

Image = NDArray[np.floating[Any]]

LIGHT = np.array([-0.45, 0.55, 0.90])
"""Direction to the key light, in the picture's frame (right, up, towards the viewer)."""

OVERSAMPLING = 2
"""Factor by which a picture is drawn larger and then averaged."""

PIXELS = 1_000_000
"""Most pixels of triangles that are held in memory at once, but for one row of them."""
EDGE = 1e-9
"""Tolerance [pixels] within which a pixel's middle on an edge belongs to both triangles."""


@dataclass(frozen=True)
class Camera:
    """An orthographic view."""

    rotation: FloatArray  # rows right, up and towards the viewer, shape (3, 3), world
    center: FloatArray  # world point in the picture's middle [m], shape (3,)
    height: float  # height of the view [m]
    shape: tuple[int, int]  # rows and columns of the finished picture [pixels]


@dataclass(frozen=True)
class Layer:
    """A surface as the camera sees it, at `OVERSAMPLING` times the pixels of the picture."""

    color: Image  # shape (rows, columns, 3)
    depth: FloatArray  # towards the viewer [m], minus infinity without a surface, shape (rows, columns)
    facing: Image  # cosine between the surface's normal and the direction to the viewer, shape (rows, columns)

    def seen(self) -> BoolArray:
        """Return where the surface is, shape (rows, columns)."""
        return np.isfinite(self.depth)


def frame(points: FloatArray, rotation: FloatArray, shape: tuple[int, int], margin: float = 0.04) -> Camera:
    """Return the camera that shows all points [m], with `margin` of the picture left free on each side."""
    seen = points @ rotation.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    rows, columns = shape
    height = max(high[1] - low[1], (high[0] - low[0]) * rows / columns) / (1.0 - 2.0 * margin)
    return Camera(rotation, 0.5 * (low + high) @ rotation, float(height), shape)


def shade(
    surface: Surface, camera: Camera, marked: Callable[[FloatArray], BoolArray] | None = None, mark: ArrayLike = 0.0
) -> Layer:
    """Render and light a surface; pixels that `marked` says of their depth, as in a `Layer`, have the colour `mark`."""
    depth, normals, corners, weight = rendered(surface, camera)
    normal = _interpolated(normals, corners, weight)
    normal /= np.maximum(np.sqrt(np.einsum("ip,ip->p", normal, normal)), 1e-12)
    color = _interpolated(np.ascontiguousarray(surface.colors.T.astype(np.float32)), corners, weight).T
    if marked is not None:
        color[marked(depth)[np.isfinite(depth)]] = mark
    return lit(depth, normal.T, color, camera)


def rendered(surface: Surface, camera: Camera) -> tuple[FloatArray, Image, list[IntArray], FloatArray]:
    """Return the depth, the normals of all vertices, and vertices and weights of each pixel that shows a triangle."""
    # Single precision and one component after another: what is done at every pixel is most of the work.
    normals = np.ascontiguousarray((camera.rotation @ surface.normals.T).astype(np.float32))
    faces = surface.faces[(normals[2] > 0.0)[surface.faces].any(axis=1)]
    rows, columns = OVERSAMPLING * camera.shape[0], OVERSAMPLING * camera.shape[1]
    scale = rows / camera.height
    points = (surface.points - camera.center) @ camera.rotation.T
    screen = np.stack([points[:, 0] * scale + 0.5 * columns, 0.5 * rows - points[:, 1] * scale], axis=1)
    depth, weight, face = rasterise(screen, points[:, 2], faces, (rows, columns))
    there = face[face >= 0]
    return depth, normals, [faces[:, k][there] for k in range(3)], weight


def _interpolated(values: Image, corners: Sequence[IntArray], weight: FloatArray) -> Image:
    """Interpolate values of vertices, shape (3, vertices), at pixels: shape (3, pixels)."""
    if (values == values[:, :1]).all():
        return np.repeat(values[:, :1], weight.shape[1], axis=1)
    share = weight.astype(np.float32)
    return np.stack([sum(share[k] * row[corners[k]] for k in range(3)) for row in values])


def see_spheres(center: ArrayLike, radius: ArrayLike, camera: Camera) -> tuple[FloatArray, FloatArray, IntArray]:
    """Render spheres [m], shapes (n, 3), (n,), world, exact at every pixel.

    Returns depth and normals as `lit` takes them, and the sphere at each pixel of one, shape (pixels,).
    """
    rows, columns = OVERSAMPLING * camera.shape[0], OVERSAMPLING * camera.shape[1]
    scale = rows / camera.height
    seen = (np.asarray(center, np.float64) - camera.center) @ camera.rotation.T
    screen = np.column_stack([seen[:, 0] * scale + 0.5 * columns, 0.5 * rows - seen[:, 1] * scale, seen[:, 2] * scale])
    depth, owner = np.empty((rows, columns)), np.empty((rows, columns), np.int64)
    nearest_spheres(screen, np.asarray(radius, np.float64) * scale, depth, owner)
    row, column = np.nonzero(owner >= 0)
    there = owner[row, column]
    normals = np.column_stack([column, row, depth[row, column]]) - screen[there]
    normals[:, 1] *= -1.0
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return depth / scale, normals, there


def lit(depth: FloatArray, normals: Image, color: Image, camera: Camera) -> Layer:
    """Light rendered pixels of `depth` as in a `Layer`.

    The n pixels of the surface have unit normals, right, up and towards the viewer, and colours, shapes (n, 3).
    """
    from scipy.ndimage import uniform_filter

    rows, columns = depth.shape
    scale, pixel = rows / camera.height, np.flatnonzero(np.isfinite(depth))
    there = depth.ravel()[pixel]
    light = LIGHT / np.linalg.norm(LIGHT)
    half = light + np.array([0.0, 0.0, 1.0])
    kind = normals.dtype
    diffuse = np.clip((normals @ light.astype(kind) + 0.25) / 1.25, 0.0, None)
    shine = np.clip(normals @ (half / np.linalg.norm(half)).astype(kind), 0.0, None) ** 30
    # What lies behind its surroundings gets less light: depth against its blur stands in for ambient occlusion.
    # Two boxes have a standard deviation of 6 mm together; no surface is the least depth.
    solid = np.where(np.isfinite(depth), depth, there.min() if len(there) else 0.0)
    side = min(round(math.sqrt(6.0 * (0.006 * scale) ** 2 + 1.0)), max(depth.shape))
    blurred = np.asarray(uniform_filter(uniform_filter(solid, side, mode="nearest"), side, mode="nearest"))
    hollow = blurred.ravel()[pixel] - there
    shadow = np.clip(1.0 - np.clip(hollow, 0.0, None) / 0.012, 0.45, 1.0).astype(kind)
    strength, gloss = (0.36 + 0.10 * normals[:, 1] + 0.66 * diffuse) * shadow, 0.10 * shine
    picture, facing = np.zeros((3, rows * columns), np.float32), np.zeros(rows * columns, np.float32)
    for channel in range(3):
        # Skin lets red through where it turns away from the light.
        glow = 0.05 * (1.0 - diffuse) if channel == 0 else 0.0
        picture[channel, pixel] = np.clip(color[:, channel] * strength + gloss + glow, 0.0, 1.0)
    facing[pixel] = normals[:, 2]
    return Layer(np.moveaxis(picture.reshape(3, rows, columns), 0, 2), depth, facing.reshape(rows, columns))


def blend(layers: Sequence[tuple[Layer, FloatArray | float]]) -> FloatArray:
    """Put layers, each with its opacity, over white, the nearest on top: shape (rows, columns, 3), 0 to 1."""
    picture = composed(layers)
    parts = [picture[i::OVERSAMPLING, j::OVERSAMPLING] for i in range(OVERSAMPLING) for j in range(OVERSAMPLING)]
    return np.asarray(sum(parts[1:], parts[0]) / len(parts))


def composed(layers: Sequence[tuple[Layer, FloatArray | float]]) -> FloatArray:
    """Return the pixels that `blend` averages."""
    seen = np.logical_or.reduce([layer.seen() for layer, _ in layers])
    pixel = np.flatnonzero(seen)
    depth = np.stack([layer.depth.ravel()[pixel] for layer, _ in layers])
    opacity = np.stack([np.broadcast_to(alpha, seen.shape).ravel()[pixel] for _, alpha in layers])
    opacity[np.isneginf(depth)] = 0.0
    order = np.argsort(depth, axis=0, kind="stable")
    flat = order * len(pixel) + np.arange(len(pixel))
    opacity = opacity.ravel()[flat]
    picture = np.ones((3, seen.size))
    for channel in range(3):
        color = np.concatenate([layer.color[:, :, channel].ravel()[pixel] for layer, _ in layers])[flat]
        mixed = np.ones(len(pixel))
        for alpha, over in zip(opacity, color):
            mixed += alpha * (over - mixed)
        picture[channel, pixel] = mixed
    return np.moveaxis(picture.reshape(3, *seen.shape), 0, 2)


def rasterise(
    screen: FloatArray, towards: FloatArray, faces: IntArray, shape: tuple[int, int]
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Find the nearest triangle at each pixel of a picture of `shape` rows and columns.

    `screen` has column and row of each vertex [pixels], shape (n, 2), `towards` its coordinate towards the viewer [m].
    Returns that coordinate, shape (rows, columns); barycentric weights of the pixels of triangles, shape (3, pixels);
    and the triangle or -1, shape (rows, columns).
    """
    rows, columns = shape
    depth, owner = np.full(rows * columns, -np.inf), np.full(rows * columns, -1, dtype=np.int64)
    weights = _weights(screen[faces])
    face, line, left, length = _spans(screen[faces], weights, shape)
    # Towards the viewer along a row of pixels, as along any line in a triangle, goes evenly.
    z = towards[faces]
    slope = np.einsum("mk,mk->m", weights[:, :, 0], z)[face]
    start = np.einsum("mk,mk->m", weights[:, :, 2], z)[face]
    start += np.einsum("mk,mk->m", weights[:, :, 1], z)[face] * line
    ends = np.cumsum(length)
    done = 0
    while done < len(ends):
        before = ends[done - 1] if done else 0
        part = slice(done, max(done + 1, int(np.searchsorted(ends, before + PIXELS, side="right"))))
        done = part.stop
        span = np.repeat(np.arange(part.start, part.stop), length[part])
        column = left[span] + count_up(length[part])
        pixel = line[span] * columns + column
        value = start[span] + slope[span] * column
        np.maximum.at(depth, pixel, value)
        nearest = value == depth[pixel]
        owner[pixel[nearest]] = face[span[nearest]]
    seen = np.flatnonzero(owner >= 0)
    row, column = np.divmod(seen, columns)
    parts = weights.reshape(-1, 9).T[:, owner[seen]].reshape(3, 3, -1)
    weight = parts[:, 0] * column + parts[:, 1] * row + parts[:, 2]
    return depth.reshape(shape), weight, owner.reshape(shape)


def _weights(corners: FloatArray) -> FloatArray:
    """Return barycentric weights over column, row and 1 of a pixel, shape (m, 3, 3); all 0 if seen edge on."""
    first, second = corners[:, [1, 2, 0]], corners[:, [2, 0, 1]]
    edge = second - first
    area = edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0]
    constant = first[:, :, 0] * edge[:, :, 1] - first[:, :, 1] * edge[:, :, 0]
    weights = np.stack([-edge[:, :, 1], edge[:, :, 0], constant], axis=2)
    seen = np.abs(area) > 1e-9
    return weights * np.divide(1.0, area, out=np.zeros_like(area), where=seen)[:, None, None]


def _spans(corners: FloatArray, weights: FloatArray, shape: tuple[int, int]) -> tuple[IntArray, ...]:
    """Return the rows of pixels whose middles lie in triangles: triangle, row, first column and length, shapes (s,).

    `corners` are in pixels, shape (m, 3, 2), `weights` as from `_weights`.
    """
    rows, columns = shape
    low = np.clip(np.ceil(corners[:, :, 1].min(axis=1) - EDGE), 0, rows).astype(np.int64)
    high = np.clip(np.floor(corners[:, :, 1].max(axis=1) + EDGE), -1, rows - 1).astype(np.int64)
    count = np.where(weights.any(axis=(1, 2)), np.maximum(high - low + 1, 0), 0)
    face = np.repeat(np.arange(len(corners)), count)
    row = low[face] + count_up(count)
    left, right = np.zeros(len(face)), np.full(len(face), columns - 1.0)
    for k in range(3):
        slope, there = weights[face, k, 0], weights[face, k, 1] * row + weights[face, k, 2]
        # A weight that does not change along the row is not negative between the highest and the lowest corner.
        end = np.divide(-there, slope, out=np.full(len(face), np.nan), where=slope != 0.0)
        left = np.fmax(left, np.where(slope > 0.0, end, np.nan))
        right = np.fmin(right, np.where(slope < 0.0, end, np.nan))
    column = np.ceil(left - EDGE).astype(np.int64)
    length = np.floor(right + EDGE).astype(np.int64) - column + 1
    some = length > 0
    return face[some], row[some], column[some], length[some]
