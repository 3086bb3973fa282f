"""The page of a board in a real browser: it sorts, filters, fits a phone and asks nobody."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from browser import Browser, browser, missing

from hhsim.board.entry import Entry, merged
from hhsim.board.standings import standings
from hhsim.board.table_file import board_page

pytestmark = pytest.mark.skipif(missing() is not None, reason=missing() or "")
NASTY = "<script>document.title = 'taken'</script>"


@pytest.fixture(scope="module")
def window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    one = Entry("cube", "grasp", "coupled", "spheres", "", "{}", own_core=True, figures={"tick_cpu_p50": 9e-6})
    others = [
        replace(one, method="slow", figures={"tick_cpu_p50": 1200e-6}),
        replace(one, method=NASTY, own_core=False, figures={"tick_cpu_p50": 20e-6}),
        replace(one, method="timeless", figures={}),
    ]
    board = merged([one, *others])
    path = tmp_path_factory.mktemp("board") / "board.html"
    path.write_text(board_page(board, standings(board)), encoding="utf-8")
    return path


METHODS = "return [...document.querySelector('#each-run').tBodies[0].rows].filter(r => !r.hidden)"


def methods(window: Browser) -> list[str]:
    found: list[str] = window.run(f"{METHODS}.map(r => r.cells[2].textContent)")
    return found


def test_it_sorts_by_number_both_ways_with_what_is_unknown_last(window: Browser, page: Path) -> None:
    window.open(page, 1280)
    column = "[...document.querySelectorAll('#each-run th button')].find(b => b.textContent.startsWith('p50'))"
    window.run(f"{column}.click()")
    assert methods(window) == ["coupled", NASTY, "slow", "timeless"]
    window.run(f"{column}.click()")
    assert methods(window) == ["slow", NASTY, "coupled", "timeless"]
    assert window.run(f"return {column}.parentElement.getAttribute('aria-sort')") == "descending"


def test_it_filters_by_words(window: Browser, page: Path) -> None:
    window.open(page, 1280)
    window.run(
        "const field = document.querySelector('input[data-table=each-run]'); field.value = 'CUBE slow';"
        "field.dispatchEvent(new Event('input'))"
    )
    assert methods(window) == ["slow"]
    assert window.run("return document.getElementById('each-run-count').textContent") == "1 of 4 rows"


@pytest.mark.parametrize("width", [320, 1280])
def test_it_fits_asks_nobody_and_runs_no_script_but_its_own(window: Browser, page: Path, width: int) -> None:
    window.open(page, width)
    assert window.overflowing() == []
    assert window.run("return document.title") == "Board of 4 runs"
    assert window.complaints() == [] and window.requests() == []
