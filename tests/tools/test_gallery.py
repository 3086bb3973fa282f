"""The gallery tells of the runs that its films show, is small enough to be kept, and its scenes need no network."""

import re
from pathlib import Path

from PIL import Image
from short_grasp import short_result

from tools import gallery


def test_the_page_is_that_of_its_tiles_and_every_film_moves_and_is_small() -> None:
    page = gallery.PAGE.read_text(encoding="utf-8")
    printed = gallery.tables(page)
    assert list(printed) == [tile.title for tile in gallery.TILES] and len(printed) == 12
    assert page == gallery.page_of(printed)
    sizes = {path.name: path.stat().st_size for path in gallery.FILMS.iterdir()}
    assert set(sizes) == {tile.file for tile in gallery.TILES}
    assert max(sizes.values()) <= gallery.MOST_BYTES and sum(sizes.values()) <= gallery.MOST_OF_ALL
    for tile in gallery.TILES:
        with Image.open(gallery.FILMS / tile.file) as film:
            assert getattr(film, "n_frames", 1) > (50 if tile.result else 0), tile.name
            assert max(film.size) <= 2 * gallery.WIDTH


def test_a_scene_to_turn_is_one_file(tmp_path: Path) -> None:
    short_result(tmp_path / "short.h5")
    page = gallery.scene_page(tmp_path / "short.h5", 150)
    assert len(page) < 1_500_000 and "$B64GLTF" not in page
    assert not re.search(r"""(src|href)=["']?https?:""", page)
