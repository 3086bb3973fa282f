"""The picture of an import."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from recording_samples import smooth_recording

from hhsim.errors import OutputError
from hhsim.recordings.cleaning import clean_recording
from hhsim.render.import_figure import draw_import

CLEAN = smooth_recording(120)


def test_a_hand_that_rests_and_holes_can_be_drawn(tmp_path: Path) -> None:
    still = replace(CLEAN.chosen(np.zeros(120, dtype=np.int64)), time=CLEAN.time, position=np.zeros((120, 3)))
    orientation = still.orientation.copy()
    orientation[:3] = np.nan
    orientation[3] = 0.0
    draw_import(clean_recording(replace(still, orientation=orientation)), tmp_path / "holes.png")
    assert imread(tmp_path / "holes.png").shape == (1500, 1300, 3)


def test_a_picture_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError):
        draw_import(clean_recording(CLEAN), tmp_path / "file" / "a.png")
