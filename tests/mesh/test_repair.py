"""Repairs and what they rest on: edges, parts, loops and windings; what is unsafe is refused with the reason."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.mesh.repair import MeshInRepair, closed_surface, winding_faults
from hhsim.mesh.topology import face_areas, hole_caps, in_fixed_order, is_closed, signed_volume
from tools.shapes.generators import sphere
from tools.shapes.surface_parts import band

BALL = sphere(0.08, subdivisions=2)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_fixed_order_does_not_depend_on_the_order_before(seed: int) -> None:
    generator = np.random.default_rng(seed)
    vertex_order = generator.permutation(len(BALL.vertices))
    rank = np.argsort(vertex_order)
    turns = generator.integers(0, 3, len(BALL.faces))[:, None]
    faces = np.take_along_axis(rank[BALL.faces], (turns + np.arange(3)) % 3, axis=1)
    vertices, faces = in_fixed_order(BALL.vertices[vertex_order], faces[generator.permutation(len(faces))])
    np.testing.assert_array_equal(vertices, BALL.vertices)
    np.testing.assert_array_equal(faces, BALL.faces)


def tube(outline: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """An open upright tube of height 1 over a counter-clockwise outline, shape (n, 2)."""
    count = len(outline)
    rings = [np.column_stack([outline, np.full(count, height)]) for height in (0.0, 1.0)]
    return np.concatenate(rings), band(np.arange(count), np.arange(count, 2 * count))


def polygon_area(outline: FloatArray) -> float:
    x, y = outline.T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2.0)


SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
HORSESHOE = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [2.0, 3.0], [2.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]])


@pytest.mark.parametrize(("outline", "centers"), [(SQUARE, 2), (HORSESHOE, 0), (SQUARE[:3], 0)])
def test_caps_close_the_tube_with_the_area_of_its_outline(outline: FloatArray, centers: int) -> None:
    vertices, faces = tube(outline)
    caps = hole_caps(vertices, faces)
    assert len(caps.width) == 2
    assert len(caps.vertices) - len(vertices) == centers
    assert is_closed(np.concatenate([faces, caps.faces]))
    # Flat caps that fold nowhere have exactly the outline's area.
    assert face_areas(caps.vertices, caps.faces).sum() == pytest.approx(2.0 * polygon_area(outline))
    np.testing.assert_allclose(caps.bend, 0.0, atol=1e-12)


def repaired(vertices: FloatArray, faces: IntArray) -> MeshInRepair:
    """Repair, and hold what comes out against what a closed surface is."""
    surface = closed_surface(vertices, faces, "test")
    assert is_closed(surface.faces)
    assert signed_volume(surface.vertices, surface.faces) > 0.0
    assert len(np.unique(surface.faces)) == len(surface.vertices)
    assert winding_faults(surface.vertices, surface.faces)[0] == 0
    return surface


def volume(surface: MeshInRepair) -> float:
    return signed_volume(surface.vertices, surface.faces)


def second_ball(shift: float, inward: bool = False, scale: float = 1.0) -> tuple[FloatArray, IntArray]:
    faces = BALL.faces[:, ::-1] if inward else BALL.faces
    moved = BALL.vertices * scale + np.array([shift, 0.0, 0.0])
    return np.concatenate([BALL.vertices, moved]), np.concatenate([BALL.faces, faces + len(BALL.vertices)])


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), part=st.floats(0.01, 0.5))
def test_any_mixture_of_windings_is_set_right(seed: int, part: float) -> None:
    turned = np.random.default_rng(seed).random(len(BALL.faces)) < part
    faces = BALL.faces.copy()
    faces[turned] = faces[turned][:, ::-1]
    surface = repaired(BALL.vertices, faces)
    assert volume(surface) == pytest.approx(BALL.volume)
    minority = min(int(turned.sum()), len(faces) - int(turned.sum()))
    named = [sentence for sentence in surface.repairs if "against the neighbours" in sentence]
    triangles = "1 triangle" if minority == 1 else f"{minority} triangles"
    assert named == ([f"turned {triangles} wound against the neighbours"] if minority else [])


SOUP, LOOSE = BALL.triangles.reshape(-1, 3), np.arange(960).reshape(-1, 3)
NOISE = np.random.default_rng(0).uniform(-1e-8, 1e-8, size=SOUP.shape)
BESIDE = np.concatenate([BALL.vertices, [[0.1, 0.0, 0.0], [0.12, 0.0, 0.0], [0.1, 0.02, 0.0]]])
SHEET = np.array([[0, 1, 2], [0, 2, 1]]) + len(BALL.vertices)
AGAIN = np.concatenate([BALL.faces[:5], [[3, 3, 7], [1, 2, 1]]])


@pytest.mark.parametrize(
    ("vertices", "faces", "repairs"),
    [
        (SOUP, LOOSE, ["merged 960 vertices into 162: equal places, or used by no triangle"]),
        (SOUP + NOISE, LOOSE, ["merged 798 vertices closer than 0.0008 mm to another"]),
        (BALL.vertices, BALL.faces[:, ::-1], ["wound inside out: turned"]),
        (BALL.vertices, np.concatenate([BALL.faces, BALL.faces[:, ::-1]]), ["removed 320 duplicate triangles"]),
        (BESIDE, np.concatenate([BALL.faces, SHEET]), ["removed 2 duplicate triangles"]),
        (
            BALL.vertices,
            np.concatenate([BALL.faces, AGAIN]),
            ["removed 2 degenerate triangles", "removed 5 duplicate triangles"],
        ),
    ],
    ids=["soup", "nearly equal vertices", "inside out", "both sides", "sheet of two sides beside it", "degenerate"],
)
def test_a_ball_is_restored(vertices: FloatArray, faces: IntArray, repairs: list[str]) -> None:
    surface = repaired(vertices, faces)
    assert surface.merged + surface.repairs == repairs
    assert bool(surface.merged) == ("equal places" in repairs[0])
    assert len(surface.faces) == len(BALL.faces)
    assert volume(surface) == pytest.approx(BALL.volume)


def test_loose_fragments_are_dropped_up_to_a_limit() -> None:
    chip = np.array([[0.1, 0.0, 0.0], [0.104, 0.0, 0.0], [0.1, 0.004, 0.0]])
    vertices = np.concatenate([BALL.vertices, chip])
    faces = np.concatenate([BALL.faces, [[162, 163, 164]]])
    surface = repaired(vertices, faces)
    assert len(surface.repairs) == 1
    assert surface.repairs[0].startswith("dropped 1 loose open fragment, 0.04")
    large = np.concatenate([BALL.vertices, chip + 20.0 * (chip - chip[0])])
    with pytest.raises(MeshError, match="an open surface: 1 hole"):
        closed_surface(large, faces, "test")


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), holes=st.integers(1, 6))
def test_missing_triangles_are_filled(seed: int, holes: int) -> None:
    missing = np.random.default_rng(seed).choice(len(BALL.faces), size=holes, replace=False)
    surface = repaired(BALL.vertices, np.delete(BALL.faces, missing, axis=0))
    assert volume(surface) == pytest.approx(BALL.volume, rel=0.01)
    assert surface.repairs[0].startswith("closed ")


def test_one_sided_strip_is_refused() -> None:
    count = 40
    angle = 2.0 * np.pi * np.arange(count) / count
    ring = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    across = np.cos(angle / 2)[:, None] * ring + np.sin(angle / 2)[:, None] * np.array([0.0, 0.0, 1.0])
    faces = []
    for i in range(count):
        a, b = i, i + count
        c, d = (i + 1, i + 1 + count) if i + 1 < count else (count, 0)
        faces += [[a, c, b], [b, c, d]]
    with pytest.raises(MeshError, match="one-sided"):
        closed_surface(np.concatenate([ring - 0.3 * across, ring + 0.3 * across]), np.array(faces), "test")


JOINED, TURNED = "joined 2 overlapping parts into 1", "1 of 2 parts wound inside out: turned"


@pytest.mark.parametrize(
    ("balls", "turned", "repairs", "least", "most"),
    [
        (second_ball(0.05), False, [JOINED], 1.0, 2.0),
        (second_ball(0.0, scale=0.5), False, [JOINED], 1.0, 1.0),
        (second_ball(0.0, inward=True, scale=0.5), False, [], 0.875, 0.875),
        (second_ball(0.0, inward=True, scale=0.5), True, ["2 of 2 parts wound inside out: turned"], 0.875, 0.875),
        (second_ball(0.1, inward=True), False, [TURNED], 2.0, 2.0),
        (second_ball(0.05, inward=True), False, [TURNED, JOINED], 1.0, 2.0),
    ],
    ids=["overlap", "swallowed", "cavity", "cavity inside out", "apart, one inside out", "overlap, one inside out"],
)
def test_two_balls_become_one_solid(
    balls: tuple[FloatArray, IntArray], turned: bool, repairs: list[str], least: float, most: float
) -> None:
    vertices, faces = balls
    surface = repaired(vertices, faces[:, ::-1] if turned else faces)
    assert surface.repairs == repairs
    assert least - 1e-9 <= volume(surface) / BALL.volume <= most + 1e-9


PUSHED = BALL.vertices * [1.0, 1.0, 1.0]
PUSHED[:, 2] = np.where(PUSHED[:, 2] > 0.01, -1.5 * PUSHED[:, 2], PUSHED[:, 2])
X, _, Z = BALL.triangles.mean(axis=1).T
FIN = [*BALL.faces[0, :2], len(BALL.vertices)]


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (BALL.vertices, BALL.faces[Z < 0.0], r"an open surface: 1 hole up to .* of its area; give it a thickness"),
        (BALL.vertices, BALL.faces[(np.abs(Z) >= 0.015) | (X <= -0.02)], "too much to close safely"),
        (PUSHED, BALL.faces, r"crosses itself: the winding number is neither 0 nor 1 .* \(from -1\.00 to"),
        (np.concatenate([PUSHED, BALL.vertices + [0.05, 0.0, 0.0]]), second_ball(0.0)[1], "a part crosses itself"),
        (
            np.concatenate([BALL.vertices, 3.0 * BALL.vertices[FIN[:1]] + [0.0, 0.03, 0.0]]),
            np.concatenate([BALL.faces, [FIN]]),
            "not watertight: 1 edge shared by more than two triangles and 2 open edges",
        ),
        (BALL.vertices * [1.0, 1.0, 1e-12], BALL.faces, "no volume: it encloses"),
    ],
    ids=["half", "bent window", "pushed through itself", "a part pushed through itself", "fin", "flat"],
)
def test_what_no_safe_repair_closes_is_refused(vertices: FloatArray, faces: IntArray, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        closed_surface(vertices, faces, "test")


@pytest.mark.parametrize("halvings", [2, 5])
def test_triangles_with_no_inside_behind_are_refused_unless_they_are_few(halvings: int) -> None:
    # The finer ball has more triangles than are looked at one by one.
    ball = sphere(0.1, subdivisions=halvings)
    for side, is_refused in ((0.02, True), (0.0005, False)):
        # Both sides of a square, each cut along another diagonal: closed, and around nothing.
        square = 0.1 + side * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
        sheets = len(ball.vertices) + np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
        vertices, faces = np.concatenate([ball.vertices, square]), np.concatenate([ball.faces, sheets])
        if is_refused:
            with pytest.raises(MeshError, match="folded over itself: 4 triangles with no inside behind"):
                closed_surface(vertices, faces, "ball")
        else:
            assert len(closed_surface(vertices, faces, "ball").faces) == len(faces)
