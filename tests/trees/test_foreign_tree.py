"""Trees of other programs, their format and faults; errors and figures of a fit by closed forms and brute force."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from hhsim.errors import InputError
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.shapes import box_mesh
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.error import measure_levels, sample_spheres
from hhsim.trees.file import save_tree
from hhsim.trees.fit import measure_fit
from hhsim.trees.foreign_tree import import_tree, load_sph, load_tree_for, save_sph
from hhsim.trees.hierarchy import build_hierarchy
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree

AWAY = np.array([0.3, -0.1, 0.05])
MESH = replace(box_mesh((0.1, 0.06, 0.04)).transformed(np.eye(3), AWAY), name="box")


@cache
def built() -> SphereTree:
    return build_sphere_tree(MESH, TreeOptions(level=2))


def toolkit_file(path: Path, tree: SphereTree, *, shift: NDArray[np.float64], unit: float = 1.0, drop: int = 0) -> None:
    """Write a two-level tree as the toolkit does: six decimals, unused slots of radius -1, statistics at the end.

    `shift` is subtracted from the centres [m]; the first `drop` leaves are left out; inner spheres are too small.
    """
    branching = 9
    lines = ["0.000000 0.000000 0.000000 -1.000000 0.000000"] * (1 + branching + branching**2)
    slot, children = np.zeros(len(tree.radius), np.int64), np.zeros(len(tree.radius), np.int64)
    for node in range(len(tree.radius)):
        above = int(tree.parent[node])
        if above >= 0:
            slot[node] = slot[above] * branching + 1 + children[above]
            children[above] += 1
        if tree.leaf_start <= node < tree.leaf_start + drop:
            continue
        radius = tree.radius[node] * (1.0 if node >= tree.leaf_start else 0.6)
        numbers = [*((tree.center[node] - shift) / unit), radius / unit, 0.5]
        lines[slot[node]] = " ".join(f"{number:.6f}" for number in numbers)
    statistics = ["", "Efficiency 0.25", "Level 1: 8 spheres, worst 1.000000"]
    path.write_text("\n".join([f"3 {branching}", *lines, *statistics]) + "\n")


@pytest.mark.parametrize(("frame", "shift"), [("centred", AWAY), ("mesh", np.zeros(3))])
@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_the_frame_is_found_and_the_parents_are_mended(
    tmp_path: Path, frame: str, shift: NDArray[np.float64], unit: float
) -> None:
    path = tmp_path / "box.sph"
    toolkit_file(path, built(), shift=shift, unit=unit)
    found = import_tree(path, MESH, unit_length=unit)
    assert found.frame == frame
    assert found.tree.mesh_sha256 == MESH.sha256
    assert found.tree.options["frame"] == frame
    rounding = 1e-6 * unit
    assert np.abs(found.tree.leaf_center - built().leaf_center).max() <= rounding
    assert np.abs(found.tree.leaf_radius - built().leaf_radius).max() <= rounding
    # Every ancestor holds its leaves, one by one.
    ancestor = np.arange(found.tree.leaf_start, len(found.tree.radius))
    for _ in range(2):
        ancestor = found.tree.parent[ancestor]
        reach = np.linalg.norm(found.tree.leaf_center - found.tree.center[ancestor], axis=1) + found.tree.leaf_radius
        assert (reach <= found.tree.radius[ancestor] * (1.0 + 1e-9)).all()
    notes = " ".join(found.notes)
    assert "9 of 9 inner spheres did not enclose" in notes
    assert f"count from {'the centre of the mesh' if frame == 'centred' else 'the mesh'}" in notes
    for ours, theirs in zip(built().errors[-1:], found.tree.errors[-1:]):
        assert theirs.bound == pytest.approx(ours.bound, abs=3.0 * rounding)
        assert theirs.protrusion_max == pytest.approx(ours.protrusion_max, abs=0.03 * ours.bound)
        assert theirs.gap_max <= 3.0 * rounding


def test_a_tree_with_holes_has_its_gap_measured_and_no_proof(tmp_path: Path) -> None:
    path = tmp_path / "box.sph"
    toolkit_file(path, built(), shift=AWAY, drop=6)
    found = import_tree(path, MESH)
    assert found.unproved > 0
    error = found.tree.errors[-1]
    points, _ = trimesh.sample.sample_surface(trimesh.Trimesh(MESH.vertices, MESH.faces), 40_000, seed=1)
    gap = (cdist(points, found.tree.leaf_center) - found.tree.leaf_radius).min(axis=1)
    assert error.gap_max == pytest.approx(gap.max(), rel=0.05)
    assert error.gap_mean == pytest.approx(np.maximum(gap, 0.0).mean(), rel=0.1)
    assert f"are not proved to cover {found.unproved}" in found.notes[-1]


def test_where_both_frames_leave_no_gap_the_one_that_sticks_out_less(tmp_path: Path) -> None:
    near = Mesh(MESH.vertices - AWAY + [0.0, 0.0, 0.01], MESH.faces, name="box")
    for middle, frame in ((0.0, "centred"), (0.01, "mesh")):
        (tmp_path / "ball.sph").write_text(f"1 2\n0 0 {middle} 0.08 1\n")
        found = import_tree(tmp_path / "ball.sph", near)
        assert found.frame == frame
        assert found.tree.center[0, 2] == pytest.approx(0.01)
        assert "the spheres protrude by" in found.notes[0]


@pytest.mark.parametrize(("size", "told"), [(1.0, ""), (2.54, "note"), (3.5, "refused")])
def test_spheres_that_stick_out_far_are_told_or_refused(tmp_path: Path, size: float, told: str) -> None:
    around = MESH.transformed(np.eye(3), -AWAY)
    save_sph(built().transformed(np.eye(3), -AWAY).scaled(size), tmp_path / "box.sph")
    doubt = r"its spheres stick out by \d+(\.\d+)? mm, and box is 124.5 mm across: are they in another unit"
    if told == "refused":
        with pytest.raises(InputError, match=f"box.sph: {doubt}"):
            import_tree(tmp_path / "box.sph", around)
    else:
        found = import_tree(tmp_path / "box.sph", around).notes
        assert bool(re.search(doubt, "".join(found))) == (told == "note")


def test_spheres_of_another_place_or_unit_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "box.sph"
    toolkit_file(path, built(), shift=3.0 * AWAY)
    with pytest.raises(InputError, match="are they in another unit or frame, or of another mesh"):
        import_tree(path, MESH)
    toolkit_file(path, built(), shift=AWAY)
    with pytest.raises(InputError, match=r"span 0\.1.* mm, but box 100 mm: is it in another unit"):
        import_tree(path, MESH, unit_length=1e-3)
    with pytest.raises(InputError, match=r"\.h5 or a \.sph"):
        import_tree(tmp_path / "box.txt", MESH)


def test_a_tree_of_another_mesh_is_measured_but_not_replayed(tmp_path: Path) -> None:
    path = tmp_path / "box.h5"
    save_tree(built(), path)
    assert load_tree_for(path, MESH).notes == ()
    longer = Mesh(AWAY + 1.05 * (MESH.vertices - AWAY), MESH.faces, name="longer")
    found = import_tree(path, longer)
    assert "another mesh than longer" in found.notes[0]
    assert found.unproved > 0
    assert found.tree.errors[-1].gap_max > 1e-3
    with pytest.raises(InputError, match=r"built for the mesh .* but longer is"):
        load_tree_for(path, longer)


@settings(max_examples=30)
@given(st.integers(1, 40), st.sampled_from([(1, 8), (2, 2), (2, 8), (3, 4)]), st.integers(0, 2**31))
def test_there_and_back(
    tmp_path_factory: pytest.TempPathFactory, count: int, shape: tuple[int, int], seed: int
) -> None:
    level, branching = shape
    rng = np.random.default_rng(seed)
    count = min(count, branching**level)
    tree = build_hierarchy(rng.normal(size=(count, 3)), 0.1 + rng.random(count), level, branching)
    path = tmp_path_factory.mktemp("sph") / "tree.sph"
    save_sph(tree, path)
    back = load_sph(path)
    for name in ("center", "radius", "level", "parent"):
        np.testing.assert_array_equal(getattr(back, name), getattr(tree, name), err_msg=name)


def test_parents_grow_and_unused_slots_vanish(tmp_path: Path) -> None:
    # As the toolkit writes: unused slots with radius -1 or 0, parents too small, statistics after the last slot.
    path = tmp_path / "toolkit.sph"
    slots = ["0 0 0 0.5 1", "1 0 0 0.1 1", "-1 0 0 0.2 1"]
    slots += ["1.5 0 0 0.3 1", "0 0 0 -1.000000 0.000000", "-1.5 0 0 0.1 1", "-1 0 0 0 0"]
    path.write_text("3 2\n" + "\n".join(slots) + "\n\nLevel 0: worst 0.25\n")
    tree = load_sph(path)
    assert tree.parent.tolist() == [-1, 0, 0, 1, 2]
    assert tree.leaf_radius.tolist() == [0.3, 0.1]
    assert tree.radius[:3] == pytest.approx([1.8, 0.8, 0.6])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "first line"),
        ("solid cube\n", "first line"),
        ("0 8\n", "expected a tree"),
        ("30 8\n", "expected a tree"),
        ("2 2\n0 0 0 1 1\n", "promises 3"),
        ("1 2\n0 0 zero 1 1\n", "slot 0 reads"),
        ("1 2\n0 0\n", "slot 0 reads"),
        ("1 2\n0 nan 0 1 1\n", "not finite"),
        ("1 2\n0 0 0 -1 1\n", "root sphere is unused"),
        ("3 2\n0 0 0 1 1\n0 0 0 -1 1\n0 0 0 1 1\n" + "0 0 0 1 1\n" * 4, "slot 3 hangs"),
    ],
)
def test_files_that_are_no_tree_are_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.sph"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        load_sph(path)
    assert "bad.sph" in str(caught.value)
    assert "\n" not in str(caught.value)


CUBE = box_mesh((0.2, 0.2, 0.2))


def test_figures_are_those_of_the_definitions_on_many_spheres() -> None:
    rng = np.random.default_rng(1)
    center, radius = rng.uniform(-0.08, 0.08, (12, 3)), rng.uniform(0.02, 0.06, 12)
    fit = measure_fit(CUBE, center, radius)
    assert fit.volume_ratio == pytest.approx(4.0 / 3.0 * np.pi * (radius**3).sum() / 0.008)
    inside = rng.uniform(-0.1, 0.1, (50_000, 3))
    within = (np.linalg.norm(inside[:, None] - center, axis=2) < radius).any(axis=1).mean()
    assert fit.coverage == pytest.approx(within, abs=0.015)
    directions = rng.normal(size=(12, 2000, 3))
    points = center[:, None] + radius[:, None, None] * directions / np.linalg.norm(directions, axis=2, keepdims=True)
    over = np.maximum(np.abs(points.reshape(-1, 3)) - 0.1, 0.0)
    height = np.linalg.norm(over, axis=1)
    assert fit.protrusion == pytest.approx((height > 0.0).mean(), abs=0.03)
    assert fit.protrusion_max == pytest.approx(height.max(), rel=0.05)
    assert fit.protrusion_mean == pytest.approx(height[height > 0.0].mean(), rel=0.1)
    assert fit.protrusion_p95 == pytest.approx(np.quantile(height[height > 0.0], 0.95), rel=0.1)
    surface = trimesh.sample.sample_surface(trimesh.Trimesh(CUBE.vertices, CUBE.faces), 20_000, seed=2)[0]
    gap = np.maximum((np.linalg.norm(surface[:, None] - center, axis=2) - radius).min(axis=1), 0.0)
    assert fit.surface_gap_max == pytest.approx(gap.max(), rel=0.05)
    assert fit.surface_gap_mean == pytest.approx(gap.mean(), rel=0.05)
    assert fit.surface_gap_p95 == pytest.approx(np.quantile(gap, 0.95), rel=0.05)
    assert fit.surface_coverage == pytest.approx((gap == 0.0).mean(), abs=0.015)


def test_errors_are_true() -> None:
    tree = build_sphere_tree(box_mesh((0.1, 0.1, 0.1)), TreeOptions(level=2))
    rng = np.random.default_rng(17)
    for error in tree.errors:
        center, radius = tree.spheres(error.level)
        points, owner, area = sample_spheres(center, radius, 40_000, rng)
        distance = np.linalg.norm(points[:, None] - center, axis=2) - radius
        distance[np.arange(len(points)), owner] = np.inf
        points, area = points[distance.min(axis=1) >= 0.0], area[distance.min(axis=1) >= 0.0]
        # The distance from a box in closed form.
        outside = np.linalg.norm(np.maximum(0.0, np.abs(points) - 0.05), axis=1)
        area, outside = area[outside > 0.0], outside[outside > 0.0]
        assert outside.max() <= error.bound
        assert error.protrusion_max <= error.bound * (1.0 + 1e-12)
        assert error.protrusion_max == pytest.approx(outside.max(), rel=0.03)
        assert error.protrusion_mean == pytest.approx(np.average(outside, weights=area), rel=0.03)
        assert error.protrusion_mean <= error.protrusion_p99 <= error.protrusion_max


def test_a_lone_ball_in_closed_form() -> None:
    small = box_mesh((0.1, 0.1, 0.1))
    tree = build_hierarchy(np.zeros((1, 3)), np.array([0.06]), 1, 8)
    error = measure_levels(small, build_mesh_bvh(small.vertices, small.faces), tree)[-1]
    assert error.bound == pytest.approx(0.01)
    assert error.protrusion_max == pytest.approx(0.01, rel=1e-3)
    # Each face lets a cap through whose heights are spread evenly: Archimedes.
    assert error.protrusion_mean == pytest.approx(0.005, rel=0.02)
    assert error.protrusion_p99 == pytest.approx(0.0099, rel=0.01)
    assert error.gap_max == pytest.approx(0.05 * np.sqrt(3.0) - 0.06, rel=0.05)
