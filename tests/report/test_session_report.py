"""What a report says of a live session alone: what the fingers were told, its faults, and how it ended."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from drawings_alone import leave_charts_undrawn
from live_rings import BEGAN, PERIOD, make_setup, session_file, solved_ticks
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from report_reader import read_page
from short_grasp import short_result

from hhsim.hand.fingers import FINGERS
from hhsim.live.session.recorder import LOOP_DIED
from hhsim.metrics.session_faults import recorded_faults
from hhsim.report.figure import ReportFigure
from hhsim.report.report import make_report
from hhsim.report.time_series import series_figure
from hhsim.result.reader import Result
from hhsim.result.schema import FAULT, WARNING

pytestmark = pytest.mark.slow

STIFF = slice(200, 500)
"""Ticks in which the fingers are told to resist."""
TOLD = np.linspace(0.1, 0.5, 5)
FAULT_TICK, LAST = 300, 699
PICTURE = ReportFigure("hand", "the hand", "A hand.", "A hand.", b"", 1, 1)


@pytest.fixture(scope="module", autouse=True)
def undrawn() -> Iterator[list[Figure]]:
    """Figures of charts whose pixels are left out."""
    with pytest.MonkeyPatch.context() as patch:
        figures = leave_charts_undrawn(patch)
        patch.setattr("hhsim.report.report.overview_picture", lambda *_: PICTURE)
        patch.setattr("hhsim.report.report.overview_view", lambda _: None)
        yield figures


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
    (curve,) = (line for line in undrawn[-1].axes[-1].lines if len(np.asarray(line.get_ydata())) == killed.ticks)
    np.testing.assert_allclose(
        np.asarray(curve.get_ydata()), killed["live/tick/command_stiffness"].max(axis=1), rtol=1e-6
    )
