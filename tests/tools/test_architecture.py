"""The picture of ARCHITECTURE.md is of the imports there are, and notices where it no longer is."""

import re

from tools.architecture import LAYERS, PICTURE, counts, imported_by, is_current, order, picture, places, reduced


def test_the_committed_picture_is_current() -> None:
    assert is_current(PICTURE.read_text(encoding="utf-8")), "run python -m tools.architecture"


def test_a_picture_that_is_not_current_is_noticed() -> None:
    drawn = picture(counts())
    assert is_current(drawn)
    paths = re.findall(r"<path d=\"M.*marker-end.*/>\n", drawn)
    assert len(paths) == sum(map(len, reduced(imported_by()).values()))
    assert not is_current(drawn.replace(paths[0], ""))
    grown = {name: (modules, lines + lines // 5) for name, (modules, lines) in counts().items()}
    assert not is_current(picture(grown))


def test_every_package_has_a_place_and_imports_from_none_above_it() -> None:
    assert sorted(name for _, names in LAYERS for name in names if name) == sorted(order())
    boxes = places()
    for name, imported in imported_by().items():
        assert all(boxes[name].layer <= boxes[other].layer for other in imported), name
