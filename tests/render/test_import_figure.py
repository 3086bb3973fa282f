"""The picture of an import."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recording_samples import smooth_recording

from hhsim.errors import OutputError
from hhsim.recordings.recording import Recording
from hhsim.recordings.repair import repair
from hhsim.render import import_figure
from hhsim.render.figure import new_figure
from hhsim.render.import_figure import COLOURS, draw_import

CLEAN = smooth_recording(120)
GREY = "#a6a6a6"


def picture(recording: Recording, path: Path) -> "np.ndarray[tuple[int, int, int], np.dtype[np.float64]]":
    from matplotlib.image import imread

    draw_import(repair(recording), path)
    return np.asarray(imread(path), dtype=np.float64)


def shows(image: "np.ndarray[tuple[int, int, int], np.dtype[np.float64]]", colour: str) -> int:
    """How many pixels have a colour."""
    wanted = [int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
    return int((np.abs(image[:, :, :3] - wanted).max(axis=2) < 0.02).sum())


def test_what_came_in_lies_under_what_went_out_in_our_units(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # A smaller sheet: the same panels with fewer pixels.
    monkeypatch.setattr(import_figure, "new_figure", lambda width, height, **options: new_figure(6, 10, **options))
    clean = picture(CLEAN, tmp_path / "clean.png")
    assert all(shows(clean, colour) > 500 for colour in COLOURS[:3])
    angles = {name: np.degrees(getattr(CLEAN, name)) for name in ("flexion", "abduction")}
    scaled = replace(CLEAN, position=1e3 * CLEAN.position, time=1e3 * CLEAN.time, **angles)
    other = picture(scaled, tmp_path / "other.png")
    assert abs(shows(other, GREY) - shows(clean, GREY)) < 0.05 * shows(clean, GREY) + 50
    position = CLEAN.position.copy()
    position[50:54, 0] += 0.8
    spiked = picture(replace(CLEAN, position=position), tmp_path / "spiked.png")
    # Where the outlier was replaced, what came in stands alone.
    assert shows(spiked, GREY) > shows(clean, GREY) + 100


def test_a_hand_that_rests_and_holes_can_be_drawn(tmp_path: Path) -> None:
    still = replace(CLEAN.chosen(np.zeros(120, dtype=np.int64)), time=CLEAN.time, position=np.zeros((120, 3)))
    orientation = still.orientation.copy()
    orientation[:3] = np.nan
    orientation[3] = 0.0
    assert picture(replace(still, orientation=orientation), tmp_path / "holes.png").shape == (1500, 1300, 3)


def test_a_picture_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError):
        draw_import(repair(CLEAN), tmp_path / "file" / "a.png")
