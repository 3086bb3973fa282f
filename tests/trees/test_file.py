"""The hhsim-tree file: every bit comes back, units stand beside the numbers, and what is no tree is refused."""

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from hhsim.errors import InputError, OutputError
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


def test_file_brings_back_every_bit(tmp_path: Path) -> None:
    tree = random_tree()
    save_tree(tree, tmp_path / "tree.h5")
    assert_equal(load_tree(tmp_path / "tree.h5"), tree)
    assert [path.name for path in tmp_path.iterdir()] == ["tree.h5"]
    with h5py.File(tmp_path / "tree.h5") as file:
        assert (file.attrs["format"], file.attrs["schema_version"]) == ("hhsim-tree", 2)
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


def test_covers_come_back(tmp_path: Path) -> None:
    tree = with_covers()
    save_tree(tree, tmp_path / "tree.h5")
    back = load_tree(tmp_path / "tree.h5")
    for one, other in zip(back.covers, tree.covers, strict=True):
        for name in ("center", "radius", "depth", "proof"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
        assert (one.gap, one.bound) == (other.gap, other.bound)
    with h5py.File(tmp_path / "tree.h5") as file:
        assert file["covers/1"].attrs["bound"] == tree.covers[1].bound
        assert all(data.attrs["units"] and data.attrs["long_name"] for data in file["covers/1"].values())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda file: file.__delitem__("covers/0"), "expected one for each level"),
        (lambda file: file.__delitem__("covers/1"), "1 covers"),
        (lambda file: file["covers/1/radius"].__setitem__(0, 9.0), "must be the leaves"),
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


def test_file_is_the_same_every_time(tmp_path: Path) -> None:
    for name in ("one.h5", "two.h5"):
        save_tree(random_tree(), tmp_path / name)
    assert (tmp_path / "one.h5").read_bytes() == (tmp_path / "two.h5").read_bytes()


def test_unwritable_place(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot write"):
        save_tree(random_tree(), tmp_path / "missing" / "tree.h5")
    (tmp_path / "folder.h5").mkdir()
    with pytest.raises(OutputError, match=r"folder\.h5"):
        save_tree(random_tree(), tmp_path / "folder.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["folder.h5"]


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
