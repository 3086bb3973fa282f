"""Shaded pictures of surfaces, pixel by pixel: orthographic view, nearest surface first, see-through layers.

matplotlib sorts triangles by their middles, which fails where bodies touch; here each pixel is decided by itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hhsim.kernels.sphere_rasterizer import nearest_spheres
from hhsim.render.triangle_soup import Surface

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LIGHT = np.array([-0.45, 0.55, 0.90])
"""Towards the key light, in the picture's frame (right, up, towards the viewer)."""

OVERSAMPLING = 2
"""A picture is drawn this much larger and averaged."""


TESTS = 1_000_000
"""Most tests of a pixel against a triangle that are held in memory at once, but for one triangle."""


@dataclass(frozen=True)
class Camera:
    """An orthographic view.

    Attributes:
        rotation: Rows right, up and towards the viewer, shape (3, 3), world.
        center: What the picture's middle shows [m], shape (3,), world.
        height: Of what the picture shows [m].
        shape: Rows and columns of the finished picture [pixels].
    """

    rotation: FloatArray
    center: FloatArray
    height: float
    shape: tuple[int, int]


@dataclass(frozen=True)
class Layer:
    """A surface as the camera sees it, at `OVERSAMPLING` times the pixels of the picture.

    Attributes:
        color: Shape (rows, columns, 3).
        depth: Towards the viewer [m], shape (rows, columns); minus infinity where nothing is.
        facing: Cosine between the surface's normal and the direction to the viewer, shape (rows, columns).
    """

    color: FloatArray
    depth: FloatArray
    facing: FloatArray

    def seen(self) -> NDArray[np.bool_]:
        """Where the surface is, shape (rows, columns)."""
        return np.isfinite(self.depth)


def look_from(towards: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> FloatArray:
    """A camera's rotation for a viewer in the direction `towards`, with `up` upright in the picture."""
    to_viewer = np.array(towards, dtype=np.float64)
    to_viewer /= np.linalg.norm(to_viewer)
    right = np.cross(np.asarray(up, dtype=np.float64), to_viewer)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(to_viewer, right), to_viewer])


def frame(points: FloatArray, rotation: FloatArray, shape: tuple[int, int], margin: float = 0.04) -> Camera:
    """The camera that shows all points [m], with `margin` of the picture left free on each side."""
    seen = points @ rotation.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    rows, columns = shape
    height = max(high[1] - low[1], (high[0] - low[0]) * rows / columns) / (1.0 - 2.0 * margin)
    return Camera(rotation, 0.5 * (low + high) @ rotation, float(height), shape)


def shade(surface: Surface, camera: Camera) -> Layer:
    """Light a surface."""
    rows, columns = OVERSAMPLING * camera.shape[0], OVERSAMPLING * camera.shape[1]
    scale = rows / camera.height
    points = (surface.points - camera.center) @ camera.rotation.T
    screen = np.stack([points[:, 0] * scale + 0.5 * columns, 0.5 * rows - points[:, 1] * scale], axis=1)
    faces = surface.faces[((surface.normals @ camera.rotation[2])[surface.faces] > 0.0).any(axis=1)]
    depth, weight, face = rasterise(screen, points[:, 2], faces, (rows, columns))
    seen = face >= 0
    corner, weight = faces[face[seen]], weight[seen]
    normals = np.einsum("pk,pki->pi", weight, surface.normals[corner]) @ camera.rotation.T
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return lit(depth, normals, np.einsum("pk,pki->pi", weight, surface.colors[corner]), camera)


def see_spheres(center: ArrayLike, radius: ArrayLike, camera: Camera) -> tuple[FloatArray, FloatArray, IntArray]:
    """Spheres as a camera sees them, exact at every pixel.

    Args:
        center: [m], shape (n, 3), world.
        radius: [m], shape (n,).
        camera: That sees them.

    Returns:
        Depth and normals as `lit` takes them, and whose surface it is at the pixels where one is, shape (pixels,).
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


def lit(depth: FloatArray, normals: FloatArray, color: FloatArray, camera: Camera) -> Layer:
    """Light what a camera sees.

    Args:
        depth: Towards the viewer [m], minus infinity where nothing is, shape (rows, columns).
        normals: Unit normals of the n pixels where something is, right, up and towards the viewer, shape (n, 3).
        color: Of these pixels, shape (n, 3).
        camera: That sees it.
    """
    rows, columns = depth.shape
    scale, seen = rows / camera.height, np.isfinite(depth)
    light = LIGHT / np.linalg.norm(LIGHT)
    half = light + np.array([0.0, 0.0, 1.0])
    diffuse = np.clip((normals @ light + 0.25) / 1.25, 0.0, None)
    shine = np.clip(normals @ (half / np.linalg.norm(half)), 0.0, None) ** 30
    # What lies behind its surroundings gets less light: depth against its blur stands in for ambient occlusion.
    far = np.where(seen, depth, depth[seen].min(initial=0.0))
    blur = _blurred(far, 0.006 * scale)
    shadow = np.clip(1.0 - np.clip(blur - far, 0.0, None)[seen] / 0.012, 0.45, 1.0)
    ambient = 0.36 + 0.10 * normals[:, 1]
    color = color * ((ambient + 0.66 * diffuse) * shadow)[:, None] + 0.10 * shine[:, None]
    # Skin lets red through where it turns away from the light.
    color[:, 0] += 0.05 * (1.0 - diffuse)
    picture, facing = np.zeros((rows, columns, 3)), np.zeros((rows, columns))
    picture[seen], facing[seen] = np.clip(color, 0.0, 1.0), normals[:, 2]
    return Layer(picture, depth, facing)


def _blurred(values: FloatArray, width: float) -> FloatArray:
    """Smoothed by a Gaussian of so many pixels; a wide one is taken of a coarser grid, where it costs little."""
    from scipy.ndimage import gaussian_filter, zoom

    step = max(1, int(width / 4.0))
    if step == 1:
        return np.asarray(gaussian_filter(values, width))
    rows, columns = values.shape
    padded = np.pad(values, ((0, -rows % step), (0, -columns % step)), mode="edge")
    coarse = padded.reshape(padded.shape[0] // step, step, -1, step).mean(axis=(1, 3))
    smooth = gaussian_filter(coarse, width / step)
    return np.asarray(zoom(smooth, step, order=1, grid_mode=True, mode="nearest"))[:rows, :columns]


def blend(layers: Sequence[tuple[Layer, FloatArray | float]]) -> FloatArray:
    """Put layers over white, the nearest on top at each pixel.

    Args:
        layers: Each with its opacity, one number or shape (rows, columns).

    Returns:
        The picture, shape (rows, columns, 3), 0 to 1.
    """
    picture = composed(layers)
    rows, columns = picture.shape[0] // OVERSAMPLING, picture.shape[1] // OVERSAMPLING
    return np.asarray(picture.reshape(rows, OVERSAMPLING, columns, OVERSAMPLING, 3).mean(axis=(1, 3)))


def composed(layers: Sequence[tuple[Layer, FloatArray | float]]) -> FloatArray:
    """The same as `blend` at the pixels of the layers, before they are averaged."""
    depth = np.stack([layer.depth for layer, _ in layers])
    opacity = np.stack([np.where(layer.seen(), alpha, 0.0) for layer, alpha in layers])
    color = np.stack([layer.color for layer, _ in layers])
    picture = np.ones_like(color[0])
    for rank in np.argsort(depth, axis=0, kind="stable"):
        alpha = np.take_along_axis(opacity, rank[None], axis=0)[0][:, :, None]
        picture += alpha * (np.take_along_axis(color, rank[None, :, :, None], axis=0)[0] - picture)
    return np.asarray(picture)


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
    done = 0
    while done < len(order):
        # Triangles of about one size are tested together, each against the square of the largest one.
        count = np.count_nonzero(np.arange(1, 257)[: len(order) - done] * span[order[done : done + 256]] ** 2 <= TESTS)
        chunk = order[done : done + max(int(count), 1)]
        done += len(chunk)
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
