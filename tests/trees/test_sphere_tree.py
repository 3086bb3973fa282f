"""The sphere tree: what it accepts, its views, its file, and that no unsound tree can be made or read."""

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from hhsim.errors import InputError
from hhsim.trees.file import load_tree, save_tree
from hhsim.trees.hierarchy import build_hierarchy
from hhsim.trees.sphere_tree import LevelCover, LevelError, SphereTree

ERROR = LevelError(0, 1, 0.0, 0.0, 0.0, 3e-3, 2e-3, 2.9e-3, 4e-3)


def random_tree(count: int = 30, level: int = 2, seed: int = 0) -> SphereTree:
    rng = np.random.default_rng(seed)
    tree = build_hierarchy(0.1 * rng.normal(size=(count, 3)), 0.01 * rng.random(count), level, 8)
    errors = tuple(replace(ERROR, level=depth) for depth in range(level + 1))
    return replace(tree, errors=errors, mesh_sha256="ab" * 32, options={"level": level, "seed": seed})


def assert_equal(one: SphereTree, other: SphereTree) -> None:
    for name in ("center", "radius", "level", "parent"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert (one.errors, one.mesh_sha256, dict(one.options)) == (other.errors, other.mesh_sha256, dict(other.options))


def test_a_tree_too_wide_for_the_walk_never_reaches_the_kernels() -> None:
    def star(leaves: int) -> SphereTree:
        level = np.concatenate([[0], np.ones(leaves, dtype=np.int64)])
        return SphereTree(np.zeros((leaves + 1, 3)), np.ones(leaves + 1), level, level - 1)

    assert star(1024).arrays().child_count[0] == 1024
    with pytest.raises(InputError, match="1,025 children need 1,025 places of 1,024"):
        star(1025).arrays()


BROKEN = {"center": np.zeros((2, 2)), "radius": np.array([1.0]), "level": np.array([0, 0]), "parent": np.array([-1, 1])}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_arrays_are_refused(name: str, tmp_path: Path) -> None:
    sound: dict[str, Any] = {
        "center": np.zeros((2, 3)),
        "radius": np.array([2.0, 1.0]),
        "level": np.array([0, 1]),
        "parent": np.array([-1, 0]),
    }
    save_tree(SphereTree(**sound), tmp_path / "tree.h5")
    with pytest.raises(InputError, match="sphere tree") as caught:
        SphereTree(**sound | {name: BROKEN[name]})
    assert "\n" not in str(caught.value)
    with h5py.File(tmp_path / "tree.h5", "a") as file:
        del file[name]
        file[name] = BROKEN[name]
    with pytest.raises(InputError, match=r"tree\.h5: sphere tree"):
        load_tree(tmp_path / "tree.h5")


def test_values_that_make_no_tree_are_refused() -> None:
    tree = random_tree()

    def changed(name: str, index: int, value: float) -> dict[str, Any]:
        array = getattr(tree, name).copy()
        array[index] = value
        return {name: array}

    last = len(tree.radius) - 1
    for name, index, value, message in [
        ("radius", 3, np.nan, "not finite"),
        ("center", 3, np.inf, "not finite"),
        ("radius", last, -1.0, "negative"),
        ("parent", 0, 0, "root"),
        ("parent", last, 0, "breadth-first"),
        ("parent", 1, 5, "breadth-first"),
        ("level", last, 1, "level"),
        ("radius", 0, 0.5 * tree.radius[0], "sticks"),
        ("radius", 1, 0.5 * tree.radius[1], "sticks"),
        ("radius", last, 10.0, "sticks"),
    ]:
        with pytest.raises(InputError, match=message):
            replace(tree, **changed(name, index, value))
    with pytest.raises(InputError, match="same level"):
        SphereTree(np.zeros((4, 3)), np.ones(4), np.array([0, 1, 1, 2]), np.array([-1, 0, 0, 1]))


def test_file_brings_back_every_bit(tmp_path: Path) -> None:
    tree = random_tree()
    save_tree(tree, tmp_path / "tree.h5")
    assert_equal(load_tree(tmp_path / "tree.h5"), tree)
    assert [path.name for path in tmp_path.iterdir()] == ["tree.h5"]
    with h5py.File(tmp_path / "tree.h5") as file:
        assert (file.attrs["format"], file.attrs["schema_version"]) == ("hhsim-tree", 3)
        for name in ("center", "radius", "level", "parent"):
            assert file[name].attrs["units"] == ("m" if name in ("center", "radius") else "1")
            assert file[name].attrs["long_name"]
        assert set(file["errors"]) == set(asdict(ERROR))
        assert all(data.attrs["units"] and data.attrs["long_name"] for data in file["errors"].values())


def with_covers() -> SphereTree:
    tree = random_tree(level=1, count=8)
    covers = (
        LevelCover(np.zeros((1, 3)), np.ones(1), np.ones(1), 0.0, np.array([0], np.int32)),
        LevelCover(tree.leaf_center, tree.leaf_radius, np.full(8, 2e-3), 1e-3, np.array([-1, 7, 3], np.int32)),
    )
    return replace(tree, covers=covers)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda file: file.__delitem__("covers/0"), "expected one for each level"),
        (lambda file: file.__delitem__("covers/1"), "1 covers"),
        (lambda file: file["covers/1/proof"].__setitem__(0, 0), "needs 3 owners, and has 2"),
        (lambda file: file["covers/0/radius"].__setitem__(0, -9.0), "negative"),
        (lambda file: file["covers/0/depth"].__setitem__(0, np.nan), "not finite"),
        (lambda file: file["covers/0"].attrs.__setitem__("gap", -1.0), "negative"),
    ],
)
def test_broken_covers_are_refused(tmp_path: Path, change: Callable[[h5py.File], None], message: str) -> None:
    path = tmp_path / "tree.h5"
    save_tree(with_covers(), path)
    with h5py.File(path, "a") as file:
        change(file)
    with pytest.raises(InputError, match=message):
        load_tree(path)


def test_files_that_are_no_tree_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_tree(tmp_path / "missing.h5")
    (tmp_path / "text.h5").write_text("not HDF5")
    with pytest.raises(InputError, match="not a readable hhsim-tree"):
        load_tree(tmp_path / "text.h5")
    path = tmp_path / "tree.h5"
    for name, value, message in [
        ("format", "hhsim-result", "expected 'hhsim-tree'"),
        ("schema_version", 99, "version 99"),
    ]:
        save_tree(random_tree(), path)
        with h5py.File(path, "a") as file:
            file.attrs[name] = value
        with pytest.raises(InputError, match=message):
            load_tree(path)
    save_tree(random_tree(), path)
    with h5py.File(path, "a") as file:
        del file["radius"]
    with pytest.raises(InputError, match="radius"):
        load_tree(path)
    save_tree(random_tree(), path)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(InputError, match="a damaged HDF5 file: cut short"):
        load_tree(path)
