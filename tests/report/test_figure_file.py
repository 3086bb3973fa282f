"""Figures as files: as wide as they are asked for, the same bytes again, letters that stay letters."""

import importlib
import itertools
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from drawings_alone import drawn, leave_charts_undrawn
from matplotlib.text import Text
from PIL import Image
from sampled import sampled
from short_grasp import short_result

from hhsim.errors import InputError, OutputError
from hhsim.report import trade_off
from hhsim.report.figure import DPI, PAGE_INCHES, ReportFigure
from hhsim.report.figure_file import FIGURES, check_figure_path, make_figure, parse_width, write_figure
from hhsim.table.file import write_table
from hhsim.table.table import Column


@pytest.fixture(scope="module", autouse=True)
def files_alone() -> Iterator[None]:
    """What is tested is the files."""
    with pytest.MonkeyPatch.context() as patch:
        leave_charts_undrawn(patch)
        yield


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("result")
    short_result(folder / "short.h5")
    return folder / "short.h5"


@pytest.fixture(scope="module")
def series(path: Path) -> ReportFigure:
    return make_figure([path, path], "series")


@pytest.mark.parametrize(("text", "inches"), [("88mm", 88 / 25.4), ("8.8cm", 8.8 / 2.54), (" 3.5 in ", 3.5)])
def test_a_width_has_a_unit(text: str, inches: float) -> None:
    assert parse_width(text) == pytest.approx(inches)


@pytest.mark.parametrize("text", ["88", "mm", "-88mm", "88pt", "49mm", "601mm", "nan mm", "1e3mm", "8.8.8cm"])
def test_what_is_no_width_is_told(text: str) -> None:
    with pytest.raises(InputError, match="expected"):
        parse_width(text)


@pytest.mark.parametrize("millimetres", sampled([88.0, 180.0], lambda _, width: width == 88.0))
def test_a_file_is_as_wide_as_it_is_asked_for(series: ReportFigure, tmp_path: Path, millimetres: float) -> None:
    inches = millimetres / 25.4
    for suffix in (".pdf", ".svg", ".png"):
        write_figure(series, tmp_path / f"figure{suffix}", inches)
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", (tmp_path / "figure.pdf").read_bytes())
    assert box is not None
    assert float(box[1]) == pytest.approx(72.0 * inches, abs=0.01)
    root = ElementTree.parse(tmp_path / "figure.svg").getroot()
    assert float(root.attrib["width"].removesuffix("pt")) == pytest.approx(72.0 * inches, abs=0.01)
    assert float(root.attrib["height"].removesuffix("pt")) == pytest.approx(float(box[2]), abs=0.01)
    with Image.open(tmp_path / "figure.png") as picture:
        assert picture.width == pytest.approx(DPI * inches, abs=1.0)


def test_letters_of_a_pdf_are_letters_and_no_date_is_in_it(series: ReportFigure, tmp_path: Path) -> None:
    write_figure(series, tmp_path / "one.pdf", 3.46)
    data = (tmp_path / "one.pdf").read_bytes()
    assert b"/CIDFontType2" in data or b"/TrueType" in data
    assert b"/Type3" not in data
    assert b"CreationDate" not in data


@pytest.mark.parametrize("name", sampled(["ticks", "speed-error", "hand"], lambda _, name: name != "speed-error"))
def test_every_figure_is_drawn_within_its_page(
    path: Path, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The hand itself, in the middle, may be coarse.
    monkeypatch.setattr("hhsim.report.pictures.RENDER_DPI", 50)
    figure = make_figure([path], name)
    for inches in (3.46, PAGE_INCHES):
        write_figure(figure, tmp_path / "figure.png", inches)
        with Image.open(tmp_path / "figure.png") as file:
            picture = file.convert("L")
        # Ink at the upper or the lower edge is a word that was cut.
        for row in (0, picture.height - 1):
            assert np.asarray(picture)[row].min() > 200, (name, inches, row)


def test_what_cannot_be_drawn_is_told(path: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="shows one result"):
        make_figure([path, path], "hand")
    with pytest.raises(InputError, match=r"\.pdf, \.svg or \.png"):
        check_figure_path(tmp_path / "figure.jpeg")
    with pytest.raises(OutputError, match="no folder"):
        check_figure_path(tmp_path / "nowhere" / "figure.pdf")


@pytest.mark.parametrize("inches", [3.46, PAGE_INCHES])
@pytest.mark.parametrize("count", [2, 20])
@pytest.mark.quick("2-3.46")
def test_labels_of_many_results_keep_apart_and_within_the_figure(
    path: Path, monkeypatch: pytest.MonkeyPatch, count: int, inches: float
) -> None:
    """Ticks of 1 µs to 50 ms, the most decades in a panel, and depths of five digits, the longest numbers."""
    times = np.geomspace(1e-6, 5e-2, count)

    def measured(label: str, result: object) -> trade_off.SpeedError:
        time = times[ord(label[0]) - ord("A")]
        return trade_off.SpeedError(label, time, time, 0.27 * time, time, 1e3 * time, of_paper=True)

    monkeypatch.setattr(trade_off, "_measured", measured)
    with drawn(make_figure([path] * count, "speed-error"), inches, narrow=inches < 6.4) as figure:
        texts = [text for text in figure.findobj(Text) if isinstance(text, Text) and text.get_visible()]
        boxes = [(text.get_text(), text.get_window_extent()) for text in texts if text.get_text()]
        assert sum(name == "1 ms" for name, _ in boxes) == 3
        for name, box in boxes:
            assert box.x0 >= 0.0 and box.x1 <= figure.bbox.width, name
        for (one, box), (other, beside) in itertools.combinations(boxes, 2):
            assert not box.overlaps(beside), (one, other)


@pytest.mark.parametrize("suite", ["speed-error", "peers"])
def test_a_table_of_a_bench_has_speed_against_error(path: Path, tmp_path: Path, suite: str) -> None:
    row = {"object": "cube", "motion": "all", "ours": True, "method": "coupled", "surface": "mesh"}
    rows = [{**row, "tick_cpu_p50": 1e-5 * k, "mesh_error": 1e-4 / k} for k in (1, 2, 3)]
    table = tmp_path / "table.json"
    write_table(table, suite, [Column(name, name) for name in rows[0]], rows, {})
    figure = make_figure([table], "speed-error")
    assert figure.alt == "Time of a tick against distance from the true mesh: 3 points."
    for suffix in (".pdf", ".svg", ".png"):
        write_figure(figure, tmp_path / f"figure{suffix}", 3.46)
        assert (tmp_path / f"figure{suffix}").stat().st_size > 1000
    with pytest.raises(InputError, match=f"table of hhsim bench {suite}, which has no figure series"):
        make_figure([table], "series")
    with pytest.raises(InputError, match="name it alone"):
        make_figure([path, table], "speed-error")
    write_table(table, suite, [Column("object", "object")], [{"object": "cube"}], {})
    with pytest.raises(InputError, match="no row of the table"):
        make_figure([table], "speed-error")
    write_table(table, "trees", [Column("object", "object")], [{"object": "cube"}], {})
    with pytest.raises(InputError, match="table of hhsim bench trees, which has no figure speed-error"):
        make_figure([table], "speed-error")


def test_the_command_line_names_the_same_figures() -> None:
    assert tuple(FIGURES) == importlib.import_module("hhsim.cli.report").FIGURES
