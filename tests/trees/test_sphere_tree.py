"""The sphere tree: what it accepts, its file, no unsound one; those that ship, and others that are built once."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from hhsim.errors import InputError
from hhsim.mesh.catalogue import BODIES, MESH_LEVEL, load_object, object_names
from hhsim.mesh.mesh import Mesh
from hhsim.scene.declared_bodies import LEVEL_OF_MANY
from hhsim.trees import builder, cache
from hhsim.trees.cache import SHIPPED_SUFFIX, cache_path, cached_sphere_tree, shipped_tree
from hhsim.trees.file import load_tree, save_tree
from hhsim.trees.hierarchy import build_hierarchy
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import LevelCover, LevelError, SphereTree
from tools.build_trees import PALM_LEVEL, body_meshes, body_tree, object_tree, palm_trees
from tools.shapes.generators import cube

ERROR = LevelError(0, 1, 0.0, 0.0, 0.0, 3e-3, 2e-3, 2.9e-3, 4e-3)


def random_tree(count: int = 30, level: int = 2, seed: int = 0) -> SphereTree:
    rng = np.random.default_rng(seed)
    tree = build_hierarchy(0.1 * rng.normal(size=(count, 3)), 0.01 * rng.random(count), level, 8)
    errors = tuple(replace(ERROR, level=depth) for depth in range(level + 1))
    return replace(tree, errors=errors, mesh_sha256="ab" * 32, options={"level": level, "seed": seed})


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
    assert_same(load_tree(tmp_path / "tree.h5"), tree)
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


def without(name: str) -> Callable[[h5py.File], None]:
    return lambda file: file.__delitem__(name)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (without("covers/0"), "expected one for each level"),
        (without("covers/1"), "1 covers"),
        (without("radius"), "radius"),
        (lambda file: file["covers/1/proof"].__setitem__(0, 0), "needs 3 owners, and has 2"),
        (lambda file: file["covers/0/radius"].__setitem__(0, -9.0), "negative"),
        (lambda file: file["covers/0/depth"].__setitem__(0, np.nan), "not finite"),
        (lambda file: file["covers/0"].attrs.__setitem__("gap", -1.0), "negative"),
        (lambda file: file.attrs.__setitem__("format", "hhsim-result"), "expected 'hhsim-tree'"),
        (lambda file: file.attrs.__setitem__("schema_version", 99), "version 99"),
    ],
)
def test_what_does_not_belong_in_a_file_is_refused(
    tmp_path: Path, change: Callable[[h5py.File], None], message: str
) -> None:
    path = tmp_path / "tree.h5"
    save_tree(with_covers(), path)
    with h5py.File(path, "a") as file:
        change(file)
    with pytest.raises(InputError, match=message):
        load_tree(path)


def test_files_that_are_no_tree_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "tree.h5"
    save_tree(random_tree(), path)
    for content, message in (
        (path.read_bytes()[:-200], "a damaged HDF5 file: cut short"),
        (b"not HDF5", "not a readable hhsim-tree"),
    ):
        path.write_bytes(content)
        with pytest.raises(InputError, match=message):
            load_tree(path)
    with pytest.raises(InputError, match="no such file"):
        load_tree(tmp_path / "missing.h5")


DUE = "not what ships: raise BUILDER_VERSION if the builder changed, and run `python -m tools.build_trees`"


def assert_same(one: SphereTree | None, other: SphereTree) -> None:
    """Byte for byte, with errors, covers and proofs."""
    assert one is not None, DUE
    for name in ("center", "radius", "level", "parent"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), DUE
    assert (one.errors, one.mesh_sha256, one.options) == (other.errors, other.mesh_sha256, other.options), DUE
    for mine, theirs in zip(one.covers, other.covers, strict=True):
        for name in ("center", "radius", "depth", "proof"):
            assert getattr(mine, name).tobytes() == getattr(theirs, name).tobytes(), DUE
        assert mine.gap == theirs.gap


@pytest.mark.parametrize("name", object_names())
def test_a_tree_ships_for_every_object_and_its_proofs_hold(name: str) -> None:
    item = load_object(name)
    tree = shipped_tree(item.mesh, TreeOptions(level=item.level))
    assert tree is not None, DUE
    assert tree.check(item.mesh) == ()
    assert tree.depth == item.level


@pytest.mark.soak
@pytest.mark.parametrize("name", object_names())
def test_what_ships_is_what_the_builder_gives(name: str) -> None:
    item = load_object(name)
    assert_same(shipped_tree(item.mesh, TreeOptions(level=item.level)), object_tree(name))


@pytest.mark.parametrize("level", [LEVEL_OF_MANY, MESH_LEVEL])
def test_trees_of_bodies_ship_for_spheres_and_triangles_and_their_proofs_hold(level: int) -> None:
    for mesh in body_meshes().values():
        tree = shipped_tree(mesh, TreeOptions(level=level))
        assert tree is not None, DUE
        assert tree.check(mesh) == ()


def test_every_tree_in_the_folder_of_bodies_is_of_one_that_has_it() -> None:
    folder = files("hhsim.objects") / BODIES
    assert {entry.name for entry in folder.iterdir() if entry.name.endswith(SHIPPED_SUFFIX)} == set(body_meshes()), DUE


@pytest.mark.soak
def test_trees_of_bodies_that_ship_are_what_the_builder_gives() -> None:
    for mesh in body_meshes().values():
        assert_same(shipped_tree(mesh, TreeOptions(level=MESH_LEVEL)), body_tree(mesh))


def test_the_palms_that_ship_are_what_the_builder_gives() -> None:
    for mesh, tree in palm_trees():
        assert_same(shipped_tree(mesh, TreeOptions(level=PALM_LEVEL)), tree)
        assert tree.check(mesh) == ()


def test_a_coarser_level_of_what_ships_is_the_tree_that_is_built_for_it() -> None:
    item = load_object("cube")
    options = TreeOptions(level=2)
    assert_same(shipped_tree(item.mesh, options), builder.build_sphere_tree(item.mesh, options))


def test_what_ships_is_taken_for_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = load_object("sphere").mesh
    for other in (
        TreeOptions(level=4),
        TreeOptions(level=3, leaves=500),
        TreeOptions(level=3, branching=7),
        TreeOptions(level=3, cover="balanced"),
        TreeOptions(level=3, seed=1),
        TreeOptions(level=3, max_error=0.01),
    ):
        assert shipped_tree(mesh, other) is None
    assert shipped_tree(replace(mesh.scaled(2.0), name="sphere"), TreeOptions(level=3)) is None
    assert shipped_tree(Mesh(mesh.vertices, mesh.faces[::-1], name="sphere"), TreeOptions(level=3)) is None
    assert shipped_tree(mesh, TreeOptions(level=3)) is not None
    monkeypatch.setattr("hhsim.trees.options.BUILDER_VERSION", 0)
    assert shipped_tree(mesh, TreeOptions(level=3)) is None


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(cache, "cache_root", lambda: tmp_path)
    return tmp_path


def test_cache_builds_once_for_each_content(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, options = cube(0.1), TreeOptions(level=1)
    built: list[str] = []
    build = builder.build_sphere_tree

    def counted(*arguments: object) -> SphereTree:
        built.append("once")
        return build(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(builder, "build_sphere_tree", counted)
    first = cached_sphere_tree(mesh, options)
    second = cached_sphere_tree(replace(mesh, name="another name"), options)
    assert len(built) == 1
    assert_same(second, first)
    cached_sphere_tree(mesh, TreeOptions(level=1, leaves=5))
    cached_sphere_tree(mesh.scaled(2.0), options)
    assert len(built) == 3
    assert len(list(folder.rglob("*"))) == 4


def test_damaged_cache_is_built_again(folder: Path) -> None:
    mesh, options = cube(0.1), TreeOptions(level=1)
    expected = cached_sphere_tree(mesh, options)
    path = cache_path(mesh, options)
    path.write_bytes(path.read_bytes()[:100])
    assert np.array_equal(cached_sphere_tree(mesh, options).center, expected.center)
    assert np.array_equal(load_tree(path).center, expected.center)


def test_a_cache_that_cannot_be_written_is_done_without(folder: Path) -> None:
    (folder / "trees").write_text("a file where the folder should be")
    assert cached_sphere_tree(cube(0.1), TreeOptions(level=1)).leaf_count == 8


SOURCES = """
import sys
import hhsim.trees.builder
print(*(module.__file__ for name, module in sys.modules.items() if name.startswith("hhsim.") and module.__file__))
"""


def test_the_cache_knows_every_source_that_a_tree_depends_on() -> None:
    done = subprocess.run([sys.executable, "-c", SOURCES], capture_output=True, text=True, check=True)
    library = Path(builder.__file__).parents[1]
    needed = {Path(name).relative_to(library).as_posix() for name in done.stdout.split()}
    unknown = {name for name in needed if not name.startswith(cache._SOURCES) and not name.endswith("__init__.py")}
    # Not what a tree is, but how it is computed, reported, written and walked, and the mesh, whose content counts.
    other = {
        "arrays.py",
        "errors.py",
        "kernels/by_reference.py",
        "kernels/cache_folder.py",
        "kernels/callee.py",
        "kernels/jit.py",
        "kernels/kernel_cache.py",
        "kernels/memory.py",
        "kernels/sphere_tree.py",
        "kernels/target.py",
        "ranges.py",
    } | {f"mesh/{name}.py" for name in ("file", "isosurface", "mesh", "repair", "scene_formats", "solidify")}
    assert {name for name in unknown if not name.startswith("system/")} == other
