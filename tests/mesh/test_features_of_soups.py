"""The distance that a tick goes by is that to every triangle, however badly the triangles are put together.

The distances that it is held against are found by search, without code of the kernels.
"""

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest
from contact_scenes import moved
from mesh_oracle import Cones, by_arctangents, least_of_features
from sampled import sampled
from scipy.spatial.transform import Rotation
from sphere_scenes import palm_spheres, set_pose

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.detection import COUNT_GATHERS, evaluate
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, PALM_BODY
from hhsim.kernels.mesh.features import MeshFeatures
from hhsim.mesh.features import mesh_features
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.topology import merged_vertices
from hhsim.solver.surface import SURFACES
from hhsim.solver.workspace import tick_state
from hhsim.trees.contact_surface import encloses

NEEDLE = 1e-9
"""Height of a triangle, as a share of its longest side, up to which it is no more than its sides: the direction of its
normal is rounding."""
SAMPLES, SECTIONS = 9, 60
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)

BOX = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]) - 0.5
BOX_FACES = np.array(
    [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4]]
    + [[1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7]]
)


def unit(random: np.random.Generator, count: int | None = None) -> FloatArray:
    """A random direction, or so many."""
    vector = random.normal(size=3 if count is None else (count, 3))
    return np.asarray(vector / np.linalg.norm(vector, axis=-1, keepdims=True))


def _loose(random: np.random.Generator) -> FloatArray:
    count = random.integers(2, 12)
    size = 10.0 ** random.uniform(-3.0, -1.5)
    return np.asarray(random.normal(0.0, 0.02, (count, 1, 3)) + random.normal(0.0, size, (count, 3, 3)))


def _turned_over(random: np.random.Generator, triangles: FloatArray) -> FloatArray:
    flip = random.random(len(triangles)) < 0.5
    return np.where(flip[:, None, None], triangles[:, ::-1], triangles)


def _coincident(random: np.random.Generator) -> FloatArray:
    base = _loose(random)
    extra = _turned_over(random, base[random.integers(0, len(base), random.integers(1, len(base) + 1))])
    return np.concatenate([base, [np.roll(triangle, random.integers(3), axis=0) for triangle in extra]])


def _nearly_coincident(random: np.random.Generator) -> FloatArray:
    base = _loose(random)
    extra = base[random.integers(0, len(base), random.integers(1, len(base) + 1))]
    away = (
        unit(random, len(extra))[:, None] if random.random() < 0.5 else unit(random, 3 * len(extra)).reshape(-1, 3, 3)
    )
    return np.concatenate([base, _turned_over(random, extra + 10.0 ** random.uniform(-9.0, -4.0) * away)])


def _folded(random: np.random.Generator) -> FloatArray:
    triangles = []
    for a, b, c in _loose(random):
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        other = (
            c if random.random() < 0.5 else a + random.uniform(0.1, 1.5) * (c - a) + random.uniform(0, 0.5) * (b - a)
        )
        rise = np.linalg.norm(c - a) * 10.0 ** random.uniform(-12.0, -1.0)
        triangles += [[a, b, c], [b, a, other + rise * normal]]
    return np.array(triangles)


def _t_junctions(random: np.random.Generator) -> FloatArray:
    triangles = []
    for a, b, c in _loose(random):
        middle = a + random.uniform(0.1, 0.9) * (b - a)
        if random.random() < 0.3:
            middle = middle + unit(random) * 10.0 ** random.uniform(-12.0, -5.0)
        across = a + b - c + unit(random) * 10.0 ** random.uniform(-12.0, -2.0)
        apex = across if random.random() < 0.7 else a + 0.02 * unit(random)
        triangles += [[a, b, c], [middle, a, apex], [b, middle, apex]]
        if random.random() < 0.4:
            triangles.append([a, middle, b])
    return np.array(triangles)


def _books(random: np.random.Generator) -> FloatArray:
    # Edges of three to eight triangles.
    triangles = []
    for _ in range(random.integers(1, 4)):
        a, b = random.normal(0.0, 0.02, (2, 3))
        for _ in range(random.integers(3, 9)):
            page = random.normal(0.0, 0.02, 3)
            triangles.append([a, b, page] if random.random() < 0.5 else [b, a, page])
    return np.array(triangles)


def _coplanar(random: np.random.Generator) -> FloatArray:
    count = random.integers(2, 12)
    flat = random.normal(0.0, 0.02, (count, 1, 2)) + random.normal(0.0, 0.02, (count, 3, 2))
    if random.random() < 0.5:
        flat = np.round(flat, int(random.integers(2, 9)))
    return np.concatenate([flat, np.zeros((count, 3, 1))], axis=2)


def _slivers(random: np.random.Generator) -> FloatArray:
    triangles = []
    for a, b, _ in _loose(random):
        off = 10.0 ** random.uniform(-17.0, -4.0) if random.random() < 0.8 else 0.0
        c = a + random.uniform(-0.2, 1.2) * (b - a) + off * unit(random)
        triangles.append([a, b, c])
        if random.random() < 0.5:
            beside = a + random.uniform(0.0, 1.0) * (b - a) + unit(random) * 10.0 ** random.uniform(-5.0, -2.0)
            triangles.append([b, a, beside])
        if random.random() < 0.5:
            triangles.append([c, a, a + 0.01 * unit(random)])
        if random.random() < 0.1:
            triangles.append([a, a, b])
    return np.array(triangles)


def _box(random: np.random.Generator, size: float | None = None) -> FloatArray:
    return np.asarray((BOX * (random.uniform(0.005, 0.04, 3) if size is None else size))[BOX_FACES])


def _halved(triangles: FloatArray) -> FloatArray:
    a, b, c = triangles.transpose(1, 0, 2)
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    return np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])


def _bumpy(random: np.random.Generator) -> FloatArray:
    triangles = _box(random)
    for _ in range(random.integers(0, 3)):
        triangles = _halved(triangles)
    vertices, faces = indexed(triangles)
    return np.asarray((vertices + random.normal(size=vertices.shape) * 10.0 ** random.uniform(-9.0, -2.3))[faces])


def _shells(random: np.random.Generator) -> FloatArray:
    # In each other, through each other, inside out, or one nearly on the other.
    shells = []
    for _ in range(random.integers(2, 5)):
        shell = _bumpy(random) @ Rotation.random(rng=random).as_matrix().T
        if random.random() < 0.6:
            shell = shell + random.normal(0.0, 0.01, 3)
        shell = shell * random.choice([1.0, 0.5, 0.9])
        shells += [shell] if random.random() < 0.7 else [shell, shell * (1.0 + 10.0 ** random.uniform(-7.0, -2.0))]
    return np.concatenate([shell[:, ::-1] if random.random() < 0.4 else shell for shell in shells])


def _with_flaps(random: np.random.Generator) -> FloatArray:
    # A solid with pairs of triangles of no thickness, so that every edge is walked as often forth as back.
    body = _bumpy(random)
    triangles = [body]
    for _ in range(random.integers(1, 6)):
        a, b, c = body[random.integers(len(body))]
        middle, normal = (a + b + c) / 3.0, np.cross(b - a, c - a)
        tip = middle + random.uniform(-0.02, 0.02) * normal / np.linalg.norm(normal)
        tip = tip + random.uniform(0.0, 0.02) * unit(random)
        flaps = [[a, b, tip] if random.random() < 0.7 else [a, tip, middle + 0.02 * unit(random)]]
        if random.random() < 0.3:
            flaps.append([b, tip + 0.01 * unit(random), tip])
        for flap in np.array(flaps):
            triangles += [flap[None], np.roll(flap[::-1], random.integers(3), axis=0)[None]]
    return np.concatenate(triangles)


def _touching_boxes(random: np.random.Generator) -> FloatArray:
    # On a lattice: they share faces, edges, corners, or all of themselves; one may be inside out.
    size = random.uniform(0.01, 0.03)
    boxes = [_box(random, size) + size * random.integers(-1, 2, 3) for _ in range(random.integers(2, 7))]
    if random.random() < 0.4:
        boxes[-1] = boxes[-1][:, ::-1]
    return np.concatenate(boxes)


SOUPS: dict[str, Callable[[np.random.Generator], FloatArray]] = {
    "loose": _loose,
    "coincident": _coincident,
    "nearly coincident": _nearly_coincident,
    "folded": _folded,
    "T-junctions": _t_junctions,
    "edges of many": _books,
    "coplanar": _coplanar,
    "slivers": _slivers,
    "closed": _bumpy,
    "shells": _shells,
    "flaps": _with_flaps,
    "touching boxes": _touching_boxes,
}


def soup(kind: str, seed: int) -> tuple[FloatArray, np.random.Generator]:
    """Triangles of a kind, shape (F, 3, 3) [m], turned anyhow; and what more is drawn for them."""
    random = np.random.default_rng([seed, list(SOUPS).index(kind)])
    triangles = SOUPS[kind](random)
    return triangles @ Rotation.random(rng=random).as_matrix().T, random


def indexed(triangles: FloatArray) -> tuple[FloatArray, IntArray]:
    """The same as vertices and faces."""
    return merged_vertices(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))


def plane_normals(triangles: FloatArray) -> FloatArray:
    """Unit normals, shape (F, 3); 0 for those of no more than their sides."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    size = np.linalg.norm(normal, axis=1)
    square = ((triangles - np.roll(triangles, 1, axis=1)) ** 2).sum(axis=2).max(axis=1)
    return np.where((size > NEEDLE * square)[:, None], normal / np.where(size > 0.0, size, 1.0)[:, None], 0.0)


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _to_segment2(x: float, y: float, z: float, a: FloatArray, b: FloatArray) -> float:
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    dx, dy, dz = x - a[0], y - a[1], z - a[2]
    square = ux * ux + uy * uy + uz * uz
    share = min(1.0, max(0.0, (dx * ux + dy * uy + dz * uz) / square)) if square > 0.0 else 0.0
    return float((dx - share * ux) ** 2 + (dy - share * uy) ** 2 + (dz - share * uz) ** 2)


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _to_triangle(x: float, y: float, z: float, triangle: FloatArray, n: FloatArray) -> float:
    beside = np.inf
    inside = n[0] * n[0] + n[1] * n[1] + n[2] * n[2] > 0.5
    for k in range(3):
        a, b = triangle[k], triangle[(k + 1) % 3]
        beside = min(beside, _to_segment2(x, y, z, a, b))
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        inward = (n[1] * uz - n[2] * uy) * (x - a[0]) + (n[2] * ux - n[0] * uz) * (y - a[1])
        inside = inside and inward + (n[0] * uy - n[1] * ux) * (z - a[2]) > 0.0
    height = abs(n[0] * (x - triangle[0, 0]) + n[1] * (y - triangle[0, 1]) + n[2] * (z - triangle[0, 2]))
    return min(math.sqrt(beside), height) if inside else math.sqrt(beside)


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _beyond(s: float, ends: FloatArray, radius: FloatArray, triangle: FloatArray, normal: FloatArray) -> float:
    x = (1.0 - s) * ends[0, 0] + s * ends[1, 0]
    y = (1.0 - s) * ends[0, 1] + s * ends[1, 1]
    z = (1.0 - s) * ends[0, 2] + s * ends[1, 2]
    return float(_to_triangle(x, y, z, triangle, normal) - radius[0] - s * (radius[1] - radius[0]))


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def least_distance(ends: FloatArray, radius: FloatArray, triangles: FloatArray, normals: FloatArray) -> float:
    """Least distance [m] of a round cone, by its axis (2, 3) and radii (2,), to triangles; negative through one."""
    best = np.inf
    half = 0.5 * math.sqrt(((ends[1] - ends[0]) ** 2).sum()) + 0.5 * (radius[0] - radius[1])
    for i in range(len(triangles)):
        triangle, normal = triangles[i], normals[i]
        if _beyond(0.5, ends, radius, triangle, normal) - half > best:
            continue
        least, at = np.inf, 0
        for k in range(SAMPLES):
            value = _beyond(k / (SAMPLES - 1), ends, radius, triangle, normal)
            if value < least:
                least, at = value, k
        low, high = max(at - 1, 0) / (SAMPLES - 1), min(at + 1, SAMPLES - 1) / (SAMPLES - 1)
        first, second = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        left = _beyond(first, ends, radius, triangle, normal)
        right = _beyond(second, ends, radius, triangle, normal)
        for _ in range(SECTIONS):
            least = min(least, left, right)
            if left > right:
                low, first, left = first, second, right
                second = low + GOLDEN * (high - low)
                right = _beyond(second, ends, radius, triangle, normal)
            else:
                high, second, right = second, first, left
                first = high - GOLDEN * (high - low)
                left = _beyond(first, ends, radius, triangle, normal)
        best = min(best, least)
    return best


def touching_cone(
    random: np.random.Generator, triangles: FloatArray, normals: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """A round cone near triangles, from 0.1 µm to 10 mm off one of them: its ends (2, 3) and radii (2,) [m]."""
    i = random.integers(len(triangles))
    share = random.dirichlet([0.5, 0.5, 0.5])
    if random.random() < 0.5:
        # On a side, or at a corner.
        share[random.integers(3)] = 0.0
        share = np.roll([1.0, 0.0, 0.0], random.integers(3)) if random.random() < 0.4 else share / share.sum()
    large = random.uniform(2e-3, 0.012)
    length = 0.0 if random.random() < 0.15 else random.uniform(2e-3, 0.05)
    small = max(1e-4, large - random.choice([0.0, 0.1, 0.5, 0.9]) * min(large, length))
    away = unit(random) if random.random() < 0.7 or not normals[i].any() else normals[i] * random.choice([-1.0, 1.0])
    place = share @ triangles[i] + away * (large + 10.0 ** random.uniform(-7.0, -2.0))
    along = unit(random)
    if random.random() < 0.5:
        along = np.cross(away, along) / np.linalg.norm(np.cross(away, along))
    start = place - random.uniform() * length * along
    return np.array([start, start + length * along]), np.array([large, small])


SAME = 2e-10
"""Two distances of one body [m]: a triangle lower than a billionth of its length is a line in one of them."""
POSES = 10
HAND = HandModel.default("right")
ARRAYS = HAND.arrays()
MARGIN, SKIN = 1e-3, 3e-3


def features_of(triangles: FloatArray) -> tuple[MeshFeatures, bool]:
    vertices, faces = indexed(triangles)
    closed = encloses(Mesh(vertices, faces))
    return mesh_features(vertices, faces, closed=closed)[0], closed


def goes_around(triangles: FloatArray, point: FloatArray) -> bool:
    return bool(by_arctangents(triangles, point[None])[0] > 0.5)


@pytest.mark.parametrize(
    ("kind", "first"), sampled([(kind, first) for first in range(0, 1680, 40) for kind in SOUPS], lambda i, _: i < 12)
)
def test_the_least_over_features_is_the_least_over_triangles(kind: str, first: int) -> None:
    judged = 0
    for seed in range(first, first + 40):
        triangles, random = soup(kind, seed)
        normals = plane_normals(triangles)
        mesh, closed = features_of(triangles)
        for _ in range(POSES):
            ends, radius = touching_cone(random, triangles, normals)
            if closed and goes_around(triangles, ends[0]):
                continue
            distance = least_distance(ends, radius, triangles, normals)
            if distance > 0.0:
                assert least_of_features(mesh, Cones(*ends[:, None], *radius[:, None]).kernel(0)) == pytest.approx(
                    distance, abs=SAME
                ), seed
                judged += 1
    assert judged > POSES


def bodies(at: HandConfiguration) -> list[tuple[FloatArray, FloatArray]]:
    """Ends and radii of the phalanges, then of the palm's spheres."""
    joints = HAND.joints(*at.at(0))
    palm = palm_spheres(HAND.palm_tree.leaf_center, at.position[:1], at.orientation[:1])[0]
    phalanges = [(joints[f, k : k + 2], HAND.radius[f, k : k + 2]) for f in range(5) for k in range(3)]
    spheres = [(np.stack([p, p]), np.array([r, r])) for p, r in zip(palm, HAND.palm_tree.leaf_radius)]
    return phalanges + spheres


def distances(at: HandConfiguration, triangles: FloatArray, normals: FloatArray) -> FloatArray:
    """Of each phalanx and of the palm [m], shape (16,)."""
    each = [least_distance(ends, radius, triangles, normals) for ends, radius in bodies(at)]
    return np.array([*each[:PALM_BODY], min(each[PALM_BODY:])])


@pytest.mark.parametrize(
    ("kind", "seed"), sampled([(kind, seed) for seed in range(20) for kind in SOUPS], lambda i, _: i < 12)
)
def test_lists_that_last_hold_the_nearest_triangle_of_every_body(kind: str, seed: int) -> None:
    triangles, random = soup(kind, seed)
    normals = plane_normals(triangles)
    mesh, closed = features_of(triangles)
    state: Any = tick_state(np.ones(DOF), surface=SURFACES["mesh"])[0]
    orientation = Rotation.random(1, rng=random).as_quat(scalar_first=True)
    at = HandConfiguration(
        np.zeros((1, 3)),
        orientation,
        random.uniform(HAND.flexion_min, HAND.flexion_max, (1, 5, 3)),
        random.uniform(HAND.abduction_min, HAND.abduction_max, (1, 5)),
    )

    def is_outside(motion: HandConfiguration, clearance: float) -> bool:
        around = closed and goes_around(triangles, motion.position[0])
        return bool(not around and distances(motion, triangles, normals).min() > clearance)

    near = False
    while not near:
        # A body on a triangle; from there away until it is a millimetre off.
        ends, _ = bodies(at)[random.integers(PALM_BODY + 5)]
        start, way = triangles[random.integers(len(triangles))].mean(axis=0) - ends[0], unit(random)
        low, high = 0.0, 0.4
        for _ in range(12):
            middle = 0.5 * (low + high)
            away = is_outside(at._replace(position=(start + middle * way)[None]), 1e-3)
            low, high = (low, middle) if away else (middle, high)
        placed = at._replace(position=(start + high * way)[None])
        near = is_outside(placed, 0.0) and distances(placed, triangles, normals).min() < 2e-3
    at = placed
    judged = taken = 0
    for _ in range(30):
        size = 10.0 ** random.uniform(-5.0, -2.5)
        step = random.normal(size=DOF) * size
        step[3:] *= 4.0
        target = moved(at, step, 4.0 * size * random.normal(size=5))
        expected = distances(target, triangles, normals)
        # Beyond the lists there is nothing to judge.
        if not is_outside(target, 0.0) or expected.min() > MARGIN + SKIN:
            continue
        at = target
        set_pose(HAND, state.pose, at)
        assert evaluate(ARRAYS, state.pose, mesh, MARGIN, MARGIN, SKIN, state.candidates, state.work) == 0
        nearest, slack = np.array(state.candidates.nearest), np.array(state.candidates.slack)
        assert (slack >= MARGIN).all()
        assert (nearest >= expected - SAME).all()
        listed = expected < slack - SAME
        np.testing.assert_allclose(nearest[listed], expected[listed], rtol=0.0, atol=SAME)
        judged += int(listed.any())
        taken += 1
    assert judged > 0
    assert state.work[COUNT_GATHERS] < 0.9 * taken * BODY_COUNT, "the lists never last"
