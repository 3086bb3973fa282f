"""The gallery tells of the runs that its films show, is small enough to be kept, and its scenes need no network."""

import re
from pathlib import Path

import pytest
from PIL import Image
from short_grasp import short_result

from tools import gallery


def test_the_page_is_that_of_its_tiles_and_every_film_moves_and_is_small() -> None:
    page = gallery.PAGE.read_text(encoding="utf-8")
    printed = gallery.tables(page)
    assert list(printed) == [tile.title for tile in gallery.TILES] and len(printed) == 11
    assert page == gallery.page_of(printed)
    sizes = {path.name: path.stat().st_size for path in gallery.FILMS.iterdir()}
    assert set(sizes) == {tile.file for tile in gallery.TILES} | {f"{name}.glb" for name in gallery.TURNED}
    assert max(sizes.values()) <= gallery.MOST_BYTES and sum(sizes.values()) <= gallery.MOST_OF_ALL
    for tile in gallery.TILES:
        with Image.open(gallery.FILMS / tile.file) as film:
            assert getattr(film, "n_frames", 1) > 50, tile.name
            assert max(film.size) <= 2 * gallery.WIDTH


def test_a_scene_to_turn_is_one_page_that_needs_no_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert {path.stem for path in gallery.FILMS.glob("*.glb")} == set(gallery.TURNED)
    short_result(tmp_path / "short.h5")
    (tmp_path / "grasp.glb").write_bytes(gallery.scene_to_turn(tmp_path / "short.h5", 150))
    for folder in (gallery.FILMS, tmp_path):
        monkeypatch.setattr(gallery, "FILMS", folder)
        page = gallery.page_to_turn("grasp")
        assert len(page) < 1_200_000 and "<title>Grasp" in page and "user-scalable" not in page and "$B64" not in page
        assert not re.search(r"""(src|href)=["']?https?:""", page)
