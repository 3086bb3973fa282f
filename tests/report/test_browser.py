"""The report in a real browser: on a phone, on a screen, on paper; it asks nobody for anything."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Browser, browser, missing, pdf_pages
from sampled import sampled
from short_grasp import short_result

from hhsim.report import pictures as report_pictures
from hhsim.report.report import make_report

pytestmark = pytest.mark.skipif(missing() is not None, reason=missing() or "")

PHONE, SCREEN = 360, 1280


@pytest.fixture(scope="module")
def window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report of two results side by side."""
    folder = tmp_path_factory.mktemp("report")
    paths = [folder / "a-result-with-a-rather-long-name-that-goes-on.h5", folder / "other.h5"]
    short_result(paths[0])
    shutil.copy(paths[0], paths[1])
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(report_pictures, "RENDER_DPI", 40)
        report = make_report(paths)
    written = folder / "report.html"
    written.write_text(report.html, encoding="utf-8")
    return written


@pytest.mark.parametrize("width", sampled([320, PHONE, 768, SCREEN], lambda _, width: width in (320, SCREEN)))
def test_nothing_goes_beyond_the_edge(window: Browser, page: Path, width: int) -> None:
    window.open(page, width)
    assert window.overflowing() == []


def test_what_goes_beyond_the_edge_is_found(window: Browser, tmp_path: Path) -> None:
    wide = tmp_path / "wide.html"
    wide.write_text('<meta name="viewport" content="width=device-width"><body><p style="width:900px">x</p>')
    window.open(wide, PHONE)
    assert any(found.startswith("P ") for found in window.overflowing())


def test_the_page_asks_nobody_and_nothing_complains(window: Browser, page: Path, tmp_path: Path) -> None:
    asking = tmp_path / "asking.html"
    asking.write_text('<img src="http://127.0.0.1:9/picture.png">')
    window.open(asking, SCREEN)
    assert window.requests() == ["http://127.0.0.1:9/picture.png"]
    assert window.complaints()
    window.open(page, SCREEN)
    window.run("document.querySelectorAll('img').forEach((image) => image.scrollIntoView())")
    assert window.requests() == []
    assert window.complaints() == []
    assert window.run("return document.scripts.length") == 0


@pytest.mark.parametrize("width", [PHONE, SCREEN])
def test_every_picture_is_shown(window: Browser, page: Path, width: int) -> None:
    window.open(page, width)
    pictures = window.run("return [...document.images].map((i) => [i.naturalWidth, i.alt, i.clientWidth])")
    assert all(natural > 0 and alt and shown <= width for natural, alt, shown in pictures)


def test_it_prints_on_a_few_pages(window: Browser, page: Path, tmp_path: Path) -> None:
    three = tmp_path / "three.html"
    three.write_text('<p>1</p><p style="break-before:page">2</p><p style="break-before:page">3</p>')
    window.open(three, SCREEN)
    assert pdf_pages(window.pdf()) == 3
    window.open(page, SCREEN)
    assert 2 <= pdf_pages(window.pdf()) <= 6
