"""Closures that ship or lie in the cache are those that the search finds, and damage to them is healed."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.scene import closure_search
from hhsim.scene.closure_search import encoded, plan_finger_closure, shipped_closures
from hhsim.scene.motion_catalogue import load_script
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree
from tools.build_closures import searched

DUE = "not what ships: raise SEARCH_VERSION if the search changed, and run `python -m tools.build_closures`"


def tree_of(name: str, level: int) -> SphereTree:
    return cached_sphere_tree(load_object(name).mesh, TreeOptions(level=level))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The cache, empty, of a process that has searched for nothing."""
    monkeypatch.setattr(closure_search, "cache_root", lambda: tmp_path)
    monkeypatch.setattr(closure_search, "_found", {})
    return tmp_path / "closures"


@pytest.fixture
def searches(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A name for each search."""
    done: list[str] = []
    keep = closure_search.kept_closure

    def counted(script: Any, hand: Any, tree: Any, search: Any) -> Any:
        def noted() -> Any:
            done.append(script.name)
            return search()

        return keep(script, hand, tree, noted)

    monkeypatch.setattr("hhsim.scene.closure_search.kept_closure", counted)
    return done


@pytest.mark.soak
def test_all_that_ship_are_what_the_search_finds() -> None:
    assert searched(object_names()) == shipped_closures(), DUE


def test_the_catalogue_needs_no_search(folder: Path, searches: list[str]) -> None:
    item = load_object("bunny")
    plan_finger_closure(load_script("grasp"), HandModel.default(), tree_of("bunny", item.level))
    assert searches == [] and not folder.exists()


def test_a_search_is_kept_by_the_process_and_by_the_cache(
    folder: Path, searches: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    question = load_script("pinch"), HandModel.default(hand_length=0.2), tree_of("cube", 2)
    first = plan_finger_closure(*question)
    first.open[:] = 0.0
    again = plan_finger_closure(*question)
    monkeypatch.setattr(closure_search, "_found", {})
    read = plan_finger_closure(*question)
    assert len(searches) == 1 and len(list(folder.glob("*.json"))) == 1
    assert again.open.any() and encoded(again) == encoded(read)


SOURCES = """
import sys
import hhsim.scene.closure_search
print(*(module.__file__ for name, module in sys.modules.items() if name.startswith("hhsim.") and module.__file__))
"""


def test_the_cache_knows_every_source_that_a_search_depends_on() -> None:
    done = subprocess.run([sys.executable, "-c", SOURCES], capture_output=True, text=True, check=True)
    library = Path(closure_search.__file__).parents[1]
    needed = {Path(name).relative_to(library).as_posix() for name in done.stdout.split()}
    # Kernels count by a digest of their own; hand and tree by every number of theirs.
    by_content = ("kernels/", "hand/", "trees/", "mesh/", "system/", "motion/", "metrics/", "recordings/")
    unknown = {name for name in needed if not name.startswith(by_content) and not name.endswith("__init__.py")}
    # Not what is searched for, but what a script says of its end and of joints, and how closures are kept and told.
    other = {"arrays.py", "errors.py", "ranges.py", "scene/contact_goals.py"}
    other |= {"scene/body.py"}
    assert unknown - {*closure_search._SOURCES} == other
