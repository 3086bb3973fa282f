"""The toolkit's text format: there and back, the toolkit's own quirks, and files that are no tree."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.errors import InputError
from hhsim.trees.foreign_tree import load_sph, save_sph
from hhsim.trees.hierarchy import build_hierarchy


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
    assert np.array_equal(back.center, tree.center)
    assert np.array_equal(back.radius, tree.radius)
    assert np.array_equal(back.level, tree.level)
    assert np.array_equal(back.parent, tree.parent)


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
