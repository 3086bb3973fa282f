"""The figures of a report: what they say is what the file says, whatever the file is; the same file, the same bytes."""

import io
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace as changed
from pathlib import Path

import file_faults
import matplotlib as mpl
import numpy as np
import pytest
from conftest import sampled
from drawings_alone import leave_charts_undrawn
from live_rings import BEGAN, PERIOD, make_setup, session_file, solved_ticks
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image
from report_reader import read_page
from short_grasp import short_grasp, short_result

from hhsim.errors import InputError
from hhsim.hand.fingers import FINGERS
from hhsim.live.session.recorder import LOOP_DIED
from hhsim.metrics.metrics import tick_statistics
from hhsim.metrics.session_faults import recorded_faults
from hhsim.render.triangle_soup import SKIN, round_cone_surface
from hhsim.render.viewpoint import viewpoint
from hhsim.report import report as report_pictures
from hhsim.report.figure import ReportFigure, time_text
from hhsim.report.report import hand_picture, make_report
from hhsim.report.sections import worst_ticks
from hhsim.report.time_series import Run, histogram_figure, series_figure
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import FAULT, WARNING
from hhsim.view.scene_log import overview_tick

pytestmark = pytest.mark.slow

HELD = 180
"""A tick of the hold."""
Chart = Callable[[Mapping[str, Result]], ReportFigure]
CHARTS: tuple[Chart, ...] = (series_figure, histogram_figure)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("report") / "short.h5", short_grasp(release=0.05))


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of the hand with few pixels."""
    monkeypatch.setattr(report_pictures, "RENDER_DPI", 50)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Figures of charts whose pixels are left out."""
    return leave_charts_undrawn(monkeypatch)


@pytest.fixture(scope="module")
def alone(result: Result) -> dict[Chart, ReportFigure]:
    """The charts of the result by what draws them."""
    return {draw: draw({"A": result}) for draw in CHARTS}


def edited(result: Result, path: Path, edits: Mapping[str, Callable[[NDArray[np.generic]], object]]) -> Result:
    """A copy of a result in which some datasets of /tick are others."""
    shutil.copy(result.path, path)
    with file_faults.changed(path) as file:
        for name, edit in edits.items():
            values = file["hands/right/tick"][name][...]
            edit(values)
            file["hands/right/tick"][name][...] = values
    return load_result(path)


def first_ticks(result: Result, ticks: int) -> Result:
    return changed(result, ticks=ticks, phases=tuple(p for p in result.phases if p.first_tick < ticks), _loaded={})


def pixels(png: bytes) -> NDArray[np.uint8]:
    return np.asarray(Image.open(io.BytesIO(png)))


def test_forces_are_those_of_the_file(result: Result) -> None:
    force = Run("A", result).force
    np.testing.assert_allclose(force[:, 0], np.linalg.norm(result["force/total"], axis=1), rtol=1e-12)
    fingers = np.linalg.norm(result["force/phalanx"].sum(axis=2), axis=2)
    np.testing.assert_allclose(force[:, 1:6], fingers, rtol=1e-12)


@pytest.mark.parametrize("draw", sampled(CHARTS, lambda place, _: place == 0))
def test_a_chart_is_the_same_bytes_whatever_the_users_style(
    result: Result, alone: dict[Chart, ReportFigure], draw: Chart
) -> None:
    first = alone[draw]
    with mpl.rc_context({"font.size": 30.0, "axes.facecolor": "yellow", "figure.dpi": 50.0}):
        assert draw({"A": result}) == first
    picture = Image.open(io.BytesIO(first.png))
    assert picture.size == (first.width_px, first.height_px) and picture.size[0] == 1400
    assert set(picture.info) == {"dpi"}, "a date or a version makes other bytes of the same picture"
    # Nothing is cut off at the sides: they are white but for the ends of the axes' lines.
    assert (np.asarray(picture)[:, 0] == 255).all()


@pytest.mark.parametrize("draw", CHARTS)
@pytest.mark.quick("histogram_figure")
def test_a_chart_of_little_nothing_or_undefined_values_is_drawn(
    result: Result, draw: Chart, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Charts whose pixels nobody looks at.
    monkeypatch.setattr("hhsim.report.figure.DPI", 40)

    def undefine(values: NDArray[np.generic]) -> None:
        values[50:] = np.nan

    names = ("penetration_depth", "force_variation_rate", "force/total")
    broken = edited(result, tmp_path / "broken.h5", dict.fromkeys(names, undefine))
    none, one, undefined = (draw({"A": shown}) for shown in (first_ticks(result, 0), first_ticks(result, 1), broken))
    assert "o tick" in none.alt
    assert "nan" not in none.alt + none.caption + one.alt + one.caption + undefined.alt


def test_the_histogram_tells_the_figures_of_the_table(result: Result, alone: dict[Chart, ReportFigure]) -> None:
    contact = result["contacts/candidates"] > 0
    times = tick_statistics(result["duration/total_cpu"][contact])
    alt = alone[histogram_figure].alt
    assert f" {int(contact.sum()):,} ticks in contact: median" in alt
    for value in (times.p50, times.p99, times.max):
        assert time_text(1e-6 * value) in alt


def test_results_side_by_side_are_told_apart(result: Result, alone: dict[Chart, ReportFigure]) -> None:
    empty = first_ticks(result, 0)
    for draw in CHARTS:
        both = draw({"A": result, "B": empty})
        assert both.png != alone[draw].png
        assert "no tick" in both.alt.lower()


def test_the_worst_ticks_are_the_planted_ones(result: Result, tmp_path: Path) -> None:
    def slow(values: NDArray[np.generic]) -> None:
        values[37] = 5_000_000

    def deep(values: NDArray[np.generic]) -> None:
        values[90] = 2e-4

    def jump(values: NDArray[np.generic]) -> None:
        values[120] = values[120] + np.array([30.0, 0.0, 0.0])
        # A change in the hold is no step of a moving hand.
        values[HELD] = values[HELD] + np.array([90.0, 0.0, 0.0])

    def late(values: NDArray[np.generic]) -> None:
        values[:] = 0.0
        values[11] = 3e-3

    planted = {"duration/total_cpu": slow, "penetration_depth": deep, "force/total": jump, "lag": late}
    worst = worst_ticks(edited(result, tmp_path / "planted.h5", planted))
    slowest, deepest, step, lag = worst
    assert (slowest["tick"], slowest["value"], slowest["unit"]) == (37, 5000.0, "µs")
    assert (deepest["tick"], deepest["value"]) == (90, pytest.approx(200.0))
    # Away again in the tick after the jump: as large a step.
    assert step["tick"] in (120, 121) and step["value"] == pytest.approx(30.0, rel=0.1)
    assert (lag["tick"], lag["value"], lag["unit"]) == (11, pytest.approx(3.0), "mm")
    assert all(one["phase"] == result.phase_at(one["tick"]) for one in worst)


def test_what_did_not_happen_is_no_worst_tick(result: Result) -> None:
    assert worst_ticks(first_ticks(result, 0)) == []
    assert [one["what"] for one in worst_ticks(first_ticks(result, 1))] == ["slowest tick, CPU time"]


def test_the_view_shows_the_marks() -> None:
    origin, beside = np.zeros(3), np.array([0.08, 0.0, 0.0])
    ball = round_cone_surface(origin, origin, 0.05, 0.05, SKIN)
    hand = round_cone_surface(beside, beside, 0.03, 0.03, SKIN)
    marks, nothing = np.array([[0.05, 0.0, 0.0]]), np.empty((0, 3))
    view = viewpoint(hand, ball, marks, nothing)
    # Marks and hand are on the far side for a viewer at 180 degrees.
    assert abs((view.azimuth + 180.0) % 360.0 - 180.0) <= 90.0


@pytest.mark.usefixtures("coarse")
def test_the_picture_of_a_tick_has_hands_forces_and_words(result: Result) -> None:
    figure = hand_picture(result, HELD)
    assert (figure.name, pixels(figure.png).shape[:2]) == (f"tick-{HELD}", (figure.height_px, figure.width_px))
    picture = pixels(figure.png).astype(np.float64) / 255.0
    red = (picture[:, :, 0] > 0.6) & (picture[:, :, 1] < 0.25) & (picture[:, :, 2] < 0.25)
    blue = picture[:, :, 2] - picture[:, :, 0] > 0.2
    skin = (picture[:, :, 0] > 0.7) & (picture[:, :, 0] - picture[:, :, 2] > 0.15) & (picture[:, :, 1] > 0.4)
    for mark in (red, blue, skin):
        assert mark.sum() > 100
    assert f"tick {HELD}" in figure.alt
    assert f"resultant {np.linalg.norm(result['force/total'][HELD]):.2f} N" in figure.alt
    assert hand_picture(result, HELD).png == figure.png
    assert hand_picture(result, HELD, (200.0, 10.0)).png != figure.png


@pytest.mark.usefixtures("coarse")
@pytest.mark.soak
def test_a_notebook_shows_the_picture_of_a_tick(result: Result) -> None:
    import hhsim

    shown = hhsim.draw(result, HELD)
    assert shown._repr_png_() == hand_picture(result, HELD).png
    assert repr(shown).startswith(f"ReportFigure(name='tick-{HELD}'") and len(repr(shown)) < 1000
    assert hhsim.draw(result).png == hand_picture(result, overview_tick(result)).png
    with pytest.raises(InputError, match="has no tick 999"):
        hhsim.draw(result, 999)


def test_the_overview_is_of_the_hold_or_of_the_largest_force(result: Result) -> None:
    assert overview_tick(result) == 199
    free = changed(result, phases=())
    assert overview_tick(free) == int(np.argmax(np.linalg.norm(result["force/total"], axis=1)))
    assert overview_tick(changed(first_ticks(result, 5), phases=())) == 4


def test_a_legend_of_long_names_keeps_off_the_title_and_within_the_figure(
    result: Result, undrawn: list[Figure]
) -> None:
    labels = [f"{letter}: nasty_bunny_94_components hand_of_the_second_session coupled, 72 Hz" for letter in "ABCD"]
    series_figure(dict.fromkeys(labels, result))
    (figure,) = undrawn
    figure.draw_without_rendering()
    placed = [legend for axes in figure.axes if (legend := axes.get_legend())]
    titles = [text.get_window_extent() for axes in figure.axes for text in (axes.title, axes._left_title)]
    for legend in placed:
        box = legend.get_window_extent()
        assert box.y0 >= legend.axes.get_window_extent().y1
        assert box.x0 >= -1.0 and box.x1 <= figure.bbox.width + 1.0 and box.y1 <= figure.bbox.height + 1.0
        assert not any(box.overlaps(title) for title in titles if title.width > 0.0)
    assert {text.get_text()[:2] for text in placed[0].get_texts()} == {"A:", "B:", "C:", "D:"}


STIFF = slice(200, 500)
"""Ticks in which the fingers are told to resist."""
TOLD = np.linspace(0.1, 0.5, 5)
FAULT_TICK, LAST = 300, 699


def recorded(path: Path, reason: str) -> Result:
    """A session with a warning and a fault that ended for a reason."""
    ticks = solved_ticks(make_setup(path))
    ticks["command_stiffness"][STIFF] = TOLD
    told = (100, WARNING, "late"), (FAULT_TICK, FAULT, "the glove is gone")
    return session_file(path, ticks, reason, [(BEGAN + PERIOD * tick, *word) for tick, *word in told])


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return recorded(tmp_path_factory.mktemp("killed") / "killed.h5", LOOP_DIED)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return recorded(tmp_path_factory.mktemp("whole") / "whole.h5", "duration")


def marks(place: Axes) -> list[float]:
    """Where vertical lines stand in a panel."""
    lines = [each for each in place.collections if isinstance(each, LineCollection)]
    return [float(segment[0][0]) for line in lines for segment in line.get_segments()]


@pytest.mark.soak
def test_how_a_killed_session_ended_stands_in_red_before_everything_else(killed: Result, whole: Result) -> None:
    report = make_report((killed.path,))
    assert report.verdict_lines()[0] == "coupled: ended: the loop failed or was killed"
    page = read_page(report.html)
    first = next(each for each in page.all("p") if "verdict" in str(each.attributes.get("class")))
    assert (first.text, first.attributes["class"]) == ("ended: the loop failed or was killed", "verdict bad")
    assert page.elements.index(first) < page.elements.index(page.all("table")[0])
    said = [each.text for each in page.all("p") if each.text.startswith("faults: ")]
    assert said == [f"{recorded_faults(killed).line}."] and said[0].startswith("faults: 1 (ended early); malformed")

    report = make_report((whole.path,))
    assert "ended: duration" in read_page(report.html).all("p")[0].text
    assert not any("ended:" in line for line in report.verdict_lines())
    both = make_report((whole.path, killed.path))
    assert [line for line in both.verdict_lines() if "ended:" in line] == [both.verdict_lines()[0]]
    assert both.verdict_lines()[0].startswith("B: ")


def test_what_each_finger_was_told_is_drawn_with_marks_at_faults(
    killed: Result, whole: Result, undrawn: list[Figure]
) -> None:
    for result, expected in ((killed, [(FAULT_TICK, "fault"), (LAST, "ended")]), (whole, [(FAULT_TICK, "fault")])):
        figure = series_figure({"session": result})
        assert "6 panels" in figure.alt
        assert "stiffness up to 0.50, fault at 0.300 s" in figure.alt
        chart = undrawn[-1]
        told = chart.axes[-1]
        curves = {str(line.get_label()): np.asarray(line.get_ydata()) for line in told.lines}
        for finger, name in enumerate(FINGERS):
            np.testing.assert_allclose(curves[name], result["live/tick/command_stiffness"][:, finger], rtol=1e-6)
        assert curves[FINGERS[4]].max() == pytest.approx(0.5)
        for place in chart.axes:
            np.testing.assert_allclose(marks(place), [1e-3 * tick for tick, _ in expected], atol=1e-9)
        words = [text.get_text() for text in chart.axes[0].texts]
        assert [word for word in words if word in ("fault", "ended")] == [word for _, word in reversed(expected)]


def test_beside_a_replay_a_session_has_one_curve_of_the_stiffest_finger(
    killed: Result, tmp_path: Path, undrawn: list[Figure]
) -> None:
    replayed = short_result(tmp_path / "short.h5")
    alone = series_figure({"A": replayed})
    assert "5 panels" in alone.alt and "stiffness" not in alone.alt
    series_figure({"A": replayed, "B": killed})
    # The others are where phases of the replay begin.
    (curve,) = (line for line in undrawn[-1].axes[-1].lines if len(line.get_ydata()) == killed.ticks)
    np.testing.assert_allclose(curve.get_ydata(), killed["live/tick/command_stiffness"].max(axis=1), rtol=1e-6)
