"""Where trees come from: those that ship are what the builder gives, and spare it; others are built once."""

import subprocess
import sys
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from hhsim.mesh.catalogue import BODIES, MESH_LEVEL, load_object, object_names
from hhsim.mesh.mesh import Mesh
from hhsim.scene.declared_bodies import LEVEL_OF_MANY
from hhsim.trees import builder, cache
from hhsim.trees.cache import SHIPPED_SUFFIX, cache_path, cached_sphere_tree, shipped_tree
from hhsim.trees.file import load_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree
from tools.build_trees import PALM_LEVEL, body_meshes, body_tree, object_tree, palm_trees
from tools.shapes.generators import cube

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
    } | {
        f"mesh/{name}.py"
        for name in ("file", "isosurface", "mesh", "polygon_formats", "repair", "scene_formats", "shell", "solidify")
    }
    assert {name for name in unknown if not name.startswith("system/")} == other
